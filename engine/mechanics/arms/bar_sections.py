"""Stresses in rectangular sections of curved bars, with derivatives.

Bending by the theory of Winkler and Bach, torsion by St. Venant's.

In a section, y points to the left of the outward tangent and z along the sheet's normal. The curvature is positive to
the left.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from ...arrays import Float

# Limit of the product of a section's curvature and width; larger products saturate at it, because the material beside a
# short kink supports the kink. A larger limit raises the strains in kinks; it must be below 2, where they are infinite
SATURATION = 1.8
# curvature times width below which a power series replaces the logarithm, whose leading digits would cancel
_SERIES_BELOW = 0.1
# number of terms of the power series that replaces the logarithm; more are slower and more exact (error 1e-15)
_SERIES_TERMS = 6
_TERMS = 60  # number of terms of the series for the torsion of a rectangle; more are more exact (error 1e-9)
# The torsion functions are interpolated by a spline in the logarithm of width over height. These are the width over
# height at its first and at its last node, and the number of nodes; more are more exact
_THINNEST, _WIDEST, _NODES = 0.01, 100.0, 600
# The warping of a corner becomes negative where a section is wider than high. Finite elements of solids show no warping
# there, so it is replaced by a smooth maximum of warping and 0. This is the range of warping per twist rate, over the
# squared height, in which the maximum is rounded; larger is smoother
_WARP_SOFT = 1e-2


@dataclass(frozen=True, eq=False)
class Curvature:
    """Functions of a section's curvature times its width (Winkler and Bach).

    bend : k, the product of curvature and width, saturated at ``SATURATION``
    log : ln((1 + k/2) / (1 - k/2)) / k, radius of the centre line over the radius of the neutral axis
    off : (1 - 1 / log) / k^2, distance of the neutral axis from the centre line, divided by k and by the width
    bend_by, log_by, off_by : their derivatives with respect to the product before saturation
    """

    bend: Float[np.ndarray, "*n"]
    bend_by: Float[np.ndarray, "*n"]
    log: Float[np.ndarray, "*n"]
    log_by: Float[np.ndarray, "*n"]
    off: Float[np.ndarray, "*n"]
    off_by: Float[np.ndarray, "*n"]

    @classmethod
    def evaluate(cls, product: Float[np.ndarray, "*n"]) -> Curvature:
        """Evaluate the functions at products of curvature (positive to the left) and width."""
        square = (product / SATURATION) ** 2
        fourth = 1.0 + square * square
        root = 1.0 / np.sqrt(np.sqrt(fourth))
        k, slope = product * root, root / fourth
        square = k * k
        # ``log`` is near 1 for small k; as 1 + k^2 rest, with an exact ``rest``, its difference from 1 is exact too
        rest, rest_by = _log_rest(k)
        log, log_by = 1.0 + square * rest, (2.0 * k * rest + square * rest_by) * slope
        off = rest / log
        return cls(k, slope, log, log_by, off, (rest_by * slope - off * log_by) / log)


def _log_rest(k: Float[np.ndarray, "*n"]) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
    """Return (ln((1 + k/2) / (1 - k/2)) / k - 1) / k^2, and its derivative with respect to k."""
    square = k * k
    small = square < _SERIES_BELOW**2
    near = np.where(small, 0.25 * square, 0.0)
    value, slope = np.zeros_like(k), np.zeros_like(k)
    for n in range(_SERIES_TERMS, 0, -1):
        slope = slope * near + value
        value = value * near + 0.25 / (2 * n + 1)
    if small.all():
        return value, 0.5 * k * slope
    far, safe = np.where(small, 1.0, k), np.where(small, 1.0, square)
    log = 2.0 * np.arctanh(0.5 * far) / far
    rest = (log - 1.0) / safe
    rest_by = ((1.0 / (1.0 - 0.25 * safe) - log) / safe - 2.0 * rest) / far
    return np.where(small, value, rest), np.where(small, 0.5 * k * slope, rest_by)


@dataclass(frozen=True, eq=False)
class Torsion:
    """St. Venant's torsion of sections of width w and height h (Timoshenko and Goodier, Theory of Elasticity, 109).

    values : (4, ...) SI units. Axis 0 counts four functions:
        0: 1 / J, the twist rate per torque times the shear modulus;
        1: shear stress per torque in the middles of the sides y = +-w/2;
        2: shear stress per torque in the middles of the faces z = +-h/2;
        3: warping of a corner per twist rate, faded out where w > h
    slopes : (4, ...) derivatives of ``values`` with respect to the width
    """

    values: Float[np.ndarray, "4 ..."]
    slopes: Float[np.ndarray, "4 ..."]

    @classmethod
    def evaluate(cls, width: Float[np.ndarray, "*n"], height: float) -> Torsion:
        """Evaluate the four functions and their derivatives, for sections of ``width`` and ``height`` in metres."""
        spline, at = _torsion_spline(), np.log(width / height)
        scale = height ** np.array([-4.0, -3.0, -3.0, 2.0])
        values, by_log = (np.moveaxis(spline(at, order) * scale, -1, 0) for order in (0, 1))
        return cls(values, by_log / width)


@lru_cache(maxsize=1)
def _torsion_spline() -> Any:
    """Return a spline of the four functions over the logarithm of the width, for sections of height 1."""
    from scipy.interpolate import CubicSpline

    log = np.linspace(np.log(_THINNEST), np.log(_WIDEST), _NODES)
    w = np.exp(log)
    n = 2.0 * np.arange(_TERMS) + 1.0
    sign = np.where(np.arange(_TERMS) % 2, -1.0, 1.0)
    x = 0.5 * np.pi * n / w[:, None]
    th, sech = np.tanh(x), 1.0 / np.cosh(np.minimum(x, 300.0))
    constant = w**3 * (1.0 / 3.0 - 64.0 / np.pi**5 * w * (th / n**5).sum(1))
    side = w * (1.0 - 8.0 / np.pi**2 * (sech / n**2).sum(1)) / constant
    # half of the series' last term is subtracted, because an alternating series that is cut off there is nearer to its
    # limit
    face = w * 8.0 / np.pi**2 * ((sign * th / n**2).sum(1) - 0.5 * (sign * th / n**2)[:, -1]) / constant
    warp = 0.25 * w - 8.0 * w * w / np.pi**3 * (th / n**3).sum(1)
    warp = 0.5 * (warp + np.sqrt(warp * warp + _WARP_SOFT**2))
    return CubicSpline(log, np.stack([1.0 / constant, side, face, warp], axis=1))

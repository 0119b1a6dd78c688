"""A spiral's arm as a curved beam: the baseline that the stiffness table corrects.

Castigliano's theorem on the centre line c(u) = (s/2) u exp(i phi (1 - u)), u from 0 at the spiral's centre to 1 at the
tip, with bending, torsion, shear and stretch of the rectangular section. Dimensionless: lengths in arm widths, Young's
modulus 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev as cheb

from ...arrays import Float

LARGEST_TWIST = math.radians(620.0)  # end of the series, a little beyond the largest twist of a spiral
SHEAR_FACTOR = 1.2  # Timoshenko shear factor of a rectangular section (Timoshenko and Goodier)
_DEGREE = 44  # of the Chebyshev series: within 3e-10 of the integrals at 300 twists
_TERMS = 12  # of the series for the torsion constant: within 6e-7 at heights of 0.05 to 20
_CURVED = 6  # number of its terms that still change with the height: 1 - tanh(13 pi / 2) is 3e-18


@dataclass(frozen=True, eq=False)
class Blocks:
    """The two symmetric 3 x 3 blocks of a tip compliance, with derivatives.

    values : (2, 6, n): block 0 for (Fx, Fy, Mz), block 1 for (Fz, Mx, My); entries 00, 10, 11, 20, 21, 22
    slopes : (3, 2, 6, n): derivatives by ln(s/w), ln(w/h) and twist; a grain adds a fourth, by its direction
    """

    values: Float[np.ndarray, "2 6 spirals"]
    slopes: Float[np.ndarray, "_ 2 6 spirals"]


@lru_cache
def gauss(points: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights of the Gauss quadrature on [0, 1]."""
    x, w = np.polynomial.legendre.leggauss(points)
    return 0.5 * (x + 1.0), 0.5 * w


def path_integrals(twist: float, start: float = 0.0, points: int = 240) -> Float[np.ndarray, " 24"]:
    """(24,) integrals along the arm of radius 1 from u = start to the tip, by Gauss quadrature.

    (X, Y) is the vector from the point to the tip, t the tangent and n the normal. The integrands are the products of
    the in-plane bending moments (-Y, X, 1), six; of t, three; of n, three; of the torques (Y tx - X ty, tx, ty), six;
    of the out-of-plane bending moments (-Y ty - X tx, -ty, tx), six. Products in the order 00, 10, 11, 20, 21, 22.
    """
    x, w = gauss(points)
    u, w = start + (1.0 - start) * x, (1.0 - start) * w
    turn = np.exp(1j * twist * (1.0 - u))
    velocity = turn * (1.0 - 1j * twist * u)
    speed = np.abs(velocity)
    t = velocity / speed
    r = 1.0 - u * turn
    ds = w * speed
    tx, ty, rx, ry = t.real, t.imag, r.real, r.imag

    def products(*v: np.ndarray) -> list[float]:
        return [float(ds @ (v[i] * v[j])) for i in range(len(v)) for j in range(i + 1)]

    return np.array(
        products(-ry, rx, np.ones_like(u))
        + products(tx, ty)
        + products(-ty, tx)
        + products(ry * tx - rx * ty, tx, ty)
        + products(-ry * ty - rx * tx, -ty, tx)
    )


@lru_cache(maxsize=1)
def integral_series() -> tuple[np.ndarray, np.ndarray]:
    """Chebyshev coefficients (degree + 1, 24) over the twist of the path integrals, and of their derivatives."""
    nodes = np.cos(np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1))
    samples = np.array([path_integrals(0.5 * (x + 1.0) * LARGEST_TWIST) for x in nodes])
    series = cheb.chebfit(nodes, samples, _DEGREE)
    return series, cheb.chebder(series) * (2.0 / LARGEST_TWIST)


def torsion_constant(height: np.ndarray, terms: int = _TERMS) -> tuple[np.ndarray, np.ndarray]:
    """Saint-Venant torsion constant J of a 1 x height rectangle, and dJ/dheight, both of the shape of ``height``.

    J = height^3 (1/3 - (64 height / pi^5) sum over odd k of tanh(k pi / (2 height)) / k^5), Timoshenko and Goodier. For
    heights above 1 the sides are swapped, so that the series converges quickly. Two terms are within 3e-4.
    """
    height = np.asarray(height, dtype=float)
    flip = height > 1.0
    # for height > 1 the width is the shorter side: J(1, height) = height J'(ratio 1 / height), else height^4 J'(height)
    ratio = np.where(flip, 1.0 / height, height)
    # tanh(k x) from powers of one exponential; it is 1 in double precision from the seventh term on, as x >= pi / 2
    power = np.exp(-np.pi / ratio)
    step = power * power
    sums, slope = np.zeros_like(ratio), np.zeros_like(ratio)
    for k in 2.0 * np.arange(min(terms, _CURVED)) + 1.0:
        th = (1.0 - power) / (1.0 + power)
        sums += th / k**5
        slope += (1.0 - th * th) / k**4
        power *= step
    sums += ((2.0 * np.arange(_CURVED, terms) + 1.0) ** -5).sum()
    slope *= -0.5 * np.pi / ratio**2
    c = 64.0 / np.pi**5
    core, core_slope = 1.0 / 3.0 - c * ratio * sums, -c * (sums + ratio * slope)
    value = np.where(flip, height * core, height**3 * core)
    by_height = np.where(flip, core - core_slope * ratio, 3.0 * height**2 * core + height**3 * core_slope)
    return value, by_height


def beam_tip_compliance(
    scale: Float[np.ndarray, " arms"],
    height: Float[np.ndarray, " arms"],
    twist: Float[np.ndarray, " arms"],
    poisson: float,
) -> Blocks:
    """Compliance of the tips of arms that are fixed at the centre.

    scale : (n,) s / w; height : (n,) h / w; twist : (n,) radians
    """
    series, slopes = integral_series()
    x = 2.0 * np.asarray(twist) / LARGEST_TWIST - 1.0
    powers = cheb.chebvander(x, _DEGREE)
    p, dp = series.T @ powers.T, slopes.T @ powers[:, :_DEGREE].T  # (24, n)
    radius = 0.5 * np.asarray(scale)
    # power of the radius with which the integral of each entry of both blocks scales
    in_degree, out_degree = np.array([[3, 3, 3, 2, 2, 1], [3, 2, 1, 2, 1, 1]])[..., None]
    torsion, torsion_slope = torsion_constant(height)
    shear_modulus = 0.5 / (1.0 + poisson)
    # flexibilities of the section, and derivatives by ln h: bending in the plane 12 / h, out of it 12 / h^3
    bend_in, bend_out = 12.0 / height, 12.0 / height**3
    twist_out = 1.0 / (shear_modulus * torsion)
    d_twist_out = -twist_out * torsion_slope * height / torsion
    stretch, shear = 1.0 / height, SHEAR_FACTOR / (shear_modulus * height)

    def inside(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        bend = bend_in * radius**in_degree * q[:6]
        axial = radius * (stretch * q[6:9] + shear * q[9:12])
        by_radius = in_degree * bend
        by_radius[:3] += axial
        bend[:3] += axial
        return bend, by_radius

    def outside(q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        scaled = radius**out_degree
        both = scaled * (twist_out * q[12:18] + bend_out * q[18:24])
        slip = radius * shear * q[5]
        value, by_radius = both.copy(), out_degree * both
        by_height = scaled * (d_twist_out * q[12:18] - 3.0 * bend_out * q[18:24])
        value[0] += slip
        by_radius[0] += slip
        by_height[0] -= slip
        return value, by_radius, by_height

    in_value, in_radius = inside(p)
    out_value, out_radius, out_height = outside(p)
    values = np.stack([in_value, out_value])
    # ln(w/h) is -ln(height); at fixed s/w every flexibility in the plane is proportional to 1 / height
    by_scale = np.stack([in_radius, out_radius])
    by_ratio = np.stack([in_value, -out_height])
    by_twist = np.stack([inside(dp)[0], outside(dp)[0]])
    return Blocks(values, np.stack([by_scale, by_ratio, by_twist]))

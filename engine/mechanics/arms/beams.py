"""A spiral's arm as a curved beam; the stiffness table stores compliances relative to this beam's compliance.

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

# The Chebyshev series of ``path_integrals`` are fitted to twists from 0 to this, in radians: a little above the largest
# twist of a spiral
LARGEST_TWIST = math.radians(620.0)
SHEAR_FACTOR = 1.2  # Timoshenko shear factor of a rectangular section (Timoshenko and Goodier)
# degree of the Chebyshev series of ``path_integrals`` in the twist; larger is slower and more exact (error 3e-10)
_DEGREE = 44
_TERMS = 12  # number of terms of the series for the torsion constant; more are slower and more exact (error 6e-7)
# Only this many terms of the series for the torsion constant depend on the height: in all further ones, tanh is 1 in
# double precision (1 - tanh(13 pi / 2) is 3e-18)
_CURVED = 6


@dataclass(frozen=True, eq=False)
class Blocks:
    """The two symmetric 3 x 3 blocks of tip compliances of n arms, with derivatives.

    Let s be the spiral's scale, w the arm's width and h the sheet's thickness.

    values : (2, 6, n) block 0 for (Fx, Fy, Mz), block 1 for (Fz, Mx, My). Axis 1 counts the entries 00, 10, 11, 20, 21,
        22 of the block's lower triangle
    slopes : (3, 2, 6, n) derivatives of ``values`` with respect to ln(s/w), ln(w/h) and twist. For a sheet with a grain
        (4, 2, 6, n): the last derivative is with respect to the grain's direction in radians
    """

    values: Float[np.ndarray, "2 6 spirals"]
    slopes: Float[np.ndarray, "_ 2 6 spirals"]


@lru_cache
def gauss(points: int) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes and weights of the Gauss quadrature on [0, 1]."""
    x, w = np.polynomial.legendre.leggauss(points)
    return 0.5 * (x + 1.0), 0.5 * w


def path_integrals(twist: float, start: float = 0.0, points: int = 240) -> Float[np.ndarray, " 24"]:
    """Integrate 24 products of unit loads along an arm of radius 1 from u = start to the tip, by Gauss quadrature.

    Let (X, Y) be the vector from a point of the arm to the tip, t the tangent and n = (-ty, tx) the normal in the
    plane. The integrands are all products of two components, in the order 00, 10, 11, 20, 21, 22, of five vectors:
    in-plane bending moments (-Y, X, 1); t; n; torques (Y tx - X ty, tx, ty); out-of-plane bending moments (-Y ty - X
    tx, -ty, tx).

    Parameters
    ----------
    twist : radians
    start : u of the inner end
    points : number of Gauss points
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
    """Return Chebyshev coefficients (degree + 1, 24) of ``path_integrals`` over the twist, and of its derivative."""
    nodes = np.cos(np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1))
    samples = np.array([path_integrals(0.5 * (x + 1.0) * LARGEST_TWIST) for x in nodes])
    series = cheb.chebfit(nodes, samples, _DEGREE)
    return series, cheb.chebder(series) * (2.0 / LARGEST_TWIST)


def torsion_constant(height: np.ndarray, terms: int = _TERMS) -> tuple[np.ndarray, np.ndarray]:
    """Return Saint-Venant's torsion constants J of 1 x height rectangles, and dJ/dheight, in the shape of ``height``.

    J = height^3 (1/3 - (64 height / pi^5) sum over odd k of tanh(k pi / (2 height)) / k^5), Timoshenko and Goodier. For
    heights above 1 the sides are swapped, so that the series converges quickly. Two ``terms`` are exact to 3e-4.
    """
    height = np.asarray(height, dtype=float)
    flip = height > 1.0
    # J is height^3 core(height), where core is the bracket in the docstring's formula. For height > 1 the sides are
    # swapped, and J is height core(1 / height)
    ratio = np.where(flip, 1.0 / height, height)
    # With x = pi / (2 ratio), tanh(k x) is computed from powers of one exponential. From the seventh term on it is 1 in
    # double precision, because x is at least pi / 2
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
    """Return the dimensionless tip compliances of arms that are fixed at the spiral's centre.

    Parameters
    ----------
    scale, height : (n,) scale and sheet thickness over arm width
    twist : (n,) radians
    poisson : Poisson's ratio
    """
    series, slopes = integral_series()
    x = 2.0 * np.asarray(twist) / LARGEST_TWIST - 1.0
    powers = cheb.chebvander(x, _DEGREE)
    # the 24 integrals of ``path_integrals`` for n arms, and their derivatives by the twist
    p, dp = series.T @ powers.T, slopes.T @ powers[:, :_DEGREE].T
    radius = 0.5 * np.asarray(scale)
    # The integrals of bending (and, in block 1, torsion) are for an arm of radius 1. These are the exponents of the
    # true radius with which they are multiplied, for the six entries of both blocks
    in_degree, out_degree = np.array([[3, 3, 3, 2, 2, 1], [3, 2, 1, 2, 1, 1]])[..., None]
    torsion, torsion_slope = torsion_constant(height)
    shear_modulus = 0.5 / (1.0 + poisson)
    # curvature per moment of the section of width 1 and height h: in the plane 12 / h, out of the plane 12 / h^3
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
    # derivatives by ln(s/w), which is ln(2 radius), by ln(w/h), which is -ln(height), and by the twist. In-plane
    # flexibilities are proportional to 1 / height, so they are their own derivatives by -ln(height)
    by_scale = np.stack([in_radius, out_radius])
    by_ratio = np.stack([in_value, -out_height])
    by_twist = np.stack([inside(dp)[0], outside(dp)[0]])
    return Blocks(values, np.stack([by_scale, by_ratio, by_twist]))

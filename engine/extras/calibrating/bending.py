"""Sag of a strip and of a spiral under a weight, and Young's modulus from the sag.

Strip: an inextensible cantilever with a weight at its end and its own weight along it, by the exact curve of large
deflections (elastica; Bisshopp and Drucker 1945 without own weight, integrated with it here):

    E I theta'' = -(F + q (L - s)) cos theta,   theta(0) = 0,   theta'(L) = 0,   sag = integral of sin theta.

Near the clamp the strip cannot bend across its width, so it acts as if it were shorter by 0.37 nu^2 times its width, nu
being Poisson's ratio (``database/coupons.py``).

The measured value is the change of height when the weight is added, so that the sag under own weight and an initial
curvature cancel. The linear limit F L^3 / (3 E I) is 1.1 % too large at a sag of a tenth of the length.

Spiral: the tips of the four arms are held in their frame and the hub sinks without turning, because the spiral has
fourfold symmetry. Each arm carries a quarter of the weight. Its stiffness K = C^-1 is the inverse of the compliance
from ``mechanics/arms/stiffness.py``, the program's own table from finite elements; K maps the motion u of the tip
against the hub to the wrench K u. This is linear: spirals computed as elastic solids sag 0 to 3 % less, up to sags of
1.5 thicknesses.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ...errors import FlexMapsError
from ...mechanics.arms.cut import FILLET_REACH, TABLE_FILLET
from ...mechanics.arms.stiffness import table_tip_compliance
from .coupons import GRAVITY, Coupons, SpiralCoupon

MIN_YOUNGS, MAX_YOUNGS = 1e6, 1e12  # bounds of Young's modulus, Pa; beyond them a reading is refused
# Young's modulus, GPa, at which the sag is so small that it is proportional to 1 / modulus, for the first guess; and
# largest number of iterations (4 to 25 are needed)
FIRST_GUESS, ROUNDS = 100.0, 60
NORMAL = 2  # index of translation and force along the sheet's normal in motions and wrenches
CLAMP_SHORTENING = 0.37  # apparent shortening of the strip by the clamp, in widths times Poisson's ratio squared
MAX_SAG_RATIO = 0.6  # largest ratio of a strip's sag to its length; larger: the weight may slip off the steep end


def strip_sag(made: Coupons, youngs: float, load: float, *, width: float | None = None) -> float:
    """Return by how many metres the strip's end sinks when a weight is added.

    Parameters
    ----------
    made : sizes of the calibration pieces, Poisson's ratio and density
    youngs : Young's modulus, Pa
    load : weight, kg
    width : true width of the strip, metres; default is the drawn width
    """
    b, h = width or made.strip_width, made.thickness
    length = made.strip_length - CLAMP_SHORTENING * made.poisson**2 * b
    bending = youngs * b * h**3 / 12.0
    own = made.density * GRAVITY * b * h * length**3 / bending
    pull = load * GRAVITY * length**2 / bending
    return length * (_elastica(pull, own) - _elastica(0.0, own))


def _elastica(pull: float, own: float) -> float:
    """Return sag / length of a cantilever; ``pull`` is F L^2 / EI for the force at its end, ``own`` q L^3 / EI."""
    from scipy.integrate import solve_bvp

    def slope(s: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.stack([y[1], -(pull + own * (1.0 - s)) * np.cos(y[0]), np.sin(y[0])])

    def ends(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.array([a[0], b[1], a[2]])

    s = np.linspace(0.0, 1.0, 25)
    first = np.zeros((3, len(s)))
    # initial guess: the curve of small deflections, limited to almost vertical
    first[0] = np.minimum(pull * (s - 0.5 * s * s) + own * (s / 2.0 - s * s / 2.0 + s**3 / 6.0), 1.5)
    found = solve_bvp(slope, ends, s, first, tol=1e-7)
    if not found.success:
        raise FlexMapsError(
            "The strip is so soft that it hangs straight down; make it shorter or take a lighter weight"
        )
    return float(found.y[2, -1])


def strip_youngs(made: Coupons, sag: float, load: float, *, width: float | None = None) -> float:
    """Return Young's modulus, Pa, of a strip whose end sank under a weight.

    Parameters
    ----------
    made : sizes of the strip
    sag : measured sag, metres
    load : weight, kg
    width : true width of the strip, metres; default is the drawn width

    Raises
    ------
    FlexMapsError : the strip hangs too steeply, or the modulus is impossible
    """
    if sag > MAX_SAG_RATIO * made.strip_length:
        raise FlexMapsError(
            f"A strip of {made.strip_length * 1e3:.0f} mm that sinks by {sag * 1e3:.1f} mm hangs too steeply; take a lighter weight"
        )
    return _modulus_for_sag(lambda youngs: strip_sag(made, youngs, load, width=width), sag, "strip", load)


def strip_load(made: Coupons, sag: float) -> float:
    """Return the weight, kg, for a strip's sag of about ``sag`` metres (linear theory), as weights are sold.

    Parameters
    ----------
    made : sizes of the strip and Young's modulus
    sag : intended sag, metres
    """
    stiffness = 3.0 * made.youngs * made.strip_width * made.thickness**3 / 12.0 / made.strip_length**3
    return _round_to_weight(stiffness * sag / GRAVITY)


def spiral_stiffness(made: Coupons, scale: float, width: float, twist: float, youngs: float) -> float:
    """Return the stiffness, N/m, of a spiral's hub along the sheet's normal with the tips of its arms held.

    Parameters
    ----------
    made : thickness, Poisson's ratio and cutter
    scale, width : diameter, and width of the arms, metres
    twist : winding angle of the arms, radians
    youngs : Young's modulus, Pa
    """
    compliance = table_tip_compliance(
        np.array([scale]), np.array([width]), np.array([twist]),
        thickness=made.thickness, youngs=youngs, poisson=made.poisson,
    ).values[0]  # fmt: skip
    # a fillet at the hub that is larger than the stiffness table's shortens the arm, an Archimedean spiral
    along = 0.25 * scale * (math.hypot(1.0, twist) + math.asinh(twist) / twist)
    longer = 1.0 - FILLET_REACH * (fillet_radius(made, width) - TABLE_FILLET * width) / along
    return 4.0 * float(np.linalg.inv(compliance)[NORMAL, NORMAL]) / longer**3


def fillet_radius(made: Coupons, width: float) -> float:
    """Return the radius of the corners between the arms at the hub, metres.

    It is the stiffness table's fillet, or the smallest that the cutter can make if that is larger.

    Parameters
    ----------
    made : kerf and diameter of the mill
    width : width of the arms, metres
    """
    return max(TABLE_FILLET * width, 0.5 * made.kerf_holes, 0.51 * made.mill)


def spiral_youngs(made: Coupons, spiral: SpiralCoupon, sag: float, load: float, wider: float = 0.0) -> float:
    """Return Young's modulus, Pa, of a spiral whose hub sank under a weight.

    Parameters
    ----------
    made, spiral : sizes of the pieces and of the spiral
    sag : measured sag of the hub, metres
    load : weight, kg
    wider : true minus drawn width of the spiral's arms, metres
    """
    unit = spiral_stiffness(made, spiral.scale, spiral.width + wider, spiral.twist, 1.0)
    return _check_bounds(load * GRAVITY / (sag * unit), f"spiral {spiral.name}", load)


def spiral_load(made: Coupons, scale: float, width: float, twist: float, sag: float) -> float:
    """Return the weight, kg, for a spiral's sag of about ``sag`` metres, as weights are sold.

    Parameters
    ----------
    made, scale, width, twist : as in ``spiral_stiffness``
    sag : intended sag, metres
    """
    return _round_to_weight(spiral_stiffness(made, scale, width, twist, made.youngs) * sag / GRAVITY)


def _modulus_for_sag(sag_of: Callable[[float], float], sag: float, what: str, load: float) -> float:
    """Return Young's modulus, Pa, for which ``sag_of`` gives the measured sag, by fixed-point iteration.

    Sag is nearly proportional to 1 / modulus, so each iteration reduces the error by a factor: 0.05 at a sag of a tenth
    of the length, 0.5 at the steepest permitted sag.
    """
    youngs = 1e9
    youngs = _check_bounds(youngs * sag_of(youngs * FIRST_GUESS) * FIRST_GUESS / sag, what, load)
    for _ in range(ROUNDS):
        before, youngs = youngs, _check_bounds(youngs * sag_of(youngs) / sag, what, load)
        if abs(youngs - before) < 1e-7 * before:
            break
    return youngs


def _check_bounds(youngs: float, what: str, load: float) -> float:
    """Return Young's modulus unchanged; raise ``FlexMapsError`` if it is out of bounds; ``what`` names the piece."""
    if not MIN_YOUNGS < youngs < MAX_YOUNGS:
        raise FlexMapsError(
            f"The sag of the {what} under {load * 1e3:g} g would take a material of {youngs * 1e-9:.3g} GPa; "
            "check that sags are in millimetres and weights in grams"
        )
    return youngs


def _round_to_weight(mass: float) -> float:
    """Round a mass, kg, to 1, 2 or 5 times a power of ten, as weights are sold."""
    power = 10.0 ** math.floor(math.log10(mass))
    return min((1.0, 2.0, 5.0, 10.0), key=lambda m: abs(math.log(m * power / mass))) * power

"""How far a strip and a spiral sag under a weight, and Young's modulus from that.

Strip: a cantilever of inextensible material with a weight at its end and its own weight along it, by the exact curve of large
deflections (elastica; Bisshopp and Drucker 1945 without the strip's weight, here integrated with it):

    E I theta'' = -(F + q (L - s)) cos theta,   theta(0) = 0,   theta'(L) = 0,   sag = integral of sin theta.

The clamp also keeps the strip from bending across near it, as if it were shorter by 0.37 nu^2 times its width: measured on solids
of widths from 5 to 12 thicknesses and Poisson's ratios from 0.2 to 0.42, see ``database/coupons.py``.

What is measured is the change of height as the weight is hung on, so that neither the strip's own sag nor a bent sheet counts. Its
small limit F L^3 / (3 E I) is 1.1 % too large at a sag of a tenth of the length, and 4 % at a fifth.

Spiral: the tips of the four arms are held in their frame and the hub sinks without turning, for the spiral looks alike after a
quarter turn. Each arm then carries a quarter of the weight, and is bent as ``mechanics/arms/stiffness.py``, the program's own
table from finite elements, says: with its compliance C, a wrench K u with K = C^-1 for the tip's motion u against its hub.
Linear: a solid whose arms' ends are held in every point sags less by 0 to 2 %, at up to a thickness and a half by 1 to 3 %.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ..errors import FlexMapsError
from ..mechanics.arms.cut import FILLET_REACH, TABLE_FILLET
from ..mechanics.arms.stiffness import tip_compliance
from .coupons import GRAVITY, Coupons, SpiralCoupon

SOFTEST, STIFFEST = 1e6, 1e12  # Pa, bounds of a custom material's modulus
STIFF, ROUNDS = (
    100.0,
    60,
)  # the first guess is of a sag at 100 GPa, which is small; rounds of the search, 4 to 25 are needed
NORMAL = 2  # place of the shift and the force along the sheet's normal
CLAMPED = 0.37  # widths times Poisson's ratio squared by which a clamp that keeps the strip flat across shortens it
STEEPEST = 0.6  # largest sag of a strip over its length; its end hangs steeply there and slips


def strip_sag(made: Coupons, youngs: float, load: float, *, width: float | None = None) -> float:
    """Metres that the strip's end sinks as ``load`` kg is hung on it; ``youngs`` in Pa, the strip's true width in metres."""
    b, h = width or made.strip_width, made.thickness
    length = made.strip_length - CLAMPED * made.poisson**2 * b
    bending = youngs * b * h**3 / 12.0
    own = made.density * GRAVITY * b * h * length**3 / bending
    pull = load * GRAVITY * length**2 / bending
    return length * (_elastica(pull, own) - _elastica(0.0, own))


def _elastica(pull: float, own: float) -> float:
    """Sag over length of a cantilever under F L^2 / EI at its end and q L^3 / EI along it."""
    from scipy.integrate import solve_bvp

    def slope(s: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.stack([y[1], -(pull + own * (1.0 - s)) * np.cos(y[0]), np.sin(y[0])])

    def ends(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.array([a[0], b[1], a[2]])

    s = np.linspace(0.0, 1.0, 25)
    first = np.zeros((3, len(s)))
    # the curve of small deflections, no steeper than a thread that hangs
    first[0] = np.minimum(pull * (s - 0.5 * s * s) + own * (s / 2.0 - s * s / 2.0 + s**3 / 6.0), 1.5)
    found = solve_bvp(slope, ends, s, first, tol=1e-7)
    if not found.success:
        raise FlexMapsError(
            "The strip is so soft that it hangs straight down; make it shorter or take a lighter weight"
        )
    return float(found.y[2, -1])


def strip_youngs(made: Coupons, sag: float, load: float, *, width: float | None = None) -> float:
    """Pa, of the strip whose end sank by ``sag`` metres as ``load`` kg was hung on it. Raises ``FlexMapsError``."""
    if sag > STEEPEST * made.strip_length:
        raise FlexMapsError(
            f"A strip of {made.strip_length * 1e3:.0f} mm that sinks by {sag * 1e3:.1f} mm hangs too steeply; take a lighter weight"
        )
    return _inverse(lambda youngs: strip_sag(made, youngs, load, width=width), sag, "strip", load)


def strip_load(made: Coupons, sag: float) -> float:
    """Kg that let the strip sink by about ``sag`` metres, to one figure; by the small limit."""
    stiffness = 3.0 * made.youngs * made.strip_width * made.thickness**3 / 12.0 / made.strip_length**3
    return _round(stiffness * sag / GRAVITY)


def spiral_stiffness(made: Coupons, scale: float, width: float, twist: float, youngs: float) -> float:
    """N/m of a spiral's hub along the sheet's normal, the tips of its four arms held; lengths in metres, twist in radians."""
    compliance = tip_compliance(
        np.array([scale]), np.array([width]), np.array([twist]),
        thickness=made.thickness, youngs=youngs, poisson=made.poisson,
    ).values[0]  # fmt: skip
    # a rounder corner at the hub than the table's makes the arm shorter; its length is that of an Archimedean spiral
    along = 0.25 * scale * (math.hypot(1.0, twist) + math.asinh(twist) / twist)
    longer = 1.0 - FILLET_REACH * (fillet(made, width) - TABLE_FILLET * width) / along
    return 4.0 * float(np.linalg.inv(compliance)[NORMAL, NORMAL]) / longer**3


def fillet(made: Coupons, width: float) -> float:
    """Metres, radius of the corners at the hub: the stiffness table's, or the smallest that the cutter can make."""
    return max(TABLE_FILLET * width, 0.5 * made.kerf_holes, 0.51 * made.mill)


def spiral_youngs(made: Coupons, spiral: SpiralCoupon, sag: float, load: float, wider: float = 0.0) -> float:
    """Pa, of the spiral whose hub sank by ``sag`` metres under ``load`` kg; its arms are ``wider`` than drawn, metres."""
    unit = spiral_stiffness(made, spiral.scale, spiral.width + wider, spiral.twist, 1.0)
    return _bounded(load * GRAVITY / (sag * unit), f"spiral {spiral.name}", load)


def spiral_load(made: Coupons, scale: float, width: float, twist: float, sag: float) -> float:
    """Kg that let a spiral sink by about ``sag`` metres, to one figure."""
    return _round(spiral_stiffness(made, scale, width, twist, made.youngs) * sag / GRAVITY)


def _inverse(sag_of: Callable[[float], float], sag: float, what: str, load: float) -> float:
    """The modulus whose sag is the measured one. Sags are nearly as one over the modulus, so each round multiplies the error by a
    share that is small: 0.05 at a sag of a tenth of the length, 0.5 where it hangs as steeply as it may.
    """
    youngs = 1e9
    youngs = _bounded(youngs * sag_of(youngs * STIFF) * STIFF / sag, what, load)
    for _ in range(ROUNDS):
        before, youngs = youngs, _bounded(youngs * sag_of(youngs) / sag, what, load)
        if abs(youngs - before) < 1e-7 * before:
            break
    return youngs


def _bounded(youngs: float, what: str, load: float) -> float:
    if not SOFTEST < youngs < STIFFEST:
        raise FlexMapsError(
            f"The sag of the {what} under {load * 1e3:g} g would take a material of {youngs * 1e-9:.3g} GPa; "
            "check that sags are in millimetres and weights in grams"
        )
    return youngs


def _round(mass: float) -> float:
    """A mass to one figure, as weights come: 1, 2 or 5 times a power of ten, in kg."""
    power = 10.0 ** math.floor(math.log10(mass))
    return min((1.0, 2.0, 5.0, 10.0), key=lambda m: abs(math.log(m * power / mass))) * power

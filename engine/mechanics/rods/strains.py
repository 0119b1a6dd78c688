"""Bending and torsion energy at one end of an edge, from the curvature binormal and the torsion (FlexMaps section 6.1).

Let x, y be the components of the curvature binormal along the hub's normal and along the left of the edge's rest
direction. The torsion of an end is the roll of the edge relative to the hub there: the edge's frame is the hub's frame,
carried onto the edge by the shortest rotation and then rotated about the edge by the torsion. The mean of both frames
gives the two curvatures of eq. 3,

    x' = c (x cos h - y sin h)    and    y' = c (y cos h + x sin h),    h = torsion / 2,   c = cos h.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Float

# A Newton step of a roll below this, in radians, ends the iteration; the remaining error is about the step squared
TOLERANCE = 1e-9
ROUNDS = 60  # largest number of Newton steps or bisections: enough for double precision
MAX_ROLL_STEP = 0.5  # largest change of an edge's roll in one step, radians; larger may skip a minimum; chosen by eye


@dataclass(frozen=True, eq=False)
class EndEnergy:
    """Energies of edge ends, with derivatives by x, y and torsion (see the module's docstring).

    energy : (...) joules
    gradient : (..., 3) first derivatives
    hessian : (..., 3, 3) second derivatives
    convex : (..., 3, 3) the Hessian without second derivatives of x' and y' (Gauss-Newton)
    """

    energy: Float[np.ndarray, " ..."]
    gradient: Float[np.ndarray, "... 3"]
    hessian: Float[np.ndarray, "... 3 3"]
    convex: Float[np.ndarray, "... 3 3"]


def _strains(bend: np.ndarray, torsion: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return x', y', cos^2 h, cos h sin h and cos^2 h - 1/2, in the notation of the module's docstring."""
    half_cosine, half_sine = 0.5 * np.cos(torsion), 0.5 * np.sin(torsion)
    squared = 0.5 + half_cosine
    x, y = bend[..., 0], bend[..., 1]
    return squared * x - half_sine * y, squared * y + half_sine * x, squared, half_sine, half_cosine


def energy(
    springs: Float[np.ndarray, "... 3"], bend: Float[np.ndarray, "... 2"], torsion: Float[np.ndarray, " ..."]
) -> Float[np.ndarray, " ..."]:
    """Return the energies of edge ends by eq. 3 and 4, joules.

    Parameters
    ----------
    springs : (..., 3) k_b0, k_b1 and k_t, divided by the length of the half edge, N m
    bend : (..., 2) components x, y of the curvature binormal
    torsion : (...) of the ends, radians
    """
    first, second = _strains(bend, torsion)[:2]
    return 0.5 * (springs[..., 0] * first**2 + springs[..., 1] * second**2 + springs[..., 2] * torsion**2)


def slope(springs: np.ndarray, bend: np.ndarray, torsion: np.ndarray) -> Float[np.ndarray, "... 3"]:
    """Return the first derivatives (..., 3) of ``energy`` by x, y and torsion; arguments as for ``energy``."""
    strains, slopes = _slopes(bend, torsion)
    return np.einsum("...i,...ij->...j", springs * strains, slopes)


def expand(springs: np.ndarray, bend: np.ndarray, torsion: np.ndarray) -> EndEnergy:
    """Return ``energy`` with its first and second derivatives; arguments as for ``energy``."""
    strains, slopes = _slopes(bend, torsion)
    half_sine, half_cosine, x, y = 0.5 * np.sin(torsion), 0.5 * np.cos(torsion), bend[..., 0], bend[..., 1]
    stress = springs * strains
    gradient = np.einsum("...i,...ij->...j", stress, slopes)
    convex = np.swapaxes(slopes, -1, -2) @ (springs[..., None] * slopes)
    hessian = convex.copy()
    m1, m2 = stress[..., 0], stress[..., 1]
    by_x, by_y = -half_sine * m1 + half_cosine * m2, -half_cosine * m1 - half_sine * m2
    hessian[..., 0, 2] += by_x
    hessian[..., 2, 0] += by_x
    hessian[..., 1, 2] += by_y
    hessian[..., 2, 1] += by_y
    hessian[..., 2, 2] += m1 * (half_sine * y - half_cosine * x) - m2 * (half_cosine * y + half_sine * x)
    return EndEnergy(0.5 * (stress * strains).sum(axis=-1), gradient, hessian, convex)


def _slopes(bend: np.ndarray, torsion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the strains (..., 3), which are x', y' and torsion, and their derivatives (..., 3, 3).

    The last axis of the derivatives is for x, y and torsion, the axis before it for the strains.
    """
    first, second, squared, half_sine, half_cosine = _strains(bend, torsion)
    x, y = bend[..., 0], bend[..., 1]
    slopes = np.zeros((*torsion.shape, 3, 3))
    slopes[..., 0, 0] = slopes[..., 1, 1] = squared
    slopes[..., 0, 1], slopes[..., 1, 0] = -half_sine, half_sine
    slopes[..., 0, 2] = -half_sine * x - half_cosine * y
    slopes[..., 1, 2] = -half_sine * y + half_cosine * x
    slopes[..., 2, 2] = 1.0
    return np.stack([first, second, torsion], axis=-1), slopes


def relaxed_roll(
    springs: Float[np.ndarray, "joints 2 3"],
    bend: Float[np.ndarray, "joints 2 2"],
    torsion: Float[np.ndarray, " joints"],
    guess: Float[np.ndarray, " joints"],
) -> Float[np.ndarray, " joints"]:
    """Return the rolls (m,) of edges, relative to their first hubs, that minimise their energies; radians.

    Newton's method, bracketed by the signs of the slope, finds the minimum downhill of ``guess``. An edge whose slope
    is not finite is left at its last roll.

    Parameters
    ----------
    springs, bend : (m, 2, 3) and (m, 2, 2), as in ``energy``, of both ends
    torsion : (m,) rotation of the second hub relative to the first about the edge, radians
    guess : (m,) rolls at which the search starts, radians
    """
    roll = np.array(guess, dtype=float)
    low, high = np.full_like(roll, -np.inf), np.full_like(roll, np.inf)
    left = np.arange(len(roll))
    for _ in range(ROUNDS):
        slope, bulge = _roll_slopes(springs[left], bend[left], roll[left][:, None] - _offsets(torsion[left]))
        here = roll[left]
        down = slope < 0
        below, above = np.where(down, here, low[left]), np.where(down, high[left], here)
        low[left], high[left] = below, above
        newton = here - slope / bulge
        good = (bulge > 0) & (newton >= below) & (newton <= above)
        # as long as the minimum is bracketed on one side only, the midpoint is infinite, and clipping makes it the
        # longest step
        roll[left] = np.clip(np.where(good, newton, 0.5 * (below + above)), here - MAX_ROLL_STEP, here + MAX_ROLL_STEP)
        left = left[(np.abs(roll[left] - here) > TOLERANCE) & np.isfinite(slope)]
        if not len(left):
            break
    return roll


def _offsets(torsion: np.ndarray) -> Float[np.ndarray, "joints 2"]:
    """Return the rotations (m, 2) of the hubs at both ends about the edge, relative to the first hub, radians."""
    return np.stack([np.zeros_like(torsion), torsion], axis=1)


def _roll_slopes(
    springs: np.ndarray, bend: np.ndarray, angle: Float[np.ndarray, "joints 2"]
) -> tuple[np.ndarray, np.ndarray]:
    """Return first and second derivatives (m,) of the energy of edges by their roll.

    springs, bend : as in ``relaxed_roll``; angle : (m, 2) roll of the edge relative to the hub at either end, radians
    """
    first, second, _, half_sine, half_cosine = _strains(bend, angle)
    x, y = bend[..., 0], bend[..., 1]
    slope1, slope2 = -half_sine * x - half_cosine * y, -half_sine * y + half_cosine * x
    bulge1, bulge2 = half_sine * y - half_cosine * x, -half_cosine * y - half_sine * x
    k1, k2, kt = springs[..., 0], springs[..., 1], springs[..., 2]
    slope = k1 * first * slope1 + k2 * second * slope2 + kt * angle
    bulge = k1 * (slope1**2 + first * bulge1) + k2 * (slope2**2 + second * bulge2) + kt
    return slope.sum(axis=1), bulge.sum(axis=1)

"""Curvatures and rolls at the ends of the rod model's edges, with first and second derivatives by the hubs' poses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Float
from ..assembly import Pose
from ..vectors import outer, skew


@dataclass(frozen=True, eq=False)
class RodState:
    """A pose, and the state of the edges in it.

    length : (m,) metres; tangent : (m, 3) from the first hub to the second
    frames : (m, 2, 3, 3) columns, in space, fixed to the hub at either end: the edge's direction at rest, its left, the
        normal
    bend : (m, 2, 2) components x, y of the curvature binormal along the normal and along the left of ``frames``
    torsion : (m,) rad, turn of the second hub relative to the first about the edge, with whole turns
    roll : (m,) rad, turn of the edge about itself relative to the first hub
    predicted : (m,) metres, the length that the last step predicted to first order
    """

    pose: Pose
    length: Float[np.ndarray, " joints"]
    tangent: Float[np.ndarray, "joints 3"]
    frames: Float[np.ndarray, "joints 2 3 3"]
    bend: Float[np.ndarray, "joints 2 2"]
    torsion: Float[np.ndarray, " joints"]
    roll: Float[np.ndarray, " joints"]
    predicted: Float[np.ndarray, " joints"]

    @property
    def angles(self) -> Float[np.ndarray, "joints 2"]:
        """(m, 2) rad, roll of the edge relative to the hub of either end: the angle of eq. 4."""
        return np.stack([self.roll, self.roll - self.torsion], axis=1)


# signs that convert derivatives by the curvatures x, y and the edge's roll relative to a hub to derivatives by x, y and
# the hub's roll relative to the edge
ROLL_SIGNS = np.array([1.0, 1.0, -1.0])

# (2, 6, 12) matrices that map the increments of both hubs (shift and turn of the first, then of the second) to the
# increments (d, w) of either end: d is the second shift minus the first, w the turn of the hub at that end
END_INCREMENTS = np.zeros((2, 6, 12))
END_INCREMENTS[:, :3, :3] = -np.eye(3)  # the first hub's shift counts negative
# the second hub's shift counts at both ends, the turn of a hub at its own end
END_INCREMENTS[:, :3, 6:9] = END_INCREMENTS[0, 3:, 3:6] = END_INCREMENTS[1, 3:, 9:] = np.eye(3)


@dataclass(frozen=True, eq=False)
class EndMotion:
    """First derivatives of curvatures x, y and rolls at both ends of m edges; (d, w) as in ``first_order``.

    jacobian : (m, 2, 3, 6) derivatives of x, y and the roll of the hub's frame about the edge, by (d, w)
    by_tangent : (m, 2, 4, 3) derivatives of x, y, roll and the tangent's component along the edge's rest direction, by
        the tangent
    pulled : (m, 2, 4, 6) derivatives of the four quantities of ``by_tangent`` by (d, w), without the direct effect w.t
        of the hub's turn on the roll
    """

    jacobian: Float[np.ndarray, "joints 2 3 6"]
    by_tangent: Float[np.ndarray, "joints 2 4 3"]
    pulled: Float[np.ndarray, "joints 2 4 6"]


def first_order(state: RodState) -> EndMotion:
    """Differentiate curvatures and rolls by d and w.

    d is the shift of the second hub minus the shift of the first, w the turn of the hub at an end. Let t be the edge's
    tangent, l its length and P the projection at right angles to t. Relative to the hub the tangent moves by
    u = P d / l + t x w + ..., and the hub's frame, carried onto the edge, rolls by w.t - (binormal . u) / 2 + ...
    """
    tangent, length = state.tangent, state.length[:, None, None, None]
    rest, left, normal = np.moveaxis(state.frames, 3, 0)
    near = _one_plus_cosine(state)[..., None]
    x, y = state.bend[..., :1], state.bend[..., 1:]
    by_tangent = np.stack(
        [(2.0 * left - x * rest) / near, -(2.0 * normal + y * rest) / near, -0.5 * (x * normal + y * left), rest],
        axis=2,
    )
    on_axis = by_tangent @ tangent[:, None, :, None]
    spun = by_tangent @ skew(tangent)[:, None]
    pulled = np.concatenate([(by_tangent - on_axis * tangent[:, None, None]) / length, spun], axis=3)
    jacobian = pulled[:, :, :3].copy()
    jacobian[:, :, 2, 3:] += tangent[:, None]
    return EndMotion(jacobian, by_tangent, pulled)


def second_order(
    state: RodState, motion: EndMotion, slope: Float[np.ndarray, "joints 2 3"]
) -> Float[np.ndarray, "joints 2 6 6"]:
    """Return the second derivatives (m, 2, 6, 6) of x, y and roll by (d, w) (see ``first_order``), summed with weights.

    Parameters
    ----------
    state, motion : m edges, and their first derivatives
    slope : (m, 2, 3) weights of x, y and roll at both ends: derivatives of the energy
    """
    tangent, length = state.tangent, state.length[:, None, None, None]
    eye, along = np.eye(3), outer(tangent, tangent)[:, None]
    force = np.einsum("mki,mkij->mkj", slope, motion.by_tangent[:, :, :3])
    axial = np.einsum("mki,mi->mk", force, tangent)[..., None, None]
    both = outer(force, np.broadcast_to(tangent[:, None], force.shape))
    both = both + np.swapaxes(both, 2, 3)
    roll = 0.5 * slope[..., 2, None, None]
    sideways = np.einsum("mki,mkij->mkj", slope * [1.0, 1.0, 0.5], motion.pulled[:, :, :3])
    twice = outer(sideways / -_one_plus_cosine(state)[..., None], motion.pulled[:, :, 3])
    curved = twice + np.swapaxes(twice, 2, 3)
    curved[..., :3, :3] += (axial * (3.0 * along - eye) - both) / length**2
    mixed = (skew(force) @ (eye - along) + roll * (eye - along)) / length
    curved[..., 3:, :3] += mixed
    curved[..., :3, 3:] += np.swapaxes(mixed, 2, 3)
    curved[..., 3:, 3:] += 0.5 * both - axial * eye
    return curved


def roll_coupling(
    ends: Float[np.ndarray, "joints 2 3 3"], jacobian: Float[np.ndarray, "joints 2 3 6"]
) -> Float[np.ndarray, "joints 12"]:
    """Return mixed derivatives (m, 12) of the energy by the hubs' increments and by a common roll of both ends.

    Parameters
    ----------
    ends : (m, 2, 3, 3) second derivatives of the energy by x, y and roll of both ends
    jacobian : (m, 2, 3, 6) derivatives of x, y and roll by (d, w)
    """
    coupled = np.einsum("mki,mkij->mkj", ends[..., 2], jacobian)
    return coupled[:, 0] @ END_INCREMENTS[0] + coupled[:, 1] @ END_INCREMENTS[1]


def _one_plus_cosine(state: RodState) -> Float[np.ndarray, "joints 2"]:
    """Return one plus the cosine of the angle (m, 2) between the edge and its rest direction at either end."""
    return 1.0 + np.einsum("mki,mi->mk", state.frames[..., 0], state.tangent)

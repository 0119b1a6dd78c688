"""Curvatures and rolls at the ends of the rod model's edges, with first and second derivatives by the hubs' poses.

An edge joins the centres of two hubs. Its roll is its rotation about itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Float
from ..assembly import Pose
from ..vectors import outer, skew


@dataclass(frozen=True, eq=False)
class RodState:
    """A pose of the hubs, and the state of the m edges in it.

    length : (m,) metres
    tangent : (m, 3) unit vectors from the first hub to the second
    frames : (m, 2, 3, 3) frames that are fixed to the hub at either end, as columns in space: the edge's direction at
        rest, the direction to its left, the normal
    bend : (m, 2, 2) components x, y of the curvature binormal at either end: along the third and the second column of
        ``frames``
    torsion : (m,) rotation of the second hub relative to the first about the edge, radians; more than a whole turn is
        possible
    roll : (m,) rotation of the edge about itself relative to the first hub, radians, also with whole turns
    predicted : (m,) length that the last Newton step predicted to first order, metres
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
        """Roll (m, 2) of the edge relative to the hub at either end, radians: the angle in eq. 4 of FlexMaps."""
        return np.stack([self.roll, self.roll - self.torsion], axis=1)


# Factors that convert derivatives by x, y (see ``RodState.bend``) and the edge's roll relative to a hub to derivatives
# by x, y and the hub's roll relative to the edge, which has the opposite sign
ROLL_SIGNS = np.array([1.0, 1.0, -1.0])

# One matrix for either end of an edge. It maps the increments of both hubs (shift and turn of the first, then of the
# second) to the six numbers (d, w): d is the shift of the second hub minus that of the first, w the turn of the hub at
# this end
END_INCREMENTS = np.zeros((2, 6, 12))
END_INCREMENTS[:, :3, :3] = -np.eye(3)  # d contains the shift of the first hub with the sign -1
# d contains the shift of the second hub with the sign 1; w is the turn of the first or of the second hub
END_INCREMENTS[:, :3, 6:9] = END_INCREMENTS[0, 3:, 3:6] = END_INCREMENTS[1, 3:, 9:] = np.eye(3)


@dataclass(frozen=True, eq=False)
class EndMotion:
    """First derivatives of curvatures and rolls at both ends of m edges.

    The quantities are the curvatures x, y, the roll of the hub's frame about the edge, and in arrays with four
    quantities the tangent's component along the edge's rest direction. (d, w) are the increments of ``END_INCREMENTS``.

    jacobian : (m, 2, 3, 6) derivatives of the first three quantities by (d, w)
    by_tangent : (m, 2, 4, 3) derivatives of all four by the tangent
    by_increments : (m, 2, 4, 6) derivatives of all four by (d, w) that come from the change of the tangent relative to
        the hub; the roll also changes directly, by w.t (see ``first_order``)
    """

    jacobian: Float[np.ndarray, "joints 2 3 6"]
    by_tangent: Float[np.ndarray, "joints 2 4 3"]
    by_increments: Float[np.ndarray, "joints 2 4 6"]


def first_order(state: RodState) -> EndMotion:
    """Differentiate curvatures and rolls at both ends by the increments (d, w) of ``END_INCREMENTS``.

    Let t be the edge's tangent, l its length and P the projection to the plane at right angles to t. To first order,
    the tangent moves relative to the hub by u = P d / l + t x w. The hub's frame, carried onto the edge by the shortest
    rotation, rolls by w.t - (binormal . u) / 2.
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
    by_increments = np.concatenate([(by_tangent - on_axis * tangent[:, None, None]) / length, spun], axis=3)
    jacobian = by_increments[:, :, :3].copy()
    jacobian[:, :, 2, 3:] += tangent[:, None]
    return EndMotion(jacobian, by_tangent, by_increments)


def second_order(
    state: RodState, motion: EndMotion, slope: Float[np.ndarray, "joints 2 3"]
) -> Float[np.ndarray, "joints 2 6 6"]:
    """Return the weighted sum (m, 2, 6, 6) of the second derivatives of x, y and roll by (d, w), at both ends.

    Parameters
    ----------
    state, motion : m edges, and their first derivatives by (d, w)
    slope : (m, 2, 3) weights: the derivatives of the energy by x, y and roll at both ends
    """
    tangent, length = state.tangent, state.length[:, None, None, None]
    eye, along = np.eye(3), outer(tangent, tangent)[:, None]
    force = np.einsum("mki,mkij->mkj", slope, motion.by_tangent[:, :, :3])
    axial = np.einsum("mki,mi->mk", force, tangent)[..., None, None]
    both = outer(force, np.broadcast_to(tangent[:, None], force.shape))
    both = both + np.swapaxes(both, 2, 3)
    roll = 0.5 * slope[..., 2, None, None]
    sideways = np.einsum("mki,mkij->mkj", slope * [1.0, 1.0, 0.5], motion.by_increments[:, :, :3])
    twice = outer(sideways / -_one_plus_cosine(state)[..., None], motion.by_increments[:, :, 3])
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
    """Return the mixed second derivatives (m, 12) of the edges' energies by the hubs' increments and by the edge's
    roll.

    Parameters
    ----------
    ends : (m, 2, 3, 3) second derivatives of the energy by x, y and roll at both ends
    jacobian : (m, 2, 3, 6) derivatives of x, y and roll by (d, w), as in ``EndMotion``
    """
    coupled = np.einsum("mki,mkij->mkj", ends[..., 2], jacobian)
    return coupled[:, 0] @ END_INCREMENTS[0] + coupled[:, 1] @ END_INCREMENTS[1]


def _one_plus_cosine(state: RodState) -> Float[np.ndarray, "joints 2"]:
    """Return 1 + cos(angle) (m, 2), for the angle between the edge and its rest direction at either end."""
    return 1.0 + np.einsum("mki,mi->mk", state.frames[..., 0], state.tangent)

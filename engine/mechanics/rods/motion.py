"""Bends and rolls at the ends of the rod model's edges, and their derivatives by the hubs' poses to second order."""

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
    frames : (m, 2, 3, 3) columns, moving with the hub of either end: the edge's rest direction, its left, the normal
    bend : (m, 2, 2) the curvature binormal along that normal and along that left
    torsion : (m,) rad of the second hub relative to the first about the edge, with whole turns
    roll : (m,) rad of the edge relative to the first hub
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


# signs that turn derivatives by x, y and the edge's roll relative to a hub into those by x, y and the roll of the hub's
# frame
ROLL_SIGNS = np.array([1.0, 1.0, -1.0])

# (2, 6, 12) increments (d, w) of either end from both hubs': first shift, first turn, second shift, second turn
END_INCREMENTS = np.zeros((2, 6, 12))
END_INCREMENTS[:, :3, :3] = -np.eye(3)  # the first hub's shift counts negative
# the second hub's shift, and the turn of the hub at that end
END_INCREMENTS[:, :3, 6:9] = END_INCREMENTS[0, 3:, 3:6] = END_INCREMENTS[1, 3:, 9:] = np.eye(3)


@dataclass(frozen=True, eq=False)
class EndMotion:
    """First derivatives of the bends and rolls at both ends of m edges.

    jacobian : (m, 2, 3, 6) of x, y and the roll of the hub's frame on the edge, by (d, w)
    by_tangent : (m, 2, 4, 3) of x, y, that roll and the tangent's component along the hub's rest direction, by the
        tangent
    pulled : (m, 2, 4, 6) of the same four by (d, w), without the roll w.t of the hub itself
    """

    jacobian: Float[np.ndarray, "joints 2 3 6"]
    by_tangent: Float[np.ndarray, "joints 2 4 3"]
    pulled: Float[np.ndarray, "joints 2 4 6"]


def first_order(state: RodState) -> EndMotion:
    """Differentiate bends and rolls by d, the shift of the second hub minus the first hub's shift, and w, the turn of an
    end's hub.

    Seen from an end, the edge's tangent moves by u = Pd/l + t x w + ..., and the hub's frame on the edge rolls by w.t -
    (binormal . u)/2 + ... (P projects at right angles to the tangent t, l is the length).
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
    """(m, 2, 6, 6) second derivatives by (d, w) of x, y and the frame's roll, weighted by ``slope`` (m, 2, 3)."""
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
    """(m, 12) mixed derivatives by the hubs' increments and by a roll of both hubs' frames relative to the edge.

    ends : (m, 2, 3, 3) second derivatives by x, y and roll of both ends; jacobian : (m, 2, 3, 6) of x, y, roll by (d,
        w)
    """
    coupled = np.einsum("mki,mkij->mkj", ends[..., 2], jacobian)
    return coupled[:, 0] @ END_INCREMENTS[0] + coupled[:, 1] @ END_INCREMENTS[1]


def _one_plus_cosine(state: RodState) -> Float[np.ndarray, "joints 2"]:
    """(m, 2): one plus the cosine of each end's bend."""
    return 1.0 + np.einsum("mki,mi->mk", state.frames[..., 0], state.tangent)

"""Motion of two joined hubs relative to each other, and its first and second derivatives by the hubs' poses.

The relative turn is a rotation vector. The relative shift is the vector from a point fixed to the first hub to a point
fixed to the second, in the frame half way between both hubs (corotational).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ...arrays import Columns, Float
from ..assembly import Pose
from ..vectors import matvec, rotation_vector
from .stacked import EYE, cross, dot, joints_first, joints_last, outer, skew


@dataclass(frozen=True, eq=False)
class JointMotion(Columns):
    """Motion of m joints, and the frame in which it is measured.

    middle : (m, 3, 3) axes of the frame half way between both hubs ("half-way axes"), as columns in space
    turn : (m, 3) rotation vector of the second hub relative to the first, in half-way axes, radians
    gap : (m, 3) vector from the first hub's bend point to the second's (see ``arm_bend``), in half-way axes, metres
    shift : (m, 3) gap minus gap at rest
    first, second : (m, 3) vectors from the centres of the first and second hubs to their bend points, in space, metres
    """

    middle: Float[np.ndarray, "joints 3 3"]
    turn: Float[np.ndarray, "joints 3"]
    gap: Float[np.ndarray, "joints 3"]
    shift: Float[np.ndarray, "joints 3"]
    first: Float[np.ndarray, "joints 3"]
    second: Float[np.ndarray, "joints 3"]

    @property
    def vector(self) -> Float[np.ndarray, "joints 6"]:
        """Shift (3), then turn (3), of every joint."""
        return np.concatenate([self.shift, self.turn], axis=1)


def joint_motion(
    pose: Pose,
    pairs: np.ndarray,
    lever: Float[np.ndarray, "joints 2 3"],
    axes: Float[np.ndarray, "joints 2 3 3"],
    rest: Float[np.ndarray, "joints 3"],
) -> JointMotion:
    """Compute the motion of m joints in a pose.

    Parameters
    ----------
    pose : of the hubs, with the rim's nodes if there is a rim
    pairs : (m, 2) indices of the two hubs of every joint
    lever : vectors from the hubs' centres to the bend points, in the flat frames of their patches, metres
    axes : axes of the joints as columns, in the flat frames of both hubs' patches
    rest : vectors from the first bend point to the second at rest, in the joints' axes, metres
    """
    pose = pose.whole
    a, b = pairs.T
    first, second = pose.rotations[a] @ axes[:, 0], pose.rotations[b] @ axes[:, 1]
    turn = rotation_vector(np.swapaxes(first, 1, 2) @ second)
    middle = first @ Rotation.from_rotvec(0.5 * turn).as_matrix()
    first, second = matvec(pose.rotations[a], lever[:, 0]), matvec(pose.rotations[b], lever[:, 1])
    gap = matvec(np.swapaxes(middle, 1, 2), pose.centres[b] + second - pose.centres[a] - first)
    return JointMotion(middle, turn, gap, gap - rest, first, second)


@dataclass(frozen=True, eq=False)
class SpatialMotion:
    """Motion of m joints in space, with the joints as the last axis of all arrays, as the derivatives need it.

    gap, turn, first, second : (3, m) as in ``JointMotion``, but all with components in space
    angle : (m,) length of the rotation vector ``turn``, radians
    quarter : (3, m) vector along ``turn``, of the length tan(angle / 4)
    across : (m,) (angle / 2) / sin(angle / 2), the change of ``turn`` when the hubs rotate against each other by a
        small vector at right angles to it, over that vector
    """

    gap: Float[np.ndarray, "3 joints"]
    turn: Float[np.ndarray, "3 joints"]
    first: Float[np.ndarray, "3 joints"]
    second: Float[np.ndarray, "3 joints"]
    angle: Float[np.ndarray, " joints"]
    quarter: Float[np.ndarray, "3 joints"]
    across: Float[np.ndarray, " joints"]

    @classmethod
    def from_joints(cls, motion: JointMotion) -> SpatialMotion:
        """Return the motion, rotated from the half-way frame to the axes of space."""
        gap, turn = (joints_last(matvec(motion.middle, v)) for v in (motion.gap, motion.turn))
        angle = np.sqrt(dot(turn, turn))
        # (angle / 2) / sin(angle / 2), as numpy's sinc(x) is sin(pi x) / (pi x)
        across = 1.0 / np.sinc(angle / (2.0 * np.pi))
        first, second = joints_last(motion.first), joints_last(motion.second)
        return cls(gap, turn, first, second, angle, tan_quarter(angle) * turn, across)


def first_order(at: SpatialMotion) -> Float[np.ndarray, "joints 6 12"]:
    """Return the derivatives (m, 6, 12) of gap (3) and turn (3) by the increments of both hubs (6 each).

    A hub's increment is its shift and its rotation vector in space. When the hubs rotate by small vectors a and b, the
    half-way frame rotates by (a + b)/2 - q x (b - a)/2 to first order, with q = ``quarter``, because its quaternion is
    along the sum of both hubs' quaternions.
    """
    out = np.zeros((6, 12, len(at.angle)))
    carried = skew(0.5 * at.gap)
    aside = 0.5 * (outer(at.quarter, at.gap) - dot(at.quarter, at.gap) * EYE)
    out[:3, :3], out[:3, 6:9] = -EYE, EYE
    out[:3, 3:6] = carried + aside + skew(at.first)
    out[:3, 9:] = carried - aside - skew(at.second)
    spin = at.across * EYE + outer((1.0 - at.across) / np.maximum(at.angle, 1e-12) ** 2 * at.turn, at.turn)
    out[3:, 3:6], out[3:, 9:] = -spin, spin
    return joints_first(out)


def second_order(
    at: SpatialMotion, force: np.ndarray, moment: Float[np.ndarray, "joints 3"]
) -> Float[np.ndarray, "joints 12 12"]:
    """Return second derivatives (m, 12, 12) of force . gap + moment . turn by the increments of both hubs (6 each).

    Parameters
    ----------
    at : motion of m joints
    force, moment : (m, 3) constant weights of the components of gap and turn in space
    """
    force, moment, quarter, turn = joints_last(force), joints_last(moment), at.quarter, at.turn
    # ``out`` is half of the result; its transpose is added at the end. First come the terms of force . (exp(-m) gap),
    # where m is the small rotation vector of the half-way frame to first order in the increments
    out = np.zeros((12, 12, len(at.angle)))
    level = 0.5 * dot(force, at.gap)
    bend = 0.25 * (outer(force, at.gap) + outer(at.gap, force)) - level * EYE
    aside = 0.25 * (outer(force, cross(at.gap, quarter)) + outer(at.gap, cross(force, quarter))) - level * skew(quarter)
    by_shift = skew(force)
    by_first = outer(at.first, force) - dot(force, at.first) * EYE
    by_second = outer(at.second, force) - dot(force, at.second) * EYE
    both = np.concatenate(
        [-by_shift, by_first + 0.5 * (bend + aside), by_shift, 0.5 * (bend - aside) - by_second], axis=1
    )
    around = cross(quarter, both)
    out[3:6], out[9:] = 0.5 * (both - around), 0.5 * (both + around)
    # a lever l (from a hub's centre to its bend point) that rotates by b changes to second order by b x (b x l) / 2
    out[3:6, 3:6] -= 0.5 * by_first
    out[9:, 9:] += 0.5 * by_second
    # when the hubs rotate by a and b, the half-way frame rotates to second order by
    # [(e.q) s - (s.e) q]/4 + (e.q)(e x q)/8, with s = (a + b)/2, e = b - a and q = ``quarter``
    torque = cross(force, at.gap)
    mixed = 0.125 * (outer(torque, quarter) - dot(quarter, torque) * EYE)
    # When the hubs rotate by a and b, with e = b - a, the turn changes to second order by
    # alpha |e_across|^2 n + beta (n.e) e_across, with n the direction of the turn and e_across the part of e at right
    # angles to it (see ``_turn_coefficients``)
    alpha, beta = _turn_coefficients(at.angle)
    share = dot(moment, turn) / np.maximum(at.angle, 1e-12) ** 2
    way = (0.125 * tan_quarter(at.angle)) * cross(quarter, torque) - share * (alpha + beta) * turn + beta * moment
    own = outer(turn, way) + (share * alpha * at.angle**2) * EYE
    out[3:6, 3:6] += own - mixed
    out[9:, 9:] += own + mixed
    # rotations by a and b do not commute: the relative rotation of the hubs is b - a - a x b / 2 to second order
    carried = at.across * moment + (1.0 - at.across) * share * turn
    out[3:6, 9:] -= own + np.swapaxes(own, 0, 1) - skew(0.5 * carried - 0.125 * cross(torque, quarter))
    return joints_first(out + np.swapaxes(out, 0, 1))


def tan_quarter(angle: np.ndarray) -> np.ndarray:
    """Return tan(angle / 4) / angle for angles in radians; 1/4 at 0."""
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    return np.where(small, 0.25 + angle**2 / 192.0, np.tan(0.25 * safe) / safe)


def _turn_coefficients(angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return alpha / angle and beta / angle, coefficients of the second-order change of a rotation vector.

    When a relative rotation with the vector turn, of length angle and direction n, changes by a small vector e in the
    half-way frame, its rotation vector log(exp(turn/2) exp(e) exp(turn/2)) changes to second order by
    alpha |e_across|^2 n + beta (n.e) e_across, with e_across the part of e at right angles to n and

        alpha = -(angle - sin angle) / (8 sin^2(angle/2))
        beta = (2 sin(angle/2) - angle cos(angle/2)) / (4 sin^2(angle/2))
    """
    small = angle < 1e-2
    safe = np.where(small, 1.0, angle)
    sine, cosine = np.sin(0.5 * safe), np.cos(0.5 * safe)
    alpha = -(safe - np.sin(safe)) / (8.0 * sine**2 * safe)
    beta = (2.0 * sine - safe * cosine) / (4.0 * sine**2 * safe)
    near = angle**2
    return (
        np.where(small, -1.0 / 12.0 - near / 360.0, alpha),
        np.where(small, 1.0 / 12.0 + 7.0 * near / 1440.0, beta),
    )

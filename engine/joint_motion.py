"""How two joined hubs have moved against each other, and how that changes with their poses, to second order.

The relative turn is a rotation vector; the way from a point that the first hub carries to one that the second carries is
measured in the frame half way between both (corotational).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from .assembly import Pose


@dataclass(frozen=True, eq=False)
class JointMotion:
    """Strains of the joints and the frame in which they are measured.

    middle : (m, 3, 3) the frame half way between both hubs; turn : (m, 3) rad in its axes
    gap, shift : (m, 3) m in its axes, the way between both bend points, and less what it is at rest
    first, second : (m, 3) m in space, from the centre of either hub to its bend point
    """

    middle: np.ndarray
    turn: np.ndarray
    gap: np.ndarray
    shift: np.ndarray
    first: np.ndarray
    second: np.ndarray

    @property
    def vector(self) -> np.ndarray:
        """(m, 6): shift and turn."""
        return np.concatenate([self.shift, self.turn], axis=1)


# increments (d, a, b) from those of both hubs: first shift, first turn, second shift, second turn
SPLIT = np.zeros((9, 12))
SPLIT[:3, :3], SPLIT[:3, 6:9], SPLIT[3:6, 3:6], SPLIT[6:, 9:] = -np.eye(3), np.eye(3), np.eye(3), np.eye(3)


def joint_motion(pose: Pose, pairs: np.ndarray, lever: np.ndarray, axes: np.ndarray, rest: np.ndarray) -> JointMotion:
    """The motion of m joints in a pose; pairs (m, 2), lever (m, 2, 3), axes (m, 2, 3, 3) and rest (m, 3) as in ``ArmModel``."""
    a, b = pairs.T
    first, second = pose.rotations[a] @ axes[:, 0], pose.rotations[b] @ axes[:, 1]
    turn = rotation_vector(np.swapaxes(first, 1, 2) @ second)
    middle = first @ Rotation.from_rotvec(0.5 * turn).as_matrix()
    first, second = times(pose.rotations[a], lever[:, 0]), times(pose.rotations[b], lever[:, 1])
    gap = times(np.swapaxes(middle, 1, 2), pose.centres[b] + second - pose.centres[a] - first)
    return JointMotion(middle, turn, gap, gap - rest, first, second)


def first_order(
    angle: np.ndarray, turn: np.ndarray, gap: np.ndarray, first: np.ndarray, second: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Derivatives by (d, a, b): of gap and turn (m, 6, 9), of the half-way frame's turn (m, 3, 9), of the gap seen from a fixed frame (m, 3, 9)."""
    m, eye = len(angle), np.eye(3)
    quarter = cross(turn * (_tan_quarter(angle))[:, None])
    frame, shift, jacobian = np.zeros((m, 3, 9)), np.zeros((m, 3, 9)), np.zeros((m, 6, 9))
    frame[:, :, 3:6], frame[:, :, 6:] = 0.5 * (eye + quarter), 0.5 * (eye - quarter)
    shift[:, :, :3], shift[:, :, 3:6], shift[:, :, 6:] = eye, cross(first), -cross(second)
    jacobian[:, :3] = shift + cross(gap) @ frame
    across = _across(angle)
    spin = across[:, None, None] * eye + ((1.0 - across) / np.maximum(angle, 1e-12) ** 2)[:, None, None] * outer(
        turn, turn
    )
    jacobian[:, 3:, 3:6], jacobian[:, 3:, 6:] = -spin, spin
    return jacobian, frame, shift


def second_order(
    angle: np.ndarray,
    turn: np.ndarray,
    gap: np.ndarray,
    force: np.ndarray,
    moment: np.ndarray,
    first: np.ndarray,
    second: np.ndarray,
) -> np.ndarray:
    """(m, 6, 6) X by (a, b), so that X + X^T is what the second derivatives of levers, half-way frame and turn add."""
    eye = np.eye(3)
    x = np.zeros((len(angle), 6, 6))
    # levers: b x (b x l) / 2
    x[:, :3, :3] = -0.5 * (outer(force, first) - dot(force, first) * eye)
    x[:, 3:, 3:] = 0.5 * (outer(force, second) - dot(force, second) * eye)
    # half-way frame: with sum s = (a + b)/2 and difference e = b - a, its second order is
    # [(e.q) s - (s.e) q]/4 + (e.q)(e x q)/8
    q, v = turn * _tan_quarter(angle)[:, None], np.cross(force, gap)
    mixed = 0.25 * (outer(v, q) - dot(q, v) * eye)
    own = 0.125 * outer(q, np.cross(q, v))
    # turn: alpha |e_across|^2 n + beta (n.e) e_across, its logarithm's second order
    along, cross_axis = _turn_coefficients(angle)
    length2 = np.maximum(angle, 1e-12) ** 2
    on_axis = np.einsum("mi,mi->m", moment, turn)
    aside = moment - (on_axis / length2)[:, None] * turn
    across = eye - outer(turn, turn) / length2[:, None, None]
    own += (along * on_axis)[:, None, None] * across + cross_axis[:, None, None] * outer(turn, aside)
    x[:, :3, :3] += 0.5 * (own + np.swapaxes(own, 1, 2)) - 0.5 * mixed
    x[:, 3:, 3:] += 0.5 * (own + np.swapaxes(own, 1, 2)) + 0.5 * mixed
    x[:, :3, 3:] += 0.5 * mixed - 0.5 * (own + np.swapaxes(own, 1, 2))
    x[:, 3:, :3] += -0.5 * mixed - 0.5 * (own + np.swapaxes(own, 1, 2))
    # order of the two turns: delta = b - a - a x b / 2
    size = _across(angle)
    carried = size[:, None] * moment + ((1.0 - size) * on_axis / length2)[:, None] * turn
    x[:, :3, 3:] += 0.5 * cross(carried)
    return x


def gap_curvature(force: np.ndarray, gap: np.ndarray) -> np.ndarray:
    """(m, 3, 3): second derivatives of force . e^(-m) gap by m."""
    both = outer(force, gap)
    return 0.5 * (both + np.swapaxes(both, 1, 2)) - dot(force, gap) * np.eye(3)


def _tan_quarter(angle: np.ndarray) -> np.ndarray:
    """tan(angle/4) / angle."""
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    return np.where(small, 0.25 + angle**2 / 192.0, np.tan(0.25 * safe) / safe)


def _across(angle: np.ndarray) -> np.ndarray:
    """(angle/2) / sin(angle/2): how fast the rotation vector changes at right angles to itself."""
    return 1.0 / np.sinc(angle / (2.0 * np.pi))


def _turn_coefficients(angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """alpha / angle and beta / angle of the second order of log(e^(turn/2) e^delta e^(turn/2)).

    alpha = -(angle - sin angle) / (8 sin^2(angle/2)), beta = (2 sin(angle/2) - angle cos(angle/2)) / (4 sin^2(angle/2))
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


def rotation_vector(matrix: np.ndarray) -> np.ndarray:
    """(m, 3) radians of rotation matrices (m, 3, 3); several times faster than scipy's, which takes over near half turns."""
    double = np.stack(
        [matrix[:, 2, 1] - matrix[:, 1, 2], matrix[:, 0, 2] - matrix[:, 2, 0], matrix[:, 1, 0] - matrix[:, 0, 1]], 1
    )
    sine, cosine = 0.5 * np.linalg.norm(double, axis=1), 0.5 * (np.einsum("mii->m", matrix) - 1.0)
    angle = np.arctan2(sine, cosine)
    out = double * (0.5 * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-300), 1.0))[:, None]
    far = cosine < -0.9
    if far.any():
        out[far] = Rotation.from_matrix(matrix[far]).as_rotvec()
    return out


def cross(v: np.ndarray) -> np.ndarray:
    """(..., 3, 3) with cross(v) x = v x x."""
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return out


def times(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    return (matrix @ vector[..., None])[..., 0]


def outer(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., :, None] * b[..., None, :]


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("mi,mi->m", a, b)[:, None, None]

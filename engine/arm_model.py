"""The 6 x 6 arm model: rigid hubs joined by two arms in series, each with the tip compliance of the stiffness table.

The compliances of both arms of a joint add up, for both carry the same wrench. Their motion is that of one hub against
the other: the relative turn is a rotation vector, and the way from the bend point of the first arm to that of the second
(see ``arm_bend``) is measured in the frame half way between both hubs (corotational).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from .arm_bend import bend_point
from .assembly import Assembly, Pose
from .elastic import Expansion, summed
from .errors import FlexMapsError
from .materials import Material
from .stiffness import tip_compliance


@dataclass(frozen=True, eq=False)
class ArmState:
    """The state of the arm model: the pose alone."""

    pose: Pose


@dataclass(frozen=True, eq=False)
class _Strains:
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


@dataclass(frozen=True, eq=False)
class ArmModel:
    """The elastic model of an assembly with one 6 x 6 stiffness a joint.

    assembly : spirals and joints at rest
    lever : (m, 2, 3) metres, from the hubs to the arms' bend points, in the flat frames of their patches
    rest : (m, 3) metres, from the first bend point to the second at rest, in the joint's axes
    stiffness : (m, 6, 6) SI, of the way between the bend points and the turn, in the joint's axes
    offset : (m, 3) metres, from the joint to the middle between both bend points at rest, in the joint's axes
    """

    assembly: Assembly
    lever: np.ndarray
    rest: np.ndarray
    stiffness: np.ndarray
    offset: np.ndarray
    name: str = "arm"

    @classmethod
    def of(cls, assembly: Assembly, material: Material) -> ArmModel:
        """The model of an assembly of one material; raises FlexMapsError with the faces outside the stiffness table."""
        at_joint = np.linalg.inv(arm_compliances(assembly, material).sum(axis=1))
        lever = _bend_levers(assembly)
        beyond = np.einsum("ekji,ekj->eki", assembly.axes, assembly.lever - lever)
        # a turn about the middle between the bend points leaves the joint aside
        offset = -0.5 * (beyond[:, 0] + beyond[:, 1])
        transfer = np.broadcast_to(np.eye(6), at_joint.shape).copy()
        transfer[:, :3, 3:] = _cross(offset)
        stiffness = np.swapaxes(transfer, 1, 2) @ at_joint @ transfer
        return cls(assembly, lever, beyond[:, 0] - beyond[:, 1], stiffness, offset)

    @property
    def pairs(self) -> np.ndarray:
        return self.assembly.pairs

    def start(self, pose: Pose) -> ArmState:
        return ArmState(pose)

    def moved(self, state: ArmState, step: np.ndarray) -> ArmState:
        return ArmState(state.pose.moved(step))

    def energy(self, state: ArmState) -> float:
        e = self._strains(state.pose).vector
        return 0.5 * float((_times(self.stiffness, e) * e).sum())

    def wrenches(self, state: ArmState) -> np.ndarray:
        """(m, 6) N and N m at every joint that the second arm exerts on the first, in the joint's axes half way."""
        wrench = _times(self.stiffness, self._strains(state.pose).vector)
        wrench[:, 3:] += np.cross(self.offset, wrench[:, :3])
        return wrench

    def twist(self, state: ArmState) -> np.ndarray:
        return self._strains(state.pose).turn[:, 0]

    def _strains(self, pose: Pose, joints: slice = slice(None)) -> _Strains:
        (a, b), lever, axes = self.pairs[joints].T, self.lever[joints], self.assembly.axes[joints]
        first, second = pose.rotations[a] @ axes[:, 0], pose.rotations[b] @ axes[:, 1]
        turn = rotation_vector(np.swapaxes(first, 1, 2) @ second)
        middle = first @ Rotation.from_rotvec(0.5 * turn).as_matrix()
        first, second = _times(pose.rotations[a], lever[:, 0]), _times(pose.rotations[b], lever[:, 1])
        gap = pose.centres[b] + second - pose.centres[a] - first
        gap = _times(np.swapaxes(middle, 1, 2), gap)
        return _Strains(middle, turn, gap, gap - self.rest[joints], first, second)

    def expand(self, state: ArmState) -> Expansion:
        m = len(self.pairs)
        per_joint, gradient = np.empty(m), np.empty((m, 12))
        hessian, convex = np.empty((m, 12, 12)), np.empty((m, 12, 12))
        # a few hundred joints at a time stay in the processor's cache
        for start in range(0, m, BATCH):
            part = slice(start, start + BATCH)
            strains = self._strains(state.pose, part)
            per_joint[part], gradient[part], hessian[part], convex[part] = _expanded(strains, self.stiffness[part])
        return Expansion(
            float(per_joint.sum()), per_joint, summed(gradient, self.pairs, self.assembly.size), hessian, convex
        )


def _expanded(strains: _Strains, stiffness: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Energy (m,), gradient (m, 12), Hessian (m, 12, 12) and its convex part of joints; all in the axes of space.

    With a, b the turns of both hubs and d the shift of the second against the first, all to second order:
    turn' = log(e^(turn/2) e^delta e^(turn/2)) with delta = b - a - a x b / 2, and the half-way frame turns by
    m = (a + b)/2 - q x (b - a)/2 + ..., q = tan(|turn|/4) turn/|turn| (from the sum of both sides' quaternions).
    """
    base, first, second = strains.middle, strains.first, strains.second
    wrench = _times(stiffness, strains.vector)
    per_joint = 0.5 * np.einsum("mi,mi->m", wrench, strains.vector)
    gap, turn, force, moment = (_times(base, v) for v in (strains.gap, strains.turn, wrench[:, :3], wrench[:, 3:]))
    angle = np.linalg.norm(turn, axis=1)
    jacobian, frame, shift = _first_order(angle, turn, gap, first, second)
    split = jacobian @ _SPLIT
    gradient = _times(np.swapaxes(split, 1, 2), np.concatenate([force, moment], axis=1))
    spread = np.zeros((len(base), 6, 6))
    spread[:, :3, :3] = spread[:, 3:, 3:] = base
    convex = np.swapaxes(split, 1, 2) @ (spread @ stiffness @ np.swapaxes(spread, 1, 2)) @ split
    curved = np.swapaxes(frame, 1, 2) @ (_cross(force) @ shift + 0.5 * _mixed(force, gap) @ frame)
    curved[:, 3:, 3:] += _second_order(angle, turn, gap, force, moment, first, second)
    curved = _SPLIT.T @ curved @ _SPLIT
    return per_joint, gradient, convex + curved + np.swapaxes(curved, 1, 2), convex


BATCH = 1024
# increments (d, a, b) from those of both hubs: first shift, first turn, second shift, second turn
_SPLIT = np.zeros((9, 12))
_SPLIT[:3, :3], _SPLIT[:3, 6:9], _SPLIT[3:6, 3:6], _SPLIT[6:, 9:] = -np.eye(3), np.eye(3), np.eye(3), np.eye(3)


def _bend_levers(assembly: Assembly) -> np.ndarray:
    """(m, 2, 3) metres: from the hubs to the bend points of the arms."""
    bend = bend_point(assembly.twist)[0][assembly.pairs]
    left = np.cross([0.0, 0.0, 1.0], assembly.lever) * (-1.0 if assembly.clockwise else 1.0)
    return bend[..., :1] * assembly.lever + bend[..., 1:] * left


def arm_compliances(assembly: Assembly, material: Material) -> np.ndarray:
    """(m, 2, 6, 6) SI: tip compliance of both arms of every joint, in the joint's axes; tip against hub.

    Raises FlexMapsError with the spirals outside the stiffness table.
    """
    spiral = assembly.pairs.ravel()
    try:
        found = tip_compliance(
            2.0 * assembly.radius.ravel(),
            assembly.width[spiral],
            assembly.twist[spiral],
            thickness=assembly.thickness,
            youngs=material.youngs,
            poisson=material.poisson,
        ).values
    except FlexMapsError as error:
        raise FlexMapsError(str(error), faces=np.unique(spiral[np.asarray(error.faces, dtype=int)])) from None
    if assembly.clockwise:
        mirror = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
        found = found * np.outer(mirror, mirror)
    turned = np.zeros((len(spiral), 6, 6))
    turned[:, :3, :3] = turned[:, 3:, 3:] = assembly.radial.reshape(-1, 3, 3)
    return (turned @ found @ np.swapaxes(turned, 1, 2)).reshape(*assembly.pairs.shape, 6, 6)


def _first_order(
    angle: np.ndarray, turn: np.ndarray, gap: np.ndarray, first: np.ndarray, second: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Derivatives by (d, a, b): of gap and turn (m, 6, 9), of the half-way frame's turn (m, 3, 9), of the gap seen from a fixed frame (m, 3, 9)."""
    m, eye = len(angle), np.eye(3)
    quarter = _cross(turn * (_tan_quarter(angle))[:, None])
    frame, shift, jacobian = np.zeros((m, 3, 9)), np.zeros((m, 3, 9)), np.zeros((m, 6, 9))
    frame[:, :, 3:6], frame[:, :, 6:] = 0.5 * (eye + quarter), 0.5 * (eye - quarter)
    shift[:, :, :3], shift[:, :, 3:6], shift[:, :, 6:] = eye, _cross(first), -_cross(second)
    jacobian[:, :3] = shift + _cross(gap) @ frame
    across = _across(angle)
    spin = across[:, None, None] * eye + ((1.0 - across) / np.maximum(angle, 1e-12) ** 2)[:, None, None] * _outer(
        turn, turn
    )
    jacobian[:, 3:, 3:6], jacobian[:, 3:, 6:] = -spin, spin
    return jacobian, frame, shift


def _second_order(
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
    x[:, :3, :3] = -0.5 * (_outer(force, first) - _dot(force, first) * eye)
    x[:, 3:, 3:] = 0.5 * (_outer(force, second) - _dot(force, second) * eye)
    # half-way frame: with sum s = (a + b)/2 and difference e = b - a, its second order is
    # [(e.q) s - (s.e) q]/4 + (e.q)(e x q)/8
    q, v = turn * _tan_quarter(angle)[:, None], np.cross(force, gap)
    mixed = 0.25 * (_outer(v, q) - _dot(q, v) * eye)
    own = 0.125 * _outer(q, np.cross(q, v))
    # turn: alpha |e_across|^2 n + beta (n.e) e_across, its logarithm's second order
    along, cross_axis = _turn_coefficients(angle)
    length2 = np.maximum(angle, 1e-12) ** 2
    on_axis = np.einsum("mi,mi->m", moment, turn)
    aside = moment - (on_axis / length2)[:, None] * turn
    across = eye - _outer(turn, turn) / length2[:, None, None]
    own += (along * on_axis)[:, None, None] * across + cross_axis[:, None, None] * _outer(turn, aside)
    x[:, :3, :3] += 0.5 * (own + np.swapaxes(own, 1, 2)) - 0.5 * mixed
    x[:, 3:, 3:] += 0.5 * (own + np.swapaxes(own, 1, 2)) + 0.5 * mixed
    x[:, :3, 3:] += 0.5 * mixed - 0.5 * (own + np.swapaxes(own, 1, 2))
    x[:, 3:, :3] += -0.5 * mixed - 0.5 * (own + np.swapaxes(own, 1, 2))
    # order of the two turns: delta = b - a - a x b / 2
    size = _across(angle)
    carried = size[:, None] * moment + ((1.0 - size) * on_axis / length2)[:, None] * turn
    x[:, :3, 3:] += 0.5 * _cross(carried)
    return x


def _mixed(force: np.ndarray, gap: np.ndarray) -> np.ndarray:
    """(m, 3, 3): second derivatives of force . e^(-m) gap by m."""
    both = _outer(force, gap)
    return 0.5 * (both + np.swapaxes(both, 1, 2)) - _dot(force, gap) * np.eye(3)


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


def _cross(v: np.ndarray) -> np.ndarray:
    """(m, 3, 3) with _cross(v) x = v x x."""
    out = np.zeros((len(v), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    out[:, 1, 0], out[:, 2, 0], out[:, 2, 1] = v[:, 2], -v[:, 1], v[:, 0]
    return out


def _times(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    return (matrix @ vector[..., None])[..., 0]


def _outer(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, :, None] * b[:, None, :]


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("mi,mi->m", a, b)[:, None, None]

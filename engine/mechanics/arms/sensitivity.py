"""How the forces of the arm model change with the widths and twists of the spirals, at a fixed pose.

With the motion y of a joint, y = T x, and the wrench n = K y there, K = (C_a + C_b)^-1, the energy y.K.y / 2 changes with
a parameter of one arm by -n.C' n / 2, C' of both arms, for each is blended with the other, and, because the bend points move with the twist, by n_force.Y', where

    Y' = A(-turn) beta' for the first arm, -A(turn) beta' for the second,  A(turn) = e^(turn/2) - 1 - turn x / 2,

and beta is the way from an arm's bend point to the joint in the joint's axes. The derivatives by the pose follow.

With the strains' second order y + y.D.y in the place of y (see ``arm_curving``), the wrench is S'K (y + y.D.y) with
S = 1 + 2 y.D, and D counts as given: what the design changes in it is left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Float, Int
from ..assembly import Assembly
from ..vectors import skew, times
from .curving import curved, weighted
from .cut import BESIDE, MATE_TWIST, MATE_WIDTH, TWIST, WIDTH
from .joint_motion import JointMotion, SpatialMotion, first_order

# What a joint follows of the spiral on either side, in this order: width of the arm that meets it, twist (``WIDTH`` and
# ``TWIST`` of ``cut``), width of the arms on both sides of that one, half of their sum.
PARAMETERS = 3  # how many these are


@dataclass(frozen=True, eq=False)
class JointChanges:
    """How m joints answer to the pose and to the design, in the axes of their half-way frames.

    sides : (m, 2) int, the arms that meet
    wrench : (m, 6) N, N m at the joint
    by_pose : (m, 6, 12) of the joint's motion y by the increments of both hubs
    wrench_by_design : (m, 2, 3, 6) at a fixed pose; side of the joint, then the parameters above
    wrench_by_pose : (m, 6, 12)
    turned : (m, 2, 3) what a twist's change of the bend points adds to the gradient by the turn, by side
    """

    sides: Int[np.ndarray, "joints 2"]
    wrench: Float[np.ndarray, "joints 6"]
    by_pose: Float[np.ndarray, "joints 6 12"]
    wrench_by_design: Float[np.ndarray, "joints 2 parameters 6"]
    wrench_by_pose: Float[np.ndarray, "joints 6 12"]
    turned: Float[np.ndarray, "joints 2 3"]

    @classmethod
    def of(
        cls,
        assembly: Assembly,
        by: Float[np.ndarray, "joints 2 numbers 6 6"],
        at_joint: np.ndarray,
        offset: np.ndarray,
        motion: JointMotion,
        curving: np.ndarray | None = None,
    ) -> JointChanges:
        """Arguments as in ``ArmModel`` and ``ArmCompliances``, but ``curving`` is that of the motion at the joint."""
        turn, base = motion.turn, motion.middle
        angle = np.linalg.norm(turn, axis=1)
        shift = motion.shift + np.cross(offset, turn)
        strains = np.concatenate([shift, turn], axis=1)
        slope, tangent = np.eye(6)[None], at_joint
        if curving is not None:
            strains, slope = curved(strains, curving)
        inner, across = times(at_joint, strains), np.swapaxes(slope, 1, 2)
        if curving is not None:
            tangent = across @ at_joint @ slope + 2.0 * weighted(inner, curving)
        wrench = times(across, inner)
        spread = np.zeros((len(base), 6, 6))
        spread[:, :3, :3] = spread[:, 3:, 3:] = np.swapaxes(base, 1, 2)
        by_pose = spread @ first_order(SpatialMotion.of(motion))
        by_pose[:, :3] += skew(offset) @ by_pose[:, 3:]
        turned = np.zeros((len(turn), 2, 3))
        changes = -softened(assembly, by, inner) @ np.swapaxes(across @ at_joint, 1, 2)[:, None]
        for side in (0, 1):
            sign = 1.0 if side == 0 else -1.0
            moved, found = _second_bend(-sign * turn, angle, _way_by_twist(assembly, side), wrench[:, :3])
            changes[:, side, TWIST] += sign * times(tangent[..., :3], moved)
            turned[:, side] = -found
        return cls(assembly.sides, wrench, by_pose, changes, tangent @ by_pose, turned)

    def force_by_design(self, way: Float[np.ndarray, "joints 12"]) -> Float[np.ndarray, "joints 2 5"]:
        """Return ``gradient_by_design`` along a motion of both hubs, by the widths and the twist of both spirals."""
        along = times(self.by_pose, way)
        out = times(self.wrench_by_design, along[:, None])
        out[:, :, TWIST] += times(self.turned, along[:, 3:])
        return of_spirals(out, self.sides)

    @property
    def gradient_by_design(self) -> Float[np.ndarray, "joints 12 2 5"]:
        """(m, 12, 2, 5): derivative of every joint's gradient by the four widths and the twist of both spirals.

        Rows as in ``Expansion.hessian``; then the side of the joint; then the widths, the twist.
        """
        m = len(self.wrench)
        out = (self.wrench_by_design.reshape(m, -1, 6) @ self.by_pose).reshape(m, 2, PARAMETERS, 12)
        out[:, :, TWIST] += self.turned @ self.by_pose[:, 3:]
        return of_spirals(out, self.sides).transpose(0, 3, 1, 2)


def softened(
    assembly: Assembly, by: Float[np.ndarray, "joints 2 numbers 6 6"], wrench: Float[np.ndarray, "joints 6"]
) -> Float[np.ndarray, "joints 2 parameters 6"]:
    """Return how the motion under a constant wrench follows the parameters of both sides: the compliance's derivatives times it."""
    axes = assembly.arm_axes
    own = np.swapaxes(axes, 2, 3) @ wrench[:, None, :, None]
    softer = np.einsum("esij,eskjl->eski", axes, by @ own[:, :, None])
    changes = softer[:, :, [WIDTH, TWIST, BESIDE]]
    changes[:, :, [WIDTH, TWIST]] += softer[:, ::-1, [MATE_WIDTH, MATE_TWIST]]
    return changes


def convex_by_design(
    assembly: Assembly,
    by: Float[np.ndarray, "joints 2 numbers 6 6"],
    at_joint: np.ndarray,
    offset: np.ndarray,
    motion: JointMotion,
    way: Float[np.ndarray, "joints 12"],
    curving: np.ndarray | None = None,
) -> Float[np.ndarray, "joints 2 5"]:
    """Return how every joint's r.K.r follows the widths and the twist of both spirals, with r = S x' along a motion of both hubs.

    Arguments as in ``JointChanges.of``.
    """
    turn, base = motion.turn, motion.middle
    angle = np.linalg.norm(turn, axis=1)
    rates = times(first_order(SpatialMotion.of(motion)), way).reshape(-1, 2, 3) @ base
    rates = np.concatenate([rates[:, 0] + np.cross(offset, rates[:, 1]), rates[:, 1]], axis=1)
    slope = np.eye(6)[None]
    if curving is not None:
        slope = curved(np.concatenate([motion.shift + np.cross(offset, turn), turn], axis=1), curving)[1]
    inner = times(at_joint, times(slope, rates))
    found = -times(softened(assembly, by, inner), inner[:, None])
    force = times(np.swapaxes(slope, 1, 2), inner)[:, :3]
    for side, sign in ((0, 1.0), (1, -1.0)):
        moved, bent = _second_bend(-sign * turn, angle, _way_by_twist(assembly, side), force)
        found[:, side, TWIST] -= 2.0 * (bent * rates[:, 3:]).sum(axis=1)
        if curving is not None:
            found[:, side, TWIST] += 4.0 * sign * (times(weighted(inner, curving)[:, :3], rates) * moved).sum(axis=1)
    return of_spirals(found, assembly.sides)


def of_spirals(changes: np.ndarray, sides: Int[np.ndarray, "joints 2"]) -> np.ndarray:
    """(m, 2, 5, ...) by the widths and the twist of both spirals, from changes (m, 2, 3, ...) by the joints' parameters."""
    out = np.zeros((*changes.shape[:2], 5, *changes.shape[3:]))
    every = np.arange(len(sides))[:, None], [0, 1]
    out[(*every, sides)] = changes[:, :, WIDTH]
    for step in (1, -1):
        out[(*every, (sides + step) % 4)] = 0.5 * changes[:, :, BESIDE]
    out[:, :, 4] = changes[:, :, TWIST]
    return out


def arm_wrenches(assembly: Assembly, wrench: Float[np.ndarray, "joints 6"]) -> Float[np.ndarray, "joints 2 6"]:
    """Wrenches of the joints, N and N m in their axes, in the axes of both arms."""
    return (np.swapaxes(assembly.arm_axes, 2, 3) @ wrench[:, None, :, None])[..., 0]


def _way_by_twist(assembly: Assembly, side: int) -> Float[np.ndarray, "joints 3"]:
    """(m, 3) metres per radian: how the way from the bend point to the joint changes, in the joint's axes."""
    change = assembly.bend[1][:, side]
    way = change[:, :1] * assembly.lever[:, side] + change[:, 1:] * assembly.left[:, side]
    return -np.einsum("eji,ej->ei", assembly.axes[:, side], way)


def _second_bend(
    turn: Float[np.ndarray, "joints 3"], angle: np.ndarray, way: np.ndarray, force: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """A(turn) way, and the gradient of force.A(turn) way by the turn, both (m, 3)."""
    small = angle < 1e-2
    safe = np.where(small, 1.0, angle)
    near = angle**2
    half = 0.5 * safe
    first = np.where(small, -near / 48.0 + near**2 / 3840.0, np.sin(half) / safe - 0.5)[:, None]
    second = np.where(small, 0.125 - near / 384.0, (1.0 - np.cos(half)) / safe**2)[:, None]
    by_first = np.where(small, -1.0 / 24.0 + near / 960.0, (half * np.cos(half) - np.sin(half)) / safe**3)[:, None]
    by_second = np.where(
        small, -1.0 / 192.0 + near / 11520.0, (half * np.sin(half) - 2.0 * (1.0 - np.cos(half))) / safe**4
    )[:, None]
    once = np.cross(turn, way)
    twice = np.cross(turn, once)
    pulled, pulled_twice = ((force * v).sum(axis=1, keepdims=True) for v in (once, twice))
    along_way, along_force = ((turn * v).sum(axis=1, keepdims=True) for v in (way, force))
    gradient = (
        first * np.cross(way, force)
        + pulled * by_first * turn
        + second * (force * along_way + way * along_force - 2.0 * turn * (force * way).sum(axis=1, keepdims=True))
        + pulled_twice * by_second * turn
    )
    return first * once + second * twice, gradient

"""Derivatives of the arm model's forces by the widths and twists of the spirals, at a fixed pose.

Let y be the motion of a joint (its shift and the rotation vector turn), C_a and C_b the compliances of its arms,
K = (C_a + C_b)^-1 its stiffness and n = K y the wrench. The derivative of the energy y.K.y / 2 by a parameter of one
arm is -n.C' n / 2, where C' is the derivative of C_a + C_b: both compliances depend on the parameter, because the arms
are blended with each other. A twist also moves the bend points, between which the shift is measured. This adds the
force of n times Y', the derivative of the shift:

    Y' = A(-turn) beta' for the first arm, -A(turn) beta' for the second,  A(turn) = exp(turn/2) - 1 - turn x / 2,

where beta is the vector from the arm's bend point to the joint in the joint's axes and beta' its derivative by the
twist. The derivatives of the forces follow by differentiating once more, by the pose.

With the second-order term D (see ``curving``), y + y.D.y replaces y, and the wrench is S^T K (y + y.D.y) with
S = 1 + 2 y.D. D is constant here; ``curving_changes`` adds the effect of its changes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Float, Int
from ..assembly import Assembly
from ..vectors import matvec, skew
from .curving import add_second_order, contract_with_wrench
from .cut import BESIDE, MATE_TWIST, MATE_WIDTH, TWIST, WIDTH
from .joint_motion import JointMotion, SpatialMotion, first_order

SENSES = np.array([1.0, -1.0])  # the loads on the two arms of a joint are opposite: signs for the first and second arm

# Number of design parameters on either side of a joint. They are the width of the arm at the joint, the twist of its
# spiral and the mean width of the two arms beside it, with the indices ``WIDTH``, ``TWIST`` and ``BESIDE`` of ``cut``
PARAMETERS = 3


@dataclass(frozen=True, eq=False)
class JointDerivatives:
    """Derivatives of m joints by the pose and the design; all vectors are in half-way axes (see ``JointMotion``).

    The letters y, K, D and S are those of this module's docstring; motions are measured at the joint (see
    ``ArmModel``). Increments are those of both hubs (6 each), parameters the ``PARAMETERS`` of either side.

    sides : (m, 2) indices (0 to 3) of the arms that meet at the joint, in both of its spirals
    wrench : (m, 6) S^T K (y + y.D.y), force and moment at the joint, N and N m
    by_pose : (m, 6, 12) derivatives of y by the increments
    wrench_by_design : (m, 2, 3, 6) derivatives of the wrench by the parameters, at a fixed pose; axis 1: side
    wrench_by_pose : (m, 6, 12) derivatives of the wrench by the increments
    at_joint : (m, 6, 6) K
    linear : (m, 6) first-order wrench K y; equal to ``wrench`` without D
    linear_by_design : (m, 2, 3, 6) derivatives of ``linear`` by the parameters
    turn : (m, 3) rotation vector of the second hub relative to the first, radians
    turned : (m, 2, 3) mixed second derivatives of the energy by the twist on either side and by ``turn``, as far as
        they come from the motion of the bend points
    inner : (m, 6) K (y + y.D.y)
    across : (m, 6, 6) S^T K
    tangent : (m, 6, 6) derivative of the wrench by y
    """

    sides: Int[np.ndarray, "joints 2"]
    wrench: Float[np.ndarray, "joints 6"]
    by_pose: Float[np.ndarray, "joints 6 12"]
    wrench_by_design: Float[np.ndarray, "joints 2 parameters 6"]
    wrench_by_pose: Float[np.ndarray, "joints 6 12"]
    at_joint: Float[np.ndarray, "joints 6 6"]
    linear: Float[np.ndarray, "joints 6"]
    linear_by_design: Float[np.ndarray, "joints 2 parameters 6"]
    turn: Float[np.ndarray, "joints 3"]
    turned: Float[np.ndarray, "joints 2 3"]
    inner: Float[np.ndarray, "joints 6"]
    across: Float[np.ndarray, "joints 6 6"]
    tangent: Float[np.ndarray, "joints 6 6"]

    @classmethod
    def from_assembly(
        cls,
        assembly: Assembly,
        by: Float[np.ndarray, "joints 2 numbers 6 6"],
        at_joint: np.ndarray,
        offset: np.ndarray,
        motion: JointMotion,
        curving: np.ndarray | None = None,
    ) -> JointDerivatives:
        """Differentiate the motions and wrenches of joints in one pose.

        Parameters
        ----------
        assembly, at_joint, offset : as in ``ArmModel``
        by : derivatives of the compliances, as in ``ArmCompliances``
        motion : of the joints, in this pose
        curving : (m, 6, 6, 6) second-order term D; None leaves it out
        """
        turn, base = motion.turn, motion.middle
        angle = np.linalg.norm(turn, axis=1)
        shift = motion.shift + np.cross(offset, turn)
        strains = np.concatenate([shift, turn], axis=1)
        slope, tangent, linear = np.eye(6)[None], at_joint, matvec(at_joint, strains)
        if curving is not None:
            strains, slope = add_second_order(strains, curving)
        inner, across = matvec(at_joint, strains), np.swapaxes(slope, 1, 2) @ at_joint
        if curving is not None:
            tangent = across @ slope + 2.0 * contract_with_wrench(inner, curving)
        wrench = matvec(across, strains)
        spread = np.zeros((len(base), 6, 6))
        spread[:, :3, :3] = spread[:, 3:, 3:] = np.swapaxes(base, 1, 2)
        by_pose = spread @ first_order(SpatialMotion.from_joints(motion))
        by_pose[:, :3] += skew(offset) @ by_pose[:, 3:]
        turned = np.zeros((len(turn), 2, 3))
        changes = -motion_by_parameters(assembly, by, inner) @ np.swapaxes(across, 1, 2)[:, None]
        first = changes if curving is None else -motion_by_parameters(assembly, by, linear) @ at_joint[:, None]
        for side in (0, 1):
            sign = 1.0 if side == 0 else -1.0
            moved, found = _bend_shift(-sign * turn, angle, _way_by_twist(assembly, side), wrench[:, :3])
            changes[:, side, TWIST] += sign * matvec(tangent[..., :3], moved)
            if curving is not None:
                first[:, side, TWIST] += sign * matvec(at_joint[..., :3], moved)
            turned[:, side] = -found
        known = (assembly.sides, wrench, by_pose, changes, tangent @ by_pose)
        return cls(*known, at_joint, linear, first, turn, turned, inner, across, tangent)

    def force_by_design(self, direction: Float[np.ndarray, "joints 12"]) -> Float[np.ndarray, "joints 2 5"]:
        """Return ``gradient_by_design`` times ``direction``, the increments (m, 12) of both hubs: (m, 2, 5)."""
        along = matvec(self.by_pose, direction)
        out = matvec(self.wrench_by_design, along[:, None])
        out[:, :, TWIST] += matvec(self.turned, along[:, 3:])
        return spread_over_design(out, self.sides)

    @property
    def gradient_by_design(self) -> Float[np.ndarray, "joints 12 2 5"]:
        """Derivatives of every joint's contribution to the energy's gradient by widths and twists of both spirals.

        Axes: joint; increments of both hubs (6 each); side of the joint; the spiral's four widths, then its twist.
        """
        m = len(self.wrench)
        out = (self.wrench_by_design.reshape(m, -1, 6) @ self.by_pose).reshape(m, 2, PARAMETERS, 12)
        out[:, :, TWIST] += self.turned @ self.by_pose[:, 3:]
        return spread_over_design(out, self.sides).transpose(0, 3, 1, 2)


def motion_by_parameters(
    assembly: Assembly, by: Float[np.ndarray, "joints 2 numbers 6 6"], wrench: Float[np.ndarray, "joints 6"]
) -> Float[np.ndarray, "joints 2 parameters 6"]:
    """Return the derivatives, by the ``PARAMETERS``, of the joints' motions under constant wrenches.

    They are the derivatives of the compliances times the wrench. Axes: joint; side; parameter; component of the motion.

    Parameters
    ----------
    assembly, by : as in ``JointDerivatives.from_assembly``
    wrench : (m, 6) force and moment at the joint, in the joint's axes
    """
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
    direction: Float[np.ndarray, "joints 12"],
    curving: np.ndarray | None = None,
) -> Float[np.ndarray, "joints 2 5"]:
    """Differentiate every joint's convex energy by the widths and twists of both spirals, at a fixed pose.

    The convex energy is r.K.r, where r is the derivative of the joint's strains along ``direction``.

    Parameters
    ----------
    assembly, by, at_joint, offset, motion, curving : as in ``JointDerivatives.from_assembly``
    direction : (m, 12) increments of both hubs (6 each)

    Returns
    -------
    (m, 2, 5) : derivatives; axis 1: side of the joint; axis 2: the spiral's four widths (per metre), then its twist
        (per radian)
    """
    turn, base = motion.turn, motion.middle
    angle = np.linalg.norm(turn, axis=1)
    rates = matvec(first_order(SpatialMotion.from_joints(motion)), direction).reshape(-1, 2, 3) @ base
    rates = np.concatenate([rates[:, 0] + np.cross(offset, rates[:, 1]), rates[:, 1]], axis=1)
    slope = np.eye(6)[None]
    if curving is not None:
        slope = add_second_order(np.concatenate([motion.shift + np.cross(offset, turn), turn], axis=1), curving)[1]
    inner = matvec(at_joint, matvec(slope, rates))
    found = -matvec(motion_by_parameters(assembly, by, inner), inner[:, None])
    force = matvec(np.swapaxes(slope, 1, 2), inner)[:, :3]
    for side, sign in ((0, 1.0), (1, -1.0)):
        moved, bent = _bend_shift(-sign * turn, angle, _way_by_twist(assembly, side), force)
        found[:, side, TWIST] -= 2.0 * (bent * rates[:, 3:]).sum(axis=1)
        if curving is not None:
            found[:, side, TWIST] += (
                4.0 * sign * (matvec(contract_with_wrench(inner, curving)[:, :3], rates) * moved).sum(axis=1)
            )
    return spread_over_design(found, assembly.sides)


def spread_over_design(changes: np.ndarray, sides: Int[np.ndarray, "joints 2"]) -> np.ndarray:
    """Convert derivatives by the joints' parameters to derivatives (m, 2, 5, ...) by widths and twists of both spirals.

    Axis 2 of the result counts the four widths of the spiral on this side, then its twist.

    Parameters
    ----------
    changes : (m, 2, 3, ...) derivatives by the ``PARAMETERS`` of either side
    sides : (m, 2) indices (0 to 3) of the arms that meet at the joint, in both of its spirals
    """
    out = np.zeros((*changes.shape[:2], 5, *changes.shape[3:]))
    every = np.arange(len(sides))[:, None], [0, 1]
    out[(*every, sides)] = changes[:, :, WIDTH]
    for step in (1, -1):
        out[(*every, (sides + step) % 4)] = 0.5 * changes[:, :, BESIDE]
    out[:, :, 4] = changes[:, :, TWIST]
    return out


def arm_loads(
    assembly: Assembly, wrench: Float[np.ndarray, "joints 6"], linear: Float[np.ndarray, "joints 6"], turn: np.ndarray
) -> Float[np.ndarray, "joints 2 15"]:
    """Return the loads on both arms of m joints in the arms' own axes, in the columns of ``bar_loads``.

    Parameters
    ----------
    assembly : with m joints
    wrench, linear, turn : of the joints, as in ``JointDerivatives``
    """
    vectors = np.stack([wrench, linear, np.concatenate([np.zeros_like(turn), turn], axis=1)], axis=1)
    own = (vectors[:, None] @ assembly.arm_axes).reshape(len(turn), 2, -1)
    return SENSES[:, None] * own[..., [*range(12), 15, 16, 17]]


def _way_by_twist(assembly: Assembly, side: int) -> Float[np.ndarray, "joints 3"]:
    """Return the derivatives (m, 3), by the twist, of the vectors from the arms' bend points to the joints.

    side : of the joints, on which the arms are (0 or 1); the vectors are in the joints' axes
    """
    change = assembly.bend_points[1][:, side]
    way = change[:, :1] * assembly.lever[:, side] + change[:, 1:] * assembly.lever_normals[:, side]
    return -np.einsum("eji,ej->ei", assembly.axes[:, side], way)


def _bend_shift(
    turn: Float[np.ndarray, "joints 3"], angle: np.ndarray, vector: np.ndarray, force: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return A(turn) vector, and the derivatives of force . A(turn) vector by the turn, both (m, 3).

    The matrix A is defined in this module's docstring; angle : (m,) length of ``turn``
    """
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
    once = np.cross(turn, vector)
    twice = np.cross(turn, once)
    pulled, pulled_twice = ((force * v).sum(axis=1, keepdims=True) for v in (once, twice))
    along_way, along_force = ((turn * v).sum(axis=1, keepdims=True) for v in (vector, force))
    gradient = (
        first * np.cross(vector, force)
        + pulled * by_first * turn
        + second * (force * along_way + vector * along_force - 2.0 * turn * (force * vector).sum(axis=1, keepdims=True))
        + pulled_twice * by_second * turn
    )
    return first * once + second * twice, gradient

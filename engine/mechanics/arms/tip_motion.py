"""Motions of the tips of both arms of every joint relative to their hubs, with exact derivatives.

The place of the joint at rest can be fixed to the first hub or to the second. When the hubs move, these two points
separate: the motion y of the joint is that of the second point relative to the first, in the axes half way between both
hubs. Both arms, of compliances C_a and C_b, carry the wrench K y, with K = (C_a + C_b)^-1. So in these axes the tip of
the first arm moves by C_a K y and the tip of the second by -C_b K y, to the same point. The axes of a hub differ from
the half-way axes by half of the joint's turn, so the shifts are rotated by this half turn to the axes of the hub.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Float
from ..assembly import Assembly, Pose
from ..vectors import matvec, right_jacobian, rotation_matrix, skew
from .cut import BESIDE, MATE_TWIST, MATE_WIDTH, TWIST, WIDTH
from .joint_motion import JointMotion, SpatialMotion, first_order, joint_motion
from .sensitivity import PARAMETERS, spread_over_design


@dataclass(frozen=True, eq=False)
class TipMotions:
    """Motions of both tips of m joints relative to their hubs, each in the flat frame of its own hub's patch.

    values : (m, 2, 6) shifts (3, metres) and turns (3, radians)
    by_pose : (m, 2, 6, 12) derivatives by the increments of both hubs (6 each)
    by_design : (m, 2, 6, 2, 5) derivatives by the spirals on both sides of the joint (axis 3): their four widths, then
        the twist (axis 4)
    """

    values: Float[np.ndarray, "joints 2 6"]
    by_pose: Float[np.ndarray, "joints 2 6 12"]
    by_design: Float[np.ndarray, "joints 2 6 2 5"]

    @classmethod
    def from_assembly(
        cls,
        assembly: Assembly,
        compliance: Float[np.ndarray, "joints 2 6 6"],
        by: Float[np.ndarray, "joints 2 numbers 6 6"],
        stiffness: Float[np.ndarray, "joints 6 6"],
        pose: Pose,
    ) -> TipMotions:
        """Compute the motions with their derivatives by pose and design.

        Parameters
        ----------
        assembly, pose : m joints, and where their hubs are
        compliance, by : tip compliances of the arms and their derivatives: ``values`` and ``by`` of ``ArmCompliances``
        stiffness : of the joints, as ``ArmModel.at_joint``
        """
        motion, m, axes = _motion(assembly, pose), len(assembly.pairs), assembly.arm_axes
        values, by_pose, by_design = np.empty((m, 2, 6)), np.empty((m, 2, 6, 12)), np.empty((m, 2, 6, 2, 5))
        wrench = matvec(stiffness, motion.vector)
        back = np.zeros((m, 6, 6))
        back[:, :3, :3] = back[:, 3:, 3:] = np.swapaxes(motion.middle, 1, 2)
        motion_by_pose = back @ first_order(SpatialMotion.from_joints(motion))
        # derivatives of compliance @ wrench at constant wrench, for both arms
        own = np.swapaxes(axes, 2, 3) @ wrench[:, None, :, None]
        yields = np.einsum("esij,eskjl->eski", axes, by @ own[:, :, None])
        # derivatives of compliance @ wrench at constant wrench; axes: joint, arm, spiral to which the parameter
        # belongs, parameter, component of the motion
        both = np.zeros((m, 2, 2, PARAMETERS, 6))
        for side in (0, 1):
            both[:, side, side] = yields[:, side][:, [WIDTH, TWIST, BESIDE]]
            both[:, side, 1 - side, [WIDTH, TWIST]] = yields[:, side][:, [MATE_WIDTH, MATE_TWIST]]
        for side, sign in ((0, 1.0), (1, -1.0)):
            share = sign * (axes[:, side] @ compliance[:, side] @ np.swapaxes(axes[:, side], 1, 2)) @ stiffness
            moved = matvec(share, motion.vector)
            by_arms = sign * both[:, side] - matvec(share[:, None, None], both.sum(axis=1))
            half = 0.5 * sign * motion.turn
            turn = rotation_matrix(half)
            frame = np.zeros((m, 6, 6))
            frame[:, :3, :3], frame[:, 3:, 3:] = assembly.axes[:, side] @ turn, assembly.axes[:, side]
            values[:, side] = matvec(frame, moved)
            by_pose[:, side] = frame @ share @ motion_by_pose
            # the shift is rotated by half of the joint's turn; this is the derivative of the rotated shift by the turn
            swing = -0.5 * sign * (frame[:, :3, :3] @ skew(moved[:, :3]) @ right_jacobian(half))
            by_pose[:, side, :3] += swing @ motion_by_pose[:, 3:]
            by_design[:, side] = spread_over_design(matvec(frame[:, None, None], by_arms), assembly.sides).transpose(
                0, 3, 1, 2
            )
        return cls(values, by_pose, by_design)


def tip_motions(
    assembly: Assembly,
    compliance: Float[np.ndarray, "joints 2 6 6"],
    stiffness: Float[np.ndarray, "joints 6 6"],
    pose: Pose,
) -> Float[np.ndarray, "joints 2 6"]:
    """Compute ``TipMotions.values``, without derivatives.

    Parameters
    ----------
    assembly, compliance, stiffness, pose : as in ``TipMotions.from_assembly``

    Returns
    -------
    (m, 2, 6) : metres and radians
    """
    motion, axes, sign = _motion(assembly, pose), assembly.arm_axes, np.array([1.0, -1.0])[:, None]
    own = (np.swapaxes(axes, 2, 3) @ matvec(stiffness, motion.vector)[:, None, :, None])[..., 0]
    moved = sign * matvec(axes, matvec(compliance, own))
    shift = matvec(rotation_matrix(0.5 * sign * motion.turn[:, None]), moved[..., :3])
    return np.concatenate([matvec(assembly.axes, shift), matvec(assembly.axes, moved[..., 3:])], axis=2)


def _motion(assembly: Assembly, pose: Pose) -> JointMotion:
    """Return the motions of the joints, measured at the joint (see the module's docstring) and not at bend points."""
    return joint_motion(pose, assembly.pairs, assembly.lever, assembly.axes, np.zeros((len(assembly.pairs), 3)))

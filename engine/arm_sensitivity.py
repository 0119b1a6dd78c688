"""How the forces of the arm model change with the widths and twists of the spirals, at a fixed pose.

With the motion y of a joint, y = T x, and the wrench n = K y there, K = (C_a + C_b)^-1, the energy y.K.y / 2 changes with
a parameter of one arm by -n.C' n / 2, and, because the bend points move with the twist, by n_force.Y', where

    Y' = A(-turn) beta' for the first arm, -A(turn) beta' for the second,  A(turn) = e^(turn/2) - 1 - turn x / 2,

and beta is the way from an arm's bend point to the joint in the joint's axes. The derivatives by the pose follow.
"""

from __future__ import annotations

import numpy as np

from .arm_bend import bend_point
from .assembly import Assembly
from .joint_motion import JointMotion, SpatialMotion, cross, first_order, times
from .stiffness import ArmCompliance

WIDTH, TWIST = 0, 1


def gradient_by_design(
    assembly: Assembly, compliance: ArmCompliance, at_joint: np.ndarray, offset: np.ndarray, motion: JointMotion
) -> np.ndarray:
    """(m, 12, 2, 2): derivative of every joint's gradient by the width (per metre) and twist (per radian) of both spirals.

    Rows as in ``Expansion.hessian``; then the side of the joint; then width, twist. Arguments as in ``ArmModel``.
    """
    turn, base = motion.turn, motion.middle
    angle = np.linalg.norm(turn, axis=1)
    shift = motion.shift + np.cross(offset, turn)
    wrench = times(at_joint, np.concatenate([shift, turn], axis=1))
    force = wrench[:, :3]
    out = np.zeros((len(turn), 12, 2, 2))
    # derivatives of the joint's motion by the pose, in the axes of the half-way frame
    by_pose = first_order(SpatialMotion.of(motion))
    spread = np.zeros((len(base), 6, 6))
    spread[:, :3, :3] = spread[:, 3:, 3:] = np.swapaxes(base, 1, 2)
    by_pose = spread @ by_pose
    by_pose[:, :3] += cross(offset) @ by_pose[:, 3:]
    back = np.swapaxes(by_pose, 1, 2)
    stiff = back @ at_joint
    axes = assembly.arm_axes
    for side in (0, 1):
        own = times(np.swapaxes(axes[:, side], 1, 2), wrench)
        for k, change in ((WIDTH, compliance.by_width), (TWIST, compliance.by_twist)):
            out[:, :, side, k] = -times(stiff, times(axes[:, side], times(change[:, side], own)))
        way = _way_by_twist(assembly, side)
        sign = 1.0 if side == 0 else -1.0
        moved, turned = _second_bend(-sign * turn, angle, way, force)
        out[:, :, side, TWIST] += times(stiff[:, :, :3], sign * moved)
        out[:, :, side, TWIST] += times(back[:, :, 3:], -turned)
    return out


def _way_by_twist(assembly: Assembly, side: int) -> np.ndarray:
    """(m, 3) metres per radian: how the way from the bend point to the joint changes, in the joint's axes."""
    change = bend_point(assembly.twist)[1][assembly.pairs[:, side]]
    lever = assembly.lever[:, side]
    left = np.cross([0.0, 0.0, 1.0], lever) * (-1.0 if assembly.clockwise else 1.0)
    return -np.einsum("eji,ej->ei", assembly.axes[:, side], change[:, :1] * lever + change[:, 1:] * left)


def _second_bend(
    turn: np.ndarray, angle: np.ndarray, way: np.ndarray, force: np.ndarray
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

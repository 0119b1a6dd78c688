"""Rows and rings of spirals, and poses of them, for tests of the mechanics."""

from __future__ import annotations

import numpy as np
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.mechanics.arms.compliances import arm_compliances
from flexmaps.engine.mechanics.assembly import Assembly, Pose
from flexmaps.engine.mechanics.loads import Loads
from flexmaps.engine.spirals.curves.spiral import same_width
from scipy.spatial.transform import Rotation

SPACING, WIDTH, THICKNESS = 0.02, 0.0025, 0.0015
VERO = MATERIALS["vero"]


def row(count: int, *, twist: float = 0.0, closed: bool = False, clockwise: bool = False) -> Assembly:
    """Spirals in squares side by side along x; ``closed`` joins the last to the first."""
    first = np.arange(count if closed else count - 1)
    pairs = np.stack([first, (first + 1) % count], axis=1)
    lever = np.zeros((len(pairs), 2, 3))
    lever[:, 0, 0], lever[:, 1, 0] = 0.5 * SPACING, -0.5 * SPACING
    axes = np.broadcast_to(np.eye(3), (len(pairs), 2, 3, 3))
    full = np.full(count, 1.0)
    sides = np.tile([1, 3], (len(pairs), 1))
    return Assembly(pairs, sides, lever, axes, same_width(WIDTH * full), twist * full, THICKNESS, clockwise)


def at_joints(assembly: Assembly) -> np.ndarray:
    """(m, 6, 6) compliance of both arms of every joint in series, in the joint's axes."""
    axes = assembly.arm_axes
    return (axes @ arm_compliances(assembly, VERO).values @ np.swapaxes(axes, 2, 3)).sum(axis=1)


def straight(count: int) -> Pose:
    centres = np.zeros((count, 3))
    centres[:, 0] = SPACING * np.arange(count)
    return Pose(centres, np.broadcast_to(np.eye(3), (count, 3, 3)).copy())


def ring(count: int) -> Pose:
    """Hubs on a circle, their normals outwards."""
    angle = 2.0 * np.pi * np.arange(count) / count
    radius = SPACING * count / (2.0 * np.pi)
    turns = Rotation.from_rotvec(np.outer(angle, [0.0, 1.0, 0.0])).as_matrix()
    return Pose(radius * np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=1), turns)


def shaken(pose: Pose, shift: float, turn: float, seed: int = 0) -> Pose:
    noise = np.random.default_rng(seed).normal(size=(len(pose.centres), 6))
    return pose.moved(noise * np.repeat([shift, turn], 3))


def free(count: int) -> Loads:
    return Loads.for_spirals(count)

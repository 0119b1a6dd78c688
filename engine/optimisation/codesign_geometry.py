"""How the flat rest shape of the patches enters an elastic model, and how its forces change with it.

A spiral's flat quad matters for the equilibrium only through the ways from its centre to its joints and the directions of
the edges there: three numbers for either side of a joint. By those what happens in the joints is derived with central
differences, all joints at once; from the flat vertices to those numbers it is geometry.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.sparse import coo_array, csr_array

from ..arrays import Float
from ..mechanics.arms.model import ArmModel
from ..mechanics.assembly import Assembly, Pose
from ..patches.layout import PatchLayout

STEP = 3e-5  # of the central differences, in radii and radians: what cutting off and rounding cost is alike


def by_geometry(
    model: ArmModel, pose: Pose, measure: Callable[[ArmModel, Pose], np.ndarray]
) -> Float[np.ndarray, "joints r 2 3"]:
    """(m, r, 2, 3): derivative of r quantities of every joint by the rest geometry of its sides, at a fixed pose; a rim's stays.

    By the side of the joint, then x and y of its lever (per metre) and the direction of its edge (per radian).
    measure : (m, r) of a model in which every joint has two spirals of its own, and of the pose of those
    """
    model = model.without_rim
    spiral = model.pairs.ravel()
    alone, placed = model.varied(_taken_apart(model.assembly)), Pose(pose.centres[spiral], pose.rotations[spiral])
    parts = []
    for side in (0, 1):
        for k in range(3):
            step = STEP * alone.assembly.radius[:, side] if k < 2 else np.full(len(alone.pairs), STEP)
            ahead, behind = (
                measure(alone.varied(_changed(alone.assembly, side, k, sign * step)), placed) for sign in (1.0, -1.0)
            )
            parts.append((ahead - behind) / (2.0 * step[:, None]))
    return np.stack(parts, axis=2).reshape(*parts[0].shape, 2, 3)


def _taken_apart(assembly: Assembly) -> Assembly:
    """Every joint with two spirals of its own, so that what a model finds of the spirals is that of each joint."""
    spiral = assembly.pairs.ravel()
    pairs = np.arange(len(spiral)).reshape(-1, 2)
    return replace(assembly, pairs=pairs, width=assembly.width[spiral], twist=assembly.twist[spiral])


def _changed(assembly: Assembly, side: int, k: int, step: np.ndarray) -> Assembly:
    """With x, y or the direction of the edge (k = 0, 1, 2) of one side of all joints changed by (m,)."""
    if k < 2:
        lever = assembly.lever.copy()
        lever[:, side, k] += step
        return assembly.reshaped(lever, assembly.axes)
    axes, (cosine, sine) = assembly.axes.copy(), (np.cos(step)[:, None], np.sin(step)[:, None])
    x, y = axes[:, side, 0].copy(), axes[:, side, 1].copy()
    axes[:, side, 0], axes[:, side, 1] = cosine * x - sine * y, sine * x + cosine * y
    return assembly.reshaped(assembly.lever, axes)


def geometry_by_points(layout: PatchLayout, points: np.ndarray) -> csr_array:
    """(6 m, 2 P): derivative of the joints' rest geometry by the flat vertices (P, 2) in metres.

    Rows in the order joint, side, then as the last axis of ``by_geometry``; columns in the order vertex, x, y.
    """
    mesh = layout.mesh
    inner = ~mesh.border
    quad, side = mesh.edge_quads[inner].ravel(), mesh.edge_sides[inner].ravel()
    first = 3 * np.arange(len(quad))[:, None]
    corner = layout.flat_corners[quad]
    nth = (np.arange(4) - side[:, None]) % 4
    # the middle of the side less the middle of the quad
    share = np.where(nth < 2, 0.25, -0.25)
    start, end = (np.take_along_axis(corner, (side[:, None] + i) % 4, 1)[:, 0] for i in (0, 1))
    along = points[end] - points[start]
    turn = np.stack([-along[:, 1], along[:, 0]], axis=1) / (along**2).sum(axis=1, keepdims=True)
    both = np.broadcast_arrays(first + 2, turn, 2 * end[:, None] + np.arange(2), 2 * start[:, None] + np.arange(2))
    rows, cols, values = (
        [np.broadcast_to(first, share.shape), np.broadcast_to(first + 1, share.shape), both[0], both[0]],
        [2 * corner, 2 * corner + 1, both[2], both[3]],
        [share, share, turn, -turn],
    )
    entries = tuple(np.concatenate([part.ravel() for part in parts]) for parts in (values, rows, cols))
    return coo_array((entries[0], entries[1:]), shape=(3 * len(quad), points.size)).tocsr()

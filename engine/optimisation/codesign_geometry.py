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
from ..mechanics.assembly import Assembly, Nodes, Pose
from ..mechanics.rim import RimJoints
from ..patches.layout import PatchLayout

STEP = 3e-5  # of the central differences, in radii and radians: what cutting off and rounding cost is alike


def by_geometry(
    model: ArmModel, pose: Pose, measure: Callable[[ArmModel, Pose], np.ndarray]
) -> Float[np.ndarray, "joints r 2 3"]:
    """(m, r, 2, 3): derivative of r quantities of every joint by the rest geometry of its sides, at a fixed pose.

    By the side of the joint, then x and y of its lever (per metre) and the direction of its edge (per radian). The joints are those between
    spirals and, behind them, those of arms at the border with a rim, of which nothing on the rim's side counts.
    measure : (m, r) of a model in which every joint has two spirals of its own, and of the pose of those
    """
    model = model.without_strips
    assembly, placed = _taken_apart(model.assembly, pose.whole)
    alone = model.varied(assembly)
    parts = []
    for side in (0, 1):
        for k in range(3):
            step = STEP * alone.assembly.radius[:, side] if k < 2 else np.full(len(alone.pairs), STEP)
            ahead, behind = (
                measure(alone.varied(_changed(alone.assembly, side, k, sign * step)), placed) for sign in (1.0, -1.0)
            )
            parts.append((ahead - behind) / (2.0 * step[:, None]))
    return np.stack(parts, axis=2).reshape(*parts[0].shape, 2, 3)


def _taken_apart(assembly: Assembly, pose: Pose) -> tuple[Assembly, Pose]:
    """Every joint with two spirals of its own, so that what a model finds of the spirals is that of each joint, and their pose.

    The nodes of a rim come behind all spirals, as in ``Assembly.whole``.
    """
    inner, ties = assembly.pairs[: assembly.inner], assembly.pairs[assembly.inner :]
    body = np.concatenate([inner.ravel(), ties[:, 0], ties[:, 1]])
    hubs = np.arange(inner.size, inner.size + len(ties))
    pairs = np.concatenate([np.arange(inner.size).reshape(-1, 2), np.stack([hubs, hubs + len(ties)], axis=1)])
    rim = None if assembly.rim is None else replace(assembly.rim, hub=hubs)
    alone = replace(assembly, pairs=pairs, width=assembly.width[body], twist=assembly.twist[body], rim=rim)
    placed = Pose(pose.centres[body], pose.rotations[body])
    if rim is None:
        return alone, placed
    own, nodes = (
        Pose(placed.centres[part], placed.rotations[part]) for part in (np.s_[: alone.spirals], np.s_[alone.spirals :])
    )
    return alone, replace(own, nodes=Nodes.of(own, hubs, nodes))


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


def geometry_by_points(layout: PatchLayout, points: np.ndarray, rim: RimJoints | None = None) -> csr_array:
    """(6 m, 2 P): derivative of the joints' rest geometry by the flat vertices (P, 2) in metres.

    Rows in the order joint, side, then as the last axis of ``by_geometry``; columns in the order vertex, x, y. The rim itself stays, so
    that its joints' second sides have rows of zeros.
    """
    mesh = layout.mesh
    inner = ~mesh.border
    quad, side = mesh.edge_quads[inner].ravel(), mesh.edge_sides[inner].ravel()
    first, joints = np.arange(len(quad)), len(quad) // 2
    if rim is not None:
        first = np.concatenate([first, len(quad) + 2 * np.arange(len(rim.hub))])
        quad, side, joints = np.append(quad, rim.hub), np.append(side, rim.side), joints + len(rim.hub)
    first = 3 * first[:, None]
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
    return coo_array((entries[0], entries[1:]), shape=(6 * joints, points.size)).tocsr()

"""Derivatives of an elastic model's joints with respect to the flat rest shape of the patches.

A spiral's flat quad affects the equilibrium only through the levers from its centre to its joints and the directions of
the edges there: three numbers for each side of a joint, its rest geometry. The derivatives of these numbers with
respect to the flat vertices are exact, and so are most derivatives with respect to these numbers
(``mechanics.arms.rest_geometry``); only the derivatives of soft modes are central differences, computed for all joints
at once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.sparse import coo_array, csr_array

from ..arrays import Float
from ..mechanics.arms.curving_changes import with_rest_change
from ..mechanics.arms.model import ArmModel
from ..mechanics.assembly import Assembly, Pose, RimNodes
from ..mechanics.rim_bodies import RimJoints
from ..patches.layout import PatchLayout

# Step of the central differences, in arm radii and radians. Smaller: rounding errors; larger: truncation errors
STEP = 3e-5


def joint_derivatives(
    model: ArmModel, pose: Pose, measure: Callable[[ArmModel, Pose], np.ndarray]
) -> Float[np.ndarray, "joints r 2 3"]:
    """Return the derivatives of r quantities of every joint with respect to its rest geometry, at a fixed pose.

    Parameters
    ----------
    model, pose : of the whole piece
    measure : function from a model in which every joint has two spirals of its own, and their pose, to quantities (m,
        r)

    Returns
    -------
    Derivatives (m, r, 2, 3): the third axis is the side of the joint, the last axis x and y of its lever (per metre)
    and the direction of its edge (per radian). Joints between spirals come first, then joints of border arms with a
    rim, where the values of the rim's side have no meaning.
    """
    model = model.without_strips
    assembly, placed = _separate_joints(model.assembly, pose.whole)
    alone = model.with_rest_geometry(assembly)
    parts = []
    for side in (0, 1):
        for k in range(3):
            step = STEP * alone.assembly.radius[:, side] if k < 2 else np.full(len(alone.pairs), STEP)
            ahead, behind = (
                measure(alone.with_rest_geometry(with_rest_change(alone.assembly, side, k, sign * step)), placed)
                for sign in (1.0, -1.0)
            )
            parts.append((ahead - behind) / (2.0 * step[:, None]))
    return np.stack(parts, axis=2).reshape(*parts[0].shape, 2, 3)


def _separate_joints(assembly: Assembly, pose: Pose) -> tuple[Assembly, Pose]:
    """Copy the spirals so that every joint has two of its own and a change of a side affects this joint only.

    Return the assembly and pose of the copies; the nodes of a rim follow all spirals, as in ``Assembly.whole``.
    """
    inner, ties = assembly.pairs[: assembly.n_inner_joints], assembly.pairs[assembly.n_inner_joints :]
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
    return alone, replace(own, nodes=RimNodes.from_poses(own, hubs, nodes))


def geometry_jacobian(layout: PatchLayout, points: np.ndarray, rim: RimJoints | None = None) -> csr_array:
    """Return the derivatives of the joints' rest geometry with respect to the flat vertices.

    Parameters
    ----------
    layout, points : the patches and their flat vertices (P, 2), metres
    rim : the joints of border arms with a rim, if there is a rim

    Returns
    -------
    Derivatives (6 m, 2 P); rows in the order joint, side, last axis of ``joint_derivatives``; columns in the order
    vertex, then x and y. The rim does not move, so the rows of its sides are 0.
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
    # a lever is the midpoint of the edge (two corners, 1/2 each) minus the centre of the quad (four corners, 1/4 each)
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

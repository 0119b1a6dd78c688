"""Find the spiral under the mouse, on the live shape if it is drawn, else on the object's mesh."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
import numpy as np

from ...engine.arrays import Float, Int
from ..store import attributes, shape_keys, vertex_positions
from ..store.columns import column

if TYPE_CHECKING:
    from mathutils import Vector

    from ...engine.extras.live.live_piece import LiveEquilibrium


def visible_surface(
    obj: bpy.types.Object, shape: LiveEquilibrium | None = None
) -> tuple[Float[np.ndarray, "vertices 3"], Int[np.ndarray, "quads 4"]]:
    """Return the visible surface: vertices in the scene's units and world axes, and quads.

    There are no quads if the mesh has other faces.

    Parameters
    ----------
    obj : the mesh object
    shape : live shape that is drawn for the object, or None
    """
    if (
        shape is not None
        and shape.vertices is not None
        and shape.quads is not None
        and len(shape.quads) == len(obj.data.polygons)
    ):
        return shape.vertices / bpy.context.scene.unit_settings.scale_length, shape.quads
    with attributes.readable_mesh(obj) as mesh:
        points = shape_keys.simulated_positions(mesh) if obj.data.is_editmode else vertex_positions.read_displayed(obj)
        corners = column(mesh.loops, "vertex_index")
        whole = len(mesh.loops) == 4 * len(mesh.polygons)
    return _to_world(obj, points), corners.reshape(-1, 4) if whole else np.zeros((0, 4), np.int32)


def target_vertices(obj: bpy.types.Object) -> Float[np.ndarray, "vertices 3"]:
    """Return the target's vertices in the scene's units and world axes."""
    if not obj.data.is_editmode:
        return _to_world(obj, vertex_positions.read_target(obj))
    with attributes.readable_mesh(obj) as mesh:
        return _to_world(obj, column(mesh.vertices, "co"))


def _to_world(obj: bpy.types.Object, points: Float[np.ndarray, "vertices 3"]) -> Float[np.ndarray, "vertices 3"]:
    matrix = np.array(obj.matrix_world)
    return points.astype(float) @ matrix[:3, :3].T + matrix[:3, 3]


def hit_quad(
    points: Float[np.ndarray, "vertices 3"], quads: Int[np.ndarray, "quads 4"], origin: Vector, direction: Vector
) -> int | None:
    """Return the index of the first quad that a ray hits; None if it misses.

    Parameters
    ----------
    points, quads : the surface, from ``visible_surface``
    origin, direction : start and direction of the ray
    """
    from mathutils.bvhtree import BVHTree

    tree = BVHTree.FromPolygons(points.tolist(), quads.tolist())
    hit = tree.ray_cast(origin, direction)
    return None if hit[2] is None else int(hit[2])


def median_edge(obj: bpy.types.Object) -> float:
    """Return the target's median edge length in the scene's units; a force arrow of one newton has this length."""
    with attributes.readable_mesh(obj) as mesh:
        pairs = column(mesh.edges, "vertices")
    points = target_vertices(obj)[pairs]
    return max(float(np.median(np.linalg.norm(points[:, 1] - points[:, 0], axis=1))), 1e-12)

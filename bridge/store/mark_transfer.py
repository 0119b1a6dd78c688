"""Transfer the user's marks from a mesh to the quads that replace it: vertex groups, held or protected quads, seams."""

from __future__ import annotations

from itertools import pairwise

import bpy
import numpy as np
from mathutils import Vector
from mathutils.bvhtree import BVHTree

from ...engine.arrays import Float, Int
from . import attributes, handles, stored_report, vertex_positions
from .columns import column

MIN_WEIGHT = 0.5  # least interpolated weight at which a new vertex joins a vertex group; larger shrinks groups


def transfer_marks(old: bpy.types.Object, new: bpy.types.Object) -> None:
    """Transfer the user's marks to the object that replaces another; both must coincide in their own frames.

    Parameters
    ----------
    old : the object that is replaced
    new : the object of quads that replaces it
    """
    if not len(old.data.polygons) or not len(new.data.polygons):
        return
    old_positions = vertex_positions.read_target(old)  # the surface from which the new quads were made
    tree = BVHTree.FromPolygons(old_positions.tolist(), [tuple(face.vertices) for face in old.data.polygons])
    for group in old.vertex_groups:
        _transfer_group(old, new, group, tree, old_positions)
    _transfer_face_marks(old, new, tree)
    if "layout" not in stored_report.read(old.data):  # only seams marked by hand; seams of a layout are computed anew
        _transfer_seams(old, new, old_positions)


def _transfer_group(
    old: bpy.types.Object,
    new: bpy.types.Object,
    group: bpy.types.VertexGroup,
    tree: BVHTree,
    points: Float[np.ndarray, "vertices 3"],
) -> None:
    weights = np.zeros(len(old.data.vertices))
    for vertex in old.data.vertices:
        weights[vertex.index] = max((g.weight for g in vertex.groups if g.group == group.index), default=0.0)
    new_group = new.vertex_groups.get(group.name) or new.vertex_groups.new(name=group.name)
    new_weights = np.array(
        [_interpolate_weight(old.data, vertex.co, weights, tree, points) for vertex in new.data.vertices]
    )
    inside = np.flatnonzero(new_weights >= MIN_WEIGHT)
    if len(inside) < 2 and weights.any():  # the group is smaller than a quad: take the nearest quad
        middle = Vector(points[weights > 0].astype(float).mean(axis=0))
        centres = [(face.center - middle).length for face in new.data.polygons]
        inside = np.array(new.data.polygons[int(np.argmin(centres))].vertices)
    new_group.add(inside.tolist(), 1.0, "REPLACE")


def _interpolate_weight(
    mesh: bpy.types.Mesh,
    point: Vector,
    weights: Float[np.ndarray, " vertices"],
    tree: BVHTree,
    points: Float[np.ndarray, "vertices 3"],
) -> float:
    """Interpolate weights at the surface point nearest to ``point``, from its face's corners by inverse distance."""
    foot, _, face, _ = tree.find_nearest(point)
    if face is None:
        return 0.0
    corners = list(mesh.polygons[face].vertices)
    distances = np.maximum(np.linalg.norm(points[corners] - np.array(foot), axis=1), 1e-12)
    return float((weights[corners] / distances).sum() / (1.0 / distances).sum())


def _transfer_face_marks(old: bpy.types.Object, new: bpy.types.Object, tree: BVHTree) -> None:
    nearest: Int[np.ndarray, " quads"] = np.array([tree.find_nearest(face.center)[2] for face in new.data.polygons])
    for name in (*handles.NAMES, "protect"):
        values = attributes.read_as_stored(old.data, attributes.PREFIX + name)
        if values is not None and values.any() and len(old.data.polygons) == len(values):
            domain, kind, _, _ = attributes.SPECS[name]
            attributes.write(new, attributes.PREFIX + name, domain, kind, values[nearest])


def _transfer_seams(
    old: bpy.types.Object, new: bpy.types.Object, old_positions: Float[np.ndarray, "vertices 3"]
) -> None:
    """Mark seams along the edges of the new quads that are nearest to the old seams."""
    marked = [edge for edge in old.data.edges if edge.use_seam]
    if not marked:
        return
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra
    from scipy.spatial import cKDTree

    points = column(new.data.vertices, "co").astype(float)
    pairs = np.array([tuple(edge.vertices) for edge in new.data.edges])
    lengths = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    nearest, step = cKDTree(points), float(np.median(lengths))
    graph = coo_array((lengths, (pairs[:, 0], pairs[:, 1])), shape=(len(points), len(points)))
    number = {(min(a, b), max(a, b)): k for k, (a, b) in enumerate(pairs.tolist())}
    for edge in marked:
        a, b = (old_positions[k].astype(float) for k in edge.vertices)
        count = max(2, int(np.ceil(np.linalg.norm(b - a) / step)) + 1)
        path = nearest.query(a + np.linspace(0.0, 1.0, count)[:, None] * (b - a))[1]
        for start, end in pairwise(path):
            if start == end:
                continue
            _, previous = dijkstra(graph, directed=False, indices=start, return_predecessors=True, limit=4.0 * step)
            while end != start and previous[end] >= 0:
                new.data.edges[number[min(end, previous[end]), max(end, previous[end])]].use_seam = True
                end = previous[end]

"""Size and quad edge of an object's surface, as a stage would read it; fast enough for every redraw.

Only vertices and edges of faces count, moved by the user's shape keys but not by FlexMaps' own, and with the object's
scale in the world.
"""

from __future__ import annotations

import zlib
from math import sqrt

import bpy
import numpy as np

from ...engine.arrays import Bool, Float
from . import modifiers, shape_keys, vertex_positions
from .columns import column

# Blender's id of a mesh -> its numbers of vertices, edges and corners, and whether it has loose vertices, loose edges
_LOOSE_CACHE: dict[int, tuple[tuple[int, ...], bool, bool]] = {}
# Blender's id of a mesh -> checksum of all that its median edge depends on, and the median edge in Blender units
_EDGE_CACHE: dict[int, tuple[object, float]] = {}


def extents(obj: bpy.types.Object) -> tuple[float, ...]:
    """Return the surface's size in Blender units along the object's own axes, after modifiers that change the surface."""
    mesh = obj.data
    whole = tuple(obj.dimensions)
    if obj.type != "MESH" or not len(mesh.polygons):
        return whole
    # without such modifiers, leave out a simulated shape key, which the evaluated size would include
    if modifiers.list_changing(obj) and not shape_keys.simulated_keys(mesh):
        return whole
    if mesh.shape_keys is None and not _has_loose(mesh)[0]:
        return whole
    lengths = np.ptp(vertex_positions.read_target(obj)[face_vertices(mesh)], axis=0)
    return tuple((lengths * np.linalg.norm(_world_axes(obj), axis=0)).tolist())


def quad_edge(obj: bpy.types.Object, scene: bpy.types.Scene) -> float:
    """Return the median edge length in metres; 0 without faces.

    Parameters
    ----------
    obj, scene : the mesh object and its scene
    """
    mesh = obj.data
    if not len(mesh.polygons):
        return 0.0
    points, axes = vertex_positions.read_target(obj), _world_axes(obj)
    known = _EDGE_CACHE.get(mesh.session_uid)
    state = zlib.crc32(points.tobytes()), _counts(mesh), axes.tobytes()
    if known is None or known[0] != state:
        pairs = column(mesh.edges, "vertices")
        if _has_loose(mesh)[1]:
            pairs = pairs[np.unique(column(mesh.loops, "edge_index"))]
        with np.errstate(all="ignore"):  # the mesh may hold coordinates that are not numbers; the check reports them
            points = points.astype(float) @ axes.T
            lengths = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
            known = _EDGE_CACHE[mesh.session_uid] = state, float(np.median(lengths))
    return known[1] * scene.unit_settings.scale_length


def estimate_quad_edge(obj: bpy.types.Object, scene: bpy.types.Scene) -> float:
    """Return the median edge of the present quads, or else the approximate edge of the quads of Quad remesh, metres.

    Parameters
    ----------
    obj : mesh object, with quads or other polygons
    scene : its scene
    """
    mesh = obj.data
    if len(mesh.loops) == 4 * len(mesh.polygons):
        return quad_edge(obj, scene)
    return remeshed_edge(obj, scene)


def remeshed_edge(obj: bpy.types.Object, scene: bpy.types.Scene) -> float:
    """Return the approximate edge of the quads that Quad remesh would make, metres.

    Parameters
    ----------
    obj, scene : the mesh object and its scene
    """
    return sqrt(_area(obj) / obj.flexmaps.remesh.quads) * scene.unit_settings.scale_length


def face_vertices(mesh: bpy.types.Mesh) -> Bool[np.ndarray, " vertices"]:
    """Return which vertices belong to faces."""
    if not _has_loose(mesh)[0]:
        return np.ones(len(mesh.vertices), bool)
    used = np.zeros(len(mesh.vertices), bool)
    used[column(mesh.loops, "vertex_index")] = True
    return used


def _area(obj: bpy.types.Object) -> float:
    """Return the area of all faces in square Blender units, approximately where the object is scaled unevenly."""
    mesh = obj.data
    stretch = abs(np.linalg.det(_world_axes(obj))) ** (2 / 3)
    if not shape_keys.has_user_keys(mesh):
        return float(column(mesh.polygons, "area").sum() * stretch)
    points, first = vertex_positions.read_target(obj).astype(float), column(mesh.polygons, "loop_start")
    sizes = column(mesh.polygons, "loop_total")
    corners, ends = column(mesh.loops, "vertex_index"), first + sizes - 1
    following = np.arange(1, len(corners) + 1)
    following[ends] = first
    anchor = points[np.repeat(corners[first], sizes)]
    triangles = np.cross(points[corners] - anchor, points[corners[following]] - anchor)
    return float(0.5 * np.linalg.norm(np.add.reduceat(triangles, first), axis=1).sum() * stretch)


def _world_axes(obj: bpy.types.Object) -> Float[np.ndarray, "3 3"]:
    """Return the matrix of the object's rotation and scale, including those of its parents."""
    return np.array(obj.matrix_world)[:3, :3]


def _counts(mesh: bpy.types.Mesh) -> tuple[int, ...]:
    return len(mesh.vertices), len(mesh.edges), len(mesh.loops)


def _has_loose(mesh: bpy.types.Mesh) -> tuple[bool, bool]:
    """Return whether vertices, and whether edges, belong to no face; cached until their numbers change."""
    known, counts = _LOOSE_CACHE.get(mesh.session_uid), _counts(mesh)
    if known is None or known[0] != counts:
        vertices, edges = (len(np.unique(column(mesh.loops, name))) for name in ("vertex_index", "edge_index"))
        known = _LOOSE_CACHE[mesh.session_uid] = counts, vertices < counts[0], edges < counts[1]
    return known[1:]

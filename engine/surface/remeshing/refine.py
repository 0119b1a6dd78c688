"""Subdivide coarse quads on their target surface.

Coarse meshes have few irregular vertices, and subdivision adds none.
"""

from __future__ import annotations

import numpy as np

from ...arrays import Float
from ..checking.topology import sides_of
from ..mesh import PolygonMesh
from .mend import TargetSurface, line_corners, mesh_from_rows, move_corners, neighbour_mean_move, square_fit_move

# Quad corners nearer to a sharp edge than this are moved onto it, in quad edges. Larger: sharp edges are followed more
# completely; from 0.5 both ends of a quad's side would be moved.
SNAP_DISTANCE = 0.3
# Largest distance, in quad edges, over which a quad corner is moved to a point where sharp edges or the border meet or
# turn. Larger: more such points are preserved, with more distorted quads.
CORNER_SNAP_DISTANCE = 0.5


def split_into_quads(polygons: PolygonMesh) -> PolygonMesh:
    """Split every polygon into one quad per corner, round its centroid, as in the first Catmull-Clark step."""
    sides = sides_of(polygons)
    halves = polygons.vertices[sides.edges].mean(axis=1)
    on_side = len(polygons.vertices) + sides.edge
    before = np.empty_like(on_side)
    before[sides.next_side] = on_side
    rows = np.stack([polygons.corners, on_side, len(polygons.vertices) + len(halves) + sides.face, before], axis=1)
    return mesh_from_rows(np.concatenate([polygons.vertices, halves, polygons.centres]), rows)


def refine_quads(quads: PolygonMesh, target: TargetSurface, times: int) -> PolygonMesh:
    """Split every quad into four, ``times`` times; project the corners onto the surface and make the quads square.

    Corners near sharp edges of the surface are moved onto these edges and stay there; border corners are moved onto the
    surface's border.

    Parameters
    ----------
    quads : quad mesh
    target : surface on which the corners must lie
    times : number of subdivisions
    """
    quads = _snap_to_surface(quads, target)
    for _ in range(times):
        quads = _snap_to_surface(split_into_quads(quads), target)
        for way in (neighbour_mean_move, square_fit_move):  # averaging unfolds quads, fitting squares makes them square
            quads = move_corners(quads, np.arange(len(quads.sizes)), target, way)
    return quads


def _snap_to_surface(quads: PolygonMesh, target: TargetSurface) -> PolygonMesh:
    """Return a mesh with its corners projected onto the surface, nearby sharp edges and the border.

    Where these lines meet or turn, the nearest corner is moved to that point.
    """
    sides = sides_of(quads)
    once = np.bincount(sides.edge, minlength=len(sides.edges)) == 1
    rim = np.unique(sides.edges[once])
    lengths = np.linalg.norm(quads.vertices[sides.edges[:, 0]] - quads.vertices[sides.edges[:, 1]], axis=1)
    size = float(lengths.mean())
    points = target.nearest(np.ascontiguousarray(quads.vertices, float))[0]
    off, there = target.project_to_sharp_edges(points)
    near = off < SNAP_DISTANCE * size
    points[near] = there[near]
    _snap_to_corners(points, np.flatnonzero(near), target.vertices[_line_corner_mask(target, target.sharp_edges)], size)
    if len(rim) and len(target.border_edges):
        import igl

        points[rim] = igl.point_mesh_squared_distance(points[rim], target.vertices, target.border_edges)[2]
        _snap_to_corners(points, rim, target.vertices[_line_corner_mask(target, target.border_edges)], size)
    return PolygonMesh(points, quads.corners, quads.sizes)


def _line_corner_mask(target: TargetSurface, lines: np.ndarray) -> np.ndarray:
    """Return a mask of the target's vertices where ``lines``, pairs of vertices, turn sharply or branch."""
    return line_corners(target.vertices, lines) if len(lines) else np.zeros(len(target.vertices), bool)


def _snap_to_corners(
    points: Float[np.ndarray, "points 3"], among: np.ndarray, corners: np.ndarray, size: float
) -> None:
    """For every corner, move the nearest of the points ``points[among]`` onto it, in place, if it is near enough.

    corners : positions, (corners, 3)
    size : mean edge length of the quads, to which ``CORNER_SNAP_DISTANCE`` refers
    """
    if not len(among) or not len(corners):
        return
    from scipy.spatial import cKDTree

    off, nearest = cKDTree(points[among]).query(corners)
    close = off < CORNER_SNAP_DISTANCE * size
    points[among[nearest[close]]] = corners[close]

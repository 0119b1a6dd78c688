"""Find T-junctions: border vertices inside the border edge of another face, where the surface looks closed but is open."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ...arrays import Bool, Float, Int
from ..mesh import PolygonMesh
from .topology import Sides, border_sides

# A vertex on a border edge makes a T-junction if its distance from the edge is at most this share of the edge's length,
# and its distance from the edge's ends at least as much. Smaller: T-junctions on curved borders are missed; larger: narrow
# slits are taken for T-junctions.
BESIDE = 0.05
# Smallest absolute cosine between two border edges that count as parallel. Larger: T-junctions on curved borders are
# missed.
ALONG = 0.9
# Largest cosine between the directions from a border into the faces on its two sides, for the surface to continue there
# (a crease of 120 degrees). Larger: sharper folds count as a continued surface.
FOLDED = 0.5


@dataclass(frozen=True, eq=False)
class TJunctions:
    """T-junctions: the vertex, the side on which it lies, and its position along that side, 0 to 1."""

    vertex: Int[np.ndarray, " junctions"]
    side: Int[np.ndarray, " junctions"]
    share: Float[np.ndarray, " junctions"]


def t_junctions(mesh: PolygonMesh, sides: Sides) -> TJunctions:
    """Find all T-junctions of a mesh in O(n log n); ``sides`` are the sides of the mesh."""
    rim = border_sides(sides)
    a, b = mesh.corners[rim], sides.end_vertex[rim]
    p, q = mesh.vertices[a], mesh.vertices[b]
    length = np.linalg.norm(q - p, axis=1)
    ends = np.unique(np.concatenate([a, b]))
    none = np.zeros(0, np.int64)
    if not len(rim):
        return TJunctions(none, none, np.zeros(0))
    row, of_side, share, off = _points_beside(mesh.vertices[ends], p, q, BESIDE * length)
    vertex = ends[row]
    inside = (share > BESIDE) & (share < 1.0 - BESIDE)
    faces = np.stack([sides.face[rim[of_side]], vertex], axis=1)[inside]
    own = np.isin(faces @ (len(mesh.vertices), 1), sides.face * len(mesh.vertices) + mesh.corners)
    kept = np.flatnonzero(inside)[~own]
    kept = kept[_continues_beyond(mesh, sides, rim, vertex[kept], of_side[kept])]
    kept = kept[~_several_sheets_meet(mesh, sides, rim, vertex[kept], of_side[kept])]
    # assign every vertex to the nearest edge only
    order = kept[np.lexsort((off[kept], vertex[kept]))]
    order = order[np.unique(vertex[order], return_index=True)[1]]
    return TJunctions(vertex[order], rim[of_side[order]], share[order])


def _points_beside(
    points: Float[np.ndarray, "points 3"],
    start: Float[np.ndarray, "sides 3"],
    end: Float[np.ndarray, "sides 3"],
    near: Float[np.ndarray, " sides"] | float,
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"], Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Return all pairs of a side and a point near the side's line.

    Parameters
    ----------
    points : points to test
    start, end : ends of every side
    near : largest distance of a point from the side's line

    Returns
    -------
    index of the point; index of the side; position along the side, 0 to 1 between its ends; distance from its line
    """
    length = np.linalg.norm(end - start, axis=1)
    found = cKDTree(points).query_ball_point(0.5 * (start + end), 0.5 * length + near)
    side = np.repeat(np.arange(len(start)), [len(row) for row in found])
    point = np.concatenate([np.zeros(0, np.int64), *found]).astype(np.int64)
    along = end[side] - start[side]
    share = np.einsum("ni,ni->n", points[point] - start[side], along) / np.maximum(length[side], 1e-300) ** 2
    off = np.linalg.norm(points[point] - start[side] - share[:, None] * along, axis=1)
    kept = off < np.broadcast_to(near, length.shape)[side]
    return point[kept], side[kept], share[kept], off[kept]


def _several_sheets_meet(
    mesh: PolygonMesh,
    sides: Sides,
    rim: Int[np.ndarray, " rim"],
    vertex: Int[np.ndarray, " n"],
    side: Int[np.ndarray, " n"],
) -> Bool[np.ndarray, " n"]:
    """Return whether three or more sheets meet at a vertex that lies on a border edge, as plates at a common edge.

    Such sheets only touch: joined, they would have an edge of three faces. Two points on the edge are tested, shortly
    before and after the vertex. Three sheets meet if more than one other border edge passes through one of these points.

    Parameters
    ----------
    rim, vertex, side : as in ``_continues_beyond``
    """
    if not len(vertex):
        return np.zeros(0, bool)
    start, end = mesh.vertices[mesh.corners[rim]], mesh.vertices[sides.end_vertex[rim]]
    step = 2.0 * BESIDE * (end - start)[side]
    size, middle = np.linalg.norm(end - start, axis=1), mesh.vertices[vertex]
    near = BESIDE * size[side]  # the tolerance of the edge on which the vertex lies, also for shorter edges beside it
    point, other, share, off = _points_beside(np.concatenate([middle - step, middle + step]), start, end, near.max())
    own = side[point % len(vertex)]
    along = np.abs(np.einsum("ni,ni->n", _normalise(end - start)[own], _normalise(end - start)[other]))
    passing = (other != own) & (off < near[point % len(vertex)]) & (share >= 0.0) & (share <= 1.0) & (along > ALONG)
    return (np.bincount(point, passing, minlength=2 * len(vertex)).reshape(2, -1) > 1.0).any(axis=0)


def _continues_beyond(
    mesh: PolygonMesh,
    sides: Sides,
    rim: Int[np.ndarray, " rim"],
    vertex: Int[np.ndarray, " n"],
    side: Int[np.ndarray, " n"],
) -> Bool[np.ndarray, " n"]:
    """Return whether the surface continues on the other side of a border edge, at a vertex that lies on this edge.

    It continues if a border edge at the vertex is parallel to the edge and has its face on the other side; otherwise
    parts of the surface overlap or cross.

    Parameters
    ----------
    rim : border sides
    vertex : vertices on border edges
    side : for every vertex, the index in ``rim`` of the side on which it lies
    """
    middle = mesh.centres
    start, end = mesh.corners[rim], sides.end_vertex[rim]
    along = _normalise(mesh.vertices[end] - mesh.vertices[start])
    inward = middle[sides.face[rim]] - mesh.vertices[start]
    inward = _normalise(inward - np.einsum("ni,ni->n", inward, along)[:, None] * along)
    at, other = np.concatenate([start, end]), np.tile(np.arange(len(rim)), 2)
    order = np.argsort(at, kind="stable")
    first, last = (np.searchsorted(at[order], vertex, which) for which in ("left", "right"))
    row = np.repeat(np.arange(len(vertex)), last - first)
    beside = other[order][np.arange(len(row)) - np.repeat(np.cumsum(last - first) - last, last - first)]
    parallel = np.abs(np.einsum("ni,ni->n", along[side[row]], along[beside])) > ALONG
    beyond = np.einsum("ni,ni->n", inward[side[row]], inward[beside]) < FOLDED
    return np.bincount(row, parallel & beyond, minlength=len(vertex)) > 0


def _normalise(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Return unit vectors."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1), 1e-300)[:, None]

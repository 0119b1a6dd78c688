"""Connectivity of any polygon mesh: sides of faces, bodies (connected components), fans of faces, orientation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Bool, Int
from ...components import components
from ..mesh import PolygonMesh


@dataclass(frozen=True, eq=False)
class Sides:
    """The sides of all faces; side c runs from corner c of the mesh to the next corner of its face.

    edges : both vertices of every edge, the smaller index first; edges are in ascending order
    face, edge, end_vertex : face and edge of every side, and the vertex at its end
    forward : whether the side runs from the smaller to the larger vertex index
    next_side : next side of the same face
    pairs : the two sides of every edge that has exactly two sides
    """

    edges: Int[np.ndarray, "edges 2"]
    face: Int[np.ndarray, " corners"]
    edge: Int[np.ndarray, " corners"]
    end_vertex: Int[np.ndarray, " corners"]
    forward: Bool[np.ndarray, " corners"]
    next_side: Int[np.ndarray, " corners"]
    pairs: Int[np.ndarray, "pairs 2"]


def sides_of(polygons: PolygonMesh) -> Sides:
    """Build the sides of a mesh with valid indices."""
    corners, face, after = polygons.corners.astype(np.int64), polygons.face_of, polygons.next_corner
    following = corners[after]
    low, high = np.minimum(corners, following), np.maximum(corners, following)
    count = len(polygons.vertices)
    keys, edge = np.unique(low * count + high, return_inverse=True)
    edge = edge.reshape(-1)
    order = np.argsort(edge, kind="stable")
    starts = np.flatnonzero(np.bincount(edge, minlength=len(keys)) == 2)
    first = np.searchsorted(edge[order], starts)
    pairs = np.stack([order[first], order[first + 1]], axis=1) if len(starts) else np.zeros((0, 2), np.int64)
    edges = np.stack([keys // max(count, 1), keys % max(count, 1)], axis=1)
    return Sides(edges, face, edge, following, corners < following, after, pairs)


def border_sides(sides: Sides) -> Int[np.ndarray, " sides"]:
    """Return the sides on the border, whose edge has only one face."""
    return np.flatnonzero(np.bincount(sides.edge, minlength=len(sides.edges))[sides.edge] == 1)


def bodies(sides: Sides, faces: int) -> Int[np.ndarray, " faces"]:
    """Return the body (component connected over edges) of every face, numbered from 0.

    Parameters
    ----------
    sides : sides of all faces
    faces : number of faces
    """
    order = np.argsort(sides.edge, kind="stable")
    same = sides.edge[order][1:] == sides.edge[order][:-1]
    return components(faces, sides.face[order[1:][same]], sides.face[order[:-1][same]])


def corner_fans(sides: Sides) -> Int[np.ndarray, " corners"]:
    """Return the fan of every corner, numbered from 0.

    A fan is a set of corners at one vertex whose faces are connected over edges of this vertex.
    """
    start, end = np.arange(len(sides.face)), sides.next_side
    one, two = sides.pairs.T
    flipped = sides.forward[one] != sides.forward[two]  # the usual case: the two sides run in opposite directions
    a = np.concatenate([start[one], end[one]])
    b = np.concatenate([np.where(flipped, end[two], start[two]), np.where(flipped, start[two], end[two])])
    return components(len(start), a, b)


def non_manifold_vertices(polygons: PolygonMesh, sides: Sides) -> np.ndarray:
    """Return the non-manifold vertices, whose corners form several fans.

    Parameters
    ----------
    polygons : mesh with valid indices
    sides : sides of that mesh
    """
    found = np.unique(np.stack([polygons.corners, corner_fans(sides)], axis=1), axis=0)[:, 0]
    return np.flatnonzero(np.bincount(found) > 1)


def orientation_faults(sides: Sides, body: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find faces with inconsistent orientation, and bodies that cannot be oriented.

    The orientable double cover contains every face twice, once reversed; a body is not orientable if its two copies are
    connected. A body can be made consistent by reversing either of two sets of faces; the smaller set is returned.

    Parameters
    ----------
    sides : sides of all faces
    body : (F,) body of every face, from ``bodies``

    Returns
    -------
    faces to reverse; bodies that are not orientable; edges between faces of different orientation
    """
    one, two = sides.pairs.T
    f, g = sides.face[one], sides.face[two]
    agree = sides.forward[one] != sides.forward[two]
    n = len(body)
    a = np.concatenate([f, f + n])
    b = np.concatenate([np.where(agree, g, g + n), np.where(agree, g + n, g)])
    cover = components(2 * n, a, b)
    one_sided = np.unique(body[cover[:n] == cover[n:]])
    # in an orientable body, copy 0 of a face is connected to copy 0 of the body's first face, or to its copy 1
    first = np.full(body.max() + 1, n)
    np.minimum.at(first, body, np.arange(n))
    turned = cover[:n] != cover[first][body]
    share = np.bincount(body, turned) / np.bincount(body)
    turned ^= (share > 0.5)[body]
    turned &= ~np.isin(body, one_sided)
    return np.flatnonzero(turned), one_sided, np.unique(sides.edge[one[~agree]])


def repeated_faces(polygons: PolygonMesh, later: bool = True) -> Int[np.ndarray, " repeated"]:
    """Return the faces, ascending, that have the vertices of another face, in any order.

    Parameters
    ----------
    polygons : mesh with valid indices
    later : whether to return the later faces of such pairs (True) or the earlier faces
    """
    sizes = polygons.sizes
    corners = polygons.corners[np.lexsort((polygons.corners, polygons.face_of))]  # sorted within every face
    found = [np.zeros(0, np.int64)]
    for size in np.unique(sizes):
        own = np.flatnonzero(sizes == size)
        rows = corners[polygons.starts[own][:, None] + np.arange(size)]
        order = np.lexsort(rows.T[::-1])
        equal = (rows[order][1:] == rows[order][:-1]).all(axis=1)
        found.append(own[order[1:][equal] if later else order[:-1][equal]])
    return np.sort(np.concatenate(found))

"""Folds: edges at which a surface turns more sharply than spirals bend, and their rounding."""

from __future__ import annotations

import numpy as np

from ...arrays import Float
from ..mesh import PolygonMesh
from .geometry import area_vectors_of
from .topology import Sides, sides_of

# Radians between the normals of two quads from which their edge is a fold. Spirals bend, they do not fold: a pen holder whose edges turn
# by 72 degrees ends at 3.2 % of its size from its target, and at 1.5 % where they turn by 41
SHARP = np.radians(45.0)
RINGS = 2  # of vertices round a fold that move with it, each half as much as the one before; by eye
PACE = 0.5  # share of the way to the mean of its neighbours that a vertex goes in a round; more than 1 does not settle
ROUNDS = 200  # at most; a right angle takes 5


def turns(polygons: PolygonMesh, sides: Sides) -> Float[np.ndarray, " edges"]:
    """Return the radians between the normals of the two faces at every edge; 0 where an edge has not exactly two.

    Parameters
    ----------
    polygons : faces that turn the same way round
    sides : of the mesh
    """
    normals = area_vectors_of(polygons, sides)
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    one, two = sides.pairs[sides.forward[sides.pairs[:, 0]] != sides.forward[sides.pairs[:, 1]]].T
    found = np.zeros(len(sides.edges))
    across = np.einsum("ei,ei->e", normals[sides.face[one]], normals[sides.face[two]])
    found[sides.edge[one]] = np.arccos(np.clip(across, -1.0, 1.0))
    return found


def radius(edge: float) -> float:
    """Return the radius of the arc on which edges of this length turn by as much as is just no fold."""
    return edge / (2.0 * float(np.sin(0.5 * SHARP)))


def rounded(polygons: PolygonMesh) -> Float[np.ndarray, "vertices 3"]:
    """Return the vertices after vertices at and near folds were drawn to the mean of their neighbours, until no fold is left.

    Vertices of the border keep to the border.
    """
    sides = sides_of(polygons)
    uses = np.bincount(sides.edge, minlength=len(sides.edges))
    held = np.unique(sides.edges[uses == 1])
    inner = ~np.isin(sides.edges, held).all(axis=1)
    # every vertex is drawn by its neighbours, those of the border by their neighbours there
    edges = np.concatenate([sides.edges[inner], sides.edges[uses == 1]])
    to, by = np.concatenate([edges, edges[:, ::-1]]).T
    drawn = np.isin(to, held) <= np.isin(by, held)
    to, by = to[drawn], by[drawn]
    count = np.maximum(np.bincount(to, minlength=len(polygons.vertices)), 1)
    vertices = np.array(polygons.vertices, float)
    for _ in range(ROUNDS):
        sharp = turns(PolygonMesh(vertices, polygons.corners, polygons.sizes), sides) > SHARP
        if not sharp.any():
            break
        share = np.zeros(len(vertices))
        share[sides.edges[sharp]] = PACE
        for _ in range(RINGS):
            wider = share.copy()
            np.maximum.at(wider, sides.edges, 0.5 * share[sides.edges[:, ::-1]])
            share = wider
        mean = np.stack([np.bincount(to, vertices[by, k], len(vertices)) for k in range(3)], axis=1) / count[:, None]
        vertices += np.where(np.isin(np.arange(len(vertices)), to), share, 0.0)[:, None] * (mean - vertices)
    return vertices

"""Find and smooth folds: edges at which a surface turns more sharply than spirals can bend."""

from __future__ import annotations

import numpy as np

from ...arrays import Float
from ..mesh import PolygonMesh
from .geometry import area_vectors_of
from .topology import Sides, sides_of

# Angle between the normals of two neighbouring quads, radians, above which their edge counts as a fold. Larger: fewer
# folds are reported and rounded, but pieces end farther from their targets, as spirals bend but do not fold.
SHARP = np.radians(45.0)
# Number of rings of vertices round a fold that are smoothed too, each ring half as much as the ring inside it. Larger:
# the surface gets rounder, and departs farther from the given shape.
RINGS = 2
# Share of the way to the mean of its neighbours that a vertex on a fold moves in a round. Larger: fewer rounds; above 1
# the rounds do not converge.
PACE = 0.5
ROUNDS = 200  # largest number of rounds of smoothing; a right angle takes 5. Smaller: sharp folds may be left.


def fold_angles(polygons: PolygonMesh, sides: Sides) -> Float[np.ndarray, " edges"]:
    """Return the angle between the normals of the two faces at every edge, radians.

    The angle is 0 at edges that do not have exactly two faces.

    Parameters
    ----------
    polygons : mesh with consistently oriented faces
    sides : sides of that mesh
    """
    normals = area_vectors_of(polygons, sides)
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    one, two = sides.pairs[sides.forward[sides.pairs[:, 0]] != sides.forward[sides.pairs[:, 1]]].T
    found = np.zeros(len(sides.edges))
    across = np.einsum("ei,ei->e", normals[sides.face[one]], normals[sides.face[two]])
    found[sides.edge[one]] = np.arccos(np.clip(across, -1.0, 1.0))
    return found


def min_bend_radius(edge: float) -> float:
    """Return the smallest radius, metres, of an arc that edges of length ``edge`` (metres) can follow without folds."""
    return edge / (2.0 * float(np.sin(0.5 * SHARP)))


def smooth_folds(polygons: PolygonMesh) -> Float[np.ndarray, "vertices 3"]:
    """Return vertex positions of a mesh with its folds rounded.

    Vertices at and near folds move towards the mean of their neighbours, round by round, until no fold is left. Border
    vertices follow only their neighbours on the border.
    """
    sides = sides_of(polygons)
    uses = np.bincount(sides.edge, minlength=len(sides.edges))
    held = np.unique(sides.edges[uses == 1])
    inner = ~np.isin(sides.edges, held).all(axis=1)
    # border vertices follow only their neighbours on the border
    edges = np.concatenate([sides.edges[inner], sides.edges[uses == 1]])
    to, by = np.concatenate([edges, edges[:, ::-1]]).T
    drawn = np.isin(to, held) <= np.isin(by, held)
    to, by = to[drawn], by[drawn]
    count = np.maximum(np.bincount(to, minlength=len(polygons.vertices)), 1)
    vertices = np.array(polygons.vertices, float)
    for _ in range(ROUNDS):
        sharp = fold_angles(PolygonMesh(vertices, polygons.corners, polygons.sizes), sides) > SHARP
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

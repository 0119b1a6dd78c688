"""Quads cut into finer ones on the surface that they stand for: coarse quads have few irregular vertices, and finer ones
that are cut from them no more."""

from __future__ import annotations

import numpy as np

from ...arrays import Float
from ..checking.topology import sides_of
from ..mesh import PolygonMesh
from .mend import Target, line_corners, moved, of_rows, to_middles, to_squares

NEAR = 0.3  # quad edges: corners so near a sharp edge, or the border, are put onto it; under a half, or both ends of a quad's side would
AT_CORNER = 0.5  # quad edges: the nearest corner of a quad, within these, goes to where sharp edges meet or turn


def split(polygons: PolygonMesh) -> PolygonMesh:
    """Every polygon in quads from its middle, one at each corner, as in the first step of Catmull and Clark."""
    sides, starts = sides_of(polygons), np.cumsum(polygons.sizes) - polygons.sizes
    corners, face = polygons.vertices[polygons.corners], sides.face
    middles = np.add.reduceat(corners, starts, axis=0) / polygons.sizes[:, None]
    halves = polygons.vertices[sides.edges].mean(axis=1)
    on_side = len(polygons.vertices) + sides.edge
    before = np.empty_like(on_side)
    before[sides.after] = on_side
    rows = np.stack([polygons.corners, on_side, len(polygons.vertices) + len(halves) + face, before], axis=1)
    return of_rows(np.concatenate([polygons.vertices, halves, middles]), rows)


def refined(quads: PolygonMesh, target: Target, times: int) -> PolygonMesh:
    """Every quad cut into four ``times`` times, its corners brought to the surface and made square on it.

    Corners near sharp edges of the surface go onto them and stay there; those on the border go to the surface's border.
    """
    quads = _snapped(quads, target)
    for _ in range(times):
        quads = _snapped(split(quads), target)
        for way in (to_middles, to_squares):  # the first unfolds, the second squares
            quads = moved(quads, np.arange(len(quads.sizes)), target, way)
    return quads


def _snapped(quads: PolygonMesh, target: Target) -> PolygonMesh:
    """Corners on the surface, its sharp edges, its border, and where those meet or turn."""
    sides = sides_of(quads)
    once = np.bincount(sides.edge, minlength=len(sides.edges)) == 1
    rim = np.unique(sides.edges[once])
    lengths = np.linalg.norm(quads.vertices[sides.edges[:, 0]] - quads.vertices[sides.edges[:, 1]], axis=1)
    size = float(lengths.mean())
    points = target.nearest(np.ascontiguousarray(quads.vertices, float))[0]
    off, there = target.onto_sharp(points)
    near = off < NEAR * size
    points[near] = there[near]
    _to_corners(points, np.flatnonzero(near), target.vertices[_turns(target, target.sharp)], size)
    if len(rim) and len(target.border):
        import igl

        points[rim] = igl.point_mesh_squared_distance(points[rim], target.vertices, target.border)[2]
        _to_corners(points, rim, target.vertices[_turns(target, target.border)], size)
    return PolygonMesh(points, quads.corners, quads.sizes)


def _turns(target: Target, lines: np.ndarray) -> np.ndarray:
    return line_corners(target.vertices, lines) if len(lines) else np.zeros(len(target.vertices), bool)


def _to_corners(points: Float[np.ndarray, "points 3"], among: np.ndarray, corners: np.ndarray, size: float) -> None:
    """Put the nearest of the points ``among`` at every corner, in place."""
    if not len(among) or not len(corners):
        return
    from scipy.spatial import cKDTree

    off, nearest = cKDTree(points[among]).query(corners)
    close = off < AT_CORNER * size
    points[among[nearest[close]]] = corners[close]

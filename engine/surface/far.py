"""Surfaces far away from the origin: computed about their own middle, and what was rounded before they came here."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..arrays import Float
from .mesh import PolygonMesh, QuadMesh

# extents of a piece between its middle and the origin from which on it is brought to the origin: there single precision, which
# Blender's meshes have, rounds to 1e-6 of the extent. Larger: coarser; smaller: pieces move that need not
FAR = 20.0
COARSE = 1e-4  # of a piece's extent: steps of its coordinates that are told; .02 mm of a piece of 200 mm


def about_middle(polygons: PolygonMesh) -> PolygonMesh:
    """The mesh with its middle at the origin where it lies far away from there, else as it is."""
    used = polygons.vertices[np.unique(polygons.corners)]
    if not len(used) or not np.isfinite(used).all():
        return polygons
    low, high = used.min(axis=0), used.max(axis=0)
    middle, extent = 0.5 * low + 0.5 * high, float((high - low).max())
    if not 0 < extent < np.abs(middle).max() / FAR:
        return polygons
    return replace(polygons, vertices=polygons.vertices - middle)


def near(mesh: QuadMesh) -> QuadMesh:
    """The same of a mesh of quads."""
    moved = about_middle(PolygonMesh.of(mesh)).vertices
    return mesh if moved is mesh.vertices else mesh.moved(moved)


def coarse_step(positions: Float[np.ndarray, "vertices 3"]) -> float:
    """The step of single precision where these positions lie; 0 where it is fine beside their extent."""
    finite = positions[np.isfinite(positions).all(axis=1)]
    if not len(finite):
        return 0.0
    step = float(np.spacing(np.float32(min(np.abs(finite).max(), np.finfo(np.float32).max / 4))))
    extent = float(np.ptp(finite, axis=0).max())
    return step if step > COARSE * extent > 0 else 0.0

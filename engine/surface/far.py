"""Surfaces far from the origin: move them there, and detect coordinates that single precision rounds visibly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..arrays import Float
from .mesh import PolygonMesh, QuadMesh

# Distance of a mesh's middle from the origin, in extents of the mesh, beyond which the mesh is moved to the origin: there
# Blender's single precision rounds to 1e-6 of the extent. Larger: coarser coordinates; smaller: needless moves.
MAX_DISTANCE = 20.0
# Largest rounding step of coordinates that is not reported, as a share of the extent (0.02 mm for a piece of 200 mm).
# Larger: visible rounding passes.
MAX_ROUNDING = 1e-4


def recentre(polygons: PolygonMesh) -> PolygonMesh:
    """Centre a mesh at the origin if it lies far from the origin; otherwise return it unchanged."""
    used = polygons.vertices[np.unique(polygons.corners)]
    if not len(used) or not np.isfinite(used).all():
        return polygons
    low, high = used.min(axis=0), used.max(axis=0)
    middle, extent = 0.5 * low + 0.5 * high, float((high - low).max())
    if not 0 < extent < np.abs(middle).max() / MAX_DISTANCE:
        return polygons
    return replace(polygons, vertices=polygons.vertices - middle)


def recentre_quads(mesh: QuadMesh) -> QuadMesh:
    """Centre a quad mesh at the origin if it lies far from the origin; otherwise return it unchanged."""
    moved = recentre(PolygonMesh.from_quads(mesh)).vertices
    return mesh if moved is mesh.vertices else mesh.with_vertices(moved)


def rounding_step(positions: Float[np.ndarray, "vertices 3"]) -> float:
    """Return the rounding step of single precision at positions, in the positions' unit; 0 if it is fine enough.

    A step is fine enough up to ``MAX_ROUNDING`` times the extent of the positions.
    """
    finite = positions[np.isfinite(positions).all(axis=1)]
    if not len(finite):
        return 0.0
    step = float(np.spacing(np.float32(min(np.abs(finite).max(), np.finfo(np.float32).max / 4))))
    extent = float(np.ptp(finite, axis=0).max())
    return step if step > MAX_ROUNDING * extent > 0 else 0.0

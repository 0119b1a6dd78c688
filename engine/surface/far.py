"""Surfaces far from the origin: move them to the origin, and detect coordinates rounded to single precision."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..arrays import Float
from .mesh import PolygonMesh, QuadMesh

# Move a mesh to the origin if its middle is farther away than so many of its extents: there Blender's single precision
# rounds to 1e-6 of the extent. Larger: coarser coordinates; smaller: meshes move without need.
FAR = 20.0
COARSE = 1e-4  # share of the extent: a coarser rounding of the coordinates is reported; 0.02 mm for a piece of 200 mm


def about_middle(polygons: PolygonMesh) -> PolygonMesh:
    """Return the mesh with its middle at the origin if it lies far from there, else unchanged."""
    used = polygons.vertices[np.unique(polygons.corners)]
    if not len(used) or not np.isfinite(used).all():
        return polygons
    low, high = used.min(axis=0), used.max(axis=0)
    middle, extent = 0.5 * low + 0.5 * high, float((high - low).max())
    if not 0 < extent < np.abs(middle).max() / FAR:
        return polygons
    return replace(polygons, vertices=polygons.vertices - middle)


def near(mesh: QuadMesh) -> QuadMesh:
    """Return a quad mesh moved to the origin if it lies far from there, else unchanged."""
    moved = about_middle(PolygonMesh.from_quads(mesh)).vertices
    return mesh if moved is mesh.vertices else mesh.moved(moved)


def coarse_step(positions: Float[np.ndarray, "vertices 3"]) -> float:
    """Return the single-precision rounding step at these positions, in their unit; 0 if it is fine relative to their extent."""
    finite = positions[np.isfinite(positions).all(axis=1)]
    if not len(finite):
        return 0.0
    step = float(np.spacing(np.float32(min(np.abs(finite).max(), np.finfo(np.float32).max / 4))))
    extent = float(np.ptp(finite, axis=0).max())
    return step if step > COARSE * extent > 0 else 0.0

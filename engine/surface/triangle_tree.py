"""Triangulated surfaces with fast queries of closest points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..arrays import Float, Int


@dataclass(frozen=True, eq=False)
class TriangleTree:
    """A triangulated surface with a search tree of its triangles."""

    vertices: Float[np.ndarray, "vertices 3"]
    triangles: Int[np.ndarray, "triangles 3"]

    @cached_property
    def _tree(self) -> Any:
        """Tree of the triangles' bounding boxes (libigl AABB)."""
        import igl

        tree = igl.AABB()
        tree.init(self.vertices, self.triangles)
        return tree

    @cached_property
    def normals(self) -> Float[np.ndarray, "triangles 3"]:
        """Unit normals of the triangles."""
        a, b, c = self.vertices[self.triangles.T]
        normals = np.cross(b - a, c - a)
        return normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]

    def closest(self, points: Float[np.ndarray, "points 3"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return for every point its squared distance, the nearest triangle and the closest point (points, 3) on it."""
        squared, triangle, foot = self._tree.squared_distance(
            self.vertices, self.triangles, np.ascontiguousarray(points, float)
        )
        return np.asarray(squared).ravel(), np.asarray(triangle).ravel(), np.asarray(foot).reshape(-1, 3)

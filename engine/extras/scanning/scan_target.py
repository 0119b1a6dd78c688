"""Surface to which a scan is registered, with distances to it, exact or from a table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ...surface.mesh import QuadMesh
from ...surface.triangle_tree import TriangleTree

STEP = 1 / 40  # grid spacing of the table, as a share of the size; larger: less exact, less memory
MARGIN = 0.3  # margin of the table around the surface, as a share of the size; more than the error of initial poses


class Distances(Protocol):
    """Function that returns distances of points from a surface, and their gradients."""

    def __call__(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return unit directions away from the surface (..., 3), and distances along them (...), at points (..., 3)."""


@dataclass(frozen=True, eq=False)
class TriangleSurface(TriangleTree):
    """A triangulated surface; two triangles per quad, in the order of the quads."""

    @classmethod
    def from_mesh(cls, mesh: QuadMesh, middle: np.ndarray, size: float) -> TriangleSurface:
        """Make the surface from a quad mesh.

        Parameters
        ----------
        mesh : quad mesh, metres
        middle, size : point that becomes the origin, and length that becomes 1, metres
        """
        halves = np.stack([mesh.quads[:, [0, 1, 2]], mesh.quads[:, [0, 2, 3]]], axis=1).reshape(-1, 3)
        return cls(np.ascontiguousarray((mesh.vertices - middle) / size, float), np.ascontiguousarray(halves, np.int64))

    def __call__(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return exact directions and distances, see ``Distances``; on the surface the direction is its normal."""
        flat = np.ascontiguousarray(points.reshape(-1, 3), float)
        _, triangle, foot = self.closest(flat)
        away = flat - foot
        distance = np.linalg.norm(away, axis=1)
        off = distance[:, None] > 1e-9
        direction = np.where(off, away / np.maximum(distance, 1e-300)[:, None], self.normals[triangle])
        return direction.reshape(points.shape), distance.reshape(points.shape[:-1])


class ClosestPoints:
    """Table of closest points for the nodes of a grid; other points use the tangent plane of the nearest node.

    As in Fitzgibbon 2003, "Robust registration of 2D and 3D point sets". It is a hundred times faster than
    ``TriangleSurface``; close to the surface the error is about 0.1 % of the size.
    """

    def __init__(self, surface: TriangleSurface):
        self._low = surface.vertices.min(axis=0) - MARGIN
        self._counts = np.ceil((surface.vertices.max(axis=0) + MARGIN - self._low) / STEP).astype(np.int32) + 1
        nodes = (
            np.stack(np.meshgrid(*map(np.arange, self._counts), indexing="ij"), -1).reshape(-1, 3) * STEP + self._low
        )
        direction, distance = surface(nodes)
        height = np.einsum("ij,ij->i", direction, nodes) - distance
        self._direction, self._height = direction.astype(np.float32), height.astype(np.float32)

    def __call__(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return directions and signed distances from the nearest nodes' tangent planes, see ``Distances``."""
        at = np.clip(np.rint((points - self._low) / STEP), 0, self._counts - 1).astype(np.int32)
        node = (at[..., 0] * self._counts[1] + at[..., 1]) * self._counts[2] + at[..., 2]
        direction = self._direction[node]
        return direction, np.einsum("...i,...i->...", direction, points) - self._height[node]

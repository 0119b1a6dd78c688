"""Interface of the remesher that the engine calls: a second Blender (``bridge.hosts.second_blender``)."""

from __future__ import annotations

from typing import Protocol

from ...progress import Progress
from ..mesh import PolygonMesh


class RemeshTool(Protocol):
    """External remesher; every call may take seconds, checks ``progress`` for a cancel, and may return None."""

    def triangles(self, mesh: PolygonMesh, near: float, progress: Progress) -> PolygonMesh | None:
        """Return a mesh as triangles, with corners nearer to each other than ``near`` merged, without faces of no area."""
        ...

    def quads(self, body: PolygonMesh, count: int, seed: int, sharp: bool, progress: Progress) -> PolygonMesh | None:
        """Return about ``count`` quads for a clean body.

        seed : seed of the remesher's random numbers, for different results
        sharp : whether quads follow the body's sharp edges
        """
        ...

    def voxels(self, body: PolygonMesh, size: float, progress: Progress) -> PolygonMesh | None:
        """Return the quads of a voxel remesh of a body; ``size`` is the voxel edge."""
        ...

    def cells(self, body: PolygonMesh, size: float, progress: Progress) -> PolygonMesh | None:
        """Return a body with large flat faces divided into polygons; ``size`` is about their diameter."""
        ...

    def intersecting_pairs(self, parts: list[PolygonMesh], progress: Progress) -> list[tuple[int, int]]:
        """Return pairs of bodies whose surfaces intersect."""
        ...

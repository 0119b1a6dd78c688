"""Interface to the program that makes quads: Blender's remeshers (``bridge.hosts.second_blender``)."""

from __future__ import annotations

from typing import Protocol

from ...progress import Progress
from ..mesh import PolygonMesh


class Tool(Protocol):
    """Makes quads; every call may take seconds, checks ``progress`` for a cancel, and may return None."""

    def triangles(self, mesh: PolygonMesh, near: float, progress: Progress) -> PolygonMesh | None:
        """Triangulate; merge corners nearer than ``near``, drop faces without area."""
        ...

    def quads(self, body: PolygonMesh, count: int, seed: int, sharp: bool, progress: Progress) -> PolygonMesh | None:
        """Return about ``count`` quads of a clean body, along its sharp edges if ``sharp``."""
        ...

    def voxels(self, body: PolygonMesh, size: float, progress: Progress) -> PolygonMesh | None:
        """Return the voxel surface of a closed body; ``size`` is the voxel edge."""
        ...

    def cells(self, body: PolygonMesh, size: float, progress: Progress) -> PolygonMesh | None:
        """Return a body of large flat faces as polygons of about ``size``."""
        ...

    def touching(self, parts: list[PolygonMesh], progress: Progress) -> list[tuple[int, int]]:
        """Return pairs of bodies whose surfaces intersect."""
        ...

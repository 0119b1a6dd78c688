"""What is asked of the program that makes quads: Blender's remeshers stand behind it (``bridge.hosts.second_blender``)."""

from __future__ import annotations

from typing import Protocol

from ...progress import Progress
from ..mesh import PolygonMesh


class Tool(Protocol):
    """Makes quads; every call may take seconds, asks ``progress`` meanwhile, and may come back with nothing."""

    def triangles(self, mesh: PolygonMesh, near: float, progress: Progress) -> PolygonMesh | None:
        """The mesh as triangles, corners nearer than ``near`` joined, nothing without area."""
        ...

    def quads(self, body: PolygonMesh, count: int, seed: int, sharp: bool, progress: Progress) -> PolygonMesh | None:
        """About ``count`` quads of one clean body, along its sharp edges where that is asked for."""
        ...

    def voxels(self, body: PolygonMesh, size: float, progress: Progress) -> PolygonMesh | None:
        """The skin of a closed body as small faces."""
        ...

    def cells(self, body: PolygonMesh, size: float, progress: Progress) -> PolygonMesh | None:
        """A body of large flat faces as polygons of about this size."""
        ...

    def touching(self, parts: list[PolygonMesh], progress: Progress) -> list[tuple[int, int]]:
        """Pairs of bodies whose surfaces cut each other."""
        ...

"""The two exceptions that the engine raises on purpose."""

from __future__ import annotations

from collections.abc import Iterable


class FlexMapsError(Exception):
    """A mistake that the user can mend: says what is wrong, where, and what to do.

    ``faces`` and ``edges`` are the indices of the culprits in the mesh that the user gave, so that Blender can
    select them. ``quads`` is the number of quads to remesh with where that mends it, else None.
    """

    def __init__(self, message: str, *, faces: Iterable[int] = (), edges: Iterable[int] = (), quads: int | None = None):
        super().__init__(message)
        self.quads = quads
        self.faces = [int(f) for f in faces]
        self.edges = [int(e) for e in edges]


class Cancelled(Exception):
    """The user asked to stop; raised by a progress report, caught by whoever started the job."""

"""The two exceptions that the engine raises deliberately."""

from __future__ import annotations

from collections.abc import Iterable


class FlexMapsError(Exception):
    """An error that the user can correct; its message says what is wrong, where, and what to do.

    faces, edges : indices of the faulty faces and edges in the user's mesh, for Blender to select
    quads : number of quads to remesh with, if that corrects the error; else None
    """

    def __init__(self, message: str, *, faces: Iterable[int] = (), edges: Iterable[int] = (), quads: int | None = None):
        super().__init__(message)
        self.quads = quads
        self.faces = [int(f) for f in faces]
        self.edges = [int(e) for e in edges]


class Cancelled(Exception):
    """The user cancelled; raised by calls of ``Progress``, caught where the job was started."""

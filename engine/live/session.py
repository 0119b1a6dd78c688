"""Live pieces in a process beside this one, each by a name: what the process keeps between two calls is what makes it quick."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ..mechanics.assembly import Pose
from .piece import LivePiece, Shape

_pieces: dict[str, LivePiece] = {}


@dataclass(frozen=True, eq=False)
class Call:
    """name : of the piece; changes : what differs since the last call, None where nothing does; whole : a new piece begins

    start : where a new piece rests, if that is known
    """

    name: str
    changes: dict[str, Any] | None = None
    whole: bool = False
    start: Pose | None = None


def step(call: Call) -> Shape | None:
    """Follow the changes and go some steps; None where the piece is not known here, so that all of it has to be sent."""
    if call.whole:
        _pieces.clear()  # one at a time: a process would else keep all that anybody ever looked at
        _pieces[call.name] = LivePiece()
    piece = _pieces.get(call.name)
    if piece is None:
        return None
    if call.changes is not None:
        piece.change(call.changes, call.start)
    return piece.advance()


def forget() -> None:
    """Let go of all pieces."""
    _pieces.clear()

"""Live pieces in a worker process, by name; keeping them between calls makes each call fast."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...mechanics.assembly import Pose
from .live_piece import LiveEquilibrium, LivePiece

_pieces: dict[str, LivePiece] = {}  # the pieces of this process


@dataclass(frozen=True, eq=False)
class LiveRequest:
    """Request to a live piece.

    name : of the piece
    changes : changed fields of ``LiveInput`` since the last call, or None
    whole : whether ``changes`` holds all fields and starts a new piece
    start : pose at rest of a new piece, if known
    """

    name: str
    changes: dict[str, Any] | None = None
    whole: bool = False
    start: Pose | None = None


def step_piece(call: LiveRequest) -> LiveEquilibrium | None:
    """Apply the changes and compute some steps; None if this process does not have the piece, so that ``whole`` is needed."""
    if call.whole:
        _pieces.clear()  # keep one piece only, to save memory
        _pieces[call.name] = LivePiece()
    piece = _pieces.get(call.name)
    if piece is None:
        return None
    if call.changes is not None:
        piece.change(call.changes, call.start)
    return piece.advance()


def forget_pieces() -> None:
    """Delete all pieces."""
    _pieces.clear()

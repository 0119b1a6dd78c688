"""Live piece of a worker process; the process keeps it between calls, so that each call is fast."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...mechanics.assembly import Pose
from .live_piece import LiveEquilibrium, LivePiece

_pieces: dict[str, LivePiece] = {}  # the live piece of this process, by name; at most one


@dataclass(frozen=True, eq=False)
class LiveRequest:
    """Request to a live piece.

    name : name of the piece
    changes : fields of ``LiveInput`` that changed since the last call, or None
    whole : whether ``changes`` has all fields and starts a new piece
    start : equilibrium pose of a new piece, if known
    """

    name: str
    changes: dict[str, Any] | None = None
    whole: bool = False
    start: Pose | None = None


def step_piece(call: LiveRequest) -> LiveEquilibrium | None:
    """Apply the changes and compute some steps.

    Return None if this process does not have the piece; the request must then be repeated with ``whole``.
    """
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
    """Delete the live pieces of this process."""
    _pieces.clear()

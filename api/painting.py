"""Script functions that change spirals like a brush does, and protect spirals from the optimiser."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..engine.errors import FlexMapsError
from ..engine.mechanics.loads import parse_supports
from ..engine.runs.manual_changes import with_design
from ..engine.runs.outputs import DesignVersion
from ..engine.runs.piece import Piece
from ..engine.runs.stages import BY_HAND
from ..engine.spirals import painting
from ..engine.spirals.fabricable import resolve_contacts
from .pieces import ProgressLike, as_progress, run_until

# axis name -> unit vector in the surface's axes
AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
Where = float | str | Sequence[float]


def paint(
    piece: Piece,
    brush: str,
    where: Where = 1.0,
    *,
    strength: float = 1.0,
    inverted: bool = False,
    direction: str | Sequence[float] | None = None,
    progress: ProgressLike = None,
) -> Piece:
    """Change the spirals by a brush stroke, within what can be cut; drop later results.

    Protected spirals do not change. A later ``optimise`` starts from the painted spirals.

    Parameters
    ----------
    piece : the piece; stages up to the spirals run first if missing
    brush : "stiffer", "softer", "smooth", "twist", "width", "along" (with ``direction``), or "stiffness", which sets
        the stiffness to the values of ``where``, from 0 (softest) to 1 (stiffest)
    where : weights from 0 to 1: a number for all quads, a number for each quad, or the quads as "1,2,3" or "lowest", or
        the name of a vertex group, a colour or an attribute of the object
    strength : share of the brush's full effect, 0 to 1
    inverted : apply the opposite change
    direction : "x", "y", "z" or a vector of three numbers
    progress : called with a fraction and a text

    Returns
    -------
    A new piece.

    Raises
    ------
    FlexMapsError where ``where``, ``strength`` or ``direction`` cannot be read.
    """
    reporter = as_progress(progress)
    ready = run_until(piece, "design", reporter.part(0.0, 0.8))
    design, kept = ready.result.need(DesignVersion).design, ready.result.protected
    weight, share = _parse_weight_field(ready, where), _parse_strength(strength)
    level = weight if brush == "stiffness" else None
    stroke = painting.Stroke(inverted, None if direction is None else _parse_direction(direction), level)
    weight = np.full(len(weight), share) if level is not None else share * weight
    changed = painting.paint_spirals(design, brush, weight, stroke, fixed=kept)
    free = np.ones(len(weight), dtype=bool)
    free[[] if kept is None else kept] = False
    sound = resolve_contacts(changed, reporter.part(0.8, 1.0), free=free)
    return replace(ready, made=with_design(ready.result, sound, BY_HAND, ready.settings))


def protect(piece: Piece, where: Where | None) -> Piece:
    """Set which spirals the optimiser must not change.

    Parameters
    ----------
    piece : the piece
    where : as in ``paint``; quads with a weight of at least 0.5 are protected. None protects no spirals.

    Returns
    -------
    A new piece.

    Raises
    ------
    FlexMapsError where ``where`` cannot be read.
    """
    quads = None if where is None else np.flatnonzero(_parse_weight_field(piece, where) >= 0.5)
    return replace(piece, made=piece.result.with_user(protected=quads if quads is not None and len(quads) else None))


def _parse_weight_field(piece: Piece, where: Where) -> np.ndarray:
    """Return the weights that ``where`` describes, (F,) from 0 to 1.

    Parameters
    ----------
    piece : the piece
    where : as in ``paint``

    Raises
    ------
    FlexMapsError where ``where`` is neither a known name nor numbers from 0 to 1, or has the wrong length.
    """
    count = len(piece.mesh.quads)
    if isinstance(where, str):
        if piece.uid is not None:
            from ..bridge.store import fields, objects, snapshot

            if where in fields.list_fields(objects.find_by_uid(piece.uid)):
                return fields.read_field(*snapshot.reread_surface(piece.uid), where)
        try:
            quads = parse_supports(piece.mesh, where)
        except FlexMapsError:
            text = f"'{where:.60}' is no group, colour or attribute of {piece.name}; nor numbers of quads from 0 to {count - 1}, nor 'lowest'"
            raise FlexMapsError(text) from None
        chosen = np.zeros(count)
        chosen[quads] = 1.0
        return chosen
    values = _parse_weights(where)
    if values.shape not in ((), (count,)):
        raise FlexMapsError(f"{piece.name} has {count} quads; give one number for all of them, or {count}")
    if not ((values >= 0.0) & (values <= 1.0)).all():
        raise FlexMapsError("Painting weights must lie between 0 and 1")
    return np.broadcast_to(values, (count,)).astype(float)


def _parse_weights(where: Any) -> np.ndarray:
    try:
        return np.asarray(where, dtype=float)
    except (TypeError, ValueError):
        raise FlexMapsError(f"'{where!s:.60}' is not a number, or an array of numbers, from 0 to 1") from None


def _parse_strength(strength: Any) -> float:
    value = _parse_weights(strength)
    if value.shape or not 0.0 <= float(value) <= 1.0:
        raise FlexMapsError(f"Strength '{strength!s:.30}': give a number from 0 to 1")
    return float(value)


def _parse_direction(direction: str | Sequence[float]) -> np.ndarray:
    """Return an axis name or three numbers as a vector, (3,)."""
    way = AXES.get(direction) if isinstance(direction, str) else direction
    try:
        vector = np.asarray(way, dtype=float)
    except (TypeError, ValueError):
        vector = np.zeros(0)
    if vector.shape != (3,) or not np.isfinite(vector).all() or not vector.any():
        raise FlexMapsError(f"Direction '{direction!s:.60}': give x, y, z, or three numbers")
    return vector

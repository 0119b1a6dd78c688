"""Forces on single spirals and wishes for them, for scripts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..engine.errors import FlexMapsError
from ..engine.mechanics.loads import standing
from ..engine.optimisation.wishes import Wishes
from ..engine.runs import stages
from ..engine.runs.piece import Piece


def pull(piece: Piece, quads: str | Sequence[int], force: Sequence[float]) -> Piece:
    """The piece with a force of newtons in world axes at each of some spirals, beside what pulls already; what it makes out of date is dropped."""
    made, by = piece.result, _vector(force, "force")
    total = np.zeros((len(made.mesh.quads), 3)) if made.force is None else made.force.copy()
    total[standing(made.mesh, quads)] += by
    left = stages.without(made, stages.concerned({"loads"}))
    return replace(piece, made=replace(left, force=total if total.any() else None))


def wish(piece: Piece, quads: str | Sequence[int], by: Sequence[float]) -> Piece:
    """The piece with the wish that ``optimise`` brings some spirals to so many millimetres beside the target; by nothing takes it back.

    quads : numbers, or as ``supports`` are named
    """
    made, shift = piece.result, _vector(by, "way")
    offsets = np.zeros((len(made.mesh.quads), 3)) if made.wishes is None else made.wishes.offsets(made.mesh)
    offsets[standing(made.mesh, quads)] = 1e-3 * shift
    return replace(piece, made=replace(made, wishes=Wishes.of(made.mesh, offsets)))


def _vector(values: Sequence[float], name: str) -> np.ndarray:
    try:
        found = np.array(values, dtype=float)
    except (TypeError, ValueError):
        found = np.zeros(0)
    if found.shape != (3,) or not np.isfinite(found).all():
        raise FlexMapsError(f"The {name} must be three finite numbers, along x, y and z")
    return found

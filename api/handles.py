"""Script functions that set forces on single spirals and drag targets for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..engine.errors import FlexMapsError
from ..engine.mechanics.loads import parse_supports
from ..engine.optimisation.wishes import Wishes
from ..engine.runs.piece import Piece


def pull(piece: Piece, quads: str | Sequence[int], force: Sequence[float]) -> Piece:
    """Add a force to the forces on some spirals, and drop the results that depend on loads.

    Parameters
    ----------
    piece : the piece
    quads : indices of the quads, or a text as for ``supports`` of ``load``
    force : newtons on each of these quads, in world axes (x, y, z)

    Returns
    -------
    A new piece; without forces if all of them are zero now.

    Raises
    ------
    FlexMapsError where ``force`` is not three finite numbers, or ``quads`` names no quads.
    """
    made, by = piece.result, _parse_vector(force, "force")
    total = np.zeros((len(made.mesh.quads), 3)) if made.force is None else made.force.copy()
    total[parse_supports(made.mesh, quads)] += by
    return replace(piece, made=made.with_user(force=total if total.any() else None))


def wish(piece: Piece, quads: str | Sequence[int], by: Sequence[float]) -> Piece:
    """Set a drag target for some spirals: ``optimise`` then moves them towards an offset from the target surface.

    Parameters
    ----------
    piece : the piece
    quads : indices of the quads, or a text as for ``supports`` of ``load``
    by : offset in millimetres, in world axes (x, y, z); (0, 0, 0) removes the drag target

    Returns
    -------
    A new piece.

    Raises
    ------
    FlexMapsError where ``by`` is not three finite numbers, or ``quads`` names no quads.
    """
    made, shift = piece.result, _parse_vector(by, "offset")
    offsets = np.zeros((len(made.mesh.quads), 3)) if made.wishes is None else made.wishes.offsets(made.mesh)
    offsets[parse_supports(made.mesh, quads)] = 1e-3 * shift
    return replace(piece, made=made.with_user(wishes=Wishes.from_offsets(made.mesh, offsets)))


def _parse_vector(values: Sequence[float], name: str) -> np.ndarray:
    try:
        vector = np.array(values, dtype=float)
    except (TypeError, ValueError):
        vector = np.zeros(0)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise FlexMapsError(f"The {name} must be three finite numbers, along x, y and z")
    return vector

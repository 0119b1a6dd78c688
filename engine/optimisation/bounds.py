"""Restoration of the clearance between arms after a step, so that every design of a search can be cut.

The clearance of a gap is a smooth function of the design (see ``spirals.clearance.room``). A step keeps its linearisation
``room + slope @ step >= 0``. Gaps that still close, because clearance is curved, are opened again along the slopes; where that
fails, single spirals take only part of the step. So every design of the search can be cut.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..arrays import Bool, Float
from ..spirals.clearance.room import Terms
from .polytope import LinearClearances, Projection

# Tikhonov term of the least-squares problem that restores clearances. Without it, nearly parallel rows with different residuals lead to
# moves many times as long as the step: on a surface of 986 quads these undid half of every step, with this term 3 to 10 %
RESTORE_RIDGE = 0.1
OVERSHOOT = 1.0 + RESTORE_RIDGE  # factor on the missing clearance that makes up for the Tikhonov term on a single gap
MAX_RESTORATIONS = 8  # largest number of rounds that open closed gaps again along the slopes of their clearances
HALVINGS = 6  # of the share of a step that a spiral takes, before it takes none
MAX_SHORTENINGS = 50  # rounds that look for spirals which must take a smaller share
MIN_CLEARANCE = 5e-4  # clearance, in units of the coordinates, that a restored gap gets


def narrowest_per_pair(terms: Terms) -> Terms:
    """Keep the narrowest gap of every two arms, out of the several places where it is measured."""
    order = np.lexsort((terms.value, *terms.arms.T))
    arms = terms.arms[order]
    first = np.ones(len(order), dtype=bool)
    first[1:] = (arms[1:] != arms[:-1]).any(axis=1)
    kept = order[first]
    by_flat = None if terms.by_flat is None else terms.by_flat[kept]
    return Terms(terms.value[kept], terms.by_design[kept], by_flat, terms.arms[kept])


@dataclass(frozen=True, eq=False)
class ClearanceProblem:
    """Clearances of a problem, as ``restore_clearances`` needs them.

    rooms(x, mask) : clearances, by the first ``own`` coordinates, of closed and nearly closed gaps at the arms of the masked spirals
    shut(x, mask) : mask of the spirals with an arm in a closed gap, out of the gaps at the arms of the masked spirals
    spread : repeats a value of every spiral for each of its coordinates
    spirals : number of spirals; own : number of coordinates that may move to open a gap, equally many for each spiral
    A mask of None stands for all spirals.
    """

    rooms: Callable[[np.ndarray, np.ndarray | None], LinearClearances]
    shut: Callable[[np.ndarray, np.ndarray | None], Bool[np.ndarray, " spirals"]]
    spread: Callable[[np.ndarray], np.ndarray]
    spirals: int
    own: int


def restore_clearances(
    x: Float[np.ndarray, " coordinates"], inner: Float[np.ndarray, " coordinates"], within: ClearanceProblem
) -> Float[np.ndarray, " coordinates"]:
    """Return the coordinates of a design near ``x`` that can be cut; ``inner`` are the coordinates of a design that can be cut."""
    x, own, quads = x.copy(), within.own, None
    for _ in range(MAX_RESTORATIONS):
        near = within.rooms(x, quads)
        closed = near.room <= 0.0
        if not closed.any():
            return x
        rows = near.of_rows(closed)
        x[:own] = np.clip(
            x[:own] + Projection(rows.slope, RESTORE_RIDGE).least(OVERSHOOT * (MIN_CLEARANCE - rows.room)), 0.0, 1.0
        )
        # only gaps at spirals that have just moved can have closed
        quads = (abs(rows.slope).sum(axis=0) > 0.0).reshape(within.spirals, -1).any(axis=1)
    share, quads, found = np.ones(within.spirals), None, x
    for turn in range(MAX_SHORTENINGS):
        quads = within.shut(found, quads)
        if not quads.any():
            return found
        if turn > HALVINGS and not share[quads].any():
            break  # the remaining closed gaps do not depend on these spirals
        share[quads] = 0.5 * share[quads] if turn < HALVINGS else 0.0
        found = inner + within.spread(share) * (x - inner)
    return inner

"""Restore the clearance between arms after a step, so that every design of a search can be cut.

The clearance of a gap is a smooth function of the design (see ``spirals.clearance.clearance_model``). A step satisfies
the linearised clearances ``clearance + slope @ step >= 0``. Gaps that close all the same, because clearance is not
linear, are opened by moving the design along the gradients of their clearances; if that fails, single spirals take only
a share of the step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..arrays import Bool, Float
from ..spirals.clearance.clearance_model import Clearances
from .polytope import LinearClearances, Projection

# Tikhonov term of the least-squares problem that restores clearances. Smaller: nearly parallel gradients with different
# residuals lead to moves many times as long as the step; larger: more rounds (docs/tuning.md)
RESTORE_RIDGE = 0.1
OVERSHOOT = 1.0 + RESTORE_RIDGE  # factor on the missing clearance that makes up for the Tikhonov term on a single gap
MAX_RESTORATIONS = 8  # largest number of rounds that open closed gaps along the gradients of their clearances
HALVINGS = 6  # number of times that a spiral's share of the step is halved before it becomes 0
MAX_SHORTENINGS = 50  # largest number of rounds in which spirals with closed gaps get smaller shares of the step
# Linearised clearance, in units of the design variables, to which a closed gap is opened. Larger: fewer rounds, designs
# move farther
MIN_CLEARANCE = 5e-4


def narrowest_per_pair(terms: Clearances) -> Clearances:
    """Return the clearances without all but the narrowest place of every pair of arms."""
    order = np.lexsort((terms.value, *terms.arms.T))
    arms = terms.arms[order]
    first = np.ones(len(order), dtype=bool)
    first[1:] = (arms[1:] != arms[:-1]).any(axis=1)
    kept = order[first]
    by_flat = None if terms.by_flat is None else terms.by_flat[kept]
    return Clearances(terms.value[kept], terms.by_design[kept], by_flat, terms.arms[kept])


@dataclass(frozen=True, eq=False)
class ClearanceProblem:
    """Clearances of a problem, as functions of the design variables x and of a mask of spirals; None stands for all.

    linear_clearances : closed and nearly closed gaps at the arms of these spirals, linearised in the first
        ``n_movable`` design variables
    spirals_with_closed_gaps : mask of the spirals with an arm in a closed gap; counts only gaps at these spirals' arms
    repeat_per_coordinate : repeats a value of every spiral for each of its design variables
    spirals : number of spirals
    n_movable : number of design variables that may move to open a gap, equally many for each spiral
    """

    linear_clearances: Callable[[np.ndarray, np.ndarray | None], LinearClearances]
    spirals_with_closed_gaps: Callable[[np.ndarray, np.ndarray | None], Bool[np.ndarray, " spirals"]]
    repeat_per_coordinate: Callable[[np.ndarray], np.ndarray]
    spirals: int
    n_movable: int


def restore_clearances(
    x: Float[np.ndarray, " coordinates"], feasible: Float[np.ndarray, " coordinates"], problem: ClearanceProblem
) -> Float[np.ndarray, " coordinates"]:
    """Return the design variables of a design near ``x`` that can be cut.

    Parameters
    ----------
    x : design variables after a step
    feasible : design variables before the step, of a design that can be cut
    problem : clearances and their closed gaps
    """
    x, n_movable, quads = x.copy(), problem.n_movable, None
    for _ in range(MAX_RESTORATIONS):
        near = problem.linear_clearances(x, quads)
        closed = near.clearance <= 0.0
        if not closed.any():
            return x
        rows = near.subset(closed)
        x[:n_movable] = np.clip(
            x[:n_movable]
            + Projection(rows.slope, RESTORE_RIDGE).least_norm_solution(OVERSHOOT * (MIN_CLEARANCE - rows.clearance)),
            0.0,
            1.0,
        )
        # only gaps at spirals that have just moved can have closed
        quads = (abs(rows.slope).sum(axis=0) > 0.0).reshape(problem.spirals, -1).any(axis=1)
    share, quads, found = np.ones(problem.spirals), None, x
    for turn in range(MAX_SHORTENINGS):
        quads = problem.spirals_with_closed_gaps(found, quads)
        if not quads.any():
            return found
        if turn > HALVINGS and not share[quads].any():
            break  # these spirals take no share of the step any more, so other spirals close the remaining gaps
        share[quads] = 0.5 * share[quads] if turn < HALVINGS else 0.0
        found = feasible + problem.repeat_per_coordinate(share) * (x - feasible)
    return feasible

"""Newton's full steps, for problems whose start is near the minimum."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..engine.newton import CONVERGED, DIVERGED, INDEFINITE, ITERATIONS, FactoredProblem, Iteration, LocalModel

GROWN, PATIENCE = 1e6, 6  # it diverges if the decrement exceeds GROWN times its minimum after PATIENCE steps; by eye


@dataclass(eq=False)
class FullSteps:
    """Full Newton steps until the decrement is small relative to the energy; the last step is still taken.

    tolerance : decrement over energy at which the iteration has converged
    iterations : largest number of iterations
    convex : shares of the convex part, tried until the matrix is positive definite; only the first one counts as converged
    least : smallest energy with which the decrement is compared
    patience : number of iterations before it may be declared divergent
    best : smallest decrement so far
    """

    tolerance: float
    iterations: int
    convex: tuple[float, ...] = (0.0,)
    least: float = 0.0
    patience: int = PATIENCE
    best: float = field(default=np.inf, init=False)

    def advance(
        self, problem: FactoredProblem, state: Any, here: LocalModel, history: list[Iteration]
    ) -> tuple[Any, str | None]:
        row = history[-1]
        for row.modified in self.convex:
            if problem.factor(here, row.modified, 0.0):
                break
        else:
            return state, INDEFINITE
        step = problem.step(here)
        row.decrement, row.step = abs(problem.slope(here, step)), 1.0
        state = problem.moved(state, step)
        energy = problem.energy(state)
        if not np.isfinite(energy):
            return state, DIVERGED
        if row.decrement <= self.tolerance * max(energy, self.least) and row.modified == self.convex[0]:
            return state, CONVERGED
        self.best = min(self.best, row.decrement)
        if len(history) > self.patience and row.decrement > GROWN * self.best:
            return state, DIVERGED
        return state, ITERATIONS if len(history) == self.iterations else None

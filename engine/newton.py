"""Newton's method for all minimisations of the program.

A problem (``Problem``) defines what its states are: for example poses of hubs, positions of a solid's nodes, or
designs. At a state it evaluates the energy and its gradient, and solves linear systems with the Hessian. The unknowns
are increments, which ``moved`` adds to the state; increments of fixed degrees of freedom are zero. A rule chooses the
next state: ``LineSearch`` if the Hessian may be indefinite on the way, ``LevenbergMarquardt`` (in its own module) for
least squares whose Hessian is available only as products with vectors.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import numpy as np

Result = TypeVar("Result")

# Reasons for the end of a run. CONVERGED: at a minimum within the tolerance; REACHED: the state is as good as the
# problem requires; ITERATIONS, TIME: a limit is exceeded; AT_ROUNDING, SADDLE: further steps would be rounding errors,
# at a minimum or at a saddle; INDEFINITE: the Hessian cannot be made positive definite; NO_DESCENT: no step decreases
# the energy; DIVERGED: the energy is not finite, or the steps grow
CONVERGED, REACHED, ITERATIONS, TIME = "converged", "reached", "iterations", "time"
SADDLE, INDEFINITE, NO_DESCENT = "saddle", "indefinite", "no descent"
AT_ROUNDING, DIVERGED = "rounded", "diverged"

# A share of an indefinite Hessian is replaced by its convex part (Gauss-Newton). After each step this share is
# multiplied by DECAY; a share below LEAST_CONVEX is replaced by 0; both by eye. Larger: safer, but more steps
DECAY, LEAST_CONVEX = 0.3, 0.01
# shares by which the convex part's diagonal is increased, tried in turn where rounding errors make it indefinite
SHIFTS = (1e-9, 1e-6, 1e-3)
# share of the decrease predicted by the slope that a step must at least achieve (Nocedal and Wright, section 3.1)
ARMIJO = 1e-4
SHORTEST = 2.0**-30  # smallest share of a step that the line search tries; shorter steps would be rounding errors
# A step must end below the maximum of this number of recent energies, because the energy of thin shells may rise before
# it falls
RECENT = 5
NOISE = 1e-13  # rounding error of the energy, over the sum of its terms' absolute values
NEGLIGIBLE_STEP = 1e-13  # steps with smaller increments, in radians and metres, are rounding errors
# The iteration stagnates if the residual is below CREEPING and has not halved in STEPS steps. This happens on the ridge
# of a saddle or in a flat valley, where the convex part makes steps far too short. Larger CREEPING or fewer STEPS:
# reacts sooner (docs/tuning.md)
CREEPING, STEPS = 1e-5, 8
LITTLE = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3)  # shares of the convex part that are tried in turn on stagnation; by eye


@dataclass(frozen=True, eq=False)
class LocalModel:
    """Expansion of a problem about a state.

    energy : value of the objective
    gradient : derivatives of the energy with respect to the increments of a step
    residual : norm of the gradient, in a norm that the problem chooses
    terms : sum of the absolute values of the energy's terms, to estimate rounding errors
    own : data that the problem needs for its Hessian
    """

    energy: float
    gradient: np.ndarray
    residual: float = 0.0
    terms: float = 0.0
    own: Any = None


@dataclass(eq=False)
class Iteration:
    """Record of one iteration.

    energy, residual : at the state where the iteration begins
    modified : share of the convex part in the Hessian (``LineSearch``), or damping (``LevenbergMarquardt``)
    step : share of the full step that was taken
    decrement : predicted decrease of the energy
    """

    energy: float
    residual: float
    modified: float = 0.0
    step: float = 0.0
    decrement: float = 0.0


@dataclass(frozen=True, eq=False)
class Run:
    """Outcome of a minimisation.

    state : last state
    here : last computed expansion
    ended : reason for the end, such as ``CONVERGED``
    history : all iterations
    """

    state: Any
    here: LocalModel
    ended: str
    history: list[Iteration]


class Problem(Protocol):
    """A minimisation problem. States are never changed in place."""

    def expand(self, state: Any) -> LocalModel:
        """Return the expansion about a state: energy, gradient and the data that the Hessian needs."""

    def energy(self, state: Any) -> float:
        """Return the energy of a state; NaN or infinite for states that are not allowed."""

    def watch(self, state: Any, history: list[Iteration]) -> None:
        """Is called with every new state and all iterations so far; raises ``Cancelled`` if the user cancels."""


class FactoredProblem(Problem, Protocol):
    """A problem whose Hessian can be factorised (Cholesky)."""

    def moved(self, state: Any, step: np.ndarray) -> Any:
        """Return the state after the increments ``step``; rotations are composed, vectors added."""

    def factor(self, here: LocalModel, convex: float, shift: float) -> bool:
        """Factorise (1 - convex) H + convex B, where H is the Hessian and B its convex part with a larger diagonal.

        The diagonal of B is increased by the share ``shift`` of itself. Returns False if the sum is not positive
        definite.
        """

    def step(self, here: LocalModel) -> np.ndarray:
        """Return the Newton step with the last factorised matrix, shortened to where the expansion is accurate."""

    def slope(self, here: LocalModel, step: np.ndarray) -> float:
        """Return the directional derivative of the energy along a step."""


class SaddleProblem(FactoredProblem, Protocol):
    """A problem whose energy may have saddles."""

    def stable(self, state: Any) -> bool:
        """Return whether the exact Hessian at a state is positive definite; its factorisation is kept."""

    def exits(self, state: Any) -> list[Any]:
        """Return two states from which a search leaves a saddle.

        They are a small step away from it, to either side along the direction in which the energy falls most.
        """


class Rule(Protocol):
    """A rule that chooses the next state of a minimisation."""

    def advance(self, problem: Any, state: Any, here: LocalModel, history: list[Iteration]) -> tuple[Any, str | None]:
        """Return the next state, and the reason for the end (such as ``CONVERGED``) or None if the search goes on.

        Parameters
        ----------
        problem, state : the problem and its present state
        here : expansion about this state
        history : all iterations so far; the last one is this iteration, whose record the rule completes
        """


def minimise(problem: Problem, start: Any, rule: Rule) -> Run:
    """Minimise the energy of a problem.

    Parameters
    ----------
    problem : the problem, of the protocol that the rule needs
    start : initial state
    rule : chooses the next states
    """
    return run_to_end(minimise_stepwise(problem, start, rule))


def minimise_stepwise(problem: Problem, start: Any, rule: Rule) -> Generator[Any, None, Run]:
    """Run ``minimise`` as a generator: it yields every new state, and returns the run at the end.

    Parameters
    ----------
    problem, start, rule : as in ``minimise``
    """
    state, history = start, []
    while True:
        here = problem.expand(state)
        history.append(Iteration(here.energy, here.residual))
        problem.watch(state, history)
        state, ended = rule.advance(problem, state, here, history)
        if ended:
            return Run(state, here, ended, history)
        yield state


def run_to_end(steps: Generator[Any, None, Result]) -> Result:
    """Run a generator to its end and return its return value."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value  # type: ignore[no-any-return]


@dataclass(eq=False)
class LineSearch:
    """Newton's method with a nonmonotone line search (Grippo, Lampariello and Lucidi 1986).

    If the Hessian is indefinite, its convex part replaces it in this step, and a decreasing share of it in the next
    steps. This takes far fewer iterations than projecting the Hessian in every step. From a saddle, the search
    goes on along a direction in which the energy falls.

    tolerance : residual at which the iteration has converged
    iterations : largest number of iterations
    convex : present share of the convex part in the Hessian
    decay : factor on ``convex`` after each step
    """

    tolerance: float
    iterations: int
    decay: float = DECAY
    convex: float = 0.0

    def advance(
        self, problem: SaddleProblem, state: Any, here: LocalModel, history: list[Iteration]
    ) -> tuple[Any, str | None]:
        if here.residual <= self.tolerance:
            if problem.stable(state):
                return state, CONVERGED
            return min(problem.exits(state), key=problem.energy), None
        if len(history) > self.iterations:
            return state, ITERATIONS
        if not self._factorise(problem, here, history):
            return state, INDEFINITE
        step = problem.step(here)
        if np.abs(step).max() <= NEGLIGIBLE_STEP:
            # the step consists of rounding errors, so no further step would make the residual smaller
            return state, AT_ROUNDING if problem.stable(state) else SADDLE
        found = self._search_line(problem, state, here, step, history)
        return (state, NO_DESCENT) if found is None else (found, None)

    def _factorise(self, problem: FactoredProblem, here: LocalModel, history: list[Iteration]) -> bool:
        """Factorise the Hessian with the present share of its convex part.

        If it is indefinite, try small shares (on stagnation only), then the convex part alone. Returns False if that
        fails too.
        """
        row = history[-1]
        row.modified = self.convex if self.convex >= LEAST_CONVEX else 0.0
        if not problem.factor(here, row.modified, SHIFTS[0]):
            for row.modified in LITTLE if self._stagnates(history) else ():
                if problem.factor(here, row.modified, SHIFTS[0]):
                    return True
            row.modified = 1.0
            if not any(problem.factor(here, 1.0, shift) for shift in SHIFTS):
                return False
        self.convex = self.decay * row.modified
        return True

    def _stagnates(self, history: list[Iteration]) -> bool:
        """Return whether the iteration stagnates, as defined at ``CREEPING``."""
        residuals = [one.residual for one in history]
        return len(residuals) > STEPS and CREEPING > min(residuals[-STEPS:]) > 0.5 * min(residuals[:-STEPS])

    def _search_line(
        self, problem: FactoredProblem, state: Any, here: LocalModel, step: np.ndarray, history: list[Iteration]
    ) -> Any | None:
        """Halve the step until the energy is low enough (see ``ARMIJO`` and ``RECENT``).

        Returns the new state, or None if that does not happen down to ``SHORTEST``.
        """
        row, slope = history[-1], problem.slope(here, step)
        row.decrement = -slope
        base, share = max(one.energy for one in history[-RECENT:]), 1.0
        noise = NOISE * (abs(base) + here.terms)
        while share > SHORTEST:
            trial = problem.moved(state, share * step)
            with np.errstate(all="ignore"):
                energy = problem.energy(trial)
            if np.isfinite(energy) and energy <= base + ARMIJO * share * slope + noise:
                row.step = share
                return trial
            share *= 0.5
        return None

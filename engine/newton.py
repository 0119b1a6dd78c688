"""Newton's method for all minimisations of the program.

A problem (``Problem``) defines its states, such as hubs with rotations, nodes of a solid, or a design. At a state it
evaluates energy and gradient and solves with its Hessian, in increments that ``moved`` adds to the state; increments of
fixed degrees of freedom are zero. A rule chooses the next state: ``LineSearch`` if the Hessian may be indefinite on the
way, ``LevenbergMarquardt`` for least squares whose Hessian is available only as products with vectors.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import numpy as np

Result = TypeVar("Result")

# Reasons for the end of a run. REACHED: the state is as good as required; ITERATIONS, TIME: a limit is exceeded;
# AT_ROUNDING, SADDLE: steps are rounding errors, at a minimum or at a saddle; INDEFINITE: the Hessian cannot be made
# positive definite; NO_DESCENT: no step decreases the energy
CONVERGED, REACHED, ITERATIONS, TIME = "converged", "reached", "iterations", "time"
SADDLE, INDEFINITE, NO_DESCENT = "saddle", "indefinite", "no descent"
AT_ROUNDING, DIVERGED = "rounded", "diverged"

# DECAY: factor on the share of the convex part in the Hessian after each step; LEAST_CONVEX: a smaller share counts as
# 0; by eye. Larger: safer, more steps
DECAY, LEAST_CONVEX = 0.3, 0.01
SHIFTS = (1e-9, 1e-6, 1e-3)  # relative shifts of the convex part's diagonal, tried if rounding makes it indefinite
ARMIJO = 1e-4  # smallest share of the predicted decrease that a step must achieve (Nocedal and Wright, section 3.1)
SHORTEST = 2.0**-30  # smallest share of a step in the line search; shorter steps drown in rounding errors
# Number of recent energies; a step must end below their maximum. The energy of thin shells may rise before it falls
RECENT = 5
NOISE = 1e-13  # relative rounding error of the sum of the energy's terms
NEGLIGIBLE_STEP = 1e-13  # radians and metres; smaller steps are rounding errors
# The iteration stagnates if the residual is below CREEPING and has not halved in STEPS steps: on the ridge of a saddle
# or in a flat valley the convex part makes steps far too short. Larger CREEPING, fewer STEPS: reacts sooner
# (docs/tuning.md)
CREEPING, STEPS = 1e-5, 8
LITTLE = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3)  # shares of the convex part to try in turn on stagnation; by eye
TRIALS = 12  # attempts at a damped step; each may multiply the damping by 8, so that after 12 hardly a step is left
# Actual over predicted decrease: above GOOD damping shrinks, below POOR it grows, below TAKEN the step is rejected
GOOD, POOR, TAKEN = 0.7, 0.25, 1e-3
# CUT: factor on the damping after a good step; DEEP_CUT: this factor while no step has failed and the relative error of
# the predicted decrease is below EXACT, as searches begin with much damping. Smaller: fewer steps, more refused ones
# (docs/tuning.md)
CUT, DEEP_CUT, EXACT = 0.3, 0.1, 0.1
# Smallest damping, in energies per variable: less would not change the steps, and would take longer to grow again
LEAST_DAMPING = 0.01
SHARES = 0.05, 0.5  # smallest and largest share of a refused step to try
NEGLIGIBLE = 1e-9  # length of a negligible step, in variables scaled to a box of size 1


@dataclass(frozen=True, eq=False)
class LocalModel:
    """Expansion of a problem about a state.

    energy : objective; terms : sum of its terms' absolute values, for estimates of rounding errors
    gradient : derivative of the energy with respect to the increments of a step
    residual : norm of the gradient, in a norm that the problem chooses
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
    """Outcome: last state, last computed expansion, reason for the end (a constant of this module), all iterations."""

    state: Any
    here: LocalModel
    ended: str
    history: list[Iteration]


class Problem(Protocol):
    """A minimisation problem. States are never changed in place."""

    def expand(self, state: Any) -> LocalModel:
        """Return energy, gradient and the data that the Hessian needs."""

    def energy(self, state: Any) -> float:
        """Return the energy of a state; NaN outside the problem's domain."""

    def watch(self, state: Any, history: list[Iteration]) -> None:
        """Observe every new state; raise ``Cancelled`` if the user cancels."""


class FactoredProblem(Problem, Protocol):
    """A problem whose Hessian can be factored."""

    def moved(self, state: Any, step: np.ndarray) -> Any:
        """Return the state after an increment; rotations are composed, vectors added."""

    def factor(self, here: LocalModel, convex: float, shift: float) -> bool:
        """Factor the Hessian; return False if it is not positive definite.

        A share ``convex`` of it is replaced by its convex part, whose diagonal is raised by the share ``shift`` of
        itself.
        """

    def step(self, here: LocalModel) -> np.ndarray:
        """Return Newton's step with the last factor, limited to where the expansion is accurate."""

    def slope(self, here: LocalModel, step: np.ndarray) -> float:
        """Return the directional derivative of the energy along a step."""


class SaddleProblem(FactoredProblem, Protocol):
    """A problem whose energy may have saddles."""

    def stable(self, state: Any) -> bool:
        """Return whether the exact Hessian is positive definite; its factor is stored."""

    def exits(self, state: Any) -> list[Any]:
        """Return states on both sides of a saddle, a small step along the direction of steepest decrease."""


class DampedProblem(Problem, Protocol):
    """A least squares problem with dependent quantities, such as hubs that move when the design changes."""

    @property
    def over(self) -> bool:
        """Whether the search must end, because its time has elapsed or its steps bring too little."""

    def reached(self, state: Any) -> bool:
        """Return whether a state is so good that the search ends."""

    def proposed(self, here: LocalModel, damping: float, following: float) -> Any:
        """Return a step (``step``, ``gain``) that nearly minimises the damped quadratic model; None if there is none.

        ``damping`` acts on the variables, ``following`` on the dependent quantities; ``gain`` is the predicted
        decrease.
        """

    def tried(self, here: LocalModel, proposal: Any) -> Any | None:
        """Return the state after a proposed step; None if the dependent quantities cannot follow it."""

    def shortened(self, here: LocalModel, proposal: Any, share: float) -> Any:
        """Return a proposal with a share of another proposal's step, and with the decrease predicted for that."""

    def gentle(self, proposal: Any) -> float:
        """Return the smallest damping of the dependent quantities to try after ``tried`` returned None."""

    def rejected(self) -> None:
        """Observe that the last state from ``tried`` is rejected."""

    def accepted(self, state: Any) -> None:
        """Observe that the search continues from a state."""


class Rule(Protocol):
    """Iteration scheme."""

    def advance(self, problem: Any, state: Any, here: LocalModel, history: list[Iteration]) -> tuple[Any, str | None]:
        """Return the next state, and the reason if the search ends there, else None.

        Parameters
        ----------
        problem, state : the problem and its present state
        here : expansion about this state
        history : all iterations so far; the last one is to be completed
        """


def minimise(problem: Problem, start: Any, rule: Rule) -> Run:
    """Minimise the energy of a problem; return its last state, the reason for the end, and the history.

    Parameters
    ----------
    problem : energy and derivatives
    start : initial state
    rule : iteration scheme
    """
    return run_to_end(minimise_stepwise(problem, start, rule))


def minimise_stepwise(problem: Problem, start: Any, rule: Rule) -> Generator[Any, None, Run]:
    """Minimise step by step: yield every new state, and return the run at the end.

    Parameters
    ----------
    problem, start, rule : as for ``minimise``
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

    If the Hessian has no Cholesky factor, its convex part replaces it, and its share decreases over the next steps.
    This takes far fewer iterations than projecting the Hessian in every step. Saddles are left along a direction of
    decrease.

    tolerance : residual at which the iteration has converged; iterations : largest number of iterations
    convex : present share of the convex part; decay : its factor after each step
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
        if not self._factored(problem, here, history):
            return state, INDEFINITE
        step = problem.step(here)
        if np.abs(step).max() <= NEGLIGIBLE_STEP:
            # the step is a rounding error, so the residual cannot get smaller
            return state, AT_ROUNDING if problem.stable(state) else SADDLE
        found = self._searched(problem, state, here, step, history)
        return (state, NO_DESCENT) if found is None else (found, None)

    def _factored(self, problem: FactoredProblem, here: LocalModel, history: list[Iteration]) -> bool:
        """Factor the Hessian with the present share of its convex part; if that fails, with small shares, then 1."""
        row = history[-1]
        row.modified = self.convex if self.convex >= LEAST_CONVEX else 0.0
        if not problem.factor(here, row.modified, SHIFTS[0]):
            for row.modified in LITTLE if self._creeps(history) else ():
                if problem.factor(here, row.modified, SHIFTS[0]):
                    return True
            row.modified = 1.0
            if not any(problem.factor(here, 1.0, shift) for shift in SHIFTS):
                return False
        self.convex = self.decay * row.modified
        return True

    def _creeps(self, history: list[Iteration]) -> bool:
        """Return whether the residual stagnates at a small value."""
        residuals = [one.residual for one in history]
        return len(residuals) > STEPS and CREEPING > min(residuals[-STEPS:]) > 0.5 * min(residuals[:-STEPS])

    def _searched(
        self, problem: FactoredProblem, state: Any, here: LocalModel, step: np.ndarray, history: list[Iteration]
    ) -> Any | None:
        """Halve the step until the energy is low enough; return the new state, or None if no halving is enough."""
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


@dataclass(eq=False)
class LevenbergMarquardt:
    """Levenberg-Marquardt steps: damping grows when the model predicts badly and shrinks when it predicts well.

    iterations : largest number of iterations
    stop : relative decrease; the search ends after two steps in a row below it, or after a refused step predicted below
        it
    first : RMS length of the first step along the gradient, in variables scaled to a box of size 1; sets the first
        damping
    damping : damping of the variables; may be the last value of an earlier search, unless ``first`` sets a smaller one
    following : damping of the dependent quantities
    small : number of steps in a row with a decrease below ``stop``
    too_far : whether a step has failed or achieved much less than predicted
    """

    iterations: int
    stop: float
    first: float
    damping: float | None = None
    following: float = 0.0
    small: int = 0
    too_far: bool = False

    def advance(
        self, problem: DampedProblem, state: Any, here: LocalModel, history: list[Iteration]
    ) -> tuple[Any, str | None]:
        if not history[1:]:
            along = float(np.linalg.norm(here.gradient) / (self.first * np.sqrt(here.gradient.size)))
            self.damping = along if self.damping is None else min(self.damping, along)
        found, gain = self._tried(problem, here, history[-1])
        if found is None:
            return state, TIME if problem.over else CONVERGED
        energy = problem.energy(found)
        # a step much worse than predicted does not indicate convergence: count at least POOR of the predicted decrease
        fall = max(here.energy - energy, POOR * gain) / here.energy
        problem.accepted(found)
        self.small = self.small + 1 if fall < self.stop else 0
        if problem.reached(found):
            return found, REACHED
        if self.small == 2:
            return found, CONVERGED
        if len(history) == self.iterations:
            return found, ITERATIONS
        return found, TIME if problem.over else None

    def _tried(self, problem: DampedProblem, here: LocalModel, row: Iteration) -> tuple[Any | None, float]:
        """Propose steps with ever more damping until one is accepted, as a whole or shortened.

        Return the accepted state, None if all are refused, and its predicted decrease.
        """
        assert self.damping is not None
        for _ in range(TRIALS):
            row.modified = self.damping
            proposal = problem.proposed(here, self.damping, self.following)
            if proposal is None:
                break
            if proposal.gain <= 0.0:
                # no decrease is left after projecting the step onto the bounds: a shorter step is projected less
                self.damping *= 8.0
                continue
            trial = problem.tried(here, proposal)
            if trial is None:
                self.following, self.too_far = max(8.0 * self.following, problem.gentle(proposal)), True
                continue
            ratio = (here.energy - problem.energy(trial)) / max(proposal.gain, 1e-300)
            if ratio > GOOD:
                factor = CUT if self.too_far or abs(ratio - 1.0) > EXACT else DEEP_CUT
                least = min(self.damping, LEAST_DAMPING * here.energy / here.gradient.size)
                self.damping, self.following = max(factor * self.damping, least), factor * self.following
            elif ratio < POOR:
                self.damping, self.following, self.too_far = 4.0 * self.damping, 8.0 * self.following, True
            if ratio > TAKEN:
                row.decrement, row.step = proposal.gain, 1.0
                return trial, proposal.gain
            problem.rejected()
            if proposal.gain < self.stop * here.energy:
                break  # with more damping even less decrease would be predicted
            share = _least_share(here, proposal.step, problem.energy(trial))
            found, gain = self._shorter(problem, here, proposal, share, row)
            if found is not None:
                return found, gain
        return None, 0.0

    @staticmethod
    def _shorter(
        problem: DampedProblem, here: LocalModel, proposal: Any, share: float, row: Iteration
    ) -> tuple[Any | None, float]:
        """Return the state after a share of a refused step, and its predicted decrease; None if that is refused too."""
        shorter = problem.shortened(here, proposal, share)
        found = problem.tried(here, shorter)
        if found is None or here.energy - problem.energy(found) <= max(TAKEN * shorter.gain, 0.0):
            return None, 0.0
        row.decrement, row.step = shorter.gain, share
        return found, shorter.gain


def _least_share(here: LocalModel, step: np.ndarray, energy: float) -> float:
    """Return the share of a step, within ``SHARES``, at which the parabola that has the slope at its beginning and the
    energies at both ends is least; ``energy``: energy after the whole step."""
    along = float(here.gradient @ step)
    bend = energy - here.energy - along
    return float(np.clip(-0.5 * along / bend, *SHARES)) if bend > 0.0 else SHARES[1]

"""Newton's method for every minimisation of the program: one kind of problem, one loop, one history.

A problem knows what its states are (hubs with rotations, nodes of a solid, a design) and gives, about a state, the energy, its
gradient and the solution of its Hessian, in increments that ``moved`` adds to a state; increments that are held stay zero. A
rule knows how to go on from there: ``LineSearch`` where the Hessian is indefinite on the way, ``FullSteps`` where mixed
stresses make full steps safe, ``Damped`` for least squares whose Hessian is known by its products only.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

import numpy as np

Result = TypeVar("Result")

CONVERGED, ITERATIONS, TIME = "converged", "iterations", "time"
SADDLE, INDEFINITE, NO_DESCENT = "saddle", "indefinite", "no descent"
ROUNDED, DIVERGED = "rounded", "diverged"

# of the convex share: what a step leaves of it, and below which it counts as none; by eye
DECAY, LEAST_CONVEX = 0.3, 0.01
# of the convex part's diagonal, one after the other where rounding leaves it indefinite; not measured, the first nearly always does
SHIFTS = (1e-9, 1e-6, 1e-3)
ARMIJO = 1e-4  # share of the predicted fall that a step must bring: the usual value (Nocedal and Wright, section 3.1)
SHORTEST = 2.0**-30  # of a step that is halved again and again before it is given up: rounding takes over
RECENT = 5  # energies, of which a step may reach the largest: along bends a thin shell gets worse before it gets better
NOISE = 1e-13  # of the energy's terms: what rounding alone may change in their sum
STILL = 1e-13  # radians and metres of a step that changes nothing any more: rounding
ESCAPES = 5  # saddles that are left before the search is given up; not measured, one is the rule
# A residual below this that has not been halved for so many steps creeps along the ridge of a saddle or a valley that is hardly
# bent, where the convex part makes steps far too short: then shares of it are tried from the least one on. A piece of 196 spirals
# just beyond a bifurcation took 500 steps without coming to rest
CREEPING, STEPS = 1e-5, 8
LITTLE = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3)  # these shares; by eye
GROWN, PATIENCE = 1e6, 6  # a decrement so much above its least, after so many steps, does not come down again; by eye
TRIALS = 12  # of a damped step before the search ends: 8 ** 12 times the damping leaves nothing of it
FIRST = 0.3  # of a box of size 1 that a first step along the gradient uses
# actual over predicted fall: above, less damping; below, more; below, the step is not taken
GOOD, POOR, TAKEN = 0.7, 0.25, 1e-3
# Factor of the damping after a good step, and the smaller one while no step has gone too far and the fall is predicted within the share ``EXACT``.
# First steps are damped a thousand times too much: with the smaller factor a surface of 986 quads took 5 steps, not 9
CUT, DEEP_CUT, EXACT = 0.3, 0.1, 0.1
# Least damping, in energies over the number of variables: below it no step changes, and the damping takes longer to grow again
LEAST_DAMPING = 0.01
HOPE = 0.25  # share of the predicted fall that counts as still to be had; by eye
TINY = 1e-9  # of a box of size 1: a step that is none


@dataclass(frozen=True, eq=False)
class Local:
    """A problem about one state.

    energy : what is minimised; terms : sum of the sizes of its terms, of which rounding changes a share
    gradient : by the increments of a step; residual : the gradient's size in the problem's own measure
    own : whatever else the problem needs for its Hessian
    """

    energy: float
    gradient: np.ndarray
    residual: float = 0.0
    terms: float = 0.0
    own: Any = None


@dataclass(eq=False)
class Iteration:
    """What happened at one state.

    modified : share of the convex part in the place of the Hessian, or the damping; step : share of the step that was taken;
    decrement : the fall of the energy that its slope predicts for the whole step
    """

    energy: float
    residual: float
    modified: float = 0.0
    step: float = 0.0
    decrement: float = 0.0


@dataclass(frozen=True, eq=False)
class Run:
    """state : where it ended; here : about the last state whose derivatives were asked for; ended : why, a word of this module"""

    state: Any
    here: Local
    ended: str
    history: list[Iteration]


class Problem(Protocol):
    """What is minimised. States are never changed in place."""

    def expand(self, state: Any) -> Local:
        """Energy and gradient, and what the Hessian needs."""

    def energy(self, state: Any) -> float:
        """Not a number where the state is out of what the problem knows."""

    def watch(self, state: Any, history: list[Iteration]) -> None:
        """Told of every state; raises ``Cancelled`` when the user wants to stop."""


class Factored(Problem, Protocol):
    """A problem whose Hessian has factors."""

    def moved(self, state: Any, step: np.ndarray) -> Any:
        """The state after an increment; rotations turn, vectors add up."""

    def factor(self, here: Local, convex: float, shift: float) -> bool:
        """Factor the Hessian, or with a share of its convex part in its place, whose diagonal is raised by a share of itself.

        False where it is not positive definite.
        """

    def step(self, here: Local) -> np.ndarray:
        """Newton's step with the last factor, as far as the expansion can be trusted."""

    def slope(self, here: Local, step: np.ndarray) -> float:
        """How fast the energy changes along a step."""


class Escapable(Factored, Protocol):
    """A problem with saddles."""

    def stable(self, state: Any) -> bool:
        """Whether the exact Hessian there is positive definite; its factor is kept."""

    def exits(self, state: Any) -> list[Any]:
        """States to both sides of a saddle, a little along the direction in which the energy falls most."""


class DampedProblem(Problem, Protocol):
    """A least squares problem with quantities that follow its variables, such as hubs that move with a design."""

    @property
    def over(self) -> bool:
        """Whether the time for it is used up."""

    def proposed(self, here: Local, damping: float, following: float) -> Any:
        """A step (``step``, ``gain``) that nearly minimises the quadratic model, damped in the variables and in what follows them.

        ``gain`` is the fall of the energy that the model predicts.
        """

    def tried(self, here: Local, proposal: Any) -> Any | None:
        """The state after a proposed step; None where there is none."""

    def gentle(self, here: Local, proposal: Any) -> float:
        """The least damping of what follows with which to go on where there was none."""

    def rejected(self) -> None:
        """Told of every state that is not gone on from."""

    def accepted(self, state: Any) -> None:
        """Told of every state that is gone on from."""


class Rule(Protocol):
    """How to go on from a state."""

    def advance(self, problem: Any, state: Any, here: Local, history: list[Iteration]) -> tuple[Any, str | None]:
        """The next state, and why the search ends there, if it does."""


def minimise(problem: Problem, start: Any, rule: Rule) -> Run:
    """From a state to where the rule ends, best a minimum."""
    return exhausted(stepping(problem, start, rule))


def stepping(problem: Problem, start: Any, rule: Rule) -> Generator[Any, None, Run]:
    """The same, step by step: gives every state as soon as it is reached, and returns the run."""
    state, history = start, []
    while True:
        here = problem.expand(state)
        history.append(Iteration(here.energy, here.residual))
        problem.watch(state, history)
        state, ended = rule.advance(problem, state, here, history)
        if ended:
            return Run(state, here, ended, history)
        yield state


def exhausted(steps: Generator[Any, None, Result]) -> Result:
    """What a generator returns in the end."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value  # type: ignore[no-any-return]


@dataclass(eq=False)
class LineSearch:
    """Steps that keep the energy below those of the last few (Grippo, Lampariello and Lucidi 1986), to a residual.

    Where the Hessian has no Cholesky factor, its convex part takes its place and is blended out again over the next steps: far
    fewer iterations than with always projecting it. A saddle is left along its falling direction.

    decay : share of the convex part that a step leaves to the next one
    """

    tolerance: float
    iterations: int
    decay: float = DECAY
    convex: float = 0.0
    escapes: int = 0

    def advance(self, problem: Escapable, state: Any, here: Local, history: list[Iteration]) -> tuple[Any, str | None]:
        if here.residual <= self.tolerance:
            if problem.stable(state):
                return state, CONVERGED
            if self.escapes == ESCAPES:
                return state, SADDLE
            self.escapes += 1
            return min(problem.exits(state), key=problem.energy), None
        if len(history) > self.iterations:
            return state, ITERATIONS
        if not self._factored(problem, here, history):
            return state, INDEFINITE
        step = problem.step(here)
        if np.abs(step).max() <= STILL:
            # nothing is left to move: the forces are what rounding leaves
            return state, ROUNDED if problem.stable(state) else SADDLE
        found = self._searched(problem, state, here, step, history)
        return (state, NO_DESCENT) if found is None else (found, None)

    def _factored(self, problem: Factored, here: Local, history: list[Iteration]) -> bool:
        """Factor the Hessian with as much of the convex part as the last steps needed, or as little as does, or all of it."""
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
        """Whether the residual is small and yet does not fall."""
        residuals = [one.residual for one in history]
        return len(residuals) > STEPS and CREEPING > min(residuals[-STEPS:]) > 0.5 * min(residuals[:-STEPS])

    def _searched(
        self, problem: Factored, state: Any, here: Local, step: np.ndarray, history: list[Iteration]
    ) -> Any | None:
        """The state after the longest halved step that goes well enough below the largest recent energy; None if there is none."""
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
class FullSteps:
    """Whole steps until the work of one is a share of the energy; it is taken, and squares what was left.

    tolerance : that share; convex : shares of the convex part, tried until one is positive definite; it converges with the
    first only; least : energy below which the work is compared with this; patience : steps before it may be given up
    """

    tolerance: float
    iterations: int
    convex: tuple[float, ...] = (0.0,)
    least: float = 0.0
    patience: int = PATIENCE
    best: float = field(default=np.inf, init=False)

    def advance(self, problem: Factored, state: Any, here: Local, history: list[Iteration]) -> tuple[Any, str | None]:
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


@dataclass(eq=False)
class Damped:
    """Damped steps (Levenberg 1944, Marquardt 1963): more damping where the model predicts badly, less where it does well.

    stop : relative fall below which, twice in a row, the search ends; goal : energy below which nothing is left to gain
    damping : with which an earlier search has ended, or None; the first step takes no more than a step along the gradient needs
    too_far : whether a step has fallen much short of what was predicted
    """

    iterations: int
    stop: float
    goal: float
    damping: float | None = None
    following: float = 0.0
    small: int = 0
    too_far: bool = False

    def advance(
        self, problem: DampedProblem, state: Any, here: Local, history: list[Iteration]
    ) -> tuple[Any, str | None]:
        if not history[1:]:
            along = float(np.linalg.norm(here.gradient) / (FIRST * np.sqrt(here.gradient.size)))
            self.damping = along if self.damping is None else min(self.damping, along)
        found, gain = self._tried(problem, here, history[-1])
        if found is None:
            return state, TIME if problem.over else CONVERGED
        energy = problem.energy(found)
        # where the model is poor, a small fall does not mean that nothing is to be had any more
        fall = max(here.energy - energy, HOPE * gain) / here.energy
        problem.accepted(found)
        self.small = self.small + 1 if fall < self.stop else 0
        if self.small == 2 or (self.stop and energy < self.goal):
            return found, CONVERGED
        if len(history) == self.iterations:
            return found, ITERATIONS
        return found, TIME if problem.over else None

    def _tried(self, problem: DampedProblem, here: Local, row: Iteration) -> tuple[Any | None, float]:
        """The state after a step that brings enough of the gain that was predicted, and that gain."""
        assert self.damping is not None
        for _ in range(TRIALS):
            row.modified = self.damping
            proposal = problem.proposed(here, self.damping, self.following)
            if proposal is None:
                break
            if proposal.gain <= 0.0:
                # bounds have bent the step so far that nothing of its gain is left: a shorter one bends less
                self.damping *= 8.0
                continue
            trial = problem.tried(here, proposal)
            if trial is None:
                self.following, self.too_far = max(8.0 * self.following, problem.gentle(here, proposal)), True
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
        return None, 0.0

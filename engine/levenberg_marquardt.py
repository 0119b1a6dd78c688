"""Levenberg-Marquardt steps for ``newton.minimise``: damped steps of least squares problems."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from .newton import CONVERGED, ITERATIONS, REACHED, TIME, Iteration, LocalModel, Problem

# largest number of damped steps that are tried in one iteration; each may multiply the damping by 8, so that after 12
# the steps are almost 0
TRIALS = 12
# Limits on the ratio of the actual decrease of the energy to the predicted decrease: above GOOD the damping is reduced,
# below POOR it is increased, and below TAKEN the step is refused
GOOD, POOR, TAKEN = 0.7, 0.25, 1e-3
# The damping is multiplied by CUT after a good step. Searches begin with much damping, so it is multiplied by DEEP_CUT
# as long as no step has failed, if the relative error of the predicted decrease is below EXACT. Smaller factors: fewer
# steps, more refused ones (docs/tuning.md)
CUT, DEEP_CUT, EXACT = 0.3, 0.1, 0.1
# The damping stays above this times the energy over the number of variables. Less damping would hardly change the
# steps, and would take longer to grow again
LEAST_DAMPING = 0.01
SHARES = 0.05, 0.5  # smallest and largest share of a refused step that is tried next
NEGLIGIBLE = 1e-9  # steps are negligible if no variable, scaled to [0, 1], changes by more than this


class DampedProblem(Problem, Protocol):
    """A least squares problem whose variables determine dependent quantities, as a design determines poses of hubs."""

    @property
    def must_end(self) -> bool:
        """True if the search must end, because its time has elapsed or its steps decrease the energy too little."""

    def reached(self, state: Any) -> bool:
        """Return whether a state is so good that the search ends."""

    def propose(self, here: LocalModel, damping: float, following: float) -> Any:
        """Return a proposal: a step that nearly minimises the damped quadratic model; None if there is none.

        A proposal has the attributes ``step``, the change of the variables, and ``gain``, the predicted decrease.

        here : expansion about the present state
        damping, following : damping of the variables, and of the dependent quantities
        """

    def take_step(self, here: LocalModel, proposal: Any) -> Any | None:
        """Return the state after a proposal's step; None if the dependent quantities cannot be computed there."""

    def shorten(self, here: LocalModel, proposal: Any, share: float) -> Any:
        """Return a proposal with the step ``share`` * ``proposal.step``, and with the decrease predicted for it."""

    def min_following(self, proposal: Any) -> float:
        """Return the smallest damping of the dependent quantities to try after ``take_step`` has returned None."""

    def note_rejection(self) -> None:
        """Is called when the last state from ``take_step`` is refused."""

    def note_acceptance(self, state: Any) -> None:
        """Is called when the search continues from the new state ``state``."""


@dataclass(eq=False)
class LevenbergMarquardt:
    """Levenberg-Marquardt steps: damping grows when the model predicts badly and shrinks when it predicts well.

    iterations : largest number of iterations
    stop : relative decrease of the energy. The search ends after two successive steps with a smaller decrease, or when
        a step is refused whose predicted decrease is smaller
    first : RMS change of the variables, scaled to [0, 1], in a first step along the gradient; it sets the first damping
    damping : damping of the variables; at the start the last damping of an earlier search or None. The first damping is
        the smaller of this and the one that ``first`` sets
    following : damping of the dependent quantities
    small : number of successive steps so far with a decrease below ``stop``
    too_far : True once a step has failed or achieved much less than predicted
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
        found, gain = self._find_step(problem, here, history[-1])
        if found is None:
            return state, TIME if problem.must_end else CONVERGED
        energy = problem.energy(found)
        # a small decrease indicates convergence only if it was predicted, so at least POOR times the prediction is used
        fall = max(here.energy - energy, POOR * gain) / here.energy
        problem.note_acceptance(found)
        self.small = self.small + 1 if fall < self.stop else 0
        if problem.reached(found):
            return found, REACHED
        if self.small == 2:
            return found, CONVERGED
        if len(history) == self.iterations:
            return found, ITERATIONS
        return found, TIME if problem.must_end else None

    def _find_step(self, problem: DampedProblem, here: LocalModel, row: Iteration) -> tuple[Any | None, float]:
        """Propose steps with more and more damping until one is accepted, as a whole or shortened.

        Returns the accepted state, or None if all steps are refused, and its predicted decrease. ``row`` is completed.
        """
        assert self.damping is not None
        for _ in range(TRIALS):
            row.modified = self.damping
            proposal = problem.propose(here, self.damping, self.following)
            if proposal is None:
                break
            if proposal.gain <= 0.0:
                # clipping the step to the variables' bounds has left no decrease; a shorter step is clipped less
                self.damping *= 8.0
                continue
            trial = problem.take_step(here, proposal)
            if trial is None:
                self.following, self.too_far = max(8.0 * self.following, problem.min_following(proposal)), True
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
            problem.note_rejection()
            if proposal.gain < self.stop * here.energy:
                break  # more damping would predict even less decrease
            share = _least_share(here, proposal.step, problem.energy(trial))
            found, gain = self._try_shorter(problem, here, proposal, share, row)
            if found is not None:
                return found, gain
        return None, 0.0

    @staticmethod
    def _try_shorter(
        problem: DampedProblem, here: LocalModel, proposal: Any, share: float, row: Iteration
    ) -> tuple[Any | None, float]:
        """Try the share ``share`` of a refused step.

        Returns the new state, or None if this step is refused too, and its predicted decrease. ``row`` is completed.
        """
        shorter = problem.shorten(here, proposal, share)
        found = problem.take_step(here, shorter)
        if found is None or here.energy - problem.energy(found) <= max(TAKEN * shorter.gain, 0.0):
            return None, 0.0
        row.decrement, row.step = shorter.gain, share
        return found, shorter.gain


def _least_share(here: LocalModel, step: np.ndarray, energy: float) -> float:
    """Return the share of a step, clipped to ``SHARES``, at which a parabola through the energies is least.

    The parabola has the energies at both ends of the step and the slope at its beginning.

    here : expansion at the beginning of the step; energy : energy at its end
    """
    along = float(here.gradient @ step)
    bend = energy - here.energy - along
    return float(np.clip(-0.5 * along / bend, *SHARES)) if bend > 0.0 else SHARES[1]

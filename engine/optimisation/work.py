"""Estimated work of a search, in seconds of a typical processor core.

Work is counted by operations, not read from a clock, so that a search ends at the same step, with the same result, on
every machine, however busy. A clock ends only searches that take several times as long as estimated.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import numpy as np

from ..progress import Progress

# Costs, seconds per spiral: an equilibrium, each of its Newton iterations, a Gauss-Newton product, and the derivatives
# with respect to the flat geometry (docs/tuning.md)
EQUILIBRIUM_COST, ITERATION_COST, PRODUCT_COST, GEOMETRY_COST = 1e-5, 1.6e-5, 2e-6, 1e-4
# Costs, seconds per spiral: building the elastic model, making a design fabricable, computing a design space
MODEL_COST, FABRICABLE_COST, DESIGN_SPACE_COST = 1.35e-4, 1.4e-4, 3.2e-4
# Cost, seconds per joint (not spiral): derivatives of second-order strains with respect to the design or the flat
# shapes
SECOND_ORDER_COST = 2.6e-4
SOFT_MODES_COST, MODE_DERIVATIVES_COST = (
    1.2e-4,
    8.5e-5,
)  # costs, seconds per spiral: the softest modes, and the derivatives of each mode
FLAT_MODES_COST = (
    2e-4  # cost, seconds per spiral: derivatives of softest modes with respect to flat shapes, beside ``GEOMETRY_COST``
)
SLOTS_COST = 4.5e-5  # cost, seconds per spiral: widths of the slots in space, with half of their derivatives
CLEARANCES_COST = 1.5e-4  # cost, seconds per spiral: clearances of a step, and restoring them
# Usual time of a search, seconds, by number of spirals; proportional to it beyond the last number. Opening closed slots
# adds up to 0.6 of it. Longer times bring pieces nearer to the target
SEARCH_SIZES, USUAL_SECONDS = (0, 1500, 6000), (12.0, 22.0, 75.0)
# Time limit over usual time with a patience of 1 or more (``END_RATE`` nearly always ends a search first); 1 up to a
# patience of 0.5, as in comparisons of layouts. Larger: the few searches that still gain take longer and come nearer
LIMIT_OVER_USUAL = 2.0
# A search ends when the logarithm of its objective falls by less than END_RATE per second of work over the last
# RATE_STEPS steps. Larger rate: ends sooner, farther from the target. Fewer steps: a single poor step ends the search
# (docs/tuning.md)
END_RATE, RATE_STEPS = 0.18, 6
SLOW = "slow"  # ``SearchRecord.ended`` of a search that ended at this rate
# Largest ratio of this thread's processor time to the limit; beyond it the clock ends the search. Busy machines take up
# to 2.9 times as long. Smaller: equal searches end at different steps (docs/tuning.md)
MAX_SLOWDOWN = 8.0
UNCOUNTED = 10.0  # seconds that the clock allows in addition, for imports, which are not counted (docs/tuning.md)


@dataclass(eq=False)
class Work:
    """Work counter with a time limit, which also ends a search whose steps bring too little for their work.

    limit : seconds; None for no limit
    rate : decrease of the objective's logarithm per second of work below which a stage ends early, see ``END_RATE``
    usual : seconds, ``USUAL_SECONDS`` times the patience; 0 without a limit
    share : share of the limit at which the present stage ends; seconds_done : work so far, seconds
    start_time : processor time at the start, seconds
    ends_at_rate : whether the present stage also ends when the objective falls more slowly than ``rate``
    rate_factor : factor on the decreases of its steps, above 1 while the piece is far from its target or overstrained
    steps : of the present stage: total work after each step, and its decrease of the objective's logarithm
    least_proposal_seconds : least work so far between an accepted step and the proposal of the following step; estimate
        for the next proposal
    """

    limit: float | None = None
    rate: float = 0.0
    share: float = 1.0
    seconds_done: float = 0.0
    start_time: float = field(default_factory=time.thread_time)
    ends_at_rate: bool = False
    rate_factor: float = 1.0
    steps: list[tuple[float, float]] = field(default_factory=list)
    least_proposal_seconds: float = np.inf
    usual: float = 0.0

    @classmethod
    def for_spirals(cls, size: int, patience: float) -> Work:
        """Return a counter for a search.

        Parameters
        ----------
        size : number of spirals
        patience : factor on the usual time, and on the time that an improvement may take; 0 for no limit
        """
        if not patience:
            return cls()
        usual = float(np.interp(size, SEARCH_SIZES, USUAL_SECONDS)) * max(1.0, size / SEARCH_SIZES[-1])
        usual *= patience
        return cls(
            usual * float(np.clip(LIMIT_OVER_USUAL * patience, 1.0, LIMIT_OVER_USUAL)), END_RATE / patience, usual=usual
        )

    def add(self, seconds: float, size: int) -> None:
        """Count the work of an operation on spirals or joints.

        Parameters
        ----------
        seconds : per spiral, or per joint
        size : number of spirals, or of joints
        """
        self.seconds_done += seconds * size

    def begin_stage(self, share: float, *, ends_at_rate: bool = True) -> None:
        """Begin a stage that must end when the total work reaches a share of the limit.

        Parameters
        ----------
        share : total work at which the stage must end, as a share of ``limit``
        ends_at_rate : whether the stage also ends earlier, when the objective falls more slowly than ``rate``
        """
        self.share, self.ends_at_rate = share, ends_at_rate
        self.steps.clear()

    def begin_overtime(self, seconds: float, *, ends_at_rate: bool = False) -> None:
        """Begin a stage that may add some seconds to the work done so far, even beyond the limit.

        Parameters
        ----------
        seconds : largest work that the stage may add
        ends_at_rate : whether the stage also ends earlier, when the objective falls more slowly than ``rate``
        """
        self.begin_stage((self.seconds_done + seconds) / self.limit if self.limit else 1.0, ends_at_rate=ends_at_rate)

    def add_step(self, decrease: float) -> None:
        """Record an accepted step and its decrease of the objective's logarithm."""
        self.steps.append((self.seconds_done, decrease))

    def add_proposal(self) -> None:
        """Record that the next step has been computed, except for its equilibrium."""
        if self.steps:
            self.least_proposal_seconds = min(self.least_proposal_seconds, self.seconds_done - self.steps[-1][0])

    @property
    def expected_seconds(self) -> float:
        """Estimate of the total work when the next step is proposed: at the last step + ``least_proposal_seconds``."""
        known = self.steps and self.least_proposal_seconds < np.inf
        return max(self.seconds_done, self.steps[-1][0] + self.least_proposal_seconds) if known else self.seconds_done

    @property
    def fraction(self) -> float:
        """Position of the progress bar for the work done so far, 0 to 1; 0 without a limit.

        Most searches end well before their limit, at a time that is not known. So the position is the cube root of the
        used share of the limit, and the bar moves fast at first. The position falls when the limit is extended;
        ``Progress.rising`` hides that.
        """
        if not self.limit:
            return 0.0
        return min(1.0, self.seconds_done / (max(1.0, self.share) * self.limit)) ** (1.0 / 3.0)

    def with_work_fraction(self, progress: Progress) -> Progress:
        """Return a progress that reports ``fraction``, as the number of steps is unknown; unchanged without a limit."""
        report = progress.report
        if self.limit is None or report is None:
            return progress

        def report_work(_: float, text: str) -> None:
            report(progress.lo + (progress.hi - progress.lo) * self.fraction, text)

        return replace(progress, report=report_work)

    @property
    def is_late(self) -> bool:
        """Whether the next proposal would exceed the stage's share of the limit, or the clock ends the search."""
        if self.limit is None:
            return False
        late = time.thread_time() - self.start_time > UNCOUNTED + MAX_SLOWDOWN * self.limit * max(1.0, self.share)
        return self.expected_seconds > self.share * self.limit or late

    @property
    def is_slow(self) -> bool:
        """Whether the last ``RATE_STEPS`` steps of the present stage lowered the objective more slowly than ``rate``.

        The work until the next proposal counts too.
        """
        if not self.ends_at_rate or len(self.steps) <= RATE_STEPS:
            return False
        before, last = self.steps[-1 - RATE_STEPS][0], self.steps[-RATE_STEPS:]
        return self.rate_factor * sum(decrease for _, decrease in last) < self.rate * (self.expected_seconds - before)

    @property
    def is_over(self) -> bool:
        """Whether the present stage must end."""
        return self.is_late or self.is_slow

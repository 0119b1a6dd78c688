"""Work of a search, in seconds of a usual processor core.

Work is counted, not read from a clock, so that a search ends at the same step, with the same result, on every machine and however
busy it is. A clock ends only searches that take several times as long as they should.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import numpy as np

from ..progress import Progress

# Costs in seconds a spiral, measured on surfaces of 1296 and 2362 quads on one core: for an equilibrium, each of its Newton iterations, a
# Gauss-Newton product, and the derivatives by the flat geometry
EQUILIBRIUM, ITERATION, PRODUCT, GEOMETRY = 1e-5, 1.6e-5, 2e-6, 1e-4
CURVING, FIT, SPACE = 1.35e-4, 1.4e-4, 3.2e-4  # building the model, fitting a design that can be cut, a design space
# Seconds a joint, not a spiral: derivatives of the second-order strains by the design, or by the flat shapes
CURVED = 2.6e-4
SOFTEST, MODE = 1.2e-4, 8.5e-5  # the softest modes, and the derivatives of each
VARIED = 2e-4  # derivatives of the softest modes by the flat shapes, beside ``GEOMETRY``
OPENING = 4.5e-5  # the widths of the slots in space, with half of their derivatives
ROOMS = 1.5e-4  # clearances of a step, and restoring them
# Usual time of a search, seconds, by the number of spirals; proportional beyond the last. Searches take up to six tenths more where closed slots
# are opened
SPIRALS, LIMITS = (0, 1500, 6000), (12.0, 22.0, 75.0)
# Factor from the usual time to the limit with a patience of 1 or more, where ``END_RATE`` nearly always ends a search first; up to a patience of 0.5,
# as of comparisons, the factor is 1. Larger: the few searches that still gain come nearer, and take longer
PATIENT = 2.0
# Rate at which a search ends, per second: the decrease of the logarithm of its objective over the last steps, divided by their work.
# Larger rates end sooner and farther from the target. With fewer steps a search ends where a single step brings little
END_RATE, RATED_STEPS = 0.18, 6
SLOW = "slow"  # ``SearchRecord.ended`` of a search that ended at this rate
# Largest ratio of this thread's processor time to the limit, beyond which the clock ends a search. Two cores that do other work beside
# took 2.3 to 2.9 times as long; with ratios near that, equal searches ended at different steps
MAX_SLOWDOWN = 8.0
# Seconds that the clock allows besides: searches of a fiftieth of the usual limit, 0.24 s, ended at different steps in processes that had
# yet to import what they use
UNCOUNTED = 10.0


@dataclass(eq=False)
class Work:
    """Work counter with a time limit, which also ends a search whose steps bring too little for their work.

    limit : seconds, None for none; rate : at which a search ends, see ``END_RATE``
    usual : seconds, ``LIMITS`` times the patience; 0 without a limit
    share : of the limit that the present stage may reach; done : work so far, seconds; began : processor time at the start, seconds
    rated : whether the present stage ends at ``rate``
    factor : by which the decreases of its steps count more, while the piece is far from its target or overstrained
    steps : total work after its steps, and their decrease of the objective's logarithm
    cheapest : least work from a step to the proposal of the next one, so far; the next takes at least about as much
    """

    limit: float | None = None
    rate: float = 0.0
    share: float = 1.0
    done: float = 0.0
    began: float = field(default_factory=time.thread_time)
    rated: bool = False
    factor: float = 1.0
    steps: list[tuple[float, float]] = field(default_factory=list)
    cheapest: float = np.inf
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
        usual = float(np.interp(size, SPIRALS, LIMITS)) * max(1.0, size / SPIRALS[-1])
        usual *= patience
        return cls(usual * float(np.clip(PATIENT * patience, 1.0, PATIENT)), END_RATE / patience, usual=usual)

    def add(self, seconds: float, size: int) -> None:
        """Add work of some seconds a spiral on ``size`` spirals.

        Parameters
        ----------
        seconds : per spiral, or per joint
        size : number of spirals, or of joints
        """
        self.done += seconds * size

    def begin(self, share: float, *, rated: bool = True) -> None:
        """Begin a stage that may reach this share of the limit.

        Parameters
        ----------
        share : of the limit
        rated : whether the stage ends at ``rate``
        """
        self.share, self.rated = share, rated
        self.steps.clear()

    def extend(self, seconds: float, *, rated: bool = False) -> None:
        """Begin a stage that may add some seconds to the work done so far, whatever the limit.

        Parameters
        ----------
        seconds : that it may add
        rated : whether the stage ends at ``rate``
        """
        self.begin((self.done + seconds) / self.limit if self.limit else 1.0, rated=rated)

    def note(self, decrease: float) -> None:
        """Record a step that has lowered the logarithm of the objective."""
        self.steps.append((self.done, decrease))

    def note_proposal(self) -> None:
        """Record that the next step is known, but for its equilibrium."""
        if self.steps:
            self.cheapest = min(self.cheapest, self.done - self.steps[-1][0])

    @property
    def expected(self) -> float:
        """Estimated total work at the next proposal: that after the last step plus the least so far, at least ``done``."""
        known = self.steps and self.cheapest < np.inf
        return max(self.done, self.steps[-1][0] + self.cheapest) if known else self.done

    @property
    def fraction(self) -> float:
        """Fraction of the progress that the work done so far stands for; 0 without a limit.

        Most searches end well before their limit, at a time that nobody knows. The fraction is therefore the cube root of the used
        share of the limit, so that the bar moves fast at first. It falls where the limit is extended; ``Progress.rising`` keeps the bar from falling.
        """
        if not self.limit:
            return 0.0
        return min(1.0, self.done / (max(1.0, self.share) * self.limit)) ** (1.0 / 3.0)

    def pace(self, progress: Progress) -> Progress:
        """Return a progress that follows the work done, as the number of steps is unknown; unchanged without a limit."""
        report = progress.report
        if self.limit is None or report is None:
            return progress

        def report_work(_: float, text: str) -> None:
            report(progress.lo + (progress.hi - progress.lo) * self.fraction, text)

        return replace(progress, report=report_work)

    @property
    def late(self) -> bool:
        """Whether the present share of the limit will be used up before the next proposal, or the clock ends the search."""
        if self.limit is None:
            return False
        late = time.thread_time() - self.began > UNCOUNTED + MAX_SLOWDOWN * self.limit * max(1.0, self.share)
        return self.expected > self.share * self.limit or late

    @property
    def slow(self) -> bool:
        """Whether the last ``RATED_STEPS`` steps of the present stage, with the work until the next proposal, were slower than ``rate``."""
        if not self.rated or len(self.steps) <= RATED_STEPS:
            return False
        before, last = self.steps[-1 - RATED_STEPS][0], self.steps[-RATED_STEPS:]
        return self.factor * sum(decrease for _, decrease in last) < self.rate * (self.expected - before)

    @property
    def over(self) -> bool:
        """Whether the present stage must end."""
        return self.late or self.slow

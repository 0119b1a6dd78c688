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
EQUILIBRIUM, ITERATION, PRODUCT, GEOMETRY = 1e-5, 1.6e-5, 2e-6, 3.6e-4
CURVING, FIT, SPACE = 1.35e-4, 1.4e-4, 3.2e-4  # building the model, fitting a design that can be cut, a design space
SOFTEST, MODE = 1.2e-4, 8.5e-5  # the softest modes, and the derivatives of each
VARIED = 2e-4  # derivatives of the softest modes by the flat shapes, beside ``GEOMETRY``
OPENING = 4.5e-5  # the widths of the slots in space, with half of their derivatives
ROOMS = 1.5e-4  # clearances of a step, and restoring them
# Time limit of a search, seconds, by the number of spirals; proportional beyond the last. The work before and after a search takes up to a
# fifth more, so that the whole stage stays within 25 s for 1,500 spirals and 90 s for 6,000. Searches take a quarter more where
# strains are still too large, and up to six tenths more where closed slots are opened
SPIRALS, LIMITS = (0, 1500, 6000), (12.0, 22.0, 75.0)
# Time limit, by the same numbers of spirals, of a search near its target whose strains are not far beyond their limit. 150 spirals reach 0.16 mm after 3 s and
# 0.14 mm after 13 s, 986 reach 0.17 mm and 1296 0.020 mm, where 0.21, 0.18 and 0.022 mm are wanted
ENOUGH = (1.0, 20.0, 70.0)
# Largest ratio of this thread's processor time to the limit, beyond which the clock ends a search. Two cores that do other work beside
# took 2.3 to 2.9 times as long; with ratios near that, equal searches ended at different steps
MAX_SLOWDOWN = 8.0


@dataclass(eq=False)
class Work:
    """Work counter with a time limit.

    limit : seconds, None for none; enough : share of the limit for a search near its target without far excess of strain
    share : of the limit that the present stage may reach; done : work so far, seconds; began : processor time at the start, seconds
    """

    limit: float | None = None
    enough: float = 1.0
    share: float = 1.0
    done: float = 0.0
    began: float = field(default_factory=time.thread_time)

    @classmethod
    def for_spirals(cls, size: int, patience: float) -> Work:
        """Return a counter for a search.

        Parameters
        ----------
        size : number of spirals
        patience : factor on the usual limit; 0 for no limit. Above 1 it also raises the share ``enough``: who asks for more time
            wants a piece that is near its target to come nearer
        """
        usual, enough = (float(np.interp(size, SPIRALS, seconds)) for seconds in (LIMITS, ENOUGH))
        limit = patience * usual * max(1.0, size / SPIRALS[-1]) if patience else None
        return cls(limit, min(1.0, max(1.0, patience) * enough / usual))

    def add(self, seconds: float, size: int) -> None:
        """Add work of some seconds a spiral on ``size`` spirals."""
        self.done += seconds * size

    def paced(self, progress: Progress) -> Progress:
        """Return a progress that follows the work done, as the number of steps is unknown.

        A search ends at the share ``enough`` of its limit or at all of it; which one, it does not know before. At ``enough`` the
        progress shows the square root of that share, which is wrong by the same factor in both cases.
        """
        report, limit = progress.report, self.limit
        if limit is None or report is None:
            return progress
        root = self.enough**0.5

        def report_work(_: float, text: str) -> None:
            share = float(np.interp(self.done / limit, (0.0, self.enough, 1.0), (0.0, root, 1.0)))
            report(progress.lo + (progress.hi - progress.lo) * share, text)

        return replace(progress, report=report_work)

    @property
    def over(self) -> bool:
        """Whether the present share of the limit is used up, or the clock ends the search."""
        if self.limit is None:
            return False
        late = time.thread_time() - self.began > MAX_SLOWDOWN * self.limit
        return self.done > self.share * self.limit or late

"""How much a search has done, in seconds of a usual processor core.

Counted in pieces of work rather than read from a clock, so that a search ends at the same step, with the same result, on
every machine and however busy it is. A clock ends only what takes several times as long as it should.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import numpy as np

from ..progress import Progress

# seconds a spiral, measured on surfaces of 1296 and 2362 quads on one core
EQUILIBRIUM, ITERATION, PRODUCT, GEOMETRY = 1e-5, 1.6e-5, 2e-6, 3.6e-4
# likewise: building the model, the nearest design that can be cut, the coordinates of designs
CURVING, FIT, SPACE = 1.35e-4, 1.4e-4, 3.2e-4
SOFTEST, MODE = 1.2e-4, 8.5e-5  # for the softest modes, and the derivatives of each
VARIED = 2e-4  # for their derivatives by the flat shapes, beside ``GEOMETRY``
OPENING = 4.5e-5  # for the widths of the slots in space and half of their slopes
ROOMS = 1.5e-4  # for a step's rooms, and for bringing it back to them
# seconds for so many, in proportion beyond; what comes before and after the search takes up to a fifth more, so that
# the whole stage stays within 25 s for 1,500 spirals and 90 s for 6,000; a quarter of the search more where strains do not hold yet, and
# up to six tenths where closed slots are opened by further searches
SPIRALS, LIMITS = (0, 1500, 6000), (12.0, 22.0, 75.0)
# The same for a search that is not strained far beyond its limit, and near its target. 150 spirals are at 0.16 mm after 3 s and at 0.14 after 13, 986 at 0.17 mm and
# 1296 at 0.020, where 0.21, 0.18 and 0.022 are asked
ENOUGH = (1.0, 20.0, 70.0)
# Times that a machine may be slower than the usual one, by this thread's processor time, before that ends the search. Two cores that
# do other work beside took 2.3 to 2.9 times as long; nearer to that, equal searches ended unlike
SLOWEST = 8.0


@dataclass(eq=False)
class Work:
    """limit : seconds; None lets it go on; enough : share of the limit for a search of what is near its target and not strained far
    share : of the limit that may be spent by now; done : seconds
    """

    limit: float | None = None
    enough: float = 1.0
    share: float = 1.0
    done: float = 0.0
    began: float = field(default_factory=time.thread_time)

    @classmethod
    def of(cls, size: int, patience: float) -> Work:
        """For so many spirals; ``patience`` times the usual limit, none where it is 0."""
        usual, enough = (float(np.interp(size, SPIRALS, seconds)) for seconds in (LIMITS, ENOUGH))
        return cls(patience * usual * max(1.0, size / SPIRALS[-1]) if patience else None, enough / usual)

    def add(self, seconds: float, size: int) -> None:
        """Note work of so many seconds a spiral on so many spirals."""
        self.done += seconds * size

    def paced(self, progress: Progress) -> Progress:
        """A progress that goes with the work that is done, and not with steps, of which nobody knows how many it will take.

        Most searches end when their time is over; one that ends before makes the rest of it in one leap.
        """
        report = progress.report
        if self.limit is None or report is None:
            return progress
        whole, limit = progress.hi - progress.lo, self.enough * self.limit

        def told(_: float, text: str) -> None:
            report(progress.lo + whole * min(self.done / limit, 1.0), text)

        return replace(progress, report=told)

    @property
    def over(self) -> bool:
        """Whether the share of the limit is used up."""
        if self.limit is None:
            return False
        late = time.thread_time() - self.began > SLOWEST * self.limit
        return self.done > self.share * self.limit or late

"""Estimate of the remaining time of work, from the history of its progress."""

from __future__ import annotations

from dataclasses import dataclass, field

# Elapsed seconds and done share of the work at which the first estimate is made; by eye. Larger: later and better first
# estimate (docs/tuning.md)
FIRST_SECONDS, FIRST_SHARE = 3.0, 0.2
# Length of the latest period over which the recent pace is measured, as a share of the elapsed time. Larger: smoother,
# reacts more slowly
MEMORY = 0.5
# Largest number of stored progress reports; when there are more, every second one is dropped. Larger: more memory
KEPT = 400


@dataclass
class RemainingTime:
    """Estimator of the remaining time: feed it with the reports of a progress.

    seen : elapsed seconds and fraction of the reports so far
    """

    seen: list[tuple[float, float]] = field(default_factory=list)

    def report(self, seconds: float, fraction: float) -> None:
        """Store a report.

        Parameters
        ----------
        seconds : elapsed seconds since the beginning
        fraction : share of the work that is done, 0 to 1
        """
        if not self.seen or fraction > self.seen[-1][1]:
            if len(self.seen) >= KEPT:
                self.seen = self.seen[::2]
            self.seen.append((seconds, fraction))

    def seconds(self, now: float) -> float | None:
        """Estimate the remaining seconds, ``now`` seconds after the beginning; None while it is too early to estimate.

        The pace is the geometric mean of the pace since the beginning and the recent pace, as stages do not progress
        evenly.
        """
        seen = self.seen
        if not seen or now < FIRST_SECONDS or seen[-1][1] < FIRST_SHARE:
            return None
        done = seen[-1][1]
        then = next((row for row in reversed(seen) if row[0] <= (1.0 - MEMORY) * now), (0.0, 0.0))
        whole, late = done / now, (done - then[1]) / (now - then[0])
        pace = (whole * late) ** 0.5 if late > 0.0 else whole
        return (1.0 - done) / pace


def format_seconds(seconds: float) -> str:
    """Format seconds roughly, as a person says them: 5 s, 40 s, 3 min, 1.5 h."""
    if seconds < 57.5:
        return f"{max(5, 5 * round(seconds / 5))} s"
    return f"{max(round(seconds / 60), 1)} min" if seconds < 90 * 60 else f"{seconds / 3600:.1f} h"

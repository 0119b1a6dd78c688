"""How long work still takes, told from how far it has come and when: for whoever shows progress."""

from __future__ import annotations

from dataclasses import dataclass, field

# Nothing is told before so many seconds, nor before so much of the work is done; by eye. On a machine with many other jobs a search
# that used up its time was told 2 times too long in the median, one that found nothing better long before, 4 times
FIRST_SECONDS, FIRST_SHARE = 3.0, 0.2
MEMORY = 0.5  # share of the time so far over which the pace of now is measured
KEPT = 400  # reports that are remembered; then every other one is forgotten


@dataclass
class Remaining:
    """Tell it the reports of a progress, and ask for the seconds that are left.

    seen : seconds since the beginning and fractions, so far
    """

    seen: list[tuple[float, float]] = field(default_factory=list)

    def report(self, seconds: float, fraction: float) -> None:
        if not self.seen or fraction > self.seen[-1][1]:
            if len(self.seen) >= KEPT:
                self.seen = self.seen[::2]
            self.seen.append((seconds, fraction))

    def seconds(self, now: float) -> float | None:
        """Seconds left at ``now`` seconds since the beginning; None while nobody can know.

        Stages are not equally quick in all of their parts, so the pace is the geometric mean of that since the beginning and that of
        the last part of the time.
        """
        seen = self.seen
        if not seen or now < FIRST_SECONDS or seen[-1][1] < FIRST_SHARE:
            return None
        done = seen[-1][1]
        then = next((row for row in reversed(seen) if row[0] <= (1.0 - MEMORY) * now), (0.0, 0.0))
        whole, late = done / now, (done - then[1]) / (now - then[0])
        pace = (whole * late) ** 0.5 if late > 0.0 else whole
        return (1.0 - done) / pace


def told(seconds: float) -> str:
    """Seconds as a person says them: 5 s, 40 s, 3 min, 1.5 h."""
    if seconds < 57.5:
        return f"{max(5, 5 * round(seconds / 5))} s"
    return f"{max(round(seconds / 60), 1)} min" if seconds < 90 * 60 else f"{seconds / 3600:.1f} h"

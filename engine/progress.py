"""Progress reports and cancelling, for scripts, modal operators and command line."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from .errors import Cancelled

T = TypeVar("T")


@dataclass(frozen=True)
class Progress:
    """Progress of a stage. Call it with the fraction done; the call raises ``Cancelled`` if the user cancels.

    report : called with the overall fraction, 0 to 1, and a text
    stopped : called by every call; returns whether the user has cancelled
    lo, hi : range of the overall fraction that this stage covers
    shown : receives the intermediate results of ``show``, such as a shape that still moves
    """

    report: Callable[[float, str], None] | None = None
    stopped: Callable[[], bool] | None = None
    lo: float = 0.0
    hi: float = 1.0
    shown: Callable[[Any], None] | None = None

    def __call__(self, fraction: float, text: str = "") -> None:
        if self.stopped is not None and self.stopped():
            raise Cancelled(text)
        self.tell(fraction, text)

    def tell(self, fraction: float, text: str = "") -> None:
        """Report without raising ``Cancelled``, for the end of work whose result should be kept after a cancel.

        Parameters
        ----------
        fraction : done share of this work, clipped to [0, 1]
        text : what is being done; it is reported with a capital first letter
        """
        if self.report is not None:
            self.report(self.lo + (self.hi - self.lo) * min(max(fraction, 0.0), 1.0), text[:1].upper() + text[1:])

    def part(self, lo: float, hi: float) -> Progress:
        """Return the progress of a substage that runs from the fraction ``lo`` to the fraction ``hi`` of this stage.

        Parameters
        ----------
        lo, hi : fractions of this work
        """
        span = self.hi - self.lo
        return Progress(self.report, self.stopped, self.lo + span * lo, self.lo + span * hi, self.shown)

    def each(self, things: Sequence[T], text: str) -> Iterator[T]:
        """Iterate over things, reporting before each.

        Parameters
        ----------
        things : items to work on
        text : text of the reports
        """
        for number, thing in enumerate(things):
            self(number / len(things), text)
            yield thing

    def batches(self, count: int, size: int, text: str) -> Iterator[slice]:
        """Iterate over batches, reporting before each.

        Parameters
        ----------
        count : number of things in all
        size : number of things per batch
        text : text of the reports

        Returns
        -------
        slice of every batch
        """
        for first in range(0, count, size):
            self(first / count, text)
            yield slice(first, min(first + size, count))

    def at(self, fraction: float, text: str) -> Progress:
        """Report the beginning of a step; return a progress for its work that repeats this report at every call.

        Parameters
        ----------
        fraction : share of this stage that is done before the step
        text : text of the reports
        """
        self(fraction, text)
        return Progress(lambda *_: self(fraction, text)) if self.report is not None else self.quiet()

    def saying(self, text: str) -> Progress:
        """Return a progress that replaces the texts of its reports by ``text`` and shows no intermediate results.

        Parameters
        ----------
        text : text of the reports
        """
        report = Progress(self.report)
        return replace(self, report=self.report and (lambda fraction, _: report.tell(fraction, text)), shown=None)

    def shares(self, share: float) -> Iterator[Progress]:
        """Yield progresses for an unknown number of steps; each step covers a share of the fraction that is left.

        Parameters
        ----------
        share : share of the remaining fraction that each step covers, 0 to 1
        """
        left = 1.0
        while True:
            yield self.part(1.0 - left, 1.0 - left * (1.0 - share))
            left *= 1.0 - share

    def quiet(self) -> Progress:
        """Return a progress that reports nothing and can be cancelled, for work within a step."""
        return Progress(stopped=self.stopped)

    def rising(self) -> Progress:
        """Return a progress whose reported fraction never falls, for work of several attempts."""
        if self.report is None:
            return self
        report, most = self.report, self.lo

        def report_largest(fraction: float, text: str) -> None:
            nonlocal most
            most = max(most, fraction)
            report(most, text)

        return replace(self, report=report_largest)

    def showing(self, made: Callable[[Any], Any]) -> Progress:
        """Return a progress that shows ``made(value)`` instead of every intermediate result ``value``."""
        if self.shown is None:
            return self
        shown = self.shown
        return replace(self, shown=lambda value: shown(made(value)))

    def show(self, value: Any) -> None:
        """Pass an intermediate result to ``shown``, if there is such a receiver."""
        if self.shown is not None:
            self.shown(value)


SILENT = Progress()

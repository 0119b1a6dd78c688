"""One mechanism for progress and cancelling, for scripts, modal operators and batch builds alike."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from .errors import Cancelled

T = TypeVar("T")


@dataclass(frozen=True)
class Progress:
    """Reports how far a stage has come, and raises ``Cancelled`` once a stop is wanted.

    ``report(fraction, text)`` receives the overall fraction in [0, 1]; ``stopped()`` is asked at every call.
    ``part(lo, hi)`` gives a stage its share of the whole. ``show(value)`` hands an intermediate result to whoever wants
    to look at it, such as a shape that is still moving; ``shown`` receives it.
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
        """Report without asking whether to stop: for the end of work whose result is to be kept even then."""
        if self.report is not None:
            self.report(self.lo + (self.hi - self.lo) * min(max(fraction, 0.0), 1.0), text)

    def part(self, lo: float, hi: float) -> Progress:
        span = self.hi - self.lo
        return Progress(self.report, self.stopped, self.lo + span * lo, self.lo + span * hi, self.shown)

    def each(self, things: Sequence[T], text: str) -> Iterator[T]:
        """Things that are worked on one after the other, each told before it is handed out."""
        for number, thing in enumerate(things):
            self(number / len(things), text)
            yield thing

    def batches(self, count: int, size: int, text: str) -> Iterator[slice]:
        """Slices of ``size`` of ``count`` things that are worked on one after the other, each told before it begins."""
        for first in range(0, count, size):
            self(first / count, text)
            yield slice(first, min(first + size, count))

    def at(self, fraction: float, text: str) -> Progress:
        """Tells where a step begins; returns the progress for the work within it, which goes on telling the same."""
        self(fraction, text)
        return Progress(lambda *_: self(fraction, text)) if self.report is not None else self.quiet()

    def quiet(self) -> Progress:
        """For work within a step: it can be stopped, but does not report."""
        return Progress(stopped=self.stopped)

    def showing(self, made: Callable[[Any], Any]) -> Progress:
        """The same progress for work that shows something else, from which ``made`` makes what is to be shown."""
        if self.shown is None:
            return self
        shown = self.shown
        return replace(self, shown=lambda value: shown(made(value)))

    def show(self, value: Any) -> None:
        if self.shown is not None:
            self.shown(value)


SILENT = Progress()

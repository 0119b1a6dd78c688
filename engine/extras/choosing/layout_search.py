"""State of the search for layouts: judged layouts, their ranking, and the number that may still be judged."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from ...figures import format_figure
from ...params import ChooseParams
from ...progress import Progress
from ...surface.checking.finding import with_count
from ...workers import cores
from .judge import LONG, FlatLayout, JudgedLayout, LayoutProblem, judge
from .predict import PredictionStart, judge_by_prediction

Together = Callable[[Callable[[Any], Any], Sequence[Any], Progress, str], list[Any]]

# Processor seconds for all predictions together, and for one: a constant part, and a part per quad
BUDGET, ONE, QUAD = 16.0, 0.4, 2.2e-3
PUNCTUAL = 0.6  # share of the expected time after which the progress bar slows down
# Ratio of the time to judge a layout to that of the initial layout, by the clock: 1.6 to 2.8 on six surfaces, with two at once
HARDER = 2.0
FEWEST, MOST = 6, 32  # smallest and largest number of layouts to judge
SEARCH_SCATTER = (
    0.03  # share of a distance by which two searches of the same layout differ at most, and which counts as the same
)
# Expected distance after a long search over the distance after a short one: measured 0.36 to 0.67 for layouts of 986 quads, less for those of 150
EXPECTED = 0.67


@dataclass(eq=False)
class LayoutSearch:
    """State of the search for layouts."""

    piece: LayoutProblem
    params: ChooseParams
    together: Together
    start: PredictionStart | None = None  # start of predictions; None if short searches judge
    reference: float = np.inf  # distance of the initial layout after a long search
    # ratio of the distance after a long search to the predicted one, or to that after a short search
    expected: float = EXPECTED
    pace: float = 0.0  # seconds that the last long search took
    first: float = 0.0  # seconds to judge the initial layout, by the clock
    known: dict[bytes, JudgedLayout | None] = field(default_factory=dict)
    proved: dict[bytes, JudgedLayout] = field(default_factory=dict)
    waiting: list[FlatLayout] = field(default_factory=list)  # flattened but not judged yet, most promising first

    @property
    def one(self) -> float:
        """Processor seconds of one prediction."""
        return ONE + QUAD * len(self.piece.mesh.quads)

    @property
    def left(self) -> int:
        """Number of layouts that may still be judged."""
        return int(np.clip(BUDGET / self.one, FEWEST, MOST)) - len(self.known)

    def unknown(self, laid: FlatLayout) -> bool:
        """Return whether a layout has not been judged yet."""
        return key(laid) not in self.known

    @property
    def ranking(self) -> list[JudgedLayout]:
        """Return the latest judgement of all layouts with an equilibrium, best first."""
        latest = self.known | self.proved
        return sorted((one for one in latest.values() if one is not None), key=self.key)

    def distance(self, one: JudgedLayout) -> float:
        """Return the RMS distance after a long search, or the expected one, with strains within the limit; at the end, the result."""
        return one.eased if one.share >= LONG else self.expected * one.rms

    @property
    def progress_text(self) -> str:
        """Return the progress text while layouts are judged: the best so far."""
        best = next(iter(self.ranking), None)
        return "Judging layouts" + ("" if best is None else f", the best: {short(best.laid, best.rms)}")

    def key(self, one: JudgedLayout) -> tuple[float, ...]:
        """Return the sort key of a layout for the present goal; smaller is better."""
        rms, laid = self.distance(one), one.laid
        work = (float(laid.joints), float(laid.panels), rms)
        if self.params.goal == "panels":
            few = laid.panels <= self.params.panels
            return (0.0, rms, *work) if few else (1.0, float(laid.panels), *work)
        limit = self.params.match / 100.0 if self.params.goal == "match" else (1.0 + SEARCH_SCATTER) * self.reference
        return (0.0, *work) if rms <= limit else (1.0, rms, *work)

    def holds(self, one: JudgedLayout) -> bool:
        """Return whether a layout meets the goal."""
        return self.key(one)[0] == 0.0

    def next(self, share: float) -> list[FlatLayout]:
        """Return the most promising layouts, a share of the number left; at least one is symmetric, if any is."""
        taken = self.waiting[: int(share * self.left)]
        symmetric = next((one for one in self.waiting if one.symmetric > 1), None)
        if taken and symmetric is not None and not any(one.symmetric > 1 for one in taken):
            taken[-1] = symmetric
        return taken

    def judge(self, laid: Iterable[FlatLayout], progress: Progress, *, more: bool = False) -> None:
        """Judge new layouts, up to the number left or ``more``: by predictions if there is a start, else by short searches."""
        fresh = list({key(one): one for one in laid if self.unknown(one)}.values())
        fresh = fresh if more else fresh[: max(self.left, 0)]
        way = partial(judge, self.piece) if self.start is None else partial(judge_by_prediction, self.piece, self.start)
        ahead = min(1.0, cores() / max(len(fresh), 1))
        paced = clocked_progress(progress, HARDER * self.first / ahead, ahead)
        found = self.together(way, fresh, paced, self.progress_text)
        self.known.update(zip(map(key, fresh), found, strict=True))

    def expect(self, searched: Iterable[JudgedLayout]) -> None:
        """Update the expected ratio of long searches to predictions: the worst of several."""
        shares = [
            one.eased / before.rms
            for one in searched
            if (before := self.known[key(one.laid)]) is not None and not before.share and before.rms > 0.0
        ]
        if shares:
            self.expected = max(shares)

    def learn(self, given: JudgedLayout) -> None:
        """Use the outcome of a search of the initial layout: long searches of other layouts start from its spirals."""
        self.reference = given.rms
        self.expect([given])
        self.piece = replace(self.piece, spirals=given.spirals)

    def prove(self, laid: Sequence[FlatLayout], progress: Progress) -> None:
        """Judge known layouts by a long search, which continues an earlier one.

        If a search loses the equilibrium, that is recorded for the layout, or its earlier judgement stays.
        """
        tries = []
        for one in laid:
            before = self.proved.get(key(one))
            tries.append((self.piece if before is None else replace(self.piece, spirals=before.spirals), one))
        found = self.together(_proved, tries, clocked_progress(progress, self.pace), self.progress_text)
        for one, made in zip(laid, found, strict=True):
            before = self.proved.get(key(one))
            if made is not None and (before is None or made.eased < before.eased):
                self.proved[key(one)] = made
            elif before is None:
                self.known[key(one)] = None


def _proved(tried: tuple[LayoutProblem, FlatLayout]) -> JudgedLayout | None:
    return judge(*tried, LONG)


def clocked_progress(progress: Progress, seconds: float, ahead: float | None = None) -> Progress:
    """Return a progress that advances with the clock, for work that reports nothing near its end.

    Parameters
    ----------
    progress : to report to
    seconds : expected duration of the work
    ahead : share of the work by which the clock may run ahead of the reports; None to ignore reports
    """
    report, began, whole = progress.report, time.monotonic(), progress.hi - progress.lo
    if report is None or seconds <= 0.0:
        return progress

    def tell(fraction: float, text: str) -> None:
        share = (time.monotonic() - began) / seconds
        late = max(share - PUNCTUAL, 0.0) / (1.0 - PUNCTUAL)
        share = min(share, PUNCTUAL) + (1.0 - PUNCTUAL) * late / (1.0 + late)
        if ahead is not None:
            done = (fraction - progress.lo) / whole
            share = min(max(share, done), done + ahead)
        report(progress.lo + whole * share, text)

    return replace(progress, report=tell)


def key(laid: FlatLayout) -> bytes:
    """Return a key that identifies a layout of the surface."""
    return np.packbits(laid.cut).tobytes()


def short(laid: FlatLayout, rms: float) -> str:
    """Describe a layout by its panels and distance in a few words."""
    panels = with_count(laid.panels, "panel", "panels")
    return f"{panels}, RMS distance {format_figure(100.0 * rms)} %"

"""State of the search for layouts: the judged layouts, their ranking, and how many more may be judged."""

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
from ...workers import count_cores
from .judge import LONG_SHARE, FlatLayout, JudgedLayout, LayoutProblem, judge
from .predict import PredictionStart, judge_by_prediction

ParallelMap = Callable[[Callable[[Any], Any], Sequence[Any], Progress, str], list[Any]]

# Processor seconds for all predictions together (larger: more layouts are judged, more time); estimated seconds of one
# prediction, and in addition for each quad
PREDICTION_BUDGET, PREDICTION_SECONDS, SECONDS_PER_QUAD = 16.0, 0.4, 2.2e-3
ON_TIME_SHARE = 0.6  # share of the expected time after which the progress bar slows down; changes only the display
# Clock time to judge a layout, in multiples of the initial layout's; changes only the progress bar
CLOCK_RATIO = 2.0
MIN_LAYOUTS, MAX_LAYOUTS = 6, 32  # smallest and largest number of layouts to judge; larger: more certain, more time
SEARCH_SCATTER = (
    0.03  # largest relative difference of the distances of two searches of one layout; smaller gains are ignored
)
# Expected distance from the target after a long search, as a share of that after a short search (measured: 0.36 to
# 0.67); larger: more pessimistic
LONG_TO_SHORT_RATIO = 0.67


@dataclass(eq=False)
class LayoutSearch:
    """State of the search for layouts; distances are RMS distances from the target as shares of its size."""

    piece: LayoutProblem
    params: ChooseParams
    together: ParallelMap  # maps a function over arguments, perhaps in several processes
    start: PredictionStart | None = None  # start of predictions; None if layouts are judged by short searches
    reference: float = np.inf  # distance of the initial layout after a long or full search
    # expected distance after a long search, as a share of the predicted one or of the one after a short search
    expected: float = LONG_TO_SHORT_RATIO
    # clock time of a long search, seconds: first an estimate, then that of the initial layout's search
    pace: float = 0.0
    first: float = 0.0  # clock time to judge the initial layout, seconds
    # first judgement of every layout, by ``layout_key``; None if the layout has no equilibrium
    known: dict[bytes, JudgedLayout | None] = field(default_factory=dict)
    proved: dict[bytes, JudgedLayout] = field(default_factory=dict)  # best long or full search, by ``layout_key``
    waiting: list[FlatLayout] = field(default_factory=list)  # flattened but not judged yet, most promising first

    @property
    def one(self) -> float:
        """Processor seconds of one prediction."""
        return PREDICTION_SECONDS + SECONDS_PER_QUAD * len(self.piece.mesh.quads)

    @property
    def left(self) -> int:
        """Number of layouts that may still be judged; negative if more were judged than planned."""
        return int(np.clip(PREDICTION_BUDGET / self.one, MIN_LAYOUTS, MAX_LAYOUTS)) - len(self.known)

    def unknown(self, laid: FlatLayout) -> bool:
        """Return whether a layout has not been judged yet."""
        return layout_key(laid) not in self.known

    @property
    def ranking(self) -> list[JudgedLayout]:
        """Return the latest judgement of all layouts with an equilibrium, best first."""
        latest = self.known | self.proved
        return sorted((one for one in latest.values() if one is not None), key=self.key)

    def distance(self, one: JudgedLayout) -> float:
        """Return the RMS distance that a layout reached in a long search, or is expected to reach in one.

        Strains beyond the limit increase it, see ``JudgedLayout.eased``.
        """
        return one.eased if one.share >= LONG_SHARE else self.expected * one.rms

    @property
    def progress_text(self) -> str:
        """Progress text for users while layouts are judged: names the best layout so far."""
        best = next(iter(self.ranking), None)
        return "Judging layouts" + ("" if best is None else f", the best: {describe_layout(best.laid, best.rms)}")

    def key(self, one: JudgedLayout) -> tuple[float, ...]:
        """Return the sort key of a layout: smaller is better, and the first entry is 0 if the goal is met."""
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
        """Return the most promising waiting layouts; if a symmetric one is waiting, at least one is symmetric.

        share : number of layouts to return, as a share of those that may still be judged
        """
        taken = self.waiting[: int(share * self.left)]
        symmetric = next((one for one in self.waiting if one.symmetric > 1), None)
        if taken and symmetric is not None and not any(one.symmetric > 1 for one in taken):
            taken[-1] = symmetric
        return taken

    def judge(self, laid: Iterable[FlatLayout], progress: Progress, *, more: bool = False) -> None:
        """Judge new layouts, by predictions if there is a ``start``, else by short searches.

        Parameters
        ----------
        laid : layouts, the most promising first; those judged before are skipped
        progress : called with the fraction done; may cancel
        more : judge all of them, even beyond the number that may still be judged
        """
        fresh = list({layout_key(one): one for one in laid if self.unknown(one)}.values())
        fresh = fresh if more else fresh[: max(self.left, 0)]
        way = partial(judge, self.piece) if self.start is None else partial(judge_by_prediction, self.piece, self.start)
        ahead = min(1.0, count_cores() / max(len(fresh), 1))
        paced = clocked_progress(progress, CLOCK_RATIO * self.first / ahead, ahead)
        found = self.together(way, fresh, paced, self.progress_text)
        self.known.update(zip(map(layout_key, fresh), found, strict=True))

    def expect(self, searched: Iterable[JudgedLayout]) -> None:
        """Set ``expected`` to the largest ratio, among searched layouts, of the reached to the predicted distance."""
        shares = [
            one.eased / before.rms
            for one in searched
            if (before := self.known[layout_key(one.laid)]) is not None and not before.share and before.rms > 0.0
        ]
        if shares:
            self.expected = max(shares)

    def learn(self, given: JudgedLayout) -> None:
        """Use the searched initial layout as reference, its spirals as the start of later searches, and its distance to
        calibrate predictions."""
        self.reference = given.rms
        self.expect([given])
        self.piece = replace(self.piece, spirals=given.spirals)

    def prove(self, laid: Sequence[FlatLayout], progress: Progress) -> None:
        """Judge layouts by a long search, which continues an earlier long search of the same layout.

        If a search ends without an equilibrium, the result of an earlier long search stays; without an earlier one, the
        layout counts as one without equilibrium.
        """
        tries = []
        for one in laid:
            before = self.proved.get(layout_key(one))
            tries.append((self.piece if before is None else replace(self.piece, spirals=before.spirals), one))
        found = self.together(_judge_long, tries, clocked_progress(progress, self.pace), self.progress_text)
        for one, made in zip(laid, found, strict=True):
            before = self.proved.get(layout_key(one))
            if made is not None and (before is None or made.eased < before.eased):
                self.proved[layout_key(one)] = made
            elif before is None:
                self.known[layout_key(one)] = None


def _judge_long(tried: tuple[LayoutProblem, FlatLayout]) -> JudgedLayout | None:
    return judge(*tried, LONG_SHARE)


def clocked_progress(progress: Progress, seconds: float, ahead: float | None = None) -> Progress:
    """Return a progress that advances with the clock, for work that reports rarely.

    Parameters
    ----------
    progress : progress to report to
    seconds : expected duration of the work
    ahead : share of the work by which the clock may run ahead of the reported fraction; None to ignore that fraction
    """
    report, began, whole = progress.report, time.monotonic(), progress.hi - progress.lo
    if report is None or seconds <= 0.0:
        return progress

    def tell(fraction: float, text: str) -> None:
        share = (time.monotonic() - began) / seconds
        late = max(share - ON_TIME_SHARE, 0.0) / (1.0 - ON_TIME_SHARE)
        share = min(share, ON_TIME_SHARE) + (1.0 - ON_TIME_SHARE) * late / (1.0 + late)
        if ahead is not None:
            done = (fraction - progress.lo) / whole
            share = min(max(share, done), done + ahead)
        report(progress.lo + whole * share, text)

    return replace(progress, report=tell)


def layout_key(laid: FlatLayout) -> bytes:
    """Return the cuts of a layout as bytes, which identify it among the layouts of a surface."""
    return np.packbits(laid.cut).tobytes()


def describe_layout(laid: FlatLayout, rms: float) -> str:
    """Return a text for users with a layout's number of panels and its RMS distance from the target.

    Parameters
    ----------
    laid : the layout
    rms : RMS distance from the target, as a share of its size
    """
    panels = with_count(laid.panels, "panel", "panels")
    return f"{panels}, RMS distance {format_figure(100.0 * rms)} %"

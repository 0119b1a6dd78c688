"""Many candidates tried beside each other: first spread evenly, then where the best ones lie.

The points of a Sobol sequence fill the space; then differential evolution (Storn and Price 1997) goes on from the best of all that
is known, for several weights of the two measures in turn, so that it draws the whole front nearer (decomposition, as Zhang and
Li 2007). Both are scipy's, which travels with the extension. What was tried once is never tried again, and a batch is chosen only
from those before it: an exploration that was stopped, or done by other processes, comes to the same candidates.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from .. import MARK
from ..arrays import Float
from ..errors import Cancelled, FlexMapsError
from ..progress import SILENT, Progress
from ..workers import Lost, as_done
from .candidate import Base, Candidate, evaluate, lost
from .space import Space, Values

# Both measured on four test functions of two to five variables, mean of six seeds, 60 and 200 candidates: batches of 6 to 12 come
# nearer than those of 16 and 24, and a quarter or a third spread evenly comes nearer than half of them, or as near. Larger batches
# keep more cores busy: processes wait for the last of every batch
SPREAD = 0.35  # share of what may be tried that is spread evenly
POPULATION = 12  # candidates of a batch at most
# of the first measure, the second gets the rest; in turn, so that the ends and the middle of the front come nearer alike
WEIGHTS = (0.5, 0.8, 0.2)
SMALLEST = 5  # population of which scipy makes another at least
# share of the difference of two that is a step, drawn anew for every batch; within what Storn and Price recommend
STEP = (0.4, 0.9)
MOST = 1e6  # goals missed by more, or wholly, count alike; so that there is a number
BARREN = 3  # batches in a row that bring nothing new, after which there is hardly anything left: one of each weight

Found = Callable[[Candidate], None]


@dataclass(frozen=True)
class Exploration:
    """All that was tried, in the order in which it was asked for.

    finished : False where somebody stopped it
    """

    space: Space
    candidates: tuple[Candidate, ...]
    finished: bool = True

    @property
    def sound(self) -> list[Candidate]:
        """Those that could be made."""
        return [one for one in self.candidates if not one.fault]

    @property
    def front(self) -> list[Candidate]:
        """Those to choose among: of those that hold the goals, or of all where none does, whichever are smallest in one measure
        for what they have of the other; by the first measure."""
        holding = [one for one in self.sound if not self.space.missed(one.measures)]
        kept: list[tuple[tuple[float, float], Candidate]] = []
        for at, one in sorted(((_pair(self.space, one), one) for one in holding or self.sound), key=lambda row: row[0]):
            if not kept or at[1] < kept[-1][0][1] or at == kept[-1][0]:
                kept.append((at, one))
        return [one for _, one in kept]

    @property
    def best(self) -> int | None:
        """Number of the one that holds the goals, or comes nearest to that, and is smallest in the first measure."""
        order = sorted(self.sound, key=lambda one: (self.space.missed(one.measures), _pair(self.space, one)))
        return self.candidates.index(order[0]) if order else None

    @property
    def note(self) -> str:
        """What was found, or what would have to give, in a sentence or two."""
        if self.best is None:
            return "Nothing that was tried could be made. " + (self.candidates[0].fault if self.candidates else "")
        best = self.candidates[self.best]
        missed = [goal for goal in self.space.goals if goal.missed(best.measures) > 0.0]
        what = ", ".join(f"{name} {_said(value)}" for name, value in best.values.items())
        if not missed:
            return f"The best that holds the goals has {what}."
        gives = " and ".join(
            f"{goal.measure} has to be {_said(best.measures.get(goal.measure))} instead of {goal}" for goal in missed
        )
        edges = [
            v.name for v in self.space.variables if not v.choices and best.values[v.name] in (v.at(0.0), v.at(1.0))
        ]
        wider = f" {' and '.join(edges)} at the end of the bounds: wider bounds may help." if edges else ""
        return f"Nothing holds all goals. The nearest has {what}: {gives}.{wider} {best.advice}".strip()

    def report(self) -> dict[str, Any]:
        """It as it is written and shown."""
        return {
            "program": MARK,
            "note": self.note,
            "finished": self.finished,
            "goals": [str(goal) for goal in self.space.goals],
            "minimised": list(self.space.minimised),
            "best": self.best,
            "front": [self.candidates.index(one) for one in self.front],
            "candidates": [
                {"values": one.values, "measures": one.measures, "advice": one.advice, "fault": one.fault}
                for one in self.candidates
            ],
        }


@dataclass
class _Search:
    """What is known so far, and how more is asked for."""

    space: Space
    count: int
    executor: Executor
    task: Callable[[Values], Candidate]
    progress: Progress
    found: Found
    known: dict[tuple[Any, ...], Candidate]
    asked: list[tuple[Any, ...]] = field(default_factory=list)

    @property
    def left(self) -> int:
        return self.count - len(self.asked)

    def ask(self, wanted: Iterable[Values]) -> int:
        """Have these tried that were not asked for yet, as far as the number goes; returns how many were new."""
        fresh: dict[tuple[Any, ...], Values] = {}
        for values in wanted:
            if key(values) not in self.asked and len(fresh) < self.left:
                fresh.setdefault(key(values), values)
        begun = len(self.asked)
        self.asked += fresh
        missing = [values for name, values in fresh.items() if name not in self.known]
        part = self.progress.part(begun / self.count, len(self.asked) / self.count)
        for number, future in as_done(self.executor, self.task, missing, part, "Trying candidates"):
            error = future.exception()
            if isinstance(error, Cancelled):
                raise error
            one = future.result() if error is None else lost(missing[number], _plain(error))
            self.known[key(missing[number])] = one
            if not isinstance(error, Lost):  # with more memory it may go well another time
                self.found(one)
        return len(fresh)

    def made(self) -> tuple[Candidate, ...]:
        return tuple(self.known[name] for name in self.asked if name in self.known)


def key(values: Values) -> tuple[Any, ...]:
    """Values by which candidates are told apart."""
    return tuple(sorted(values.items()))


def explore(
    base: Base,
    space: Space,
    count: int,
    executor: Executor,
    progress: Progress = SILENT,
    *,
    known: Iterable[Candidate] = (),
    found: Found = lambda one: None,
    seed: int = 0,
    task: Callable[[Base, Values], Candidate] = evaluate,
) -> Exploration:
    """Try up to so many candidates.

    known : what an earlier exploration has tried; found : told of every new one; task : makes a candidate of values
    Stopped, it gives what was found so far. Raises ``Cancelled`` where that is nothing.
    """
    if count < 1:
        raise FlexMapsError("At least one candidate has to be tried")
    search = _Search(
        space, count, executor, partial(task, base), progress, found, {key(one.values): one for one in known}
    )
    try:
        sweep = space.sweep(count)
        if sweep is not None:
            search.count = len(sweep)
            search.ask(sweep)
        else:
            search.ask(_spread(space, max(SMALLEST, round(SPREAD * count)), seed))
            _improve(search, seed)
            search.ask(_spread(space, 2 * count, seed))  # where batches bring nothing new before as many were tried
    except Cancelled:
        if not search.made():
            raise
        return Exploration(space, search.made(), finished=False)
    return Exploration(space, search.made())


def _spread(space: Space, count: int, seed: int) -> Iterator[Values]:
    """Values at the points of a Sobol sequence (Sobol 1967, scrambled after Owen 1998)."""
    from scipy.stats import qmc

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # balanced are powers of two alone; here that matters little
        points = qmc.Sobol(len(space.variables), seed=seed).random(count)
    return map(space.values, points)


def _improve(search: _Search, seed: int) -> None:
    """Batches of differential evolution from the best so far, until as many were tried as are wanted."""
    barren = turn = 0
    while search.left and barren < BARREN:
        new = search.ask(_evolved(search, WEIGHTS[turn % len(WEIGHTS)], seed + turn))
        barren = 0 if new else barren + 1
        turn += 1


def _evolved(search: _Search, weight: float, seed: int) -> list[Values]:
    """The next generation of the best so far, by one weight; nothing is tried for it."""
    from scipy.optimize import differential_evolution

    space, known = search.space, search.made()
    merits = _merits(space, known, weight)
    order = np.argsort(merits, kind="stable")[:POPULATION]
    order = np.resize(order, max(len(order), SMALLEST))
    asked: list[list[np.ndarray]] = []

    def noted(function: Any, places: Iterable[np.ndarray]) -> list[float]:
        """Asked first for the population, which is known, then for what comes from it."""
        asked.append([np.array(place) for place in places])
        return merits[order].tolist()

    population = np.array([space.place(known[k].values) for k in order])
    differential_evolution(
        lambda place: 0.0, [(0.0, 1.0)] * len(space.variables), init=population, maxiter=1, polish=False,
        updating="deferred", workers=noted, rng=np.random.default_rng(seed), tol=0.0, mutation=STEP,
    )  # fmt: skip
    return [space.values(place) for place in asked[-1]]


def _merits(space: Space, known: Sequence[Candidate], weight: float) -> Float[np.ndarray, " candidates"]:
    """What differential evolution makes small: first by how much the goals are missed, then the ranks in both measures."""
    pairs = np.array([_pair(space, one) for one in known])
    first, second = (np.searchsorted(np.unique(column), column) / len(column) for column in pairs.T)
    missed = np.array([min(space.missed(one.measures), MOST) for one in known])
    return np.where(missed > 0.0, 1.0 + missed, 0.0) + weight * first + (1.0 - weight) * second


def _pair(space: Space, one: Candidate) -> tuple[float, float]:
    first, second = (one.measures.get(name, np.inf) for name in space.minimised)
    return first, second


def _plain(error: BaseException) -> Exception:
    """What a candidate is lost by; what stops the whole program goes on."""
    if not isinstance(error, Exception):
        raise error
    return error


def _said(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)

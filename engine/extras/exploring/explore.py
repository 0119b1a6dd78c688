"""Explore many candidates in parallel: first spread evenly over the space, then near the best ones.

A Sobol sequence fills the space. Then differential evolution (Storn and Price 1997) starts from the best candidates so
far, with several weights of the two minimised measures in turn, so that the whole Pareto front improves (decomposition,
as Zhang and Li 2007). Both algorithms are scipy's. No candidate is tried twice, and a batch depends only on the batches
before it, so that an exploration continued after a cancel, or run with another number of processes, tries the same
candidates.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from ... import MARK
from ...arrays import Float
from ...errors import Cancelled, FlexMapsError
from ...progress import SILENT, Progress
from ...workers import WorkerDied, as_completed
from .candidate import Candidate, ExplorationInput, evaluate_candidate, failed_candidate
from .space import SearchSpace, Values

SOBOL_SHARE = 0.35  # share of candidates spread evenly; larger: wider search, fewer candidates near the best ones
# largest number of candidates in a batch; larger: more cores are busy, but candidates are farther from the optimum
MAX_POPULATION = 12
# weights of the first measure, one per batch in turn, so that the whole front improves; the second measure has the
# weight 1 minus this
WEIGHTS = (0.5, 0.8, 0.2)
MIN_POPULATION = 5  # smallest population that scipy accepts
MUTATION_RANGE = (0.4, 0.9)  # range of the mutation factor, drawn anew for every batch; larger: wider steps
MAX_MISS = 1e6  # upper limit of a shortfall from the goals, so that missing measures give a finite number
# number of successive batches without a new candidate after which the evolution ends: one for each weight
MAX_IDLE_BATCHES = 3

OnCandidate = Callable[[Candidate], None]


@dataclass(frozen=True)
class Exploration:
    """Result of an exploration.

    space : variables, goals and minimised measures
    candidates : the candidates in the order in which they were requested
    finished : False after a cancel
    """

    space: SearchSpace
    candidates: tuple[Candidate, ...]
    finished: bool = True

    @property
    def sound(self) -> list[Candidate]:
        """Candidates that did not fail."""
        return [one for one in self.candidates if not one.fault]

    @property
    def front(self) -> list[Candidate]:
        """Pareto front of the two minimised measures, sorted by the first.

        Only candidates that meet all goals count, or all ``sound`` candidates if none meets them.
        """
        holding = [one for one in self.sound if not self.space.shortfall(one.measures)]
        kept: list[tuple[tuple[float, float], Candidate]] = []
        for at, one in sorted(
            ((_minimised_pair(self.space, one), one) for one in holding or self.sound), key=lambda row: row[0]
        ):
            if not kept or at[1] < kept[-1][0][1] or at == kept[-1][0]:
                kept.append((at, one))
        return [one for _, one in kept]

    @property
    def best(self) -> int | None:
        """Index of the best candidate: smallest shortfall from the goals, then smallest first minimised measure.

        None if all candidates failed.
        """
        order = sorted(
            self.sound, key=lambda one: (self.space.shortfall(one.measures), _minimised_pair(self.space, one))
        )
        return self.candidates.index(order[0]) if order else None

    @property
    def note(self) -> str:
        """Summary in a sentence or two: the values of the best candidate, and the goals that it misses."""
        if self.best is None:
            return "No candidate could be made. " + (self.candidates[0].fault if self.candidates else "")
        best = self.candidates[self.best]
        missed = [goal for goal in self.space.goals if goal.shortfall(best.measures) > 0.0]
        what = ", ".join(f"{name} {_format_value(value)}" for name, value in best.values.items())
        if not missed:
            return f"The best candidate that holds the goals has {what}."
        gives = " and ".join(
            f"{goal.measure} has to be {_format_value(best.measures.get(goal.measure))} instead of {goal}"
            for goal in missed
        )
        edges = [
            v.name for v in self.space.variables if not v.choices and best.values[v.name] in (v.at(0.0), v.at(1.0))
        ]
        wider = f" {' and '.join(edges)} at the end of the bounds: wider bounds may help." if edges else ""
        return f"No candidate holds all goals. The nearest has {what}: {gives}.{wider} {best.advice}".strip()

    def report(self) -> dict[str, Any]:
        """Return the content of the report file, which the sidebar shows too."""
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
class _RunningExploration:
    """State of a running exploration.

    count : largest number of candidates
    task : function that makes and measures a candidate; found : callback for every new candidate
    known : computed candidates by ``candidate_key``, with those of earlier explorations
    asked : keys of the candidates requested in this exploration, in order
    """

    space: SearchSpace
    count: int
    executor: Executor
    task: Callable[[Values], Candidate]
    progress: Progress
    found: OnCandidate
    known: dict[tuple[Any, ...], Candidate]
    asked: list[tuple[Any, ...]] = field(default_factory=list)

    @property
    def left(self) -> int:
        """Number of candidates that may still be requested."""
        return self.count - len(self.asked)

    def ask(self, wanted: Iterable[Values]) -> int:
        """Try candidates with the wanted values; return how many of them were new requests.

        Values that were requested before are skipped, and so are all beyond the number ``self.left``. Candidates from
        earlier explorations count as requests, but are not computed again.
        """
        fresh: dict[tuple[Any, ...], Values] = {}
        for values in wanted:
            if candidate_key(values) not in self.asked and len(fresh) < self.left:
                fresh.setdefault(candidate_key(values), values)
        begun = len(self.asked)
        self.asked += fresh
        missing = [values for name, values in fresh.items() if name not in self.known]
        part = self.progress.part(begun / self.count, len(self.asked) / self.count)
        for number, future in as_completed(self.executor, self.task, missing, part, "Trying candidates"):
            error = future.exception()
            if isinstance(error, Cancelled):
                raise error
            one = future.result() if error is None else failed_candidate(missing[number], _as_exception(error))
            self.known[candidate_key(missing[number])] = one
            # do not report a candidate whose process died: with more memory it may succeed in a later exploration
            if not isinstance(error, WorkerDied):
                self.found(one)
        return len(fresh)

    def made(self) -> tuple[Candidate, ...]:
        """Return the tried candidates in the order of the requests."""
        return tuple(self.known[name] for name in self.asked if name in self.known)


def candidate_key(values: Values) -> tuple[Any, ...]:
    """Return a hashable key that identifies the candidate with these values."""
    return tuple(sorted(values.items()))


def explore(
    base: ExplorationInput,
    space: SearchSpace,
    count: int,
    executor: Executor,
    progress: Progress = SILENT,
    *,
    known: Iterable[Candidate] = (),
    found: OnCandidate = lambda one: None,
    seed: int = 0,
    task: Callable[[ExplorationInput, Values], Candidate] = evaluate_candidate,
) -> Exploration:
    """Try up to ``count`` candidates; after a cancel return those tried so far.

    Parameters
    ----------
    base, space : the piece, and the variables and goals
    count : largest number of candidates
    executor : runs the tasks
    progress : called with the fraction done; may cancel
    known : candidates of an earlier exploration, which are not tried again
    found : called with every new candidate
    seed : seed of the random numbers; different seeds try different candidates
    task : function that makes and measures a candidate

    Raises
    ------
    FlexMapsError : ``count`` is below 1
    Cancelled : the user cancels before a candidate is tried
    """
    if count < 1:
        raise FlexMapsError("At least one candidate has to be tried")
    search = _RunningExploration(
        space, count, executor, partial(task, base), progress, found, {candidate_key(one.values): one for one in known}
    )
    try:
        sweep = space.sweep(count)
        if sweep is not None:
            search.count = len(sweep)
            search.ask(sweep)
        else:
            search.ask(_sobol_points(space, max(MIN_POPULATION, round(SOBOL_SHARE * count)), seed))
            _evolve(search, seed)
            search.ask(_sobol_points(space, 2 * count, seed))  # more points if evolution ended early
    except Cancelled:
        if not search.made():
            raise
        return Exploration(space, search.made(), finished=False)
    return Exploration(space, search.made())


def _sobol_points(space: SearchSpace, count: int, seed: int) -> Iterator[Values]:
    """Return the values of the variables at the points of a scrambled Sobol sequence (Sobol 1967, Owen 1998)."""
    from scipy.stats import qmc

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # scipy warns unless ``count`` is a power of two
        points = qmc.Sobol(len(space.variables), seed=seed).random(count)
    return map(space.values, points)


def _evolve(search: _RunningExploration, seed: int) -> None:
    """Try generations of differential evolution until no candidates are left, or generations bring nothing new."""
    barren = turn = 0
    while search.left and barren < MAX_IDLE_BATCHES:
        new = search.ask(_next_generation(search, WEIGHTS[turn % len(WEIGHTS)], seed + turn))
        barren = 0 if new else barren + 1
        turn += 1


def _next_generation(search: _RunningExploration, weight: float, seed: int) -> list[Values]:
    """Return the values of the next generation of differential evolution.

    scipy makes it from the best candidates; ``record`` stores the points that scipy proposes, and no objective is
    evaluated.

    weight : weight of the first minimised measure, 0 to 1
    """
    from scipy.optimize import differential_evolution

    space, known = search.space, search.made()
    merits = _merits(space, known, weight)
    order = np.argsort(merits, kind="stable")[:MAX_POPULATION]
    order = np.resize(order, max(len(order), MIN_POPULATION))
    asked: list[list[np.ndarray]] = []

    def record(function: Any, places: Iterable[np.ndarray]) -> list[float]:
        """Store the points that scipy evaluates: first the population, whose objective is known, then its offspring."""
        asked.append([np.array(place) for place in places])
        return merits[order].tolist()

    population = np.array([space.place(known[k].values) for k in order])
    differential_evolution(
        lambda place: 0.0, [(0.0, 1.0)] * len(space.variables), init=population, maxiter=1, polish=False,
        updating="deferred", workers=record, rng=np.random.default_rng(seed), tol=0.0, mutation=MUTATION_RANGE,
    )  # fmt: skip
    return [space.values(place) for place in asked[-1]]


def _merits(space: SearchSpace, known: Sequence[Candidate], weight: float) -> Float[np.ndarray, " candidates"]:
    """Return the objective of the evolution for each candidate; smaller is better.

    It is the weighted mean of the candidate's ranks in both measures, as shares of the number of candidates. A
    candidate that misses goals gets 1 plus its shortfall in addition, so that it comes after all that meet them.

    weight : weight of the first measure, 0 to 1
    """
    pairs = np.array([_minimised_pair(space, one) for one in known])
    first, second = (np.searchsorted(np.unique(column), column) / len(column) for column in pairs.T)
    missed = np.array([min(space.shortfall(one.measures), MAX_MISS) for one in known])
    return np.where(missed > 0.0, 1.0 + missed, 0.0) + weight * first + (1.0 - weight) * second


def _minimised_pair(space: SearchSpace, one: Candidate) -> tuple[float, float]:
    """Return the two minimised measures of a candidate; infinite if missing."""
    first, second = (one.measures.get(name, np.inf) for name in space.minimised)
    return first, second


def _as_exception(error: BaseException) -> Exception:
    """Return a task's error; raise it again if it should end the program, as KeyboardInterrupt does."""
    if not isinstance(error, Exception):
        raise error
    return error


def _format_value(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)

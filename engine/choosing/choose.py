"""Choosing a layout: many ways to cut a surface are laid flat, the promising ones judged by the shape that they take, and
changed where that shape says so.

The paper leaves open which cuts are the best ("we believe that ... automatic cutting is an interesting avenue", FlexMaps
section 10). Geometry alone cannot tell: a layout with less distortion may snap into another shape, and one with more may come
nearer because its spirals can be softer. So every layout that is compared has been simulated, after a short optimisation.
What is done is counted, never timed: the result is the same on every machine and with any number of processes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from typing import Any

import numpy as np

from ..errors import Cancelled, FlexMapsError
from ..params import ChooseParams
from ..patches.flattening.flatten import FlatPatches
from ..patches.merging.merge import merge
from ..patches.tracing.trace import trace
from ..progress import SILENT, Progress
from ..surface.symmetry import keeping
from ..workers import Workers
from .choice import GIVEN, Choice, Proposal, proposal
from .judge import FIRST, FULL, LONG, Idea, Judged, Laid, Piece, judge, lay, taken_up
from .lines import completed, drawn, planes, unlike
from .moves import moves

Together = Callable[[Callable[[Any], Any], Sequence[Any], Progress, str], list[Any]]

# Distortion limits, as shares of the layout's own, under which the surface is merged anew: each leads to more panels. The
# steep ones, which take 10 s for 1,000 quads, only where the others do not lead to the goal
LADDER, STEEP = (0.4, 0.15), (0.06, 0.03)
MOST_PARTS = 8  # strips, rings or petals; not measured, it bounds the time
# Core seconds for all short searches together, and what one takes: some seconds, and so much a quad; with these 1,000 quads
# take some 60 s of two cores
BUDGET, ONE, QUAD = 75.0, 2.5, 2.2e-3
FEWEST, MOST = 8, 32  # layouts that are judged at least and at most
MOST_PANELS = 3  # times as many as there are now, where their number is free; not measured, it bounds the time
CURVED = 2.0  # times the curvature that the given layout's panels take up: over seven surfaces none with more lay flat
SETTLED = 0.6  # share of them that are judged before any is changed
TURNS = 3  # how often the best are changed
BASES = 2  # layouts that are changed in a turn
# Layouts that get a long search, the best first, until one holds the goal: so many at once, so often
PROVED, ROUNDS = 2, 2
CLOSE = 2.0  # times the distance asked for within which the nearest layouts get a search as long as the optimiser's own
PROPOSALS, LEAST_SHOWN = 6, 3  # that are shown: more are no choice but a list, and fewer are none either
# Distances that count as the same when the work is weighed: two searches of the same layout differ by up to 3 %
NEARER, ENOUGH = 0.03, 1.05
# What a long search leaves of the distance that a short one ends with: 0.36 to 0.67 for layouts of 986 quads, less for those of 150
EXPECTED = 0.67


@dataclass(eq=False)
class _Search:
    """What is known while layouts are sought."""

    piece: Piece
    params: ChooseParams
    together: Together
    reference: float = np.inf  # of the given layout after a long search
    expected: float = EXPECTED
    known: dict[bytes, Judged | None] = field(default_factory=dict)
    proved: dict[bytes, Judged] = field(default_factory=dict)
    waiting: list[Laid] = field(default_factory=list)  # laid flat, not judged yet, the most promising first

    @property
    def left(self) -> int:
        """How many short searches there still may be."""
        one = ONE + QUAD * len(self.piece.mesh.quads)
        return int(np.clip(BUDGET / one, FEWEST, MOST)) - len(self.known)

    @property
    def judged(self) -> list[Judged]:
        """Everything that takes a shape, as it was judged last, the best first."""
        found = {key: self.proved.get(key, one) for key, one in self.known.items()}
        return sorted((one for one in found.values() if one is not None), key=self.key)

    def distance(self, one: Judged) -> float:
        """The RMS distance that a long search left, or may well leave; in the end, what was found."""
        return one.rms if one.share >= LONG else self.expected * one.rms

    @property
    def said(self) -> str:
        """What is told while layouts are judged: the best so far."""
        best = next(iter(self.judged), None)
        return "Judging layouts" + ("" if best is None else f", the best: {_short(best.laid, best.rms)}")

    def key(self, one: Judged) -> tuple[float, ...]:
        """The smaller the better, by what is wanted."""
        rms, laid = self.distance(one), one.laid
        work = (float(laid.joints), float(laid.panels), rms)
        if self.params.goal == "panels":
            few = laid.panels <= self.params.panels
            return (0.0, rms, *work) if few else (1.0, float(laid.panels), *work)
        limit = self.params.match / 100.0 if self.params.goal == "match" else (1.0 + NEARER) * self.reference
        return (0.0, *work) if rms <= limit else (1.0, rms, *work)

    def holds(self, one: Judged) -> bool:
        """Whether a layout holds the goal."""
        return self.key(one)[0] == 0.0

    def next(self, share: float) -> list[Laid]:
        """The most promising layouts, as many as a share of what is left; one at least is symmetric, where any is."""
        taken = self.waiting[: int(share * self.left)]
        symmetric = next((one for one in self.waiting if one.symmetric > 1), None)
        if taken and symmetric is not None and not any(one.symmetric > 1 for one in taken):
            taken[-1] = symmetric
        return taken

    def judge(self, laid: Iterable[Laid], progress: Progress) -> None:
        """Judge layouts that are not known yet by a short search, as many as there still may be."""
        fresh = list({key(one): one for one in laid if key(one) not in self.known}.values())[: max(self.left, 0)]
        found = self.together(partial(judge, self.piece), fresh, progress, self.said)
        self.known.update(zip(map(key, fresh), found, strict=True))

    def prove(self, laid: Sequence[Laid], progress: Progress, share: float = LONG) -> None:
        """Judge known layouts by a long search; those that lose their shape by it are known as such."""
        found = self.together(partial(judge, self.piece, share=share), laid, progress, self.said)
        for one, made in zip(laid, found, strict=True):
            before = self.proved.get(key(one))
            if made is not None and (before is None or made.rms < before.rms):
                self.proved[key(one)] = made
            elif made is None and before is None:
                self.known[key(one)] = None


def key(laid: Laid) -> bytes:
    """What tells one layout of a surface from another."""
    return np.packbits(laid.cut).tobytes()


def choose(
    piece: Piece,
    given: FlatPatches,
    params: ChooseParams,
    progress: Progress = SILENT,
    together: Together | None = None,
) -> Choice:
    """The layout that serves the goal best, and others worth looking at.

    given : the layout that there is, which is one of the proposals; together : runs a function on many things, perhaps in
    several processes, and gives the results in the same order. Stopped, it gives the best so far. Raises ``Cancelled`` where
    it is stopped before anything was judged, and ``FlexMapsError`` where not even the given layout takes a shape.
    """
    search = _Search(piece, params, together or Workers(1))
    first = Laid(given, GIVEN, 1 + len(keeping(piece.symmetries, given.layout.cut)))
    finished = True
    try:
        _begin(search, first, progress.part(0.0, 0.1))
        _collect(search, first, progress.part(0.1, 0.4))
        search.judge(search.next(SETTLED), progress.part(0.4, 0.55))
        held = bool(search.judged) and search.holds(search.judged[0])
        if not held and params.goal != "panels" and not params.near:
            _steeper(search, first, progress.part(0.55, 0.6))
        for turn in range(TURNS):
            part = progress.part(0.6 + 0.1 * turn, 0.7 + 0.1 * turn)
            if search.left <= 0 or not _changed(search, first, part):
                break
        _prove(search, progress.part(0.9, 1.0))
    except Cancelled:
        if not search.judged:
            raise
        finished = False
    if not search.judged:
        raise FlexMapsError("No layout of this surface takes a shape: simulate it first and mend what that reports")
    return _choice(search, first, finished)


def _begin(search: _Search, first: Laid, progress: Progress) -> None:
    """Judge the given layout."""
    found = judge(search.piece, first, FIRST, progress)
    search.known[key(first)] = found
    if found is not None:
        progress(1.0, search.said)


def _short(laid: Laid, rms: float) -> str:
    panels = "1 panel" if laid.panels == 1 else f"{laid.panels} panels"
    return f"{panels}, RMS distance {100.0 * rms:.2g} %"


def _collect(search: _Search, first: Laid, progress: Progress) -> None:
    """Lay out what geometry finds, and meanwhile give the given layout a long search.

    What that makes of the short one tells what to expect of the others, which start from its spirals.
    """
    piece, mesh, quick = search.piece, search.piece.mesh, search.known[key(first)]
    others: list[Idea | float] = []
    if not search.params.near:
        sketched = [*planes(mesh, piece.symmetries), *drawn(mesh, MOST_PARTS, piece.symmetries)]
        sketched = list(unlike(sketched, piece.symmetries))
        others = [*LADDER, *(Idea(cut, name) for name, cut in sketched)]
        if piece.symmetries:
            others += [Idea(cut, name, even=True) for name, cut in sketched]
        others += [Idea(cut, name) for name, cut in completed(first.cut, mesh, piece.symmetries)]
    jobs = others if quick is None else [first, *others]
    most = CURVED * taken_up(first.flat.layout)
    made = search.together(partial(_done, piece, most), jobs, progress, search.said)
    slow = made.pop(0) if quick is not None else None
    if slow is not None:
        search.proved[key(first)] = slow
        search.reference = slow.rms
        search.piece = replace(piece, spirals=slow.spirals)
    search.waiting = _ranked([one for one in made if one is not None and _fits(one, *_limits(search, first))])


def _steeper(search: _Search, first: Laid, progress: Progress) -> None:
    """Lay out and judge the surface in more panels; who asks for a match gets as many as that takes.

    A surface of 835 irregular quads ends at 3.6 % with 7 panels, at 1.3 % with 19, and at 0.35 % with 42.
    """
    most, (panels, limit) = CURVED * taken_up(first.flat.layout), _limits(search, first)
    made = search.together(partial(_done, search.piece, most), STEEP, progress.part(0.0, 0.5), search.said)
    panels = len(first.cut) if search.params.goal == "match" else panels
    search.judge([one for one in made if one is not None and _fits(one, panels, limit)], progress.part(0.5, 1.0))


def _limits(search: _Search, first: Laid) -> tuple[int, float]:
    """How many panels there may be, and how much the worst quad may be distorted."""
    params, layout = search.params, search.piece.settings.layout
    panels = params.panels if params.goal == "panels" else max(MOST_PANELS * first.panels, MOST_PARTS)
    return panels, max(layout.distortion_limit, float(first.flat.energy.max()))


def _fits(laid: Laid, panels: int, limit: float) -> bool:
    return laid.panels <= panels and float(laid.flat.energy.max()) <= limit


def _ranked(found: list[Laid]) -> list[Laid]:
    """Layouts in fronts, those first that no other has both fewer joints and less distortion than."""
    ranked: list[Laid] = []
    left = {key(one): (one, _worth(one)) for one in found}
    while left:
        front = [k for k, (_, worth) in left.items() if not any(_beats(other, worth) for _, other in left.values())]
        ranked += sorted((left.pop(k)[0] for k in front), key=lambda one: (-one.symmetric, one.joints))
    return ranked


def _beats(mine: tuple[float, ...], theirs: tuple[float, ...]) -> bool:
    return mine != theirs and all(a <= b for a, b in zip(mine, theirs, strict=True))


def _worth(laid: Laid) -> tuple[float, ...]:
    """What geometry says of a layout: joints, mean distortion, symmetries lost; the smaller the better."""
    areas = laid.flat.layout.mesh.areas
    return laid.joints, round(float(laid.flat.energy @ areas / areas.sum()), 9), -laid.symmetric


def _done(piece: Piece, most: float, job: Laid | Idea | float) -> Judged | Laid | None:
    """A layout judged by a long search, an idea laid flat, or the surface merged under a share of the distortion limit."""
    if isinstance(job, Laid):
        return judge(piece, job, LONG)
    if isinstance(job, Idea):
        return lay(piece, job, most)
    layout = piece.settings.layout
    try:
        tighter = replace(layout, distortion_limit=job * layout.distortion_limit)
        merged = merge(trace(piece.mesh, tighter), tighter, held=piece.supports is not None)
    except FlexMapsError:
        return None
    return lay(piece, Idea(merged.layout.cut, "merged with less distortion"))


def _changed(search: _Search, first: Laid, progress: Progress) -> bool:
    """Change the best layouts where their shape says so; whether that brought a better one."""
    before = search.key(search.judged[0])
    ideas: list[Idea] = []
    share = 2 * max(1, round(search.left / (2 * TURNS)))  # an even number keeps two cores busy
    for base in search.judged[:BASES]:
        holds = search.holds(base)
        more = not holds or search.params.goal == "panels"
        ideas += islice(moves(search.piece, base, fewer=holds, more=more), share)
    made = search.together(partial(lay, search.piece), ideas, progress.part(0.0, 0.2), search.said)
    sound = [one for one in made if one is not None and _fits(one, *_limits(search, first))]
    search.judge(sound[:share], progress.part(0.2, 1.0))
    return search.key(search.judged[0]) < before


def _prove(search: _Search, progress: Progress) -> None:
    """Give the best layouts a long search, until the best one has had it and holds the goal, or enough have.

    Several at once, whether there are as many cores or not, so that the result is the same. Where none holds the goal but some
    come near, these get a search as long as the optimiser's own.
    """
    for turn in range(ROUNDS):
        if search.judged[0].share >= LONG:
            break
        best = [one.laid for one in search.judged if one.share < LONG][:PROVED]
        search.prove(best, progress.part(turn / (ROUNDS + 1), (turn + 1) / (ROUNDS + 1)))
        if not search.judged:
            return
    limit = search.params.match / 100.0
    if search.params.goal == "match" and not search.holds(search.judged[0]):
        near = sorted((one for one in search.proved.values() if one.rms <= CLOSE * limit), key=lambda one: one.rms)
        search.prove([one.laid for one in near[:PROVED]], progress.part(ROUNDS / (ROUNDS + 1), 1.0), FULL)


def _choice(search: _Search, first: Laid, finished: bool) -> Choice:
    settings, search.expected = search.piece.settings, 1.0
    judged = search.judged
    best = _taken(search, judged, first)
    made = {id(one): proposal(one, settings, settings.material.chosen) for one in judged}
    shown = _shown([made[id(one)] for one in judged], made[id(best)])
    reached = search.holds(best)
    given = next((one for one in made.values() if one.judged.laid.origin == GIVEN), None)
    return Choice(
        tuple(shown),
        shown.index(made[id(best)]),
        search.params.goal,
        reached,
        _note(search, made[id(best)], given, reached),
        finished,
        len(search.known),
    )


def _taken(search: _Search, judged: list[Judged], first: Laid) -> Judged:
    """The best. Where no goal is held, or only the distance counts, what comes hardly nearer is not worth more work."""
    best = judged[0]
    if search.params.goal != "panels" and search.holds(best):
        return best
    given = next((one for one in judged if key(one.laid) == key(first)), None)
    alike = [one for one in judged if one.share >= LONG and search.distance(one) <= ENOUGH * search.distance(best)]
    if search.params.goal == "panels":
        alike = [given] if given is not None and search.holds(given) and given in alike else []
    return min([best, *alike], key=lambda one: (one.laid.joints, one.laid.panels))


def _shown(made: list[Proposal], best: Proposal) -> list[Proposal]:
    """The proposals worth showing, fewest joints first: the taken one, the given one, a symmetric one, and the front."""
    given = [one for one in made if one.judged.laid.origin == GIVEN]
    symmetric = sorted((one for one in made if one.symmetric), key=lambda one: one.rms)[:1]
    front = [
        one
        for one in made
        if not any(other.judged.laid.joints <= one.judged.laid.joints and other.rms < one.rms for other in made)
    ]
    chosen = list(dict.fromkeys([best, *given, *symmetric]))
    # as far apart from each other as they can be
    while len(chosen) < PROPOSALS and (rest := [one for one in front if one not in chosen]):
        chosen.append(max(rest, key=lambda one: min(_apart(one, other) for other in chosen)))
    chosen += [one for one in made if one not in chosen][: max(LEAST_SHOWN - len(chosen), 0)]
    return sorted(chosen, key=lambda one: (one.judged.laid.joints, one.rms))


def _apart(one: Proposal, other: Proposal) -> float:
    """How unlike two proposals are to somebody who chooses, by the ratios of their figures."""
    joints = np.log((1 + one.judged.laid.joints) / (1 + other.judged.laid.joints))
    return float(abs(joints) + abs(np.log(max(one.rms, 1e-9) / max(other.rms, 1e-9))))


def _note(search: _Search, best: Proposal, given: Proposal | None, reached: bool) -> str:
    """What was chosen, or what stands in the way."""
    what = _short(best.judged.laid, best.rms)
    if given is not None and given is not best:
        what += f" (before: {_short(given.judged.laid, given.rms)})"
    if search.params.near and search.params.goal == "match":
        asked = "a nearer match by other cuts"
    elif search.params.goal == "panels":
        asked = f"no more than {search.params.panels} panels"
    elif search.params.goal == "match":
        asked = f"a match of {search.params.match:g} %"
    else:
        asked = "the present match with less work"
    if reached:
        return f"Chosen for {asked}: {what}."
    if search.params.near and given is not None and best.rms < given.rms:
        return f"Changed for {asked}: {what}."
    return f"No layout was found for {asked}; the nearest has {what}. {_no_nearer(search, best.judged)}{best.judged.advice}"


def _no_nearer(search: _Search, best: Judged) -> str:
    """A sentence on layouts of more panels, with a blank after it; nothing where none was judged, or one may come nearer."""
    most = max(search.judged, key=lambda one: one.laid.panels)
    left = most.rms if most.share >= LONG else EXPECTED * most.rms
    if search.params.goal != "match" or most.laid.panels <= best.laid.panels or left < best.rms:
        return ""
    return f"Up to {most.laid.panels} panels bring it no nearer. "

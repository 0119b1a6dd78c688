"""Choosing a layout: many ways to cut a surface are laid flat, the promising ones judged by the shape that they take, and
changed where that shape says so.

The paper leaves open which cuts are the best ("we believe that ... automatic cutting is an interesting avenue", FlexMaps
section 10). Geometry alone cannot tell: a layout with less distortion may snap into another shape, and one with more may come
nearer because its spirals can be softer. So every layout that is compared has been simulated, after a short optimisation.
What is done is counted, never timed: the result is the same on every machine and with any number of processes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import islice, pairwise, zip_longest

from ..errors import Cancelled, FlexMapsError
from ..optimisation.remedies import WANTED
from ..params import ChooseParams, LayoutParams
from ..patches.flattening.flatten import FlatPatches
from ..patches.merging.merge import merge
from ..patches.tracing.trace import trace
from ..progress import SILENT, Progress
from ..surface.checking.finding import counted
from ..surface.symmetry import keeping
from ..workers import Workers
from .alike import alike
from .choice import GIVEN, PROPOSALS, STRIDE, Choice, Proposal, front, proposal, worth_showing
from .judge import FIRST, FULL, LONG, SHORT, Idea, Judged, Laid, Piece, judge, lay, taken_up
from .lines import completed, drawn, planes, unlike
from .moves import IDEAS, joined, moves
from .search import EXPECTED, Search, Together, key, short

# Distortion limits, as shares of the layout's own, under which the surface is merged anew: each leads to more panels. The
# steep ones, which take 10 s for 1,000 quads, only where the others do not lead to the goal
LADDER, STEEP = (0.4, 0.15), (0.06, 0.03)
# What else merging does otherwise where as many panels are wanted as there are: a nearer limit, shapes more or less compact, wider
# necks. Each takes 0.2 to 4 s and leads to another layout on four of eight surfaces, on three to one that comes nearer
SHARES, COMPACT, NECK = (0.8, 0.6, 0.4), (0.9, 1.4), 2
MOST_PARTS = 8  # strips, rings or petals; not measured, it bounds the time
MOST_PANELS = 3  # times as many as there are now, where their number is free; not measured, it bounds the time
CURVED = 2.0  # times the curvature that the given layout's panels take up: over seven surfaces none with more lay flat
SETTLED = 0.6  # share of them that are judged before any is changed
TURNS = 3  # how often the best are changed
BASES = 2  # layouts that are changed in a turn
# Layouts that get a long search, the best first: so many at once, so often. How a long search ends is hardly told by a short one: on
# a heart of 400 quads, layouts that ended short at 1.45, 1.46 and 1.47 % ended at 1.2, 0.87 and 0.88 %
PROVED, ROUNDS = 2, 3
AGAIN = 1  # the round, from 0 on, in which the best is searched again from another start
CLOSE = 2.0  # times the distance asked for within which the nearest layouts get a search as long as the optimiser's own
# Distances that count as the same when the work is weighed: two searches of the same layout differ by up to 3 %
ENOUGH = 1.05


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
    search = Search(piece, params, together or Workers(1))
    first = Laid(given, GIVEN, 1 + len(keeping(piece.symmetries, given.layout.cut)))
    finished = True
    try:
        _begin(search, first, progress.part(0.0, 0.1))
        if params.near:
            _cut_there(search, progress.part(0.1, 1.0))
        else:
            _sought(search, first, progress.part(0.1, 0.8))
            if params.goal == "match" and search.judged and not search.holds(search.judged[0]):
                _alike(search, first, progress.part(0.8, 0.95))
            _fill_gaps(search, progress.part(0.95, 1.0))
    except Cancelled:
        if not search.judged:
            raise
        finished = False
    if not search.judged:
        raise FlexMapsError("No layout of this surface takes a shape: simulate it first and mend what that reports")
    return _choice(search, first, finished)


def _cut_there(search: Search, progress: Progress) -> None:
    """Cut the best layout where its shape is to blame, until that is near enough or no further cut brings it nearer."""
    for turn in range(TURNS):
        best = next(iter(search.judged), None)
        if best is None or (turn and 100.0 * best.rms <= WANTED):
            return
        part = progress.part(turn / TURNS, (turn + 1) / TURNS)
        ideas = list(islice(moves(search.piece, best, fewer=False, more=True), IDEAS))
        made = search.together(partial(lay, search.piece), ideas, part.part(0.0, 0.2), search.said)
        search.judge([one for one in made if one is not None], part.part(0.2, 1.0))
        if search.judged[0] is best:
            return


def _sought(search: Search, first: Laid, progress: Progress) -> None:
    """Lay out, judge, change and prove."""
    params = search.params
    _collect(search, first, progress.part(0.0, 0.3))
    search.judge(search.next(SETTLED), progress.part(0.3, 0.5))
    held = bool(search.judged) and search.holds(search.judged[0])
    if not held and params.goal != "panels":
        _steeper(search, first, progress.part(0.5, 0.55))
    for turn in range(TURNS):
        part = progress.part(0.55 + 0.1 * turn, 0.65 + 0.1 * turn)
        if search.left <= 0 or not _changed(search, first, part):
            break
    _prove(search, first, progress.part(0.85, 1.0))


def _alike(search: Search, first: Laid, progress: Progress) -> None:
    """Where more panels have not led to the match, look for as many as there are that come nearer.

    On a heart of 400 quads 22 panels end at 1.1 %, and other 4 panels, not searched for before, at 0.9 %.
    """
    mine = key(first)
    counted = replace(search.params, goal="panels", panels=first.panels)
    other = replace(search, params=counted, known={mine: search.known[mine]}, proved={}, waiting=[])
    other.piece = replace(search.piece, spirals=None)
    if mine in search.proved:
        other.proved[mine] = search.proved[mine]
    try:
        _sought(other, first, progress)
    finally:  # what it has found by a stop counts too
        for name, one in other.known.items():
            search.known.setdefault(name, one)
        search.proved |= {
            name: one
            for name, one in other.proved.items()
            if name not in search.proved or one.rms < search.proved[name].rms
        }


def _begin(search: Search, first: Laid, progress: Progress) -> None:
    """Judge the given layout."""
    found = judge(search.piece, first, SHORT if search.params.near else FIRST, progress)
    search.known[key(first)] = found
    if found is not None:
        progress(1.0, search.said)


def _collect(search: Search, first: Laid, progress: Progress) -> None:
    """Lay out what geometry finds, and meanwhile give the given layout a long search.

    What that makes of the short one tells what to expect of the others, which start from its spirals.
    """
    piece, mesh, quick = search.piece, search.piece.mesh, search.known[key(first)]
    sketched = [*planes(mesh, piece.symmetries), *drawn(mesh, MOST_PARTS, piece.symmetries)]
    sketched = list(unlike(sketched, piece.symmetries))
    others: list[Idea | LayoutParams] = [*_merges(search), *(Idea(cut, name) for name, cut in sketched)]
    if piece.symmetries:
        others += [Idea(cut, name, even=True) for name, cut in sketched]
    others += [Idea(cut, name) for name, cut in completed(first.cut, mesh, piece.symmetries)]
    slow = search.proved.get(key(first))
    jobs = others if quick is None or slow is not None else [first, *others]
    most = CURVED * taken_up(first.flat.layout)
    made = search.together(partial(_done, piece, most), jobs, progress, search.said)
    if len(jobs) > len(others):
        slow = made.pop(0)
    if slow is not None:
        search.proved[key(first)] = slow
        search.reference = slow.rms
        search.piece = replace(piece, spirals=slow.spirals)
    search.waiting = _ranked(search, [one for one in made if one is not None and _fits(one, *_limits(search, first))])


def _merges(search: Search) -> list[LayoutParams]:
    """Other limits under which the surface is merged: for more panels, or otherwise where their number is given."""
    layout = search.piece.settings.layout
    if search.params.goal != "panels":
        return _tighter(layout, LADDER)
    shapes = [replace(layout, compactness_limit=share * layout.compactness_limit) for share in COMPACT]
    return [*_tighter(layout, SHARES), *shapes, replace(layout, neck_min=NECK * layout.neck_min)]


def _tighter(layout: LayoutParams, shares: Sequence[float]) -> list[LayoutParams]:
    return [replace(layout, distortion_limit=share * layout.distortion_limit) for share in shares]


def _steeper(search: Search, first: Laid, progress: Progress) -> None:
    """Lay out and judge the surface in more panels; who asks for a match gets as many as that takes.

    A surface of 835 irregular quads ends at 3.6 % with 7 panels, at 1.3 % with 19, and at 0.35 % with 42.
    """
    most, (panels, limit) = CURVED * taken_up(first.flat.layout), _limits(search, first)
    jobs = _tighter(search.piece.settings.layout, STEEP)
    made = search.together(partial(_done, search.piece, most), jobs, progress.part(0.0, 0.5), search.said)
    panels = len(first.cut) if search.params.goal == "match" else panels
    search.judge([one for one in made if one is not None and _fits(one, panels, limit)], progress.part(0.5, 1.0))


def _limits(search: Search, first: Laid) -> tuple[int, float]:
    """How many panels there may be, and how much the worst quad may be distorted."""
    params, layout = search.params, search.piece.settings.layout
    panels = params.panels if params.goal == "panels" else max(MOST_PANELS * first.panels, MOST_PARTS)
    return panels, max(layout.distortion_limit, float(first.flat.energy.max()))


def _fits(laid: Laid, panels: int, limit: float) -> bool:
    return laid.panels <= panels and float(laid.flat.energy.max()) <= limit


def _ranked(search: Search, found: list[Laid]) -> list[Laid]:
    """Layouts in fronts, those first that no other has both fewer joints and less distortion than.

    Where only the distance counts, those with less distortion come first.
    """
    if search.params.goal == "panels":
        return sorted(found, key=lambda one: _worth(one)[1:])
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


def _done(piece: Piece, most: float, job: Laid | Idea | LayoutParams) -> Judged | Laid | None:
    """A layout judged by a long search, an idea laid flat, or the surface merged under other limits."""
    if isinstance(job, Laid):
        return judge(piece, job, LONG)
    if isinstance(job, Idea):
        return lay(piece, job, most)
    try:
        merged = merge(trace(piece.mesh, job), job, held=piece.supports is not None)
    except FlexMapsError:
        return None
    return lay(piece, Idea(merged.layout.cut, "merged under other limits"))


def _changed(search: Search, first: Laid, progress: Progress) -> bool:
    """Change the best layouts where their shape says so; whether that brought a better one, or may still."""
    before = search.key(search.judged[0])
    ideas: list[Idea] = []
    share = 2 * max(1, round(search.left / (2 * TURNS)))  # an even number keeps two cores busy
    counted = search.params.goal == "panels"
    for base in search.judged[:BASES]:
        holds = search.holds(base)
        more = base.laid.panels < search.params.panels if counted else not holds
        changes = islice(moves(search.piece, base, fewer=holds != counted, more=more), share)
        if holds == counted:  # no more panels, but nearer
            ideas += [
                one for both in zip_longest(alike(search.piece, base), changes) for one in both if one is not None
            ]
        else:
            ideas += changes
    ideas = ideas if counted else ideas[: 2 * BASES * share]
    made = search.together(partial(lay, search.piece), ideas, progress.part(0.0, 0.2), search.said)
    sound = [one for one in made if one is not None and _fits(one, *_limits(search, first)) and search.unknown(one)]
    if counted:
        sound = _ranked(search, sound)
    search.judge(sound[:share], progress.part(0.2, 1.0))
    return bool(sound) and (counted or search.key(search.judged[0]) < before)


def _prove(search: Search, first: Laid, progress: Progress) -> None:
    """Give the best layouts a long search, until the best one has had it and holds the goal, or enough have.

    Several at once, whether there are as many cores or not, so that the result is the same. In the second round one begins with
    the spirals that its curvature asks for, and the last round with those that have led nearer. Where none holds the goal but some
    come near, these get a search as long as the optimiser's own.
    """
    counted, start = search.params.goal == "panels", search.piece
    plain = replace(search.piece, spirals=None)
    for turn in range(ROUNDS):
        best = [one.laid for one in search.judged if one.share < LONG][:PROVED]
        if not best or (not counted and search.judged[0].share >= LONG):
            break
        tries = [(start, one) for one in best]
        again = _again(search, first) if turn == AGAIN else None
        if again is not None:
            tries = [(plain, again), *tries[: PROVED - 1]]
        elif counted and turn > AGAIN and start is not plain:
            # others begin with what a search has made of the given layout: it is given as much
            tries = [(start, first), *tries[: PROVED - 1]]
        found = search.prove(tries, progress.part(turn / (ROUNDS + 1), (turn + 1) / (ROUNDS + 1)))
        if not search.judged:
            return
        if again is not None and found[0] is not None and found[0] is search.proved[key(again)]:
            start = plain
    limit = search.params.match / 100.0
    if search.params.goal == "match" and not search.holds(search.judged[0]):
        near = sorted((one for one in search.proved.values() if one.rms <= CLOSE * limit), key=lambda one: one.rms)
        tries = [(start, one.laid) for one in near[:PROVED]]
        search.prove(tries, progress.part(ROUNDS / (ROUNDS + 1), 1.0), FULL)


def _again(search: Search, first: Laid) -> Laid | None:
    """The best layout but the given one that has had a long search, which has begun with the spirals of the given one.

    Which start leads nearer differs: on a minimal surface of 900 quads layouts end at 0.09 to 0.11 % from those spirals and at 0.17
    to 0.3 % from those that the curvature asks for, on a heart of 400 quads at 1.4 to 1.5 % and at 0.87 to 1.3 %.
    """
    proved = [one for name, one in search.proved.items() if name != key(first) and search.known[name] is not None]
    return min(proved, key=lambda one: one.rms).laid if proved else None


def _fill_gaps(search: Search, progress: Progress) -> None:
    """Judge layouts between two proposals of which the next has far more panels: the larger one's panels joined."""
    for turn in range(PROPOSALS):
        made = next(_between(search), None)
        if made is None:
            break
        search.judge([made], progress.part(turn / PROPOSALS, (turn + 1) / PROPOSALS), more=True)


def _between(search: Search) -> Iterator[Laid]:
    """Yield layouts that nobody has judged, of more panels than one proposal and far fewer than the next."""
    for few, many in pairwise(front(search.judged)):
        most = max(int(STRIDE * few.laid.panels), few.laid.panels + 1)
        made = joined(search.piece, many, most) if many.laid.panels > most else None
        if made is not None and made.panels > few.laid.panels and search.unknown(made):
            yield made


def _choice(search: Search, first: Laid, finished: bool) -> Choice:
    settings, search.expected = search.piece.settings, 1.0
    judged = search.judged
    best = _taken(search, judged, first)
    made = {id(one): proposal(one, settings, settings.material.chosen) for one in judged}
    shown = worth_showing([made[id(one)] for one in judged], made[id(best)])
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


def _taken(search: Search, judged: list[Judged], first: Laid) -> Judged:
    """The best. Where no goal is held, or only the distance counts, what comes hardly nearer is not worth more work."""
    best = judged[0]
    if search.params.goal != "panels" and search.holds(best):
        return best
    given = next((one for one in judged if key(one.laid) == key(first)), None)
    alike = [one for one in judged if one.share >= LONG and search.distance(one) <= ENOUGH * search.distance(best)]
    if search.params.goal == "panels":
        alike = [given] if given is not None and search.holds(given) and given in alike else []
    return min([best, *alike], key=lambda one: (one.laid.joints, one.laid.panels))


def _note(search: Search, best: Proposal, given: Proposal | None, reached: bool) -> str:
    """What was chosen, or what stands in the way."""
    what = short(best.judged.laid, best.rms)
    if given is not None and given is not best:
        what += f" (before: {short(given.judged.laid, given.rms)})"
    if search.params.near and search.params.goal == "match":
        asked = "a nearer match by other cuts"
    elif search.params.goal == "panels":
        asked = f"no more than {counted(search.params.panels, 'panel', 'panels')}"
    elif search.params.goal == "match":
        asked = f"a match of {search.params.match:g} %"
    else:
        asked = "the present match with less work"
    if reached:
        return f"Chosen for {asked}: {what}."
    if search.params.near and given is not None and best.rms < given.rms:
        return f"Changed for {asked}: {what}."
    return f"No layout was found for {asked}; the nearest has {what}. {_no_nearer(search, best.judged)}{best.judged.advice}"


def _no_nearer(search: Search, best: Judged) -> str:
    """A sentence on layouts of more panels, with a blank after it; nothing where none was judged, or one may come nearer."""
    most = max(search.judged, key=lambda one: one.laid.panels)
    left = most.rms if most.share >= LONG else EXPECTED * most.rms
    if search.params.goal != "match" or most.laid.panels <= best.laid.panels or left < best.rms:
        return ""
    return f"Up to {most.laid.panels} panels bring it no nearer. "

"""Search for a layout: flatten many layouts of a surface, judge the promising ones by the shape that their assembled
panels take, and change the best where that shape misses the target.

The paper leaves open which cuts are the best ("we believe that ... automatic cutting is an interesting avenue",
FlexMaps section 10). Geometry alone does not decide: a layout with less distortion may snap into another shape, and one
with more may come nearer because its spirals can be softer. So the match of each compared layout is predicted from its
equilibrium, and the most promising layouts are optimised. The work is limited by counts, not by the clock, so that the
result is the same on every machine and with any number of processes.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import islice, pairwise, takewhile, zip_longest
from typing import Any

import numpy as np

from ...errors import Cancelled, FlexMapsError
from ...optimisation.remedies import WANTED_PERCENT
from ...optimisation.work import Work
from ...params import ChooseParams, LayoutParams
from ...patches.flattening.flatten import FlatPatches
from ...patches.layout import PatchLayout
from ...patches.merging.ladder import merge_in_steps
from ...patches.tracing.trace import trace
from ...progress import SILENT, Progress
from ...simulation.simulate import Simulation
from ...surface.symmetry import keeping
from ...workers import Workers
from .alike import alike
from .choice import INITIAL, STRIDE, Choice, front
from .decide import decide, may_replace_initial
from .drawn_cuts import along_folds, drop_images, equal_cuts, planes, symmetric_variants
from .judge import (
    LONG,
    WHOLE,
    FlatLayout,
    Idea,
    JudgedLayout,
    LayoutProblem,
    judge,
    judge_optimised,
    lay_flat,
    panel_curvature,
)
from .layout_search import LayoutSearch, Together, clocked_progress, key
from .moves import IDEAS, merge_across_seams, moves
from .predict import PredictionStart
from .prospects import WORTH

# Distortion limits, as shares of the limit in the settings, for merging the surface again; smaller: more panels
LADDER = (0.4, 0.15, 0.06, 0.03)
Sketch = tuple[str, np.ndarray]  # a name, and its cut edges, (E,) bool
# Variants of merging if the goal is a number of panels: shares of the distortion limit, factors on the compactness
# limit, and a factor on the smallest neck. More variants: more layouts, 0.2 to 4 s each
SHARES, COMPACT, NECK = (0.8, 0.6, 0.4), (0.9, 1.4), 2
MOST_PARTS = 8  # largest number of equal strips, rings or petals; larger: more layouts, more time
MOST_PANELS = 3  # largest ratio of panel counts to the initial layout's, unless the goal limits them; larger: more time
# Largest curvature within a panel, in multiples of the initial layout's, with which flattening is tried; larger: slower
CURVED = 2.0
SETTLED = 0.6  # share of the layouts to judge before any is changed; the others are left for changes
TURNS = 3  # number of rounds in which the best layouts are changed
BASES = 2  # number of layouts that are changed in a round
PROVED = 2  # number of layouts beside the initial one that get a long search; larger: more certain, more time
# Ratio of the real to the counted seconds of a long search; changes only the displayed time left
SLOWER = 4.0
# A layout gets a second long search if the first ends within this factor of the required distance; larger: more time
CLOSE = 1.3
# Largest number of quads with which several long searches run at once; larger pieces get one at a time, about a minute
SMALL = 500
BEGUN = 0.05  # share of the progress for the initial layout
# Fractions of the remaining progress at which flattening, judging, changing, and filling of gaps between proposals end;
# long searches take the rest. Fitted so that the displayed time left hardly rises
SHARES_OF_TIME = 0.22, 0.3, 0.38, 0.42
# The fractions if the initial layout was optimised before, so that no long search runs while layouts are flattened.
# Smaller: a longer time left is displayed, which rises less
SHARES_IF_OPTIMISED = 0.1, 0.4, 0.55, 0.58
FILLED = 2  # largest number of layouts to make in gaps between proposals


def choose(
    piece: LayoutProblem,
    given: FlatPatches,
    params: ChooseParams,
    progress: Progress = SILENT,
    together: Together | None = None,
    reached: Simulation | None = None,
) -> Choice:
    """Find the layout that meets the goal best, and others worth showing.

    Parameters
    ----------
    piece : the surface, its supports and forces, and the settings
    given : the initial layout, which is one of the proposals
    params : the goal
    progress : called with the fraction done; may cancel
    together : maps a function over arguments in order, perhaps in several processes; default is in this one
    reached : equilibrium of the initial layout, if its spirals are optimised; this layout stays unless another one
        comes clearly nearer to the target, or alone meets the goal

    Returns
    -------
    the proposals and the chosen one; the best so far if the user cancels

    Raises
    ------
    Cancelled : the user cancels before any layout was judged
    FlexMapsError : not even the initial layout has an equilibrium
    """
    search = LayoutSearch(piece, params, together or Workers(1))
    first = FlatLayout(given, INITIAL, 1 + len(keeping(piece.symmetries, given.layout.cut)))
    finished = True
    if reached is not None:
        search.proved[key(first)] = found = judge_optimised(first, reached)
        search.piece = replace(piece, spirals=found.spirals)  # predictions start from the optimised spirals too
    try:
        _begin(search, first, progress.part(0.0, BEGUN))
        if params.near:
            _cut_there(search, progress.part(BEGUN, 1.0))
        else:
            _sought(search, first, progress.part(BEGUN, 1.0))
    except Cancelled:
        if not search.ranking:
            raise
        finished = False
    if not search.ranking:
        raise FlexMapsError("No layout of this surface takes a shape: simulate it first and mend what that reports")
    return decide(search, first, finished)


def _cut_there(search: LayoutSearch, progress: Progress) -> None:
    """Add cuts to the best layout where its shape misses the target, until it is near enough or no cut improves it."""
    for turn in range(TURNS):
        best = next(iter(search.ranking), None)
        if best is None or (turn and 100.0 * best.rms <= WANTED_PERCENT):
            return
        part = progress.part(turn / TURNS, (turn + 1) / TURNS)
        ideas = list(islice(moves(search.piece, best, fewer=False, more=True), IDEAS))
        made = search.together(partial(lay_flat, search.piece), ideas, part.part(0.0, 0.2), search.progress_text)
        search.judge([one for one in made if one is not None], part.part(0.2, 1.0))
        if search.ranking[0] is best:
            return


def _sought(search: LayoutSearch, first: FlatLayout, progress: Progress) -> None:
    """Collect and judge layouts, change the best, fill gaps between proposals, and give the best a long search."""
    collected, settled, changed, filled = SHARES_IF_OPTIMISED if search.proved else SHARES_OF_TIME
    _collect(search, first, progress.part(0.0, collected))
    search.judge(search.next(SETTLED), progress.part(collected, settled))
    if search.start is not None and not any(
        may_replace_initial(search, one) for one in search.ranking if one.share < LONG
    ):
        return
    turns = progress.part(settled, changed)
    for turn in range(TURNS):
        if search.left <= 0 or not _changed(search, first, turns.part(turn / TURNS, (turn + 1) / TURNS)):
            break
    _fill_gaps(search, progress.part(changed, filled))
    _prove(search, progress.part(filled, 1.0))


def _begin(search: LayoutSearch, first: FlatLayout, progress: Progress) -> None:
    """Judge the initial layout in the way in which all layouts are judged: by its prediction or by a short search.

    If it was optimised before, its simulated shape also calibrates the predictions.
    """
    piece, reached = search.piece, search.proved.get(key(first))
    if reached is not None:
        progress(0.0, search.progress_text)
    if not search.params.near and piece.settings.simulate.model != "rod":
        with suppress(FlexMapsError):  # a short search fails as well, and its error is shown
            search.start = PredictionStart.from_layout(piece, first.flat, progress.quiet())
            search.expected = 1.0
    began = time.monotonic()
    if reached is None or search.start is not None:
        search.judge([first], progress)
    if reached is not None:
        search.known[key(first)] = search.known.get(key(first)) or reached
        search.learn(reached)
    search.first = time.monotonic() - began
    counted = Work.for_spirals(len(piece.mesh.quads), LONG).limit or 0.0
    search.pace = SLOWER * counted * search.first / search.one
    if search.known[key(first)] is not None:
        progress(1.0, search.progress_text)


def _collect(search: LayoutSearch, first: FlatLayout, progress: Progress) -> None:
    """Flatten the layouts that geometry suggests; meanwhile search the initial layout, unless it was optimised before.

    The ratio of the initial layout's distance to its prediction calibrates the predictions of other layouts, and their
    long searches start from its spirals.
    """
    piece, mesh, quick = search.piece, search.piece.mesh, search.known[key(first)]
    sketches = [*along_folds(mesh), *planes(mesh, piece.symmetries), *equal_cuts(mesh, MOST_PARTS, piece.symmetries)]
    sketched = _promising(search, list(drop_images(sketches, piece.symmetries)))
    others: list[Idea | LayoutParams] = [*_merges(search), *(Idea(cut, name) for name, cut in sketched)]
    if piece.symmetries:
        others += [Idea(cut, name, even=True) for name, cut in sketched]
    others += [Idea(cut, name) for name, cut in symmetric_variants(first.cut, mesh, piece.symmetries)]
    unsearched = quick is not None and key(first) not in search.proved
    jobs = [first, *others] if unsearched else others
    most = CURVED * panel_curvature(first.flat.layout)
    began, paced = time.monotonic(), clocked_progress(progress, search.pace) if unsearched else progress
    made: list[Any] = search.together(partial(_done, piece, search.params, most), jobs, paced, search.progress_text)
    search.pace = time.monotonic() - began if unsearched else search.pace
    slow = made.pop(0) if unsearched else None
    if slow is not None:
        search.proved[key(first)] = slow
        search.learn(slow)
    found = {key(one): one for several in made for one in several if _fits(one, *_limits(search, first))}
    search.waiting = _ranked(search, [one for one in found.values() if search.unknown(one)])


def _promising(search: LayoutSearch, sketches: list[Sketch]) -> list[Sketch]:
    """Return the most promising sketches, as many as may be judged, by Pareto rank in cut edges and panel curvature."""
    mesh = search.piece.mesh
    worth = [(int(cut.sum()), panel_curvature(PatchLayout(mesh, cut & ~mesh.border))) for _, cut in sketches]
    ranked = sorted(range(len(sketches)), key=lambda k: (sum(_beats(other, worth[k]) for other in worth), worth[k], k))
    return [sketches[k] for k in sorted(ranked[: max(search.left, 0)])]


def _merges(search: LayoutSearch) -> list[LayoutParams]:
    """Return the settings for merging the surface: the user's, and variants if the goal is a number of panels."""
    layout = search.piece.settings.layout
    if search.params.goal != "panels":
        return [layout]
    shapes = [replace(layout, compactness_limit=share * layout.compactness_limit) for share in COMPACT]
    return [layout, *shapes, replace(layout, neck_min=NECK * layout.neck_min)]


def _limits(search: LayoutSearch, first: FlatLayout) -> tuple[int, float]:
    """Return the largest number of panels, and the largest distortion of a quad, that a layout may have."""
    params, layout = search.params, search.piece.settings.layout
    panels = params.panels if params.goal == "panels" else max(MOST_PANELS * first.panels, MOST_PARTS)
    return panels, max(layout.distortion_limit, float(first.flat.energy.max()))


def _fits(laid: FlatLayout, panels: int, limit: float) -> bool:
    return laid.panels <= panels and float(laid.flat.energy.max()) <= limit


def _ranked(search: LayoutSearch, found: list[FlatLayout]) -> list[FlatLayout]:
    """Sort layouts by Pareto front (joints, distortion, lost symmetries), each front spread from few to many joints.

    If the goal is a number of panels, sort by distortion.
    """
    if search.params.goal == "panels":
        return sorted(found, key=lambda one: _worth(one)[1:])
    ranked: list[FlatLayout] = []
    left = {key(one): (one, _worth(one)) for one in found}
    while left:
        front = [k for k, (_, worth) in left.items() if not any(_beats(other, worth) for _, other in left.values())]
        ranked += _spread(sorted((left.pop(k)[0] for k in front), key=lambda one: (one.joints, -one.symmetric)))
    return ranked


def _spread(ordered: list[FlatLayout]) -> list[FlatLayout]:
    """Reorder a list so that its first items span it: both ends, then the middle of the largest gap, and so on."""
    taken = sorted({0, len(ordered) - 1})
    while len(taken) < len(ordered):
        left, right = max(pairwise(sorted(taken)), key=lambda gap: gap[1] - gap[0])
        taken.append((left + right) // 2)
    return [ordered[k] for k in taken]


def _beats(mine: tuple[float, ...], theirs: tuple[float, ...]) -> bool:
    return mine != theirs and all(a <= b for a, b in zip(mine, theirs, strict=True))


def _worth(laid: FlatLayout) -> tuple[float, ...]:
    """Return the geometric costs of a layout: joints, area-weighted mean distortion, minus the symmetries kept."""
    areas = laid.flat.layout.mesh.areas
    return laid.joints, round(float(laid.flat.energy @ areas / areas.sum()), 9), -laid.symmetric


def _done(
    piece: LayoutProblem, params: ChooseParams, most: float, job: FlatLayout | Idea | LayoutParams
) -> JudgedLayout | list[FlatLayout] | None:
    """Run one job in a worker process, by its type.

    FlatLayout : judge it by a long search
    Idea : flatten it; nothing if a panel's curvature exceeds ``most``, radians
    LayoutParams : merge the surface under these limits, and under tighter ones, and flatten the layouts
    """
    if isinstance(job, FlatLayout):
        return judge(piece, job, LONG)
    if isinstance(job, Idea):
        ideas = [job]
    else:
        shares = SHARES if params.goal == "panels" else LADDER
        merged: list[PatchLayout] = []
        try:
            traced = trace(piece.mesh, job)
            for kept in (piece.symmetries, ()) if piece.symmetries else ((),):
                merged += merge_in_steps(traced, job, (*shares, 1.0), kept, held=piece.is_loaded)
        except FlexMapsError:
            return []
        ideas, most = [Idea(one.cut, "merged under other limits") for one in merged], np.inf
    return [laid for idea in ideas if (laid := lay_flat(piece, idea, most)) is not None]


def _changed(search: LayoutSearch, first: FlatLayout, progress: Progress) -> bool:
    """Change and judge the best layouts for one round; return whether another round is worthwhile."""
    before = search.key(search.ranking[0])
    ideas: list[Idea] = []
    share = 2 * max(1, round(search.left / (2 * TURNS)))  # an even number keeps two cores busy
    counted = search.params.goal == "panels"
    for base in search.ranking[:BASES]:
        holds = search.holds(base)
        more = base.laid.panels < search.params.panels if counted else not holds
        changes = islice(moves(search.piece, base, fewer=holds != counted, more=more), share)
        if holds == counted:  # look for nearer layouts with the same number of panels
            ideas += [
                one for both in zip_longest(alike(search.piece, base), changes) for one in both if one is not None
            ]
        else:
            ideas += changes
    ideas = ideas if counted else ideas[: BASES * share]
    batch = max(len(ideas), 1) if counted else share  # with a number of panels as goal, flatten all, then rank them
    sound: list[FlatLayout] = []
    for k in range(0, len(ideas), batch):
        if len(sound) < share:
            some = ideas[k : k + batch]
            made = search.together(partial(lay_flat, search.piece), some, progress.part(0.0, 0.2), search.progress_text)
            sound += [
                one for one in made if one is not None and _fits(one, *_limits(search, first)) and search.unknown(one)
            ]
    if counted:
        sound = _ranked(search, sound)
    search.judge(sound[:share], progress.part(0.2, 1.0))
    return bool(sound) and (counted or search.key(search.ranking[0]) < before)


def _prove(search: LayoutSearch, progress: Progress) -> None:
    """Give the best layouts a long search; if none meets the required match, search those that may still meet it.

    With up to ``SMALL`` quads several layouts are searched at once, whatever the number of cores, so that the result
    does not depend on it; with more quads, one after another, as long as the next is expected to meet the goal better.
    """
    together = PROVED if len(search.piece.mesh.quads) <= SMALL else 1
    searched: list[FlatLayout] = []
    for turn in range(PROVED // together):
        tries = _better(search, together)
        search.prove(tries, progress.part(0.6 * turn * together / PROVED, 0.6 * (turn + 1) * together / PROVED))
        searched += tries
        search.expect([search.proved[key(one)] for one in searched if key(one) in search.proved])
    if search.params.goal != "match" or any(search.holds(one) for one in search.proved.values()):
        return
    may_hold = [one.laid for one in search.ranking if one.share < LONG and search.holds(one)]
    search.prove([*_undecided(search), *may_hold][:together], progress.part(0.6, 1.0))


def _better(search: LayoutSearch, most: int) -> list[FlatLayout]:
    """Return at most ``most`` layouts that had no long search but are expected to be better than all that had one.

    If the goal is a number of panels, return the best layouts without a long search.
    """
    found: Iterable[JudgedLayout] = search.ranking
    if search.params.goal != "panels":
        found = takewhile(lambda one: one.share < LONG, found)
    return [one.laid for one in found if one.share < LONG and may_replace_initial(search, one)][:most]


def _undecided(search: LayoutSearch) -> list[FlatLayout]:
    """Return the nearest layout that had a long search if a second one may decide its choice; else an empty list."""
    nearest = min((one for one in search.proved.values() if one.share < WHOLE), key=lambda one: one.eased, default=None)
    if nearest is None:
        return []
    whole = next((one.rms for one in search.proved.values() if one.share >= WHOLE), 0.0)
    may_hold = nearest.eased <= CLOSE * search.params.match / 100.0
    return [nearest.laid] if may_hold or WORTH * whole < nearest.eased <= CLOSE * whole else []


def _fill_gaps(search: LayoutSearch, progress: Progress) -> None:
    """Make and judge layouts in large gaps between the panel counts of proposals."""
    made = list(islice(_between(search), FILLED))
    search.judge(made, progress, more=True)


def _between(search: LayoutSearch) -> Iterator[FlatLayout]:
    """Yield new layouts between two proposals in panel count, made from the larger one by joining panels."""
    for few, many in pairwise(front(search.ranking)):
        most = max(int(STRIDE * few.laid.panels), few.laid.panels + 1)
        made = merge_across_seams(search.piece, many, most) if many.laid.panels > most else None
        if made is not None and made.panels > few.laid.panels and search.unknown(made):
            yield made

"""Search for a layout: flatten many layouts of a surface, judge the promising ones by the shape that their assembled
panels take, and change the best where that shape misses the target.

The paper leaves open which cuts are the best ("we believe that ... automatic cutting is an interesting avenue",
FlexMaps section 10). Geometry alone does not decide: a layout with less distortion may snap into another shape, and one
with more distortion may come nearer to the target because its spirals can be softer. So the match of each layout is
predicted from its equilibrium, and the most promising layouts are optimised. Counts limit the work, not the clock, so
that the result is the same on every machine and with any number of processes.
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
from ...patches.tracing.trace import trace_layout
from ...progress import SILENT, Progress
from ...simulation.simulate import Simulation
from ...surface.symmetry import preserved_by
from ...workers import Workers
from .choice import INITIAL_ORIGIN, MAX_PANEL_STEP, Choice, pareto_front
from .decide import decide, may_replace_initial
from .drawn_cuts import cuts_along_folds, cuts_in_planes, drop_symmetric_images, equal_part_cuts, symmetric_variants
from .judge import (
    FULL_SHARE,
    LONG_SHARE,
    CutPlan,
    FlatLayout,
    JudgedLayout,
    LayoutProblem,
    flatten_cuts,
    judge,
    judge_optimised,
    panel_curvature,
)
from .layout_changes import PLANS_PER_STEP, merge_across_seams, propose_changes
from .layout_search import LayoutSearch, ParallelMap, clocked_progress, layout_key
from .layout_variants import make_variants
from .predict import PredictionStart
from .prospects import WORTHWHILE_RATIO

# Distortion limits for merging the surface again, as shares of the limit in the settings; smaller: more panels
MERGE_SHARES = (0.4, 0.15, 0.06, 0.03)
Sketch = tuple[str, np.ndarray]  # a set of cuts: its name, and whether each edge is cut, (E,) bool
# Variants of merging if the goal is a number of panels: shares of the distortion limit, factors on the compactness
# limit, and a factor on the smallest neck. More variants: more layouts to flatten, 0.2 to 4 s each
PANEL_GOAL_SHARES, COMPACTNESS_FACTORS, NECK_FACTOR = (0.8, 0.6, 0.4), (0.9, 1.4), 2
MAX_PARTS = 8  # largest number of equal strips, rings or petals; larger: more layouts, more time
# Largest number of panels, in multiples of the initial layout's, unless the goal limits it; larger: more time
MAX_PANEL_RATIO = 3
# Largest Gaussian curvature in a panel for which flattening is tried, multiples of the initial layout's; larger: slower
MAX_CURVATURE_RATIO = 2.0
FIRST_SHARE = 0.6  # share of the layouts to judge before any is changed; larger: fewer changed layouts are judged
ROUNDS = 3  # largest number of rounds in which the best layouts are changed; larger: fewer changes in a round
CHANGED_PER_ROUND = 2  # number of layouts that are changed in a round; larger: more variety, more time
LONG_SEARCHES = 2  # number of layouts beside the initial one that get a long search; larger: more certain, more time
# Clock time of a long search, in multiples of its work limit (nominal seconds); changes only the displayed time left
TIME_RATIO = 4.0
# A layout gets a second long search if the first ends within this factor of the required distance; larger: more time
SECOND_SEARCH_RATIO = 1.3
# Largest number of quads with which several long searches run at once; with more quads they run one after another, each
# for about a minute. Larger: cores are idle less often, but searches that turn out needless run too
MAX_PARALLEL_QUADS = 500
INITIAL_PROGRESS = 0.05  # share of the progress for the initial layout
# Fractions of the progress at which flattening, judging, changing layouts, and filling gaps between proposals end; long
# searches follow. Fitted so that the displayed time left hardly rises
PROGRESS_ENDS = 0.22, 0.3, 0.38, 0.42
# These fractions if the initial layout was optimised before, so that no long search runs while layouts are flattened.
# Smaller: the displayed time left is longer, and rises less
PROGRESS_ENDS_IF_OPTIMISED = 0.1, 0.4, 0.55, 0.58
MAX_GAP_LAYOUTS = 2  # largest number of layouts to make between proposals of very different panel counts


def choose(
    piece: LayoutProblem,
    given: FlatPatches,
    params: ChooseParams,
    progress: Progress = SILENT,
    together: ParallelMap | None = None,
    reached: Simulation | None = None,
) -> Choice:
    """Find the layout that meets the goal best, and others worth showing.

    Parameters
    ----------
    piece : the surface, its supports and forces, and the settings
    given : the initial layout, which is one of the proposals
    params : the goal
    progress : called with the fraction done; may cancel
    together : maps a function over arguments in order, perhaps in several processes; default: in this process
    reached : simulation of the initial layout, if its spirals are optimised; this layout then stays unless ``decide``
        finds another one clearly better

    Returns
    -------
    the proposals and the chosen one; if the user cancels, those of the layouts judged so far

    Raises
    ------
    Cancelled : the user cancels before any layout was judged
    FlexMapsError : not even the initial layout has an equilibrium
    """
    search = LayoutSearch(piece, params, together or Workers(1))
    first = FlatLayout(given, INITIAL_ORIGIN, 1 + len(preserved_by(piece.symmetries, given.layout.cut)))
    finished = True
    if reached is not None:
        search.proved[layout_key(first)] = found = judge_optimised(first, reached)
        search.piece = replace(piece, spirals=found.spirals)  # predictions start from the optimised spirals too
    try:
        _judge_initial(search, first, progress.part(0.0, INITIAL_PROGRESS))
        if params.near:
            _cut_worst_places(search, progress.part(INITIAL_PROGRESS, 1.0))
        else:
            _search_layouts(search, first, progress.part(INITIAL_PROGRESS, 1.0))
    except Cancelled:
        if not search.ranking:
            raise
        finished = False
    if not search.ranking:
        raise FlexMapsError("No layout of this surface takes a shape: simulate it first and mend what that reports")
    return decide(search, first, finished)


def _cut_worst_places(search: LayoutSearch, progress: Progress) -> None:
    """Add cuts to the best layout where its shape misses the target, until it is near enough or no cut improves it."""
    for turn in range(ROUNDS):
        best = next(iter(search.ranking), None)
        if best is None or (turn and 100.0 * best.rms <= WANTED_PERCENT):
            return
        part = progress.part(turn / ROUNDS, (turn + 1) / ROUNDS)
        ideas = list(islice(propose_changes(search.piece, best, fewer=False, more=True), PLANS_PER_STEP))
        made = search.together(partial(flatten_cuts, search.piece), ideas, part.part(0.0, 0.2), search.progress_text)
        search.judge([one for one in made if one is not None], part.part(0.2, 1.0))
        if search.ranking[0] is best:
            return


def _search_layouts(search: LayoutSearch, first: FlatLayout, progress: Progress) -> None:
    """Collect and judge layouts, change the best, fill gaps in panel count, and give the best a long search."""
    collected, settled, changed, filled = PROGRESS_ENDS_IF_OPTIMISED if search.proved else PROGRESS_ENDS
    _flatten_candidates(search, first, progress.part(0.0, collected))
    search.judge(search.next(FIRST_SHARE), progress.part(collected, settled))
    if search.start is not None and not any(
        may_replace_initial(search, one) for one in search.ranking if one.share < LONG_SHARE
    ):
        return
    turns = progress.part(settled, changed)
    for turn in range(ROUNDS):
        if search.left <= 0 or not _improve_best(search, first, turns.part(turn / ROUNDS, (turn + 1) / ROUNDS)):
            break
    _fill_gaps(search, progress.part(changed, filled))
    _run_long_searches(search, progress.part(filled, 1.0))


def _judge_initial(search: LayoutSearch, first: FlatLayout, progress: Progress) -> None:
    """Judge the initial layout by a prediction or a short search; calibrate predictions if it was optimised before."""
    piece, reached = search.piece, search.proved.get(layout_key(first))
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
        search.known[layout_key(first)] = search.known.get(layout_key(first)) or reached
        search.learn(reached)
    search.first = time.monotonic() - began
    counted = Work.for_spirals(len(piece.mesh.quads), LONG_SHARE).limit or 0.0
    search.pace = TIME_RATIO * counted * search.first / search.one
    if search.known[layout_key(first)] is not None:
        progress(1.0, search.progress_text)


def _flatten_candidates(search: LayoutSearch, first: FlatLayout, progress: Progress) -> None:
    """Flatten the layouts that geometry suggests, and give the initial layout a long search unless it was optimised.

    The ratio of the initial layout's distance to its prediction calibrates the predictions of other layouts. The long
    searches of other layouts start from the spirals of the initial one.
    """
    piece, mesh, quick = search.piece, search.piece.mesh, search.known[layout_key(first)]
    kept = piece.symmetries
    sketches = [*cuts_along_folds(mesh), *cuts_in_planes(mesh, kept), *equal_part_cuts(mesh, MAX_PARTS, kept)]
    sketched = _select_sketches(search, list(drop_symmetric_images(sketches, piece.symmetries)))
    others: list[CutPlan | LayoutParams] = [*_merge_variants(search), *(CutPlan(cut, name) for name, cut in sketched)]
    if piece.symmetries:
        others += [CutPlan(cut, name, even=True) for name, cut in sketched]
    others += [CutPlan(cut, name) for name, cut in symmetric_variants(first.cut, mesh, piece.symmetries)]
    unsearched = quick is not None and layout_key(first) not in search.proved
    jobs = [first, *others] if unsearched else others
    most = MAX_CURVATURE_RATIO * panel_curvature(first.flat.layout)
    began, paced = time.monotonic(), clocked_progress(progress, search.pace) if unsearched else progress
    made: list[Any] = search.together(partial(_run_task, piece, search.params, most), jobs, paced, search.progress_text)
    search.pace = time.monotonic() - began if unsearched else search.pace
    slow = made.pop(0) if unsearched else None
    if slow is not None:
        search.proved[layout_key(first)] = slow
        search.learn(slow)
    found = {
        layout_key(one): one for several in made for one in several if _is_within_limits(one, *_limits(search, first))
    }
    search.waiting = _rank_by_geometry(search, [one for one in found.values() if search.unknown(one)])


def _select_sketches(search: LayoutSearch, sketches: list[Sketch]) -> list[Sketch]:
    """Return the sets of cuts that fewest others surpass in both cut edges and curvature, as many as may be judged."""
    mesh = search.piece.mesh
    worth = [(int(cut.sum()), panel_curvature(PatchLayout(mesh, cut & ~mesh.border))) for _, cut in sketches]
    ranked = sorted(range(len(sketches)), key=lambda k: (sum(_dominates(o, worth[k]) for o in worth), worth[k], k))
    return [sketches[k] for k in sorted(ranked[: max(search.left, 0)])]


def _merge_variants(search: LayoutSearch) -> list[LayoutParams]:
    """Return the settings for merging the surface: the user's, and variants if the goal is a number of panels."""
    layout = search.piece.settings.layout
    if search.params.goal != "panels":
        return [layout]
    shapes = [replace(layout, compactness_limit=share * layout.compactness_limit) for share in COMPACTNESS_FACTORS]
    return [layout, *shapes, replace(layout, neck_min=NECK_FACTOR * layout.neck_min)]


def _limits(search: LayoutSearch, first: FlatLayout) -> tuple[int, float]:
    """Return the largest number of panels, and the largest distortion of a quad, that a layout may have."""
    params, layout = search.params, search.piece.settings.layout
    panels = params.panels if params.goal == "panels" else max(MAX_PANEL_RATIO * first.panels, MAX_PARTS)
    return panels, max(layout.distortion_limit, float(first.flat.energy.max()))


def _is_within_limits(laid: FlatLayout, panels: int, limit: float) -> bool:
    return laid.panels <= panels and float(laid.flat.energy.max()) <= limit


def _rank_by_geometry(search: LayoutSearch, found: list[FlatLayout]) -> list[FlatLayout]:
    """Sort layouts by Pareto front (joints, distortion, lost symmetries); if the goal is a number of panels, by
    distortion. Within a front, ``_spread`` mixes layouts with few and many joints.
    """
    if search.params.goal == "panels":
        return sorted(found, key=lambda one: _geometric_costs(one)[1:])
    ranked: list[FlatLayout] = []
    left = {layout_key(one): (one, _geometric_costs(one)) for one in found}
    while left:
        front = [k for k, (_, worth) in left.items() if not any(_dominates(other, worth) for _, other in left.values())]
        ranked += _spread(sorted((left.pop(k)[0] for k in front), key=lambda one: (one.joints, -one.symmetric)))
    return ranked


def _spread(ordered: list[FlatLayout]) -> list[FlatLayout]:
    """Reorder a list: both ends first, then repeatedly the item in the middle of the largest gap."""
    taken = sorted({0, len(ordered) - 1})
    while len(taken) < len(ordered):
        left, right = max(pairwise(sorted(taken)), key=lambda gap: gap[1] - gap[0])
        taken.append((left + right) // 2)
    return [ordered[k] for k in taken]


def _dominates(mine: tuple[float, ...], theirs: tuple[float, ...]) -> bool:
    return mine != theirs and all(a <= b for a, b in zip(mine, theirs, strict=True))


def _geometric_costs(laid: FlatLayout) -> tuple[float, ...]:
    """Return the geometric costs of a layout: joints, area-weighted mean distortion, minus the symmetries kept."""
    areas = laid.flat.layout.mesh.areas
    return laid.joints, round(float(laid.flat.energy @ areas / areas.sum()), 9), -laid.symmetric


def _run_task(
    piece: LayoutProblem, params: ChooseParams, most: float, job: FlatLayout | CutPlan | LayoutParams
) -> JudgedLayout | list[FlatLayout] | None:
    """Run one job in a worker process, by its type.

    FlatLayout : judge it by a long search
    CutPlan : flatten it; no layout if a panel has more Gaussian curvature than ``most``, radians
    LayoutParams : merge the surface under these limits and under tighter ones, and flatten the layouts
    """
    if isinstance(job, FlatLayout):
        return judge(piece, job, LONG_SHARE)
    if isinstance(job, CutPlan):
        ideas = [job]
    else:
        shares = PANEL_GOAL_SHARES if params.goal == "panels" else MERGE_SHARES
        merged: list[PatchLayout] = []
        try:
            traced = trace_layout(piece.mesh, job)
            for kept in (piece.symmetries, ()) if piece.symmetries else ((),):
                merged += merge_in_steps(traced, job, (*shares, 1.0), kept, has_supports=piece.is_loaded)
        except FlexMapsError:
            return []
        ideas, most = [CutPlan(one.cut, "merged under other limits") for one in merged], np.inf
    return [laid for idea in ideas if (laid := flatten_cuts(piece, idea, most)) is not None]


def _improve_best(search: LayoutSearch, first: FlatLayout, progress: Progress) -> bool:
    """Change the best layouts and judge the results; return whether another round is worthwhile."""
    before = search.key(search.ranking[0])
    ideas: list[CutPlan] = []
    share = 2 * max(1, round(search.left / (2 * ROUNDS)))  # an even number keeps two cores busy
    counted = search.params.goal == "panels"
    for base in search.ranking[:CHANGED_PER_ROUND]:
        holds = search.holds(base)
        more = base.laid.panels < search.params.panels if counted else not holds
        changes = islice(propose_changes(search.piece, base, fewer=holds != counted, more=more), share)
        if holds == counted:  # also try layouts with no more panels
            ideas += [
                one
                for both in zip_longest(make_variants(search.piece, base), changes)
                for one in both
                if one is not None
            ]
        else:
            ideas += changes
    ideas = ideas if counted else ideas[: CHANGED_PER_ROUND * share]
    batch = max(len(ideas), 1) if counted else share  # if the goal is a number of panels, flatten all and rank them
    sound: list[FlatLayout] = []
    for k in range(0, len(ideas), batch):
        if len(sound) < share:
            some = ideas[k : k + batch]
            flatten, part = partial(flatten_cuts, search.piece), progress.part(0.0, 0.2)
            made = search.together(flatten, some, part, search.progress_text)
            sound += [
                one
                for one in made
                if one is not None and _is_within_limits(one, *_limits(search, first)) and search.unknown(one)
            ]
    if counted:
        sound = _rank_by_geometry(search, sound)
    search.judge(sound[:share], progress.part(0.2, 1.0))
    return bool(sound) and (counted or search.key(search.ranking[0]) < before)


def _run_long_searches(search: LayoutSearch, progress: Progress) -> None:
    """Give the best layouts a long search; if none meets the required match, search those that may still meet it.

    With up to ``MAX_PARALLEL_QUADS`` quads ``LONG_SEARCHES`` layouts are searched at once, on any number of cores, so
    that the result is the same. With more quads they follow one another, as long as the next promises to be better.
    """
    together = LONG_SEARCHES if len(search.piece.mesh.quads) <= MAX_PARALLEL_QUADS else 1
    searched: list[FlatLayout] = []
    for turn in range(LONG_SEARCHES // together):
        tries = _long_search_candidates(search, together)
        begin, end = (0.6 * k * together / LONG_SEARCHES for k in (turn, turn + 1))
        search.prove(tries, progress.part(begin, end))
        searched += tries
        search.expect([search.proved[layout_key(one)] for one in searched if layout_key(one) in search.proved])
    if search.params.goal != "match" or any(search.holds(one) for one in search.proved.values()):
        return
    may_hold = [one.laid for one in search.ranking if one.share < LONG_SHARE and search.holds(one)]
    search.prove([*_second_search_candidates(search), *may_hold][:together], progress.part(0.6, 1.0))


def _long_search_candidates(search: LayoutSearch, most: int) -> list[FlatLayout]:
    """Return at most ``most`` layouts that had no long search but are expected to be better than all that had one.

    If the goal is a number of panels, return the best layouts without a long search.
    """
    found: Iterable[JudgedLayout] = search.ranking
    if search.params.goal != "panels":
        found = takewhile(lambda one: one.share < LONG_SHARE, found)
    return [one.laid for one in found if one.share < LONG_SHARE and may_replace_initial(search, one)][:most]


def _second_search_candidates(search: LayoutSearch) -> list[FlatLayout]:
    """Return the layout that came nearest in a long search, if a second one may make it the choice; else no layout."""
    nearest = min((o for o in search.proved.values() if o.share < FULL_SHARE), key=lambda o: o.eased, default=None)
    if nearest is None:
        return []
    whole = next((one.rms for one in search.proved.values() if one.share >= FULL_SHARE), 0.0)
    may_hold = nearest.eased <= SECOND_SEARCH_RATIO * search.params.match / 100.0
    return [nearest.laid] if may_hold or WORTHWHILE_RATIO * whole < nearest.eased <= SECOND_SEARCH_RATIO * whole else []


def _fill_gaps(search: LayoutSearch, progress: Progress) -> None:
    """Make and judge layouts in large gaps between the panel counts of proposals."""
    made = list(islice(_layouts_in_gaps(search), MAX_GAP_LAYOUTS))
    search.judge(made, progress, more=True)


def _layouts_in_gaps(search: LayoutSearch) -> Iterator[FlatLayout]:
    """Yield new layouts with panel counts between two on the Pareto front, by joining panels of the one with more."""
    for few, many in pairwise(pareto_front(search.ranking)):
        most = max(int(MAX_PANEL_STEP * few.laid.panels), few.laid.panels + 1)
        made = merge_across_seams(search.piece, many, most) if many.laid.panels > most else None
        if made is not None and made.panels > few.laid.panels and search.unknown(made):
            yield made

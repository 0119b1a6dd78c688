"""Merge patches greedily by removing cuts, run by run of edges (FlexMaps section 4)."""

from __future__ import annotations

import heapq
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...params import LayoutParams
from ...progress import SILENT, Progress
from ...surface.checking.finding import with_count
from ...surface.symmetry import Symmetry, preserved_by, subgroups, symmetric_closure, symmetries
from ...threads import one_thread
from ..flattening.flatten import FlatPatches, flatten
from ..flattening.flattening_report import forced_notes, symmetry_kept
from ..layout import PatchLayout, sublayout
from ..tracing.regions import RegionHalver
from ..tracing.trace import make_disks
from .board import BOTTLENECK, BoardCache, MergeBoard, SeamChange, WorkBudget
from .dissolve import dissolve_small
from .halve import cut_in_half, needs_no_halving
from .ranking import LayoutRanking, halve_long_patches, layout_cost
from .reroute import redraw_seams
from .straighten import natural_stops, straighten, widen_necks

# Number of quads times number of seams above which only the first strategy is tried, with a few symmetry groups in turn;
# larger values try more on large surfaces and take longer
MAX_SEAM_QUADS = 70_000
# Smallest budget, and budget per quad, in quads times solves, see ``WorkBudget``; more may remove more seams, in more time
MIN_WORK, WORK_PER_QUAD = 2e6, 2.5e3
MAX_STOPS = 12  # largest number of places where a removed part of a seam may begin or end; more fit better, slower
REPEAT_ROUNDS = 3  # largest number of times a merged layout is merged again; more may remove more seams, slower
# Largest number of symmetries of a surface with which first cuts that break a symmetry are completed by their images: 1
# is a mirror, 3 are two mirrors and a half turn. On a ring with hundreds, the images gave 60 panels instead of 4.
MAX_SYMMETRIES = 3
MAX_GROUPS = 5  # largest number of symmetry groups that are tried; more may give fewer panels, slower


@one_thread
def merge(
    layout: PatchLayout, params: LayoutParams, progress: Progress = SILENT, *, has_supports: bool = False
) -> FlatPatches:
    """Merge patches greedily within all limits; merges with little distortion and a long common seam come first.

    A symmetric layout stays symmetric unless that costs many patches; the ``layout.notes`` of the result tell how many
    of the surface's symmetries are kept, and what broke the other symmetries. Bodies are laid out separately.

    Parameters
    ----------
    layout : mesh and first cuts
    params : limits of the layout
    progress : called with the fraction done
    has_supports : whether something holds the piece in shape; if not, a curved surface becomes a single panel without a
        cut only if ``params.seamless`` is True
    """
    seamless = has_supports or params.seamless
    mesh, progress = layout.mesh, _monotonic(progress)
    bodies = mesh.body_count
    cut = layout.cut.copy()
    notes: dict[str, object] = dict(layout.notes)
    each: list[dict[str, object]] = []  # notes of every body, if there are several
    start = np.ones((len(mesh.quads), 4), dtype=complex)
    for body in range(bodies):
        part = progress.part(0.8 * body / bodies, 0.8 * (body + 1) / bodies)
        if bodies == 1:
            board, said = _merge_body(layout, params, part, 1, seamless)
            cut, start, notes = board.cut, board.rotations(), notes | said
        else:
            quads = np.flatnonzero(mesh.body_of == body)
            part_of, edges = sublayout(layout, quads)
            board, said = _merge_body(part_of, params, part, bodies, seamless)
            cut[edges], start[quads] = board.cut, board.rotations()
            each.append(said)
    if any(each):
        notes["bodies"] = each
    return _flatten_merged(PatchLayout(mesh, cut, notes), params, progress.part(0.8, 1.0), start)


def _monotonic(progress: Progress) -> Progress:
    """Return a progress whose reported fraction never decreases, although the number of rounds is not known beforehand."""
    report, highest = progress.report, 0.0
    if report is None:
        return progress

    def report_highest(fraction: float, text: str) -> None:
        nonlocal highest
        highest = max(highest, fraction)
        report(highest, text)

    return replace(progress, report=report_highest)


def _flatten_merged(layout: PatchLayout, params: LayoutParams, progress: Progress, start: np.ndarray) -> FlatPatches:
    """Halve patches that are too long, flatten, and add notes on limits that could not be kept."""
    layout = halve_long_patches(layout, params)
    flat = flatten(layout, params, progress, start=start)
    layout.notes.update(forced_notes(flat, params))
    return flat


def _merge_body(
    layout: PatchLayout, params: LayoutParams, progress: Progress, bodies: int, seamless: bool
) -> tuple[MergeBoard, dict[str, object]]:
    """Merge one of ``bodies`` bodies; return the board and notes on symmetry. ``seamless``: one uncut panel may result."""
    whole_group = symmetries(layout.mesh, progress=progress.part(0.0, 0.02)) if params.symmetric else []
    effort = work_budget(layout)
    tick = partial(progress, 0.0, "Flattening the first panels")
    shared, ranking = BoardCache(layout.mesh, params), LayoutRanking(whole_group)
    start = MergeBoard(layout, params, budget=effort, tick=tick, cache=shared)
    ranked = _try_strategies(start, layout.origin, whole_group, bodies, progress.part(0.02, 0.5))
    board = _best_board(ranked, ranking, progress.part(0.5, 0.55))
    kept = preserved_by(whole_group, layout.cut)
    if layout.origin and len(kept) < len(whole_group) <= MAX_SYMMETRIES:
        images = symmetric_closure(layout.cut, whole_group)
        disks = make_disks(PatchLayout(layout.mesh, images, origin=layout.origin))
        mirrored = MergeBoard(disks, params, budget=work_budget(layout), tick=tick, cache=shared)
        more = _try_strategies(mirrored, layout.origin, whole_group, bodies, progress.part(0.5, 0.55))
        more = [one for one in more if len(preserved_by(whole_group, one[2].cut)) > len(kept)] or more
        other = _best_board(more, ranking, progress.part(0.5, 0.55))
        if not ranking.is_better(board, other, progress):
            board, ranked, kept = other, more, whole_group
    if not layout.origin and not ranking.is_better(board, start, progress):
        board = start  # the layout was already merged
    if layout.origin and ranking.is_poor(board):
        parts = RegionHalver(layout.mesh, params).region_layout(np.arange(len(layout.mesh.quads)), progress)
        other = MergeBoard(parts, params, budget=effort, tick=tick, cache=shared)
        run_strategy(other, REGION_STRATEGY, progress.part(0.55, 0.75))
        other = _best_board([(0.0, 0, other)], ranking, progress.part(0.75, 0.8))
        if ranking.is_better(other, board, progress):
            board = other
    for turn in range(REPEAT_ROUNDS if len(board.pieces) > 1 and layout.origin else 0):
        # repeat merging until the layout no longer changes
        again = MergeBoard(PatchLayout(layout.mesh, board.cut), params, budget=effort, tick=tick, cache=shared)
        part = progress.part(0.8 + 0.05 * turn, 0.85 + 0.05 * turn)
        more = _try_strategies(again, "", whole_group, bodies, part)
        if (more[0][2].cut == board.cut).all():
            break
        again = _best_board(more, ranking, part)
        if effort.is_spent or not ranking.is_better(again, board, progress):
            break
        board = again
    if seamless or needs_no_halving(board):
        return board, symmetry_notes(whole_group, kept, ranked, board)
    board = cut_in_half(board, whole_group, progress.part(0.95, 1.0))
    said: dict[str, object] = {"halved": HALVED_NOTE}
    if whole_group:
        rest = preserved_by(whole_group, board.cut)
        counts, text = symmetry_kept(whole_group, rest)
        broken = "; the seam that drives the panel broke the others" if len(rest) < len(whole_group) else ""
        said |= counts | {"symmetry": text + broken}
    return board, said


def work_budget(layout: PatchLayout) -> WorkBudget:
    """Return the work budget of a merging strategy."""
    return WorkBudget(MIN_WORK + WORK_PER_QUAD * len(layout.mesh.quads))


def _try_strategies(
    start: MergeBoard, origin: str, whole_group: list[Symmetry], bodies: int, progress: Progress
) -> list[tuple[float, int, MergeBoard]]:
    """Merge the layout of ``start`` by several strategies; return cost (``layout_cost``), number and board of each result."""
    layout = start.layout
    kept = preserved_by(whole_group, layout.cut)
    if not origin:
        board = start.copy()
        board.symmetries = kept
        run_strategy(board, REPEAT_STRATEGY, progress.part(0.0, 0.5))
        if (board.cut == start.cut).all():
            return [(round(layout_cost(board), 9), 0, board)]  # the layout was already merged
    dear = len(layout.seam_edges) * len(layout.mesh.quads) > MAX_SEAM_QUADS
    most = 0 if dear else max(MAX_GROUPS // bodies, 3)
    groups = [*_useful_groups(subgroups(kept, 60), most), []] if kept else [[]]
    ranked: list[tuple[float, int, MergeBoard]] = []
    strategies = STRATEGIES if not dear and len(start.pieces) > 1 else STRATEGIES[:1]
    for strategy in [replace(w, redraws_seams=origin == "regions") for w in strategies]:
        for group in groups:
            # on large surfaces, continue from the previous result, which keeps a larger symmetry group
            again = bool(ranked) and dear
            board = (ranked[-1][2] if again else start).copy()
            board.symmetries, board.bottleneck = group, strategy.bottleneck
            run_strategy(
                board, REPEAT_STRATEGY if again else strategy, progress.part(len(ranked) / 16, (len(ranked) + 1) / 16)
            )
            ranked.append((round(layout_cost(board), 9), len(ranked), board))
    return ranked


def _best_board(ranked: list[tuple[float, int, MergeBoard]], ranking: LayoutRanking, progress: Progress) -> MergeBoard:
    """Return the best merged layout whose seams can be made equally long, merged further if that is possible.

    Earlier merging used only ``MERGING_SHARE`` of the distortion limit; here patches may use the whole limit.

    ranked : cost, number and board of every result
    """
    ordered = [r[2] for r in sorted(ranked, key=lambda r: r[:2])[:4]]
    board = next((b for b in ordered if ranking.can_match_seams(b, progress)), ordered[0])
    tighter = board.copy()
    tighter.distortion_share = 1.0
    run_strategy(tighter, REPEAT_STRATEGY, progress)
    return tighter if len(tighter.pieces) < len(board.pieces) and ranking.can_match_seams(tighter, progress) else board


def _useful_groups(groups: list[list[Symmetry]], most: int) -> list[list[Symmetry]]:
    """Return the largest symmetry group, then single mirrors and half turns, then groups of four.

    groups : symmetry groups, the largest first, without the identity
    most : largest number of returned groups; 0: one group of each kind, ever smaller
    """
    twos, fours = [g for g in groups[1:] if len(g) == 1], [g for g in groups[1:] if len(g) == 3]
    if not most:  # each strategy then starts from the result of the previous, larger group
        return groups[:1] + fours[:1] + twos[:1]
    rest = [g for g in groups[1:] if len(g) in (1, 3)]
    return (groups[:1] + sorted(rest, key=len))[:most]


HALVED_NOTE = (
    "In one panel the surface would lie flat and stay flat; the seam makes it rise into its shape. "
    'To keep it whole, hold it with supports (Rests, in Piece), or choose "One panel without a cut"'
)


@dataclass(frozen=True)
class MergeStrategy:
    """A merging strategy.

    seam_weight : weight of a seam's share of the outline in the order of merges; larger removes long seams first
    bottleneck : largest allowed bottleneck, see ``PatchMeasures``
    by_parts : remove seams only from one irregular vertex to the next, and cuts inside patches last; this saves distortion
    redraws_seams : redraw whole seams, for layouts whose seams do not follow lines of edges
    is_repeat : for layouts that were already merged: stop if neither a seam nor a part of a seam can be removed
    """

    seam_weight: float = 3.0
    bottleneck: float = BOTTLENECK
    by_parts: bool = False
    redraws_seams: bool = False
    is_repeat: bool = False


# strategies: all are tried on small surfaces, only the first on large surfaces
STRATEGIES = (MergeStrategy(), MergeStrategy(bottleneck=2 * BOTTLENECK, by_parts=True))

REGION_STRATEGY = MergeStrategy(redraws_seams=True)  # for layouts of regions, whose seams do not follow lines of edges
REPEAT_STRATEGY = MergeStrategy(is_repeat=True)  # for layouts that were merged before


def run_strategy(board: MergeBoard, strategy: MergeStrategy, progress: Progress) -> None:
    """Merge patches and straighten seams of a board alternately, in place, until nothing changes."""
    board.tick = lambda: progress(0.0, f"Merging: {with_count(len(board.pieces), 'panel', 'panels')}")
    merged = merge_seams(board, strategy, progress.part(0.0, 0.5))
    if strategy.is_repeat:
        merged |= open_parts(board, strategy, progress.part(0.5, 0.6))
        if not merged:
            return
    _straighten_and_merge(board, strategy, progress.part(0.6, 0.9))
    widen_necks(board)
    if dissolve_small(board):
        # the remaining patches have new neighbours
        merge_seams(board, strategy, progress.part(0.9, 0.95))
        _straighten_and_merge(board, strategy, progress.part(0.95, 1.0))


def _straighten_and_merge(board: MergeBoard, strategy: MergeStrategy, progress: Progress) -> None:
    """Straighten, redraw and partly remove seams, and merge after each round, until nothing changes."""
    for turn in range(4):
        part = progress.part(turn / 4, (turn + 1) / 4)
        changed = straighten(board, part, darts=not strategy.by_parts or turn == 3)
        changed |= strategy.redraws_seams and redraw_seams(board)
        changed |= open_parts(board, strategy, part)
        if not changed:
            break
        merge_seams(board, strategy, part)
    straighten(board, progress, darts=True)


def open_parts(board: MergeBoard, strategy: MergeStrategy, progress: Progress) -> bool:
    """Remove a part of a seam, then all whole seams that can go, and repeat; return whether anything changed."""
    changed = False
    while open_best_part(board, strategy, progress):
        changed = True
        merge_seams(board, strategy, progress)
    return changed


def symmetry_notes(
    whole_group: list[Symmetry], kept: list[Symmetry], ranked: list[tuple[float, int, MergeBoard]], board: MergeBoard
) -> dict[str, object]:
    """Return notes for the report about symmetry.

    Parameters
    ----------
    whole_group : symmetries of the surface
    kept : symmetries of the first cuts
    ranked : results of all strategies, the result with the largest symmetry group first
    board : the chosen result
    """
    if not whole_group:
        return {}
    rest = preserved_by(whole_group, board.cut)
    said, text = symmetry_kept(whole_group, rest)
    if len(kept) < len(whole_group):
        text += "; the first cuts chose one of several equal parametric lines"
    if len(rest) < len(kept):
        largest = ranked[0][2]
        more, now = len(largest.pieces), len(board.pieces)
        if more != now:
            text += f"; with {1 + len(largest.symmetries)} of them there would be {more} panels instead of {now}"
    return said | {"symmetry": text}


def merge_seams(board: MergeBoard, strategy: MergeStrategy, progress: Progress) -> bool:
    """Remove whole seams, the best first, until no more can be removed; return whether any seam was removed."""
    mesh = board.mesh
    tried: dict[tuple[int, ...], SeamChange | None] = {}
    heap: list[tuple[float, tuple[int, ...], bool]] = []
    first = len(board.pieces)
    changed = False
    while True:
        current: dict[tuple[int, ...], np.ndarray] = {}
        layout = board.layout
        for edges in layout.short_seam_edges if strategy.by_parts else layout.seam_edges:
            a, b = sorted(board.pieces_at(edges[:1])[0].tolist())
            key: tuple[int, ...] = (a, b, int(edges.min()), len(edges))
            if a == b and (strategy.by_parts or (layout.cut_degree[mesh.edges[edges]] > 1).all()):
                continue  # removing a cut inside a patch that has no free end would make the patch a ring
            if not board.is_first_image(edges):
                continue
            current[key] = edges
            if key not in tried:
                tried[key] = None
                heapq.heappush(heap, (_seam_rank(board, edges, 0.0, strategy), key, False))
        while heap:
            _, key, known = heapq.heappop(heap)
            if key not in current:
                continue
            if known:
                break
            change = tried[key] = board.attempt(current[key])
            if change is not None:
                worst = max(p.flat.max_energy for p in change.pieces)
                heapq.heappush(heap, (_seam_rank(board, current[key], worst, strategy), key, True))
        else:
            return changed
        best = tried[key]
        assert best is not None
        changed |= board.apply(best)
        progress(1.0 - len(board.pieces) / first, f"Merging: {with_count(len(board.pieces), 'panel', 'panels')}")


def _seam_rank(board: MergeBoard, edges: np.ndarray, worst: float, strategy: MergeStrategy) -> float:
    """Return the rank of removing a seam, smaller is better: distortion less the weighted share of outline removed.

    worst : largest distortion E after the removal; 0 before that has been tested
    """
    sides = [board.pieces[n] for n in set(board.pieces_at(edges[:1])[0].tolist())]
    shared = float(board.mesh.edge_lengths[edges].sum())
    worst = max(worst, *(p.flat.max_energy for p in sides))
    return worst / board.params.distortion_limit - strategy.seam_weight * shared / min(
        p.measures.perimeter for p in sides
    )


def open_best_part(board: MergeBoard, strategy: MergeStrategy, progress: Progress) -> bool:
    """Remove the best part of a seam that cannot be removed as a whole; return whether there was such a part.

    The rest of the seam stays as a cut inside the patch.
    """
    best: tuple[float, int, SeamChange] | None = None
    for number, edges in enumerate(board.layout.seams):
        a, b = board.pieces_at(edges[:1])[0].tolist()
        if a == b or not board.is_first_image(edges):
            continue
        change = longest_part(board, edges)
        if change is not None:
            worst = max(p.flat.max_energy for p in change.pieces)
            score = _seam_rank(board, change.joins, worst, strategy)
            if best is None or (score, number) < best[:2]:
                best = (score, number, change)
    progress(0.5, f"Merging: {with_count(len(board.pieces), 'panel', 'panels')}")
    return best is not None and board.apply(best[2])


def longest_part(board: MergeBoard, edges: np.ndarray) -> SeamChange | None:
    """Return the change that removes the longest possible part of a seam between two ``natural_stops``, or None."""
    few = min(len(board.pieces[n].quads) for n in board.pieces_at(edges[:1])[0]) < 2 * board.params.patch_min
    stops = list(range(len(edges) + 1)) if few and len(edges) <= 10 else natural_stops(board, edges)
    # limit the number of stops, because a seam without straight parts has one at every vertex
    stops = stops[:: -(-len(stops) // MAX_STOPS)] + ([] if len(stops) <= MAX_STOPS else stops[-1:])
    lengths = np.concatenate([[0.0], np.cumsum(board.mesh.edge_lengths[edges])])
    spans = [(lengths[j] - lengths[i], i, j) for n, i in enumerate(stops) for j in stops[n + 1 :]]
    for length, i, j in sorted(spans, key=lambda s: (-round(s[0], 9), s[1])):
        if j - i < board.params.neck_min or length < 0.3 * lengths[-1]:
            continue
        change = board.attempt(np.sort(edges[i:j]))
        if change is not None:
            return change
    return None

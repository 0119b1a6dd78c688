"""Fewer patches: greedy merging by opening runs of cut edges (FlexMaps section 4)."""

from __future__ import annotations

import heapq
from dataclasses import replace

import numpy as np

from .board import Board, Change
from .flatten import FlatPatches, flatten
from .layout import PatchLayout
from .params import LayoutParams
from .progress import SILENT, Progress
from .symmetry import Symmetry, keeping, subgroups, symmetries
from .tidy import natural_stops, tidy

WORK = 60_000  # quads times seams: below this every symmetry is tried, one after the other
SHARED = 3.0  # how much a long common seam counts against distortion


def merge(layout: PatchLayout, params: LayoutParams, progress: Progress = SILENT) -> FlatPatches:
    """Merge patches greedily while every limit holds; the least distorting merge with the longest seam comes first.

    A symmetric layout stays symmetric as far as that does not cost many patches; ``layout.notes`` of the result say
    which symmetries the surface has, which were kept, and what broke the others.
    """
    progress(0.0, "Looking for symmetries")
    found = symmetries(layout.mesh) if params.symmetric else []
    kept = keeping(found, layout.cut)
    start = Board(layout, params)
    work = len(layout.seam_edges) * len(layout.mesh.quads)
    tries = int(np.clip(WORK // max(work, 1), 2, 16))
    ranked: list[tuple[float, int, Board]] = []
    wanted = [*subgroups(kept)[:tries], []] if kept else [[]]
    for number, group in enumerate(wanted):
        # where trying is dear, go on from what the largest group has left
        board = (ranked[0][2] if ranked and tries == 2 else start).copy()
        board.symmetries = group
        run(board, progress.part(0.8 * number / len(wanted), 0.8 * (number + 1) / len(wanted)))
        ranked.append((round(worth(board), 9), number, board))
    board = min(ranked, key=lambda r: r[:2])[2]
    result = replace(board.layout, notes=layout.notes | symmetry_notes(found, kept, ranked, board))
    return flatten(result, params, progress.part(0.8, 1.0))


def run(board: Board, progress: Progress) -> None:
    """Merge and straighten in turns until neither changes anything."""
    greedy(board, progress.part(0.0, 0.5))
    for turn in range(3):
        part = progress.part(0.5 + turn / 6, 0.5 + (turn + 1) / 6)
        changed = tidy(board, part)
        while partial(board, part):
            changed = True
            greedy(board, part)
        if not changed:
            break
        greedy(board, part)


def worth(board: Board) -> float:
    """Patches, less what symmetry is worth: a mirror makes up for an eighth of them; then the length of the cuts."""
    share = 1.0 - 0.125 * min(np.log2(1 + len(board.symmetries)), 4.0)
    return len(board.pieces) * share + 1e-4 * float(board.cut.sum())


def symmetry_notes(
    found: list[Symmetry], kept: list[Symmetry], ranked: list[tuple[float, int, Board]], board: Board
) -> dict[str, object]:
    """What the report says about symmetry, in words."""
    if not found:
        return {}
    rest = keeping(found, board.cut)
    names = sorted({s.name for s in rest})
    said = {"symmetries": 1 + len(found), "symmetries_kept": 1 + len(rest)}
    text = f"The layout keeps {1 + len(rest)} of {1 + len(found)} symmetries"
    text += f" ({', '.join(names[:6])}{', ...' if len(names) > 6 else ''})" if names else ""
    if len(kept) < len(found):
        text += "; the first cuts chose one of several equal parametric lines"
    if len(rest) < len(kept):
        largest = ranked[0][2]
        more = len(largest.pieces)
        text += (
            f"; with {1 + len(largest.symmetries)} of them there would be {more} patches instead of {len(board.pieces)}"
        )
    return said | {"symmetry": text}


def greedy(board: Board, progress: Progress) -> bool:
    """Open whole seams, best first, until no seam can be opened."""
    mesh = board.mesh
    tried: dict[tuple[int, ...], Change | None] = {}
    heap: list[tuple[float, tuple[int, ...], bool]] = []
    first = len(board.pieces)
    changed = False
    while True:
        current: dict[tuple[int, ...], np.ndarray] = {}
        layout = board.layout
        for edges in layout.seam_edges:
            a, b = sorted(board.sides_of(edges[:1])[0].tolist())
            key = (a, b, int(edges.min()), len(edges))
            if a == b and (layout.cut_degree[mesh.edges[edges]] > 1).all():
                continue  # an inner cut without a free end: without it the patch would be a ring
            current[key] = edges
            if key not in tried:
                tried[key] = None
                heapq.heappush(heap, (_score(board, edges, 0.0), key, False))
        while heap:
            score, key, known = heapq.heappop(heap)
            if key not in current:
                continue
            if known:
                break
            change = tried[key] = board.attempt(current[key])
            if change is not None:
                worst = max(p.flat.worst for p in change.pieces)
                heapq.heappush(heap, (_score(board, current[key], worst), key, True))
        else:
            return changed
        found = tried[key]
        assert found is not None
        changed |= board.apply(found)
        progress(1.0 - len(board.pieces) / first, f"Merging: {len(board.pieces)} patches")


def _score(board: Board, edges: np.ndarray, worst: float) -> float:
    """Priority of opening a seam, the smallest first: distortion against the share of the outline that goes."""
    sides = [board.pieces[n] for n in set(board.sides_of(edges[:1])[0].tolist())]
    shared = float(board.mesh.edge_lengths[edges].sum())
    worst = max(worst, max(p.flat.worst for p in sides))
    return worst / board.params.distortion_limit - SHARED * shared / min(p.sketch.perimeter for p in sides)


def partial(board: Board, progress: Progress) -> bool:
    """Open the best part of a seam between two patches that cannot be opened as a whole; the rest stays as a dart."""
    best: tuple[float, int, Change] | None = None
    for number, edges in enumerate(board.layout.seams):
        a, b = board.sides_of(edges[:1])[0].tolist()
        if a == b:
            continue
        change = longest_part(board, edges)
        if change is not None:
            worst = max(p.flat.worst for p in change.pieces)
            score = _score(board, change.opens, worst)
            if best is None or (score, number) < best[:2]:
                best = (score, number, change)
    progress(0.5, f"Merging: {len(board.pieces)} patches")
    return best is not None and board.apply(best[2])


def longest_part(board: Board, edges: np.ndarray) -> Change | None:
    """The longest part of a seam, between two natural stops, that can be opened."""
    stops = natural_stops(board, edges)
    lengths = np.concatenate([[0.0], np.cumsum(board.mesh.edge_lengths[edges])])
    spans = [(lengths[j] - lengths[i], i, j) for n, i in enumerate(stops) for j in stops[n + 1 :]]
    for length, i, j in sorted(spans, key=lambda s: (-round(s[0], 9), s[1])):
        if j - i < board.params.neck_min or length < 0.3 * lengths[-1]:
            continue
        change = board.attempt(np.sort(edges[i:j]))
        if change is not None:
            return change
    return None

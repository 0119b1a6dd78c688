"""Last resort of merging: dissolve a patch that is too small into its neighbours, even if that breaks another limit.

A patch below the smallest size is worse than a narrow neck. It may join a neighbour, be divided among several
neighbours, or keep part of a seam as a cut inside the joined patch, as long as the total penalty (``fault_cost``) falls.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ...arrays import Int
from ...params import LayoutParams
from ...progress import SILENT, Progress
from ...surface.symmetry import Symmetry, preserved_by
from ..layout import PatchLayout
from .board import NO_EDGES, MergeBoard, SeamChange, WorkBudget
from .sketch import FlatPiece
from .straighten import fault_cost, widen_necks

# budget of work per quad, in quads times solves, see ``WorkBudget``; larger values dissolve more and take longer
WORK_PER_QUAD = 500.0


def join_small_panels(
    layout: PatchLayout, params: LayoutParams, symmetries: Sequence[Symmetry] = (), progress: Progress = SILENT
) -> PatchLayout:
    """Join panels below the smallest size to neighbours, and widen necks, where the limits allow it.

    Parameters
    ----------
    layout : layout whose patches can be laid flat
    params : limits of the layout
    symmetries : symmetries of the mesh; the result keeps the symmetries that the layout has
    progress : called with the fraction done

    Returns
    -------
    the new layout, or ``layout`` itself if nothing changed
    """
    small = min(len(quads) for quads in layout.patches) < params.patch_min
    if len(layout.patches) < 2 or not (small or (layout.isthmus_widths(own=False) < params.neck_min).any()):
        return layout
    board = limited_board(layout, params, symmetries, progress)
    changed = widen_necks(board)
    changed |= dissolve_small(board)
    return PatchLayout(layout.mesh, board.cut, dict(layout.notes)) if changed else layout


def limited_board(
    layout: PatchLayout, params: LayoutParams, symmetries: Sequence[Symmetry] = (), progress: Progress = SILENT
) -> MergeBoard:
    """Return a board with a limited budget of work, on which patches may use the whole distortion limit.

    Parameters
    ----------
    layout : mesh and cuts
    params : limits of the layout
    symmetries : symmetries of the mesh; the board keeps the symmetries that the layout has
    progress : called at every attempt
    """
    effort = WorkBudget(WORK_PER_QUAD * len(layout.mesh.quads))
    board = MergeBoard(layout, params, preserved_by(symmetries, layout.cut), effort, tick=lambda: progress(0.0))
    board.distortion_share = 1.0
    return board


def dissolve_small(board: MergeBoard) -> bool:
    """Dissolve patches that are too small, the smallest first; return whether any patch was dissolved."""
    changed = False
    board.is_lenient = True
    refused: set[tuple[int, ...]] = set()
    while not board.budget.is_spent:
        small = [p for p in board.pieces.values() if len(p.quads) < board.params.patch_min]
        for piece in sorted(small, key=lambda p: (len(p.quads), p.serial)):
            key = (piece.serial, *np.unique(_pieces_across(board, piece)).tolist())
            if key in refused:
                continue
            best = _best_change(board, piece)
            if best is not None and board.apply(best):
                changed = True
                break
            refused.add(key)
        else:
            break
    board.is_lenient = False
    return changed


def _pieces_across(board: MergeBoard, piece: FlatPiece) -> Int[np.ndarray, "quads 4"]:
    """Return the serial of the piece across every side of a piece's quads; -1 inside the piece and at the border."""
    mesh = board.mesh
    other = np.where(mesh.neighbours[piece.quads] < 0, -1, board.piece_of[mesh.neighbours[piece.quads]])
    return np.where(other == piece.serial, -1, other)


def _best_change(board: MergeBoard, piece: FlatPiece) -> SeamChange | None:
    """Return the change that dissolves a piece and lowers ``fault_cost`` most; None if no change lowers it."""
    found: list[tuple[float, int, SeamChange]] = []
    for opens, closes in _candidate_changes(board, piece):
        change = board.attempt(opens, closes)
        if change is None:
            continue
        old = np.unique(board.pieces_at(np.concatenate([change.joins, change.cuts]))).tolist()
        gain = fault_cost(board, [board.pieces[n] for n in old]) - fault_cost(board, change.pieces)
        if gain > 0:
            found.append((-round(gain, 6), len(found), change))
    return min(found, key=lambda f: f[:2])[2] if found else None


def _candidate_changes(board: MergeBoard, piece: FlatPiece) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield the changes that might dissolve a piece, as edges to join and edges to cut.

    A change removes all seams with a neighbour, one of several seams with a neighbour, or an edge of a single seam, or
    it divides the piece's quads among the neighbours.
    """
    mesh, around = board.mesh, _pieces_across(board, piece)
    edges = mesh.quad_edges[piece.quads]
    others = np.unique(around[around >= 0]).tolist()
    layout = board.layout
    for name in others:
        shared = np.unique(edges[around == name])
        yield shared, NO_EDGES
        runs = [shared[layout.seam_of[shared] == n] for n in np.unique(layout.seam_of[shared])]
        if len(runs) > 1:
            yield from ((run, NO_EDGES) for run in runs)
        elif len(shared) > 1:
            yield from ((shared[i : i + 1], NO_EDGES) for i in range(len(shared)))
    if len(others) > 1 and len(piece.quads) > 1:
        yield from _divide_among_neighbours(board, piece, around)


def _divide_among_neighbours(
    board: MergeBoard, piece: FlatPiece, around: np.ndarray
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield a change that divides a piece: every quad joins the piece with most common sides, from the outside inwards.

    around : serial of the piece across every side of the piece's quads, see ``_pieces_across``
    """
    mesh = board.mesh
    owner = dict.fromkeys(piece.quads.tolist(), -1)
    sides = dict(zip(owner, around.tolist(), strict=True))
    neighbours = dict(zip(owner, mesh.neighbours[piece.quads].tolist(), strict=True))
    while any(v < 0 for v in owner.values()):
        votes = {}
        for q in [q for q, v in owner.items() if v < 0]:
            near = [n for n in sides[q] if n >= 0] + [owner[n] for n in neighbours[q] if owner.get(n, -1) >= 0]
            if near:
                votes[q] = max(sorted(set(near)), key=near.count)
        if not votes:
            return
        owner.update(votes)
    after = board.piece_of.copy()
    after[list(owner)] = list(owner.values())
    edges = np.unique(mesh.quad_edges[piece.quads])
    edges = edges[~mesh.border[edges]]
    one, two = mesh.edge_quads[edges].T
    same = after[one] == after[two]
    opens, closes = edges[board.cut[edges] & same], edges[~board.cut[edges] & ~same]
    if len(opens):
        yield opens, closes

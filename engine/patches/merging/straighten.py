"""Straighten outlines as a person would draw them: seams along lines of edges, few corners, no notches.

Straight parts of seams slide sideways by rows of quads, and cuts inside patches are joined, where that makes the cuts
shorter or removes corners within all limits.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from ...arrays import Int
from ...progress import Progress
from ...surface.corner_costs import corner_cost, edge_rings
from ..layout import PatchLayout
from .board import BOTTLENECK, NO_EDGES, MergeBoard
from .sketch import FlatPiece

# Smallest gain (see ``gain_of``) for which a seam is changed, in median edge lengths; larger values change less
MIN_GAIN = 0.3
MAX_ROWS = 8  # largest number of rows of quads by which a seam slides at once; more take longer


@dataclass(frozen=True, eq=False)
class SeamSlide:
    """Sideways move of a straight part of a seam by one or more rows of quads.

    quads : quads in these rows, which change to the patch on the other side of the seam
    hosts : for each of ``quads``, a quad of the patch to which it changes
    """

    quads: Int[np.ndarray, " quads"]
    hosts: Int[np.ndarray, " quads"]


def straighten(board: MergeBoard, progress: Progress, *, darts: bool, sweeps: int = 8) -> bool:
    """Slide seams as long as that improves the layout; return whether anything changed.

    Parameters
    ----------
    board : the layout; changed in place
    progress : called with the fraction done
    darts : also join cuts inside patches, from their free ends
    sweeps : largest number of sweeps over all seams
    """
    changed = False
    for sweep in range(sweeps):
        progress(sweep / sweeps, "Straightening seams")
        again = _join_dead_ends(board) if darts else False
        again |= _slide_all(board)
        changed |= again
        if not again:
            break
    return changed


def _slide_all(board: MergeBoard) -> bool:
    """Try once to slide each straight part of each seam sideways, in order of decreasing gain (see ``gain_of``).

    Slides that gain more than ``MIN_GAIN`` and break no limit are kept. Return whether the layout changed.

    board : the layout; changed in place
    """
    listed: list[tuple[float, int, SeamSlide]] = []
    for slide in candidate_slides(board, fresh=True):
        flipped = edges_changed_by(board, slide)
        gain = gain_of(board, *flipped) if flipped is not None else 0.0
        if gain > MIN_GAIN:
            listed.append((-round(gain, 6), len(listed), slide))
    changed = False
    for _, _, slide in sorted(listed, key=lambda item: item[:2]):
        flipped = edges_changed_by(board, slide)
        if flipped is None or gain_of(board, *flipped) <= MIN_GAIN:
            continue
        changed |= try_change(board, *flipped)
    return changed


def try_change(board: MergeBoard, opens: Int[np.ndarray, " opened"], closes: Int[np.ndarray, " closed"]) -> bool:
    """Make a change if all limits allow it; return whether it was made. Refused changes are not tested again.

    Parameters
    ----------
    board : the layout; changed in place
    opens : cut edges to join
    closes : uncut edges to cut
    """
    names = np.unique(board.pieces_at(np.concatenate([opens, closes])))
    key = (opens.tobytes(), closes.tobytes(), names.tobytes())
    if key in board.refused_changes:
        return False
    change = board.attempt(opens, closes)
    if change is not None and board.apply(change):
        return True
    board.refused_changes.add(key)
    return False


def gain_of(board: MergeBoard, opens: Int[np.ndarray, " opened"], closes: Int[np.ndarray, " closed"]) -> float:
    """Return the gain of a change: decrease of the cuts' length, in median edge lengths, plus decrease of corner costs.

    Parameters
    ----------
    board : the layout
    opens : cut edges to join
    closes : uncut edges to cut
    """
    mesh = board.mesh
    ring = edge_rings(mesh)
    vertices = set(mesh.edges[opens].ravel().tolist())
    vertices.update(mesh.edges[closes].ravel().tolist())
    cut = board.cut_or_border
    before = sum([corner_cost(ring[v], cut) for v in vertices])
    cut.difference_update(opens.tolist())
    cut.update(closes.tolist())
    after = sum([corner_cost(ring[v], cut) for v in vertices])
    cut.update(opens.tolist())
    cut.difference_update(closes.tolist())
    length = (mesh.edge_lengths[opens].sum() - mesh.edge_lengths[closes].sum()) / mesh.median_edge
    return float(length) + before - after


def widen_necks(board: MergeBoard) -> bool:
    """Widen too narrow isthmuses and enlarge too small patches by slides, even if seams become longer.

    Return whether anything changed.
    """
    changed = False
    for _ in range(10):
        poor = {n for n, p in board.pieces.items() if p.measures.isthmuses or len(p.quads) < board.params.patch_min}
        if not poor or not _widen_neck(board, poor):
            break
        changed = True
    return changed


def _widen_neck(board: MergeBoard, poor: set[int]) -> bool:
    """Make the slide with the best gain among those that reduce ``_limit_shortfall``; return whether there was one.

    poor : serials of the pieces with faults; only slides that change one of these are tried
    """
    listed: list[tuple[float, int, tuple[np.ndarray, np.ndarray]]] = []
    for slide in candidate_slides(board):
        if not poor & set(board.piece_of[np.concatenate([slide.quads, slide.hosts])].tolist()):
            continue
        flipped = edges_changed_by(board, slide)
        if flipped is not None:
            listed.append((-round(gain_of(board, *flipped), 6), len(listed), flipped))
    for _, _, (opens, closes) in sorted(listed, key=lambda item: item[:2])[:60]:
        names = set(board.pieces_at(np.concatenate([opens, closes])).ravel().tolist())
        before = _limit_shortfall(board, [board.pieces[n] for n in names])
        change = board.attempt(opens, closes)
        if change is not None and _limit_shortfall(board, change.pieces) < before and board.apply(change):
            return True
    return False


def _limit_shortfall(board: MergeBoard, pieces: list[FlatPiece]) -> int:
    """Return the number of too narrow isthmuses of pieces plus the number of quads that pieces lack to the smallest size."""
    return sum(p.measures.isthmuses + max(board.params.patch_min - len(p.quads), 0) for p in pieces)


def fault_cost(board: MergeBoard, pieces: Iterable[FlatPiece]) -> float:
    """Return the number of ``pieces`` plus penalties for too small pieces, narrow necks and bottlenecks.

    A penalty of 1 counts as much as another piece.
    """
    params = board.params
    total = 0.0
    for p in pieces:
        total += 1.0 + 0.5 * (p.measures.isthmuses + (len(p.quads) < params.patch_min))
        total += 0.1 * max(p.measures.bottleneck - BOTTLENECK, 0.0)
    return total


def seam_cost(board: MergeBoard) -> float:
    """Return the length of all cuts, in median edge lengths, plus the costs of their corners (see ``corner_costs``)."""
    ring = edge_rings(board.mesh)
    touched = np.unique(board.mesh.edges[board.cut]).tolist()
    length = float(board.mesh.edge_lengths[board.cut].sum() / board.mesh.median_edge)
    return length + sum(corner_cost(ring[v], board.cut_or_border) for v in touched)


def edges_changed_by(board: MergeBoard, slide: SeamSlide) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the cut edges that a slide joins and the uncut edges that it cuts; None if it joins no edges."""
    mesh, owner = board.mesh, board.piece_of
    old = owner[slide.quads]
    new = owner[slide.hosts]
    stays = old == new
    if stays.any() and not (stays.all() and (old == old[0]).all()):
        return None
    touched = np.zeros(len(mesh.edges), dtype=bool)
    touched[mesh.quad_edges[slide.quads]] = True
    edges = np.flatnonzero(touched & ~mesh.border)
    cut, (one, two) = board.cut[edges], mesh.edge_quads[edges].T
    after = owner.copy()
    if stays.any():
        # at a cut inside a patch, the quads move from one side of the cut to the other side
        after[slide.quads] = 0  # no piece has this serial number
        flip = (after[one] == 0) != (after[two] == 0)
        flip &= (owner[one] == old[0]) & (owner[two] == old[0])
        opens, closes = edges[flip & cut], edges[flip & ~cut]
    else:
        after[slide.quads] = new
        same = after[one] == after[two]
        opens, closes = edges[cut & same & (owner[one] != owner[two])], edges[~cut & ~same]
    return (opens, closes) if len(opens) else None


def candidate_slides(board: MergeBoard, *, fresh: bool = False) -> Iterator[SeamSlide]:
    """Yield every slide of a straight part of a seam, to both sides, by one or more rows of quads.

    fresh : skip seams that were examined before, unless the patches beside them have changed since
    """
    mesh = board.mesh
    border = mesh.border
    for vertices, edges, stops in straight_cut_runs(board.layout):
        if not board.is_first_image(edges):
            continue
        if fresh:
            around = frozenset(board.pieces_at(np.array(edges)).ravel().tolist())
            key = (edges[0], edges[-1], tuple(stops), around)
            if key in board.tried_slides:
                continue
            board.tried_slides.add(key)
        forward = np.array(vertices[:-1]) < np.array(vertices[1:])
        line = np.array(edges)
        for side in (0, 1):
            column = np.where(forward, side, 1 - side)
            row, at = mesh.edge_quads[line, column], mesh.edge_sides[line, column]
            hosts = mesh.edge_quads[line, 1 - column]
            for i, begin in enumerate(stops[:-1]):
                for end in stops[i + 1 : i + 4]:
                    part = slice(begin, end)
                    yield from _row_slides(board, border, row[part], at[part], hosts[part])


def _row_slides(
    board: MergeBoard, border: np.ndarray, row: np.ndarray, at: np.ndarray, hosts: np.ndarray
) -> Iterator[SeamSlide]:
    """Yield the slide of a seam by a row of quads, then by two rows, and so on.

    row, at : quads along the seam that change their patch, and their sides on the seam
    hosts : quads on the other side of the seam
    """
    mesh, owner = board.mesh, board.piece_of
    taken = np.zeros(0, dtype=np.int64)
    givers = set(owner[row].tolist())
    if len(givers) > 2:
        return
    for depth in range(1, MAX_ROWS + 1):
        if not set(owner[row].tolist()) <= givers:
            return
        taken = np.concatenate([taken, row])
        unique, first = np.unique(taken, return_index=True)
        if len(unique) < len(taken):
            return
        yield SeamSlide(unique, np.tile(hosts, depth)[first])
        far = mesh.quad_edges[row, (at + 2) % 4]
        if border[far].any():
            return
        row, at = mesh.neighbours[row, (at + 2) % 4], _side_across(mesh.edge_quads, mesh.edge_sides, far, row)


def _side_across(edge_quads: np.ndarray, edge_sides: np.ndarray, edges: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """Return for every edge the side number, in the quad across it, of this edge; ``quads`` are on the near side."""
    column = (edge_quads[edges, 0] == quads).astype(np.int64)
    return edge_sides[edges, column]


def straight_cut_runs(layout: PatchLayout) -> list[tuple[list[int], list[int], list[int]]]:
    """Return every longest straight run of cut edges: its vertices, its edges, and stops.

    Stops are positions in the list of vertices where the run ends or meets another cut.
    """
    mesh = layout.mesh
    cut, ring = layout.cut, edge_rings(mesh)
    degree = layout.cut_degree
    seen: set[int] = set()
    result = []
    ends = mesh.edges.tolist()

    def onward(edge: int, vertex: int) -> int:
        """Return the cut edge straight ahead at a vertex, -1 if there is none."""
        r = ring[vertex]
        if not r.is_closed or len(r.edges) != 4:
            return -1
        other = r.edges[(r.edges.index(edge) + 2) % 4]
        return other if cut[other] else -1

    for edge in np.flatnonzero(cut).tolist():
        if edge in seen:
            continue
        seen.add(edge)
        a, b = ends[edge]
        halves = []
        for vertex in (a, b):
            points, walk, at = [vertex], [], edge
            while (at := onward(at, points[-1])) >= 0 and at not in seen:
                seen.add(at)
                walk.append(at)
                points.append(ends[at][1] if ends[at][0] == points[-1] else ends[at][0])
            halves.append((points, walk))
        vertices = halves[0][0][::-1] + halves[1][0]
        edges = halves[0][1][::-1] + [edge] + halves[1][1]
        stops = [i for i, v in enumerate(vertices) if i in (0, len(edges)) or degree[v] != 2]
        result.append((vertices, edges, stops))
    return result


def _join_dead_ends(board: MergeBoard) -> bool:
    """Join cuts inside patches from their free ends back to one of their ``natural_stops``, where all limits allow it.

    Return whether anything changed.
    """
    changed = False
    mesh = board.mesh
    layout = board.layout
    for edges in layout.seams:
        names = board.pieces_at(edges[:1])[0]
        if names[0] != names[1] or not board.cut[edges].all() or not board.is_first_image(edges):
            continue
        free = [layout.cut_degree[v] == 1 for v in _run_ends(mesh.edges[edges])]
        if not any(free):
            continue
        run = edges if free[1] else edges[::-1]
        for begin in natural_stops(board, run)[:-1]:
            if try_change(board, np.sort(run[begin:]), NO_EDGES):
                changed = True
                break
    return changed


def _run_ends(pairs: np.ndarray) -> tuple[int, int]:
    """Return the first and last vertex of a run of ordered edges (n, 2)."""
    if len(pairs) == 1:
        return int(pairs[0, 0]), int(pairs[0, 1])
    first = pairs[0, 0] if pairs[0, 0] not in pairs[1] else pairs[0, 1]
    last = pairs[-1, 0] if pairs[-1, 0] not in pairs[-2] else pairs[-1, 1]
    return int(first), int(last)


def natural_stops(board: MergeBoard, run: np.ndarray) -> list[int]:
    """Return the positions in a run of edges where a person would end a cut: ends, corners and irregular vertices."""
    mesh = board.mesh
    stops = [0]
    for i in range(1, len(run)):
        a, b = int(run[i - 1]), int(run[i])
        vertex = next(iter(set(mesh.edges[a].tolist()) & set(mesh.edges[b].tolist())))
        ring = edge_rings(mesh)[vertex]
        straight = ring.is_closed and len(ring.edges) == 4 and ring.edges[(ring.edges.index(a) + 2) % 4] == b
        if not straight:
            stops.append(i)
    return [*stops, len(run)]

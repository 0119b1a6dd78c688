"""Patches that are larger than the sheet of material: cut along straight runs of edges until every piece fits.

Runs in the layout, between merging and the spirals, because a cut changes the seams. A run goes from outline to outline,
as straight as the quads allow; of all that are possible, the one that leads to the fewest, shortest and most compact
pieces is taken.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from ..errors import FlexMapsError
from ..params import LayoutParams, SheetParams
from ..progress import SILENT, Progress
from ..surface.symmetry import keeping, symmetries
from .edit import with_cuts
from .flatten import FlatPatches
from .layout import PatchLayout, alone
from .merge import forced_notes, symmetry_kept

ANGLES = 60  # directions in half a turn in which a piece is tried on the sheet
BEND = 3.0  # what a quarter turn of a run costs, in mean edges
CHECKED = 40  # runs that are looked at closely, best first
NEEDED, UNEVEN = 2.0, 0.5  # what one more piece costs, and pieces as unequal as can be, against a run across the patch
CHANGE = 0.01  # how much a piece may grow, as a share, when it is flattened anew
ROUNDING = 1e-4  # by how much, as a share, a patch that was stored and read again may have grown
SLACK = 0.005  # share of the sheet's longer side that is left for connectors and for the packing


def split(
    flat: FlatPatches, params: LayoutParams, sheet: SheetParams, progress: Progress = SILENT, rounds: int = 8
) -> FlatPatches:
    """Cut every patch that does not fit the sheet, and flatten the pieces; nothing happens if ``sheet.oversize`` is not "split".

    Patches that no run can divide stay as they are; the sheets say so. The notes of the layout's report say how many
    patches were cut. Raises ``FlexMapsError`` with the quads that alone are larger than the sheet.
    """
    if sheet.oversize != "split":
        return flat
    room = usable(sheet)
    _refuse_large_quads(flat, room, sheet)
    first, before = len(flat.layout.patches), flat.layout.cut
    found = symmetries(flat.layout.mesh) if params.symmetric else []
    for turn in range(rounds):
        cut = flat.layout.cut.copy()
        # a patch that is its own mirror image may have been cut on one side only
        mirrored = keeping(found, cut)
        large = [p for p in range(len(flat.layout.patches)) if excess(_points(flat, p), room, sheet) > 1.0]
        done: set[int] = set()
        for number, patch in enumerate(large):
            progress((turn + number / len(large)) / rounds, "cutting patches to the sheet's size")
            if patch in done:
                continue  # as the mirror image of another one
            run = _best_run(flat, patch, params, (1.0 - CHANGE) * room, sheet, progress.quiet())
            if run is not None:
                for edges in (run, *(image.edges[run] for image in mirrored)):
                    done |= _cut_once(flat.layout, edges, cut, done)
        if (cut == flat.layout.cut).all():
            break
        notes = flat.layout.notes
        flat = with_cuts(flat, cut, params)
        flat.layout.notes.update({k: v for k, v in notes.items() if k != "forced"} | forced_notes(flat, params))
    added = len(flat.layout.patches) - first
    if added:
        flat.layout.notes["split"] = (
            f"{added} cuts more, so that every panel fits a sheet of {sheet.sheet_width * 1e3:g} x "
            f"{sheet.sheet_height * 1e3:g} mm"
        )
    if added and found:
        rest = keeping(found, flat.layout.cut)
        said, text = symmetry_kept(found, rest)
        if len(rest) < len(keeping(found, before)):
            text += "; the cuts to the sheet's size broke the others"
        flat.layout.notes.update(said | {"symmetry": text})
    return flat


def check_size(flat: FlatPatches, params: LayoutParams, sheet: SheetParams) -> None:
    """Raise ``FlexMapsError`` where ``split`` would still cut: the layout was made for a larger sheet, or by hand.

    Patches that no run can divide are let through, as ``split`` does.
    """
    if sheet.oversize != "split":
        return
    room = usable(sheet)
    _refuse_large_quads(flat, room, sheet)
    large = [p for p in range(len(flat.layout.patches)) if excess(_points(flat, p), room, sheet) > 1.0 + ROUNDING]
    able = [p for p in large if _best_run(flat, p, params, (1.0 - CHANGE) * room, sheet) is not None]
    if able:
        raise FlexMapsError(
            f"{len(able)} of {len(flat.layout.patches)} panels are larger than the sheet of {sheet.sheet_width * 1e3:g} x "
            f"{sheet.sheet_height * 1e3:g} mm less its margins: they were not cut for it; make the layout again, cut them "
            "by hand, or let too large panels have larger sheets",
            faces=np.concatenate([flat.layout.patches[p] for p in able]),
        )


def _refuse_large_quads(flat: FlatPatches, room: np.ndarray, sheet: SheetParams) -> None:
    size = f"The sheet of {sheet.sheet_width * 1e3:g} x {sheet.sheet_height * 1e3:g} mm"
    widths = np.ptp(np.einsum("fcx,xa->fca", flat.corners, _directions()), axis=1).T
    large = np.flatnonzero(_ratios(widths, room, sheet.rotation).max(axis=1).min(axis=0) > 1.0)
    if len(large):
        raise FlexMapsError(
            f"{size} has no room for {len(large)} single quads; use a larger sheet or smaller quads, or let too large "
            "panels have larger sheets",
            faces=large,
        )


def usable(sheet: SheetParams) -> np.ndarray:
    """(2,) metres: width and height of the largest box that may lie on the sheet."""
    size = np.array([sheet.sheet_width, sheet.sheet_height])
    return size - 2.0 * sheet.margin - SLACK * size.max()


def excess(points: np.ndarray, room: np.ndarray, sheet: SheetParams) -> float:
    """How many times too large points (M, 2) are for a box (2,), in the best allowed direction; at most 1 fits."""
    return float(_ratios(_widths(points)[:, None], room, sheet.rotation).max(axis=1).min())


def _points(flat: FlatPatches, patch: int) -> np.ndarray:
    return flat.corners[flat.layout.patches[patch]].reshape(-1, 2)


def _directions() -> np.ndarray:
    angle = np.pi * np.arange(ANGLES) / ANGLES
    return np.stack([np.cos(angle), np.sin(angle)])


def _widths(points: np.ndarray) -> np.ndarray:
    """(ANGLES,) metres: extent of points (M, 2) along every direction."""
    return np.ptp(points @ _directions(), axis=0)


def _ratios(width: np.ndarray, room: np.ndarray, rotation: str) -> np.ndarray:
    """(A, 2, N): extents over the sheet's, across and along it, for widths (ANGLES, N) in the directions that are allowed."""
    height = np.roll(width, -ANGLES // 2, axis=0)
    both = np.stack([width / room[0], height / room[1]], axis=1)
    if rotation == "FREE":
        return both
    # a panel's own frame has its narrowest box along x
    box = np.where(width >= height - 1e-12, width * height, np.inf)
    best = np.argmin(box, axis=0)
    rows = np.arange(width.shape[1])
    lengthwise = both[best, :, rows].T[None]
    if rotation == "GRAIN":
        return lengthwise
    crosswise = np.stack([height[best, rows] / room[0], width[best, rows] / room[1]])[None]
    return np.concatenate([lengthwise, crosswise])


def _sheets_needed(width: np.ndarray, room: np.ndarray, rotation: str) -> np.ndarray:
    """(N,) int: into how many pieces a grid of sheets would divide shapes of these widths (ANGLES, N)."""
    return np.ceil(_ratios(width, room, rotation) - 1e-9).prod(axis=1).min(axis=0).astype(np.int64)


@dataclass(frozen=True, eq=False)
class _Runs:
    """All straightest runs through a patch, from every place of its outline to every other one.

    loop : (n,) flat vertices of the outline; inner : (m,) mesh edges inside the patch
    tail, head : (2 m,) flat vertices of every inner edge in both directions
    starts : (s,) directed edges that begin on the outline; ends : (e,) those that end there
    cost : (s, e) metres, length and bends; before : (s, 2 m) the directed edge before every one
    """

    loop: np.ndarray
    inner: np.ndarray
    tail: np.ndarray
    head: np.ndarray
    starts: np.ndarray
    ends: np.ndarray
    cost: np.ndarray
    before: np.ndarray

    def edges(self, start: int, end: int) -> np.ndarray:
        """The mesh edges of one run."""
        walk = [int(self.ends[end])]
        while walk[-1] != self.starts[start]:
            walk.append(int(self.before[start, walk[-1]]))
        return self.inner[np.array(walk) % len(self.inner)]


def _runs(flat: FlatPatches, patch: int) -> _Runs | None:
    layout, mesh = flat.layout, flat.layout.mesh
    loop = flat.outlines[patch]
    inner = layout.joined[layout.patch_of[mesh.edge_quads[layout.joined, 0]] == patch]
    if not len(inner):
        return None
    quad, side = mesh.edge_quads[inner, 0], mesh.edge_sides[inner, 0]
    a, b = layout.flat_corners[quad, side], layout.flat_corners[quad, (side + 1) % 4]
    tail, head = np.concatenate([a, b]), np.concatenate([b, a])
    on_outline = np.zeros(len(flat.points), dtype=bool)
    on_outline[loop] = True
    step = flat.points[head] - flat.points[tail]
    length = np.linalg.norm(step, axis=1)
    one, two = _following(tail, head, ~on_outline)
    cross = step[one, 0] * step[two, 1] - step[one, 1] * step[two, 0]
    bend = np.abs(np.arctan2(cross, (step[one] * step[two]).sum(axis=1)))
    # half a right angle is not yet a corner: lines of quads bend a little all the time
    corner = np.maximum(bend - np.pi / 8, 0.0) / (np.pi / 2 - np.pi / 8)
    weight = length[two] + BEND * length.mean() * (corner + 0.02 * bend)
    starts, ends = np.flatnonzero(on_outline[tail]), np.flatnonzero(on_outline[head])
    graph = coo_array((weight, (one, two)), shape=(len(tail), len(tail))).tocsr()
    cost, before = dijkstra(graph, indices=starts, return_predecessors=True)
    return _Runs(loop, inner, tail, head, starts, ends, cost[:, ends] + length[starts, None], before)


def _following(tail: np.ndarray, head: np.ndarray, inside: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of directed edges of which the second begins where the first ends, at a vertex inside, and does not go back."""
    order = np.argsort(tail, kind="stable")
    count = np.bincount(tail, minlength=len(inside))
    first = np.concatenate([[0], np.cumsum(count)])
    number = np.where(inside[head], count[head], 0)
    one = np.repeat(np.arange(len(head)), number)
    place = np.arange(number.sum()) - np.repeat(np.cumsum(number) - number, number)
    two = order[first[head[one]] + place]
    forward = head[two] != tail[one]
    return one[forward], two[forward]


def _best_run(
    flat: FlatPatches,
    patch: int,
    params: LayoutParams,
    room: np.ndarray,
    sheet: SheetParams,
    progress: Progress = SILENT,
) -> np.ndarray | None:
    """The mesh edges of the best run through a patch; ``None`` if there is none."""
    runs = _runs(flat, patch)
    if runs is None:
        return None
    progress(0.0)
    number = np.full(len(flat.points), -1)
    number[runs.loop] = np.arange(len(runs.loop))
    needed, tails, heads = _needed(flat, runs, number, room, sheet)
    points = flat.points[runs.loop]
    size = np.sqrt(np.bincount(flat.layout.patch_of, weights=flat.layout.mesh.areas)[patch])
    # a chord's share of the area: as good as the run's own while the run is nearly straight
    area = _chord_areas(points)[tails[:, None], heads]
    whole = 0.5 * (points[:, 0] * np.roll(points[:, 1], -1) - points[:, 1] * np.roll(points[:, 0], -1)).sum()
    uneven = np.abs(2.0 * area / whole - 1.0)
    score = NEEDED * needed + 0.5 * runs.cost / size + UNEVEN * uneven**2
    # both directions of a run are one run: keep those that leave the smaller number behind
    score[~np.isfinite(score) | (tails[:, None] >= heads)] = np.inf
    found: list[tuple[float, int, np.ndarray]] = []
    piece = _Piece(*alone(flat.layout, flat.layout.patches[patch]), flat.corners[flat.layout.patches[patch]])
    for start, end in _worth_checking(score, needed):
        progress(0.0)
        edges = runs.edges(start, end)
        judged = _judged(piece, edges, params, room, sheet)
        if judged is not None:
            judged += 0.5 * float(runs.cost[start, end]) / size + UNEVEN * float(uneven[start, end]) ** 2
            found.append((round(judged, 9), len(found), edges))
    return min(found, key=lambda f: f[:2])[2] if found else None


def _worth_checking(score: np.ndarray, needed: np.ndarray) -> list[tuple[int, int]]:
    """Starts and ends of the best runs (s, e), some for every number of pieces: the fewest may break another limit."""
    found = []
    for pieces in np.unique(needed[np.isfinite(score)])[:3]:
        these = np.flatnonzero((needed == pieces) & np.isfinite(score))
        best = these[np.argsort(score.ravel()[these], kind="stable")[:CHECKED]]
        found += [divmod(i, score.shape[1]) for i in best.tolist()]
    return found


def _needed(
    flat: FlatPatches, runs: _Runs, number: np.ndarray, room: np.ndarray, sheet: SheetParams
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(s, e) int: pieces that the two sides of every run need, by their parts of the outline; and places of starts and ends."""
    tails, heads = number[runs.tail[runs.starts]], number[runs.head[runs.ends]]
    count = len(runs.loop)
    spread = flat.points[runs.loop] @ _directions()
    needed = np.full((len(tails), len(heads)), 10**6)
    for start in np.unique(tails).tolist():
        order = (start + np.arange(count + 1)) % count
        ahead = np.maximum.accumulate(spread[order]) - np.minimum.accumulate(spread[order])
        behind = (np.maximum.accumulate(spread[order][::-1]) - np.minimum.accumulate(spread[order][::-1]))[::-1]
        both = _sheets_needed(ahead.T, room, sheet.rotation) + _sheets_needed(behind.T, room, sheet.rotation)
        needed[tails == start] = both[(heads - start) % count]
    return needed, tails, heads


def _chord_areas(points: np.ndarray) -> np.ndarray:
    """(n, n) square metres: area of an outline's part from point i on to point j, closed by the chord."""
    after = np.roll(points, -1, axis=0)
    parts = 0.5 * (points[:, 0] * after[:, 1] - points[:, 1] * after[:, 0])
    sums = np.concatenate([[0.0], np.cumsum(parts)])[:-1]
    chord = 0.5 * (points[None, :, 0] * points[:, None, 1] - points[None, :, 1] * points[:, None, 0])
    return sums[None, :] - sums[:, None] + chord


@dataclass(frozen=True, eq=False)
class _Piece:
    """A patch by itself: its layout, the edges of the whole mesh that its edges are, and its flat corners (q, 4, 2)."""

    layout: PatchLayout
    edges: np.ndarray
    corners: np.ndarray


def _judged(piece: _Piece, run: np.ndarray, params: LayoutParams, room: np.ndarray, sheet: SheetParams) -> float | None:
    """How good the parts of a cut are, small is good, without the cut's length; ``None`` if it is not allowed."""
    layout = piece.layout
    cut = layout.cut.copy()
    cut[np.searchsorted(piece.edges, run)] = True
    after = PatchLayout(layout.mesh, cut)
    if len(after.patches) != 2 or not after.planar.all():
        return None
    small = min(len(quads) for quads in after.patches)
    if small < min(params.patch_min, len(piece.corners) // 2):
        return None
    worse = (after.necks() < min(params.neck_min, layout.necks()[0])).sum()
    widths = np.stack([_widths(piece.corners[quads].reshape(-1, 2)) for quads in after.patches], axis=1)
    needed = _sheets_needed(widths, room, sheet.rotation).sum()
    compact = np.maximum(after.compactness - 4.0, 0.0)
    beyond = np.maximum(after.compactness - params.compactness_limit, 0.0)
    return float(NEEDED * needed + 6.0 * worse + 0.25 * compact.sum() + beyond.sum())


def _cut_once(layout: PatchLayout, run: np.ndarray, cut: np.ndarray, done: set[int]) -> set[int]:
    """Mark a run in ``cut`` (E,) unless it leaves its patch or that patch has been cut; returns the patch, if so."""
    patches = set(np.unique(layout.patch_of[layout.mesh.edge_quads[run]]).tolist())
    if len(patches) != 1 or patches <= done:
        return set()
    cut[run] = True
    return patches

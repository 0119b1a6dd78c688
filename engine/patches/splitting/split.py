"""Cut patches larger than the sheet of material along straight runs of edges until every piece fits.

This belongs to the layout, after merging and before the spirals, because a cut changes the seams. A run of edges goes
from outline to outline, as straight as the quads allow. The best run is short and straight and leaves few, compact pieces.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import count

import numpy as np

from ...arrays import Bool, Float, Int
from ...errors import FlexMapsError
from ...params import LayoutParams, SheetParams
from ...progress import SILENT, Progress
from ...surface.checking.finding import with_count
from ...surface.symmetry import Symmetry, preserved_by, symmetries
from ..flattening.edit import with_cuts
from ..flattening.flatten import FlatPatches
from ..flattening.flattening_report import forced_notes, symmetry_kept
from ..layout import PatchLayout, sublayout
from .straight_runs import StraightRuns, ends_and_unevenness, straight_runs

ANGLES = 60  # number of directions per half turn in which a piece is tried on the sheet; more fit more tightly
# Number of runs whose cost is computed, for each number of sheets; more may give fewer panels, and take longer
CHECKED = 40
# Cost of every sheet that the pieces need; a cut as long as the root of the patch's area costs 0.5. Larger: fewer sheets.
NEEDED = 2.0
# Cost of a cut that leaves all area on one side, on the scale of NEEDED. Larger: pieces of more equal area.
UNEVEN = 0.5
# Share of its size by which a piece may grow when it is flattened again after the cut; chosen with a margin. Larger:
# fewer pieces turn out too large, and pieces are cut smaller.
CHANGE = 0.01
ROUNDING = 1e-4  # share by which a patch may exceed the sheet because stored positions are rounded; larger: less strict
SLACK = 0.005  # share of the sheet's longer side reserved for connectors and packing; larger makes panels smaller

# keys of a layout's notes that a further cut makes wrong: the list of missed limits, and the advice to avoid the seam
OUTDATED = {"forced", "halved"}


def split_to_sheet(
    flat: FlatPatches, params: LayoutParams, sheet: SheetParams, progress: Progress = SILENT
) -> FlatPatches:
    """Cut every patch that does not fit the sheet, and flatten the pieces.

    Nothing is cut unless ``sheet.oversize`` is "split". A patch that no run can divide is halved across its longest
    extent. The notes of the layout say how many cuts were made.

    Parameters
    ----------
    flat : flat patches
    params, sheet : limits of the layout; size and margins of the sheet
    progress : called with the fraction done

    Raises
    ------
    FlexMapsError : with single quads that are larger than the sheet
    """
    if sheet.oversize != "split":
        return flat
    box = usable_size(sheet)
    _refuse_large_quads(flat, box, sheet)
    first, before = len(flat.layout.patches), flat.layout.cut
    found: list[Symmetry] | None = None if params.symmetric else []
    for turn in count():
        part = progress.part(1.0 - 0.5**turn, 1.0 - 0.5 ** (turn + 1))
        cut = flat.layout.cut.copy()
        large = [p for p in range(len(flat.layout.patches)) if size_over_box(_patch_corners(flat, p), box, sheet) > 1.0]
        if not large:
            break
        if found is None:
            found = symmetries(flat.layout.mesh, progress=part.part(0.0, 0.0))
        # determined anew in every round: a patch that is its own mirror image is cut once, which can break a symmetry
        mirrored = preserved_by(found, cut)
        done: set[int] = set()
        for number, patch in enumerate(large):
            tick = partial(part, number / len(large), "cutting panels to the sheet's size")
            tick()
            if patch in done:
                continue  # already cut as the mirror image of another patch
            run = _best_run(flat, patch, params, (1.0 - CHANGE) * box, sheet, tick)
            run = _middle_cut_edges(flat, patch) if run is None else run
            for edges in (run, *(image.edges[run] for image in mirrored)):
                done |= _cut_once(flat.layout, edges, cut, done)
        kept = {name: value for name, value in flat.layout.notes.items() if name not in OUTDATED}
        flat = with_cuts(flat, cut, params, part.part(1.0, 1.0))
        flat.layout.notes.update(kept | forced_notes(flat, params))
    added = len(flat.layout.patches) - first
    if added:
        flat.layout.notes["split"] = (
            f"{with_count(added, 'more cut', 'more cuts')}, so that every panel fits a sheet of {sheet.sheet_width * 1e3:g} x "
            f"{sheet.sheet_height * 1e3:g} mm"
        )
    if added and found:
        rest = preserved_by(found, flat.layout.cut)
        said, text = symmetry_kept(found, rest)
        if len(rest) < len(preserved_by(found, before)):
            text += "; the cuts to the sheet's size broke the others"
        flat.layout.notes.update(said | {"symmetry": text})
    return flat


def check_fits_sheet(flat: FlatPatches, sheet: SheetParams) -> None:
    """Raise an error unless all panels fit the sheet: the layout may have been made by hand or for a larger sheet.

    Parameters
    ----------
    flat : flat patches
    sheet : size and margins of the sheet

    Raises
    ------
    FlexMapsError : a panel, or a single quad, is larger than the sheet
    """
    if sheet.oversize != "split":
        return
    box = usable_size(sheet)
    _refuse_large_quads(flat, box, sheet)
    large = [
        p
        for p in range(len(flat.layout.patches))
        if size_over_box(_patch_corners(flat, p), box, sheet) > 1.0 + ROUNDING
    ]
    if large:
        raise FlexMapsError(
            f"{len(large)} of {with_count(len(flat.layout.patches), 'panel is', 'panels are')} larger than the sheet of {sheet.sheet_width * 1e3:g} x "
            f"{sheet.sheet_height * 1e3:g} mm less its margins: they were not cut for it; make the layout again, cut them "
            "by hand, or let too large panels have larger sheets",
            faces=np.concatenate([flat.layout.patches[p] for p in large]),
        )


def _middle_cut_edges(flat: FlatPatches, patch: int) -> Int[np.ndarray, " run"]:
    """Return the mesh edges between the two halves of a patch's quads, divided across its longest extent."""
    mesh, quads = flat.layout.mesh, flat.layout.patches[patch]
    along = flat.corners[quads].mean(axis=1) @ _directions()[:, int(np.argmax(_widths(_patch_corners(flat, patch))))]
    order = np.argsort(along, kind="stable")
    side = np.full(len(mesh.quads), -1)
    side[quads[order]] = np.arange(len(quads)) >= len(quads) // 2
    inner = flat.layout.uncut_edges
    a, b = side[mesh.edge_quads[inner]].T
    found: Int[np.ndarray, " run"] = inner[(a >= 0) & (b >= 0) & (a != b)]
    return found


def _refuse_large_quads(flat: FlatPatches, box: np.ndarray, sheet: SheetParams) -> None:
    """Raise FlexMapsError if a single quad is larger than ``box``, the usable width and height of the sheet in metres."""
    size = f"The sheet of {sheet.sheet_width * 1e3:g} x {sheet.sheet_height * 1e3:g} mm"
    widths = np.ptp(np.einsum("fcx,xa->fca", flat.corners, _directions()), axis=1).T
    large = np.flatnonzero(_size_ratios(widths, box, sheet.rotation).max(axis=1).min(axis=0) > 1.0)
    if len(large):
        raise FlexMapsError(
            f"{size} has no room for {with_count(len(large), 'single quad', 'single quads')}; use a larger sheet or smaller quads, or let too large "
            "panels have larger sheets",
            faces=large,
        )


def usable_size(sheet: SheetParams) -> Float[np.ndarray, " 2"]:
    """Return width and height of the part of the sheet that panels may use, metres."""
    size = np.array([sheet.sheet_width, sheet.sheet_height])
    return size - 2.0 * sheet.margin - SLACK * size.max()


def size_over_box(points: Float[np.ndarray, "samples 2"], box: Float[np.ndarray, " 2"], sheet: SheetParams) -> float:
    """Return how large a set of points is relative to a box, in the best allowed direction; it fits up to 1.

    Parameters
    ----------
    points : positions, metres
    box : width and height, metres
    sheet : settings, with the allowed rotations
    """
    return float(_size_ratios(_widths(points)[:, None], box, sheet.rotation).max(axis=1).min())


def _patch_corners(flat: FlatPatches, patch: int) -> np.ndarray:
    """Return the flat corners of a patch's quads, (n, 2), metres."""
    return flat.corners[flat.layout.patches[patch]].reshape(-1, 2)


def _directions() -> np.ndarray:
    """Return unit vectors in evenly spaced directions over half a turn, (2, ANGLES)."""
    angle = np.pi * np.arange(ANGLES) / ANGLES
    return np.stack([np.cos(angle), np.sin(angle)])


def _widths(points: Float[np.ndarray, "samples 2"]) -> np.ndarray:
    """Return the extent of points in every direction, (ANGLES,), metres."""
    return np.ptp(points @ _directions(), axis=0)


def _size_ratios(width: np.ndarray, box: np.ndarray, rotation: str) -> Float[np.ndarray, "directions 2 patches"]:
    """Return the extents of N shapes divided by the width and the height of a box, in all allowed directions.

    width : extents of the shapes in all directions, (ANGLES, N), metres
    box : width and height, metres
    rotation : allowed rotations on the sheet: "FREE" for any, "GRAIN" for the panel's length along the sheet's width;
        otherwise the panel's length along the sheet's width or height
    """
    height = np.roll(width, -ANGLES // 2, axis=0)
    both = np.stack([width / box[0], height / box[1]], axis=1)
    if rotation == "FREE":
        return both
    # in a panel's own frame, the longer side of its smallest bounding box lies along x
    best = np.argmin(np.where(width >= height - 1e-12, width * height, np.inf), axis=0)
    rows = np.arange(width.shape[1])
    lengthwise = both[best, :, rows].T[None]
    if rotation == "GRAIN":
        return lengthwise
    crosswise = np.stack([height[best, rows] / box[0], width[best, rows] / box[1]])[None]
    return np.concatenate([lengthwise, crosswise])


def _sheets_needed(width: np.ndarray, box: np.ndarray, rotation: str) -> Int[np.ndarray, " patches"]:
    """Return the smallest number of sheets, laid in a grid, that cover each of N shapes; see ``_size_ratios``."""
    return np.ceil(_size_ratios(width, box, rotation) - 1e-9).prod(axis=1).min(axis=0).astype(np.int64)


def _best_run(
    flat: FlatPatches,
    patch: int,
    params: LayoutParams,
    box: np.ndarray,
    sheet: SheetParams,
    tick: Callable[[], None] = lambda: None,
) -> np.ndarray | None:
    """Return the mesh edges of the best run through a patch; None if no run is allowed.

    box : largest width and height of the pieces, metres
    """
    runs = straight_runs(flat, patch, tick)
    if runs is None:
        return None
    tails, heads, uneven = ends_and_unevenness(flat, runs)
    needed = _sheets_of_sides(flat, runs, tails, heads, box, sheet, tick)
    size = np.sqrt(np.bincount(flat.layout.patch_of, weights=flat.layout.mesh.areas)[patch])
    score = NEEDED * needed + 0.5 * runs.cost / size + UNEVEN * uneven**2
    # every run exists in both directions: keep one of them
    score[~np.isfinite(score) | (tails[:, None] >= heads)] = np.inf
    best, found = np.inf, None
    piece = SinglePatch.from_patch(flat, patch)
    for start, end in _candidates(score, needed):
        tick()
        if score[start, end] >= best:
            continue  # the score is a lower bound of the cost, because pieces need at least the estimated sheets
        edges = runs.edges(start, end)
        judged = _cost_of_cut(piece, edges, params, box, sheet)
        if judged is not None:
            judged += 0.5 * float(runs.cost[start, end]) / size + UNEVEN * float(uneven[start, end]) ** 2
            if round(judged, 9) < best:
                best, found = round(judged, 9), edges
    return found


def _candidates(score: np.ndarray, needed: np.ndarray) -> list[tuple[int, int]]:
    """Return the runs to examine, as positions of their start and end: for each of the three smallest numbers of sheets.

    Not only the smallest number is used, because runs that need the fewest sheets may break another limit.

    score : (starts, ends) lower bound of every run's cost; infinite if the run is impossible
    needed : (starts, ends) number of sheets
    """
    found = []
    for pieces in np.unique(needed[np.isfinite(score)])[:3]:
        these = np.flatnonzero((needed == pieces) & np.isfinite(score))
        best = these[np.argsort(score.ravel()[these], kind="stable")[:CHECKED]]
        found += [divmod(i, score.shape[1]) for i in best.tolist()]
    return found


def _sheets_of_sides(
    flat: FlatPatches,
    runs: StraightRuns,
    tails: np.ndarray,
    heads: np.ndarray,
    box: np.ndarray,
    sheet: SheetParams,
    tick: Callable[[], None],
) -> Int[np.ndarray, "starts ends"]:
    """Return the number of sheets that the pieces on both sides of every run need together, estimated from outlines.

    tails, heads : positions on the outline at which runs start and end
    """
    count = len(runs.loop)
    spread = flat.points[runs.loop] @ _directions()
    needed = np.full((len(tails), len(heads)), 10**6)
    for start in np.unique(tails).tolist():
        tick()
        order = (start + np.arange(count + 1)) % count
        ahead = np.maximum.accumulate(spread[order]) - np.minimum.accumulate(spread[order])
        behind = (np.maximum.accumulate(spread[order][::-1]) - np.minimum.accumulate(spread[order][::-1]))[::-1]
        both = _sheets_needed(ahead.T, box, sheet.rotation) + _sheets_needed(behind.T, box, sheet.rotation)
        needed[tails == start] = both[(heads - start) % count]
    return needed


@dataclass(frozen=True, eq=False)
class SinglePatch:
    """A patch as a mesh of its own.

    layout : layout of this mesh
    edges : edge of the whole mesh for each edge of this mesh
    corners : flat corners of its quads, metres
    isthmus : number of quads across its narrowest isthmus
    """

    layout: PatchLayout
    edges: np.ndarray
    corners: np.ndarray
    isthmus: int

    @classmethod
    def from_patch(cls, flat: FlatPatches, patch: int) -> SinglePatch:
        """Copy a patch of a layout to a mesh of its own.

        Parameters
        ----------
        flat : flat patches
        patch : number of the patch
        """
        quads = flat.layout.patches[patch]
        layout, edges = sublayout(flat.layout, quads)
        return cls(layout, edges, flat.corners[quads], int(layout.isthmus_widths()[0]))


def _cost_of_cut(
    piece: SinglePatch, run: np.ndarray, params: LayoutParams, box: np.ndarray, sheet: SheetParams
) -> float | None:
    """Return the cost of the two pieces that a cut makes, without the cut's length; None if the cut is not allowed.

    piece : the patch that is cut
    run : edges of the cut, in the whole mesh
    box : largest width and height of the pieces, metres
    """
    layout = piece.layout
    cut = layout.cut.copy()
    cut[np.searchsorted(piece.edges, run)] = True
    after = PatchLayout(layout.mesh, cut)
    if len(after.patches) != 2 or not after.is_flattenable.all():
        return None
    small = min(len(quads) for quads in after.patches)
    if small < min(params.patch_min, len(piece.corners) // 2):
        return None
    worse = (after.isthmus_widths() < min(params.neck_min, piece.isthmus)).sum()
    widths = np.stack([_widths(piece.corners[quads].reshape(-1, 2)) for quads in after.patches], axis=1)
    needed = _sheets_needed(widths, box, sheet.rotation).sum()
    compact = np.maximum(after.compactness - 4.0, 0.0)
    beyond = np.maximum(after.compactness - params.compactness_limit, 0.0)
    return float(NEEDED * needed + 6.0 * worse + 0.25 * compact.sum() + beyond.sum())


def _cut_once(layout: PatchLayout, run: np.ndarray, cut: Bool[np.ndarray, " edges"], done: set[int]) -> set[int]:
    """Mark a run of edges in ``cut``, in place; return the set of the patch that it cuts.

    Nothing is marked, and the set is empty, if the run leaves its patch or the patch is already in ``done``.
    """
    quads = layout.mesh.edge_quads[run]  # runs may follow the border of a hole, where there is no second quad
    patches = set(np.unique(layout.patch_of[quads[quads >= 0]]).tolist())
    if len(patches) != 1 or patches <= done:
        return set()
    cut[run] = True
    return patches

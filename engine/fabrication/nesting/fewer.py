"""Cut panels further where that takes fewer sheets, if the sheets saved are worth the added joints.

A beam search adds one cut at a time to the best layouts found so far. The number of sheets is estimated from the areas
of convex hulls (a millisecond), for the most promising layouts also by the quick packing, and for the last few by
nesting. Panels are drawn only later, so the flat patches are used in their place; they cover about as much of a sheet.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np

from ...arrays import Bool, Float
from ...errors import FlexMapsError
from ...params import LayoutParams, Settings, SheetParams, SpiralParams
from ...patches.flattening.edit import with_cuts
from ...patches.flattening.flatten import FlatPatches
from ...patches.flattening.report import forced_notes, symmetry_kept
from ...patches.layout import PatchLayout
from ...patches.splitting.runs import chord_areas, straight_runs
from ...patches.splitting.split import SinglePatch, allowed
from ...progress import SILENT, Progress
from ...spirals.rim import rim_depth
from ...surface.checking.finding import counted
from ...surface.symmetry import Symmetry, keeping, symmetries
from .nest import nest
from .outlines import HULLS, hull_area
from .packing import Packing, pack, used_length

# Cells of the rasters along a sheet: half as many as for panels take a quarter of the time; both are used, because a
# layout that saves sheets with a single raster does so by chance
RASTERS = (256, 512)
# Shares of a patch's area; for each interval between two of them the straightest cuts are tried; not measured
SHARES = (0.08, 0.2, 0.35, 0.5)
EACH = 2  # cuts tried per patch and interval; not measured, it bounds the time
# time limit for finding cuts, in multiples of the time for nesting
LONGEST = 10.0
LARGE = 0.08  # share of a sheet's area; a smaller patch is not cut; not measured, useful cuts went through larger ones
MOST = 12  # maximum number of successive cuts; on four surfaces two to six were useful
BEAM = 8  # layouts kept per step; each is also packed quickly, half a second for 23 panels
PATIENCE = 2  # successive cuts without a gain before the search ends: two together may gain where a single one does not
# The PROMISING best layouts by convex hulls are nested. The next ones, up to NESTED in all, share ALL times the time
# for nesting, and the best FINALISTS of these are nested as long as the first. On two surfaces the best layout was the
# first and the sixth; the other numbers bound the time and are not measured
PROMISING, NESTED, ALL, FINALISTS = 5, 12, 2.0, 2
# share of a quad by which a panel is narrower at an open border where outer arms are left out: the mean of seven
# surfaces
LEFT_OUT = 0.2


def fewer_sheets(flat: FlatPatches, settings: Settings, progress: Progress = SILENT) -> FlatPatches:
    """Cut the patches further if that saves sheets at no more than ``sheet.cut_joints`` joints per sheet.

    The emptiest sheet is counted by the share of its length in use, so saving half a sheet may cost half as many
    joints. Otherwise the patches are returned unchanged. The notes of the layout's report describe the result.

    Parameters
    ----------
    flat : flattened patches
    settings : layout, spiral and sheet settings
    progress : receives the share done
    """
    sheet = settings.sheet
    if sheet.cut_joints <= 0 or sheet.remnants.strip():
        return flat
    shapes = outlines(flat, settings.spiral)
    before = sheets_needed(nest(shapes, sheet, progress.part(0.0, 0.1)), shapes, sheet)
    made = _Cutting(flat, settings, progress.part(0.1, 0.6)).all()
    few, others = made[:PROMISING], made[PROMISING:NESTED]
    short = replace(sheet, nesting_seconds=sheet.nesting_seconds * min(1.0, ALL / max(len(others), 1)))

    def rated(some: list[FlatPatches], params: SheetParams, part: Progress) -> list[tuple[float, float, FlatPatches]]:
        """Return for each layout its gain in joints, the sheets it needs and the layout, best first."""
        found = []
        for number, one in enumerate(some):
            pieces, within = outlines(one, settings.spiral), part.part(number / len(some), (number + 1) / len(some))
            need = sheets_needed(nest(pieces, params, within), pieces, sheet)
            found.append((_gain_in_joints(before - need, joints(one.layout) - joints(flat.layout), sheet), need, one))
        return sorted(found, key=lambda one: -one[0])

    few += [one for _, _, one in rated(others, short, progress.part(0.6, 0.7))[:FINALISTS]]
    last = rated(few, sheet, progress.part(0.7, 1.0))
    if not last or last[0][0] <= 0.0:
        return flat
    _, need, best = last[0]
    return _with_notes(best, flat, settings.layout, before, need)


def outlines(flat: FlatPatches, spiral: SpiralParams) -> list[Float[np.ndarray, "_ 2"]]:
    """Return approximate outlines of the panels of flat patches, metres: of their quads, adjusted at open borders."""
    points = _border_adjusted(flat, spiral)
    return [points[loop] for loop in flat.outlines]


def _border_adjusted(flat: FlatPatches, spiral: SpiralParams) -> Float[np.ndarray, "vertices 2"]:
    """Return the flat vertices in metres, at open borders moved inwards for omitted arms or outwards for a rim."""
    layout, points = flat.layout, flat.points
    if spiral.border not in ("left_out", "rim"):
        return points
    quad, side = np.nonzero(layout.mesh.border[layout.mesh.quad_edges])
    ways = np.zeros((*layout.flat_corners.shape, 2))
    for end, far in ((0, 3), (1, 2)):  # end of a side, and the corner across the quad from it
        at = (side + end) % 4
        inwards = points[layout.flat_corners[quad, (side + far) % 4]] - points[layout.flat_corners[quad, at]]
        if spiral.border == "left_out":
            way = LEFT_OUT * inwards
        else:
            long = np.linalg.norm(inwards, axis=1, keepdims=True)
            way = -(rim_depth(spiral) + spiral.rim_width) / np.maximum(long, 1e-9) * inwards
        np.add.at(ways, (quad, at), way)
    # move each vertex by the mean over its quads
    touched = ways.any(axis=2)
    moved, count = np.zeros_like(points), np.zeros((len(points), 1))
    np.add.at(moved, layout.flat_corners[touched], ways[touched])
    np.add.at(count, layout.flat_corners[touched], 1.0)
    return points + moved / np.maximum(count, 1.0)


def joints(layout: PatchLayout) -> int:
    """Return the number of joints between the panels of a layout."""
    return int(np.count_nonzero(layout.cut))


def sheets_needed(packing: Packing, shapes: list[Float[np.ndarray, "_ 2"]], sheet: SheetParams) -> float:
    """Return the number of sheets; the emptiest is counted by the share of its length in use.

    Parameters
    ----------
    packing : where the shapes lie
    shapes : closed outlines (M, 2), metres
    sheet : width and margin of the sheets, metres
    """
    used = [used_length(packing, shapes, k) + sheet.margin for k in range(len(packing.sizes))]
    return len(used) - 1 + min(min(used) / sheet.sheet_width, 1.0)


def _gain_in_joints(saved: float, more: int, sheet: SheetParams) -> float:
    """Return the gain, in joints, of saving sheets at the cost of more joints."""
    return sheet.cut_joints * saved - more


def by_hulls(hulls: Sequence[float], sheet: SheetParams) -> float:
    """Return the number of sheets expected after nesting for shapes with these areas of convex hulls (m2).

    First-fit decreasing by area: each sheet bears the share ``HULLS`` of its area.
    """
    bears = HULLS * (sheet.sheet_width - 2.0 * sheet.margin) * (sheet.sheet_height - 2.0 * sheet.margin)
    used: list[float] = []
    for area in sorted((hull / bears for hull in hulls), reverse=True):
        fullest = max((k for k, one in enumerate(used) if one + area <= 1.0), key=lambda k: used[k], default=None)
        if fullest is None:
            used.append(area)
        else:
            used[fullest] += area
    return len(used) - 1 + min(*used, 1.0) if used else 0.0


def _with_notes(made: FlatPatches, flat: FlatPatches, params: LayoutParams, before: float, after: float) -> FlatPatches:
    """Add a description of the added cuts to the notes of the layout's report."""
    notes = {k: v for k, v in flat.layout.notes.items() if k != "forced"} | forced_notes(made, params)
    added, more = len(made.layout.patches) - len(flat.layout.patches), joints(made.layout) - joints(flat.layout)
    text = f"{counted(added, 'more cut', 'more cuts')}, with {counted(more, 'joint', 'joints')}, so that about {after:.1f} instead of {before:.1f} sheets are needed"
    notes["split"] = f"{notes['split']}; {text}" if "split" in notes else text
    if params.symmetric and (found := symmetries(made.layout.mesh)):
        kept, said = symmetry_kept(found, keeping(found, made.layout.cut))
        notes |= kept | {"symmetry": said}
    made.layout.notes.update(notes)
    return made


class _Cutting:
    """Search for useful cuts before anything is nested."""

    def __init__(self, flat: FlatPatches, settings: Settings, progress: Progress):
        self.flat, self.params, self.sheet, self.spiral = flat, settings.layout, settings.sheet, settings.spiral
        self.progress = progress
        found = symmetries(flat.layout.mesh, progress=progress.quiet()) if self.params.symmetric else []
        self.mirrored: list[Symmetry] = keeping(found, flat.layout.cut)
        self.known: dict[bytes, list[np.ndarray]] = {}  # candidate cuts by patch, keyed by its quads
        self.hulls: dict[bytes, float] = {}  # area of the convex hull in m2, by the quads of a patch
        self.end = time.monotonic() + LONGEST * self.sheet.nesting_seconds
        self.first = joints(flat.layout)

    def all(self) -> list[FlatPatches]:
        """Return layouts with more cuts that are expected to be worthwhile, best first."""
        found: list[tuple[float, FlatPatches]] = []
        beam, paid, idle = [self.flat], 0.0, 0
        start = self._by_hulls(self.flat, _border_adjusted(self.flat, self.spiral), self.flat.layout.cut)
        for turn in range(MOST):
            tick = partial(self.progress, turn / MOST, "looking where panels could be cut")
            made = self._one_more_cut(beam, start, tick)
            found += made
            beam = [some for _, some in made]
            most = max((pays for pays, _ in made), default=-np.inf)
            idle = idle + 1 if most <= paid else 0
            paid = max(paid, most)
            if not beam or idle == PATIENCE or time.monotonic() > self.end:
                break
        judged = self._refine_by_packing(found) if found else []
        # keep the best layout for each number of joints: others mostly differ by a row of quads
        kept: dict[int, FlatPatches] = {}
        for pays, some in sorted(judged, key=lambda one: -one[0]):
            if pays > 0.0:
                kept.setdefault(joints(some.layout), some)
        return list(kept.values())

    def _refine_by_packing(self, found: list[tuple[float, FlatPatches]]) -> list[tuple[float, FlatPatches]]:
        """Return the layouts with the gain estimated by the quick packing, if larger, as far as time allows.

        Layouts with few cuts come first.
        """
        before = [self._sheets_packed(self.flat, cells) for cells in RASTERS]
        judged = []
        for pays, some in found:
            least = np.inf
            for need, cells in zip(before, RASTERS, strict=True):
                if least > pays and time.monotonic() < self.end:
                    least = min(least, self._gain(need - self._sheets_packed(some, cells), some.layout.cut))
            judged.append((max(pays, least) if np.isfinite(least) else pays, some))
        return judged

    def _one_more_cut(
        self, beam: list[FlatPatches], start: float, tick: Callable[[], None]
    ) -> list[tuple[float, FlatPatches]]:
        """Return the best layouts with one cut more than a layout of the beam, and their expected gain in joints."""
        rated: dict[bytes, tuple[float, FlatPatches, np.ndarray]] = {}
        for flat in beam:
            points = _border_adjusted(flat, self.spiral)
            for edges in self._candidates(flat, tick):
                cut = self._add_run(flat, edges)
                key = np.packbits(cut).tobytes()
                if key not in rated:
                    rated[key] = self._gain(start - self._by_hulls(flat, points, cut), cut), flat, cut
        made: list[tuple[float, FlatPatches]] = []
        for pays, flat, cut in sorted(rated.values(), key=lambda one: -one[0]):
            if len(made) == BEAM or (made and time.monotonic() > self.end):
                break
            with suppress(FlexMapsError):  # a cut and its mirror images may cross each other
                made.append((pays, with_cuts(flat, cut, self.params, self.progress.quiet())))
        return made

    def _gain(self, saved: float, cut: Bool[np.ndarray, " edges"]) -> float:
        """Return the gain, in joints, of saving sheets by these cuts."""
        return _gain_in_joints(saved, int(np.count_nonzero(cut)) - self.first, self.sheet)

    def _add_run(self, flat: FlatPatches, edges: np.ndarray) -> Bool[np.ndarray, " edges"]:
        """Return the cuts of a layout with a run of edges and its mirror images added."""
        cut = flat.layout.cut.copy()
        for image in (edges, *(one.edges[edges] for one in self.mirrored)):
            cut[image] = True
        return cut

    def _by_hulls(
        self, flat: FlatPatches, points: Float[np.ndarray, "vertices 2"], cut: Bool[np.ndarray, " edges"]
    ) -> float:
        """Return the number of sheets expected for the patches between these cuts.

        The area of a hull is computed once for each set of quads, because a patch has nearly the same shape in all
        layouts.
        """
        areas = []
        for quads in PatchLayout(flat.layout.mesh, cut).patches:
            key = quads.tobytes()
            if key not in self.hulls:
                self.hulls[key] = hull_area(points[flat.layout.flat_corners[quads]].reshape(-1, 2))
            areas.append(self.hulls[key])
        return by_hulls(areas, self.sheet)

    def _sheets_packed(self, flat: FlatPatches, cells: int) -> float:
        """Return the number of sheets that the quick packing needs."""
        p, shapes = self.sheet, outlines(flat, self.spiral)
        found = pack(
            shapes, (p.sheet_width, p.sheet_height), p.margin, p.spacing, self.progress.quiet(), p.rotation, cells
        )
        return sheets_needed(found, shapes, p)

    def _candidates(self, flat: FlatPatches, tick: Callable[[], None]) -> Iterator[np.ndarray]:
        """Yield the edges of straight cuts that divide patches into different shares, as far as time allows."""
        for patch, quads in enumerate(flat.layout.patches):
            tick()
            if time.monotonic() > self.end:
                return
            key = quads.tobytes()
            if key not in self.known:
                self.known[key] = self._straight_cuts(flat, patch, tick)
            yield from self.known[key]

    def _straight_cuts(self, flat: FlatPatches, patch: int, tick: Callable[[], None]) -> list[np.ndarray]:
        """Return the straightest permitted cuts through a patch for each interval of ``SHARES``."""
        sheet = self.sheet
        quads = flat.layout.patches[patch]
        runs = None
        if flat.layout.mesh.areas[quads].sum() > LARGE * sheet.sheet_width * sheet.sheet_height:
            runs = straight_runs(flat, patch, tick)
        if runs is None:
            return []
        points = flat.points[runs.loop]
        number = np.full(len(flat.points), -1)
        number[runs.loop] = np.arange(len(runs.loop))
        tails, heads = number[runs.tail[runs.starts]], number[runs.head[runs.ends]]
        whole = 0.5 * (points[:, 0] * np.roll(points[:, 1], -1) - points[:, 1] * np.roll(points[:, 0], -1)).sum()
        share = chord_areas(points)[tails[:, None], heads] / whole
        share = np.minimum(share, 1.0 - share)
        cost = np.where(tails[:, None] < heads, runs.cost, np.inf)
        piece, found = SinglePatch.from_patch(flat, patch), list[np.ndarray]()
        for low, high in pairwise(SHARES):
            some = np.where((share > low) & (share <= high), cost, np.inf)
            kept: list[tuple[int, int]] = []
            for i in np.argsort(some, axis=None, kind="stable")[: 20 * EACH].tolist():
                start, end = divmod(i, some.shape[1])
                if len(kept) == EACH or not np.isfinite(some[start, end]):
                    break
                if any(abs(share[start, end] - share[one]) < 0.25 * (high - low) for one in kept):
                    continue  # nearly identical to a cut that is kept
                tick()
                edges = runs.edges(start, end)
                if allowed(piece, edges, self.params, sheet):
                    kept.append((start, end))
                    found.append(edges)
        return found

"""Panels cut further, where that takes fewer sheets: as few joints more as a sheet is worth.

Cut after cut, the one that pays most is made, by the quick packing of the pieces or by how much of a sheet their convex hulls usually
cover, whichever takes fewer sheets; what all of them save is told by nesting in the end.
The flat patches stand for the panels, which are drawn later and cover about as much of a sheet.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np

from ...arrays import Bool, Float
from ...errors import FlexMapsError
from ...params import LayoutParams, SheetParams
from ...patches.flattening.edit import with_cuts
from ...patches.flattening.flatten import FlatPatches
from ...patches.flattening.report import forced_notes, symmetry_kept
from ...patches.layout import PatchLayout
from ...patches.splitting.runs import chord_areas, straight_runs
from ...patches.splitting.split import Piece, allowed
from ...progress import SILENT, Progress
from ...surface.symmetry import Symmetry, keeping, symmetries
from .nest import nest
from .outlines import HULLS, hull_area
from .packing import Packing, pack, used_length

CELLS = 256  # of the raster along a sheet on which cuts are judged: half as many as for panels, a quarter of the time
# of a patch's area: of the parts between two of these the straightest cuts are tried; not measured
SHARES = (0.08, 0.2, 0.35, 0.5)
EACH = 2  # cuts of each such share that are tried for a patch; not measured, it bounds the time
AGAIN = 24  # cuts that are judged again after one was made, besides those of the new pieces: those that paid most before; not measured
# times the seconds for nesting that may be spent on looking for cuts: 34 s of a processor for 23 panels of some 2,900 quads
LONGEST = 10.0
LARGE = 0.08  # share of a sheet; a smaller patch is not cut; not measured, the cuts that paid went through larger ones
MOST = 12  # cuts that are made one after the other: on four surfaces at most five paid, before two in a row did not
PATIENCE = 2  # cuts in a row that may not pay: two together may, where one alone does not
NESTED = 3  # layouts that are nested in the end, each of which takes as long as nesting does
FINER = 2  # times as many cells for the second packing of a cut: one that saves sheets with the first alone does so by chance


def fewer_sheets(
    flat: FlatPatches, params: LayoutParams, sheet: SheetParams, progress: Progress = SILENT
) -> FlatPatches:
    """The patches cut further, if one sheet less takes at most ``sheet.cut_joints`` joints more; else as they are.

    What is saved counts in sheets, the emptiest one as far as it is used: half a sheet is worth half as many joints. The
    notes of the layout's report say what was done.
    """
    if sheet.cut_joints <= 0 or sheet.remnants.strip():
        return flat
    shapes = outlines(flat)
    before = sheets_needed(nest(shapes, sheet, progress.part(0.0, 0.1)), shapes, sheet)
    made = _Cutting(flat, params, sheet, progress.part(0.1, 0.6)).all()
    best, least, worth = flat, before, 0.0
    made.sort(key=lambda one: -one[0])
    for number, (_, some) in enumerate(made[:NESTED]):
        pieces = outlines(some)
        part = progress.part(0.6 + 0.4 * number / NESTED, 0.6 + 0.4 * (number + 1) / NESTED)
        need = sheets_needed(nest(pieces, sheet, part), pieces, sheet)
        pays = sheet.cut_joints * (before - need) - joints(some.layout) + joints(flat.layout)
        if pays > worth:
            best, least, worth = some, need, pays
    return flat if best is flat else _noted(best, flat, params, before, least)


def outlines(flat: FlatPatches) -> list[Float[np.ndarray, "_ 2"]]:
    """The outlines of flat patches in metres."""
    return [flat.points[loop] for loop in flat.outlines]


def joints(layout: PatchLayout) -> int:
    """How many joints its panels will have."""
    return sum(len(edges) for edges in layout.seams)


def sheets_needed(packing: Packing, shapes: list[Float[np.ndarray, "_ 2"]], sheet: SheetParams) -> float:
    """The number of sheets, of which the emptiest counts as far as it is used."""
    used = [used_length(packing, shapes, k) + sheet.margin for k in range(len(packing.sizes))]
    return len(used) - 1 + min(min(used) / sheet.sheet_width, 1.0)


def _by_hulls(shapes: list[np.ndarray], sheet: SheetParams) -> float:
    """Sheets that shapes are expected to need once they are nested: each bears so much of their convex hulls, the large ones first."""
    bears = HULLS * (sheet.sheet_width - 2.0 * sheet.margin) * (sheet.sheet_height - 2.0 * sheet.margin)
    used: list[float] = []
    for area in sorted((hull_area(shape) / bears for shape in shapes), reverse=True):
        fullest = max((k for k, one in enumerate(used) if one + area <= 1.0), key=lambda k: used[k], default=None)
        if fullest is None:
            used.append(area)
        else:
            used[fullest] += area
    return len(used) - 1 + min(*used, 1.0)


def _noted(made: FlatPatches, flat: FlatPatches, params: LayoutParams, before: float, after: float) -> FlatPatches:
    """The same with what was done in the notes of its report."""
    notes = {k: v for k, v in flat.layout.notes.items() if k != "forced"} | forced_notes(made, params)
    added, more = len(made.layout.patches) - len(flat.layout.patches), joints(made.layout) - joints(flat.layout)
    text = f"{added} cuts more, with {more} joints, so that about {after:.1f} instead of {before:.1f} sheets are needed"
    notes["split"] = f"{notes['split']}; {text}" if "split" in notes else text
    if params.symmetric and (found := symmetries(made.layout.mesh)):
        kept, said = symmetry_kept(found, keeping(found, made.layout.cut))
        notes |= kept | {"symmetry": said}
    made.layout.notes.update(notes)
    return made


@dataclass(frozen=True, eq=False)
class _Cut:
    """Edges of the mesh that are cut together, and what that pays, in joints, as far as it was judged."""

    edges: np.ndarray
    pays: float = -np.inf


class _Cutting:
    """The search for cuts that pay, before anything is nested."""

    def __init__(self, flat: FlatPatches, params: LayoutParams, sheet: SheetParams, progress: Progress):
        self.flat, self.params, self.sheet, self.progress = flat, params, sheet, progress
        found = symmetries(flat.layout.mesh, progress=progress.part(0.0, 0.0)) if params.symmetric else []
        self.mirrored: list[Symmetry] = keeping(found, flat.layout.cut)
        self.shapes: dict[bytes, np.ndarray] = {}
        self.end = time.monotonic() + LONGEST * sheet.nesting_seconds

    def all(self) -> list[tuple[float, FlatPatches]]:
        """Layouts with more and more cuts, and what each is expected to pay in joints."""
        flat, found = self.flat, []
        first, paid, idle = joints(flat.layout), 0.0, 0
        start = self._needed(flat, flat.layout.cut, 1), self._needed(flat, flat.layout.cut, FINER)
        known: list[_Cut] = []
        fresh = list(range(len(flat.layout.patches)))
        for turn in range(MOST):
            tick = partial(self.progress, turn / MOST, "looking where panels could be cut")
            cuts = [*known[:AGAIN], *(cut for patch in fresh for cut in self._candidates(flat, patch, tick))]
            judged = []
            for cut in cuts:
                tick()
                if time.monotonic() > self.end:
                    break
                judged.append(_Cut(cut.edges, self._pays(flat, cut.edges, start[0], 1, first)))
            known = sorted(judged, key=lambda cut: -cut.pays)
            best = self._surest(flat, known[:AGAIN], start[1], first, tick)
            if best is None or idle == PATIENCE or time.monotonic() > self.end:
                break
            try:
                after = with_cuts(flat, self._with(flat, best.edges), self.params, self.progress.part(0.0, 0.0))
            except FlexMapsError:  # a cut and its images may cross
                known = [cut for cut in known if cut.edges is not best.edges]
                fresh = []
                continue
            before = {quads.tobytes() for quads in flat.layout.patches}
            fresh = [p for p, quads in enumerate(after.layout.patches) if quads.tobytes() not in before]
            known = [cut for cut in known if not after.layout.cut[cut.edges].any() and self._inside(after, cut.edges)]
            idle = idle + 1 if best.pays <= paid else 0
            flat, paid = after, max(paid, best.pays)
            found.append((best.pays, flat))
        return [(pays, some) for pays, some in found if pays > 0.0]

    def _surest(
        self, flat: FlatPatches, known: list[_Cut], start: float, first: int, tick: Callable[[], None]
    ) -> _Cut | None:
        """The cut that pays most on average of two packings."""
        found = None
        for cut in known:
            if found is not None and cut.pays <= found.pays:
                break  # the average of what cannot be more
            tick()
            pays = 0.5 * (cut.pays + min(cut.pays, self._pays(flat, cut.edges, start, FINER, first)))
            if found is None or pays > found.pays:
                found = _Cut(cut.edges, pays)
        return found

    def _inside(self, flat: FlatPatches, edges: np.ndarray) -> bool:
        """Whether a run lies in one patch still."""
        return len(np.unique(flat.layout.patch_of[flat.layout.mesh.edge_quads[edges]])) == 1

    def _with(self, flat: FlatPatches, edges: np.ndarray) -> Bool[np.ndarray, " edges"]:
        """The cuts with a run and its mirror images."""
        cut = flat.layout.cut.copy()
        for image in (edges, *(one.edges[edges] for one in self.mirrored)):
            cut[image] = True
        return cut

    def _pays(self, flat: FlatPatches, edges: np.ndarray, start: float, finer: int, first: int) -> float:
        """What all cuts and this one pay, in joints."""
        cut = self._with(flat, edges)
        saved = start - self._needed(flat, cut, finer)
        return self.sheet.cut_joints * saved - joints(PatchLayout(flat.layout.mesh, cut)) + first

    def _needed(self, flat: FlatPatches, cut: np.ndarray, finer: int) -> float:
        """Sheets that the patches between cuts are expected to need; cuts more than the flat patches' own are allowed."""
        p = self.sheet
        shapes = [self._shape(flat, quads) for quads in PatchLayout(flat.layout.mesh, cut).patches]
        found = pack(shapes, (p.sheet_width, p.sheet_height), p.margin, p.spacing, rotation=p.rotation, cells=finer * CELLS)  # fmt: skip
        return min(sheets_needed(found, shapes, p), _by_hulls(shapes, p))

    def _shape(self, flat: FlatPatches, quads: np.ndarray) -> np.ndarray:
        """The outline of some quads of one patch, as they lie in it."""
        key = quads.tobytes()
        if key not in self.shapes:
            import shapely

            whole = shapely.union_all(shapely.polygons(flat.corners[quads]).tolist(), grid_size=1e-7)
            part = max(getattr(whole, "geoms", [whole]), key=lambda one: one.area)
            self.shapes[key] = np.asarray(part.exterior.coords)[:-1]
        return self.shapes[key]

    def _candidates(self, flat: FlatPatches, patch: int, tick: Callable[[], None]) -> list[_Cut]:
        """Straight cuts through a patch into parts of several shares."""
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
        piece, found = Piece.of(flat, patch), []
        for low, high in pairwise(SHARES):
            some = np.where((share > low) & (share <= high), cost, np.inf)
            kept: list[tuple[int, int]] = []
            for i in np.argsort(some, axis=None, kind="stable")[: 20 * EACH].tolist():
                start, end = divmod(i, some.shape[1])
                if len(kept) == EACH or not np.isfinite(some[start, end]):
                    break
                if any(abs(share[start, end] - share[one]) < 0.25 * (high - low) for one in kept):
                    continue  # nearly the same cut
                tick()
                edges = runs.edges(start, end)
                if allowed(piece, edges, self.params, sheet):
                    kept.append((start, end))
                    found.append(_Cut(edges))
        return found

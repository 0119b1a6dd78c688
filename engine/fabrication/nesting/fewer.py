"""Panels cut further, where that takes fewer sheets: as few joints more as a sheet is worth.

Layouts with one cut more each are made from the best ones that there are, and the best of those are kept, as a beam search does.
How many sheets a layout takes is told first by how much of a sheet convex hulls usually cover, which takes a millisecond, of the most
promising ones by the quick packing too, and of the last few by nesting. The flat patches stand for the panels, which are drawn
later and cover about as much of a sheet.
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
from ...patches.splitting.split import Piece, allowed
from ...progress import SILENT, Progress
from ...spirals.rim import rim_depth
from ...surface.checking.finding import counted
from ...surface.symmetry import Symmetry, keeping, symmetries
from .nest import nest
from .outlines import HULLS, hull_area
from .packing import Packing, pack, used_length

# cells of the rasters along a sheet on which layouts are packed: half as many as for panels, a quarter of the time, and as many,
# for a layout that saves sheets with one raster alone does so by chance
RASTERS = (256, 512)
# of a patch's area: of the parts between two of these the straightest cuts are tried; not measured
SHARES = (0.08, 0.2, 0.35, 0.5)
EACH = 2  # cuts of each such share that are tried for a patch; not measured, it bounds the time
# times the seconds for nesting that may be spent on looking for cuts
LONGEST = 10.0
LARGE = 0.08  # share of a sheet; a smaller patch is not cut; not measured, the cuts that paid went through larger ones
MOST = 12  # cuts that are made one after the other; on four surfaces two to six paid
BEAM = 8  # layouts that are cut on; each is packed the quick way too, which takes half a second for 23 panels
PATIENCE = 2  # cuts in a row that may not pay: two together may, where one alone does not
# In the end so many layouts of which convex hulls promise most are nested. Those after them, up to so many in all, share ALL times the
# seconds for nesting, and the best FINALISTS of these are nested for as long as the first. On two surfaces the best layout was the first
# and the sixth; the other numbers bound the time and are not measured
PROMISING, NESTED, ALL, FINALISTS = 5, 12, 2.0, 2
# of a quad at an open border, how much narrower a panel is there where the outer arms are left out: the average of seven surfaces
LEFT_OUT = 0.2


def fewer_sheets(flat: FlatPatches, settings: Settings, progress: Progress = SILENT) -> FlatPatches:
    """The patches cut further, if one sheet less takes at most ``sheet.cut_joints`` joints more; else as they are.

    What is saved counts in sheets, the emptiest one as far as it is used: half a sheet is worth half as many joints. The
    notes of the layout's report say what was done.
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
        """What each pays, in joints, and the sheets that it needs, the best first."""
        found = []
        for number, one in enumerate(some):
            pieces, within = outlines(one, settings.spiral), part.part(number / len(some), (number + 1) / len(some))
            need = sheets_needed(nest(pieces, params, within), pieces, sheet)
            found.append((_worth(before - need, joints(one.layout) - joints(flat.layout), sheet), need, one))
        return sorted(found, key=lambda one: -one[0])

    few += [one for _, _, one in rated(others, short, progress.part(0.6, 0.7))[:FINALISTS]]
    last = rated(few, sheet, progress.part(0.7, 1.0))
    if not last or last[0][0] <= 0.0:
        return flat
    _, need, best = last[0]
    return _noted(best, flat, settings.layout, before, need)


def outlines(flat: FlatPatches, spiral: SpiralParams) -> list[Float[np.ndarray, "_ 2"]]:
    """About the outlines that the panels of flat patches will have, metres: of their quads, at open borders with more or less."""
    points = _filled(flat, spiral)
    return [points[loop] for loop in flat.outlines]


def _filled(flat: FlatPatches, spiral: SpiralParams) -> Float[np.ndarray, "vertices 2"]:
    """Metres: the flat vertices, those of open borders moved in for arms that are left out and out for a rim."""
    layout, points = flat.layout, flat.points
    if spiral.border not in ("left_out", "rim"):
        return points
    quad, side = np.nonzero(layout.mesh.border[layout.mesh.quad_edges])
    ways = np.zeros((*layout.flat_corners.shape, 2))
    for end, far in ((0, 3), (1, 2)):  # the ends of a side, and what lies across the quad
        at = (side + end) % 4
        inwards = points[layout.flat_corners[quad, (side + far) % 4]] - points[layout.flat_corners[quad, at]]
        if spiral.border == "left_out":
            way = LEFT_OUT * inwards
        else:
            long = np.linalg.norm(inwards, axis=1, keepdims=True)
            way = -(rim_depth(spiral) + spiral.rim_width) / np.maximum(long, 1e-9) * inwards
        np.add.at(ways, (quad, at), way)
    # as far as the quads there say on average
    touched = ways.any(axis=2)
    moved, count = np.zeros_like(points), np.zeros((len(points), 1))
    np.add.at(moved, layout.flat_corners[touched], ways[touched])
    np.add.at(count, layout.flat_corners[touched], 1.0)
    return points + moved / np.maximum(count, 1.0)


def joints(layout: PatchLayout) -> int:
    """How many joints its panels will have."""
    return int(np.count_nonzero(layout.cut))


def sheets_needed(packing: Packing, shapes: list[Float[np.ndarray, "_ 2"]], sheet: SheetParams) -> float:
    """The number of sheets, of which the emptiest counts as far as it is used."""
    used = [used_length(packing, shapes, k) + sheet.margin for k in range(len(packing.sizes))]
    return len(used) - 1 + min(min(used) / sheet.sheet_width, 1.0)


def _worth(saved: float, more: int, sheet: SheetParams) -> float:
    """What saving so many sheets with so many joints more pays, in joints."""
    return sheet.cut_joints * saved - more


def by_hulls(hulls: Sequence[float], sheet: SheetParams) -> float:
    """Sheets that shapes whose convex hulls have these areas, square metres, are expected to need once they are nested.

    Each bears so much of them, the large ones first.
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


def _noted(made: FlatPatches, flat: FlatPatches, params: LayoutParams, before: float, after: float) -> FlatPatches:
    """The same with what was done in the notes of its report."""
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
    """The search for cuts that pay, before anything is nested."""

    def __init__(self, flat: FlatPatches, settings: Settings, progress: Progress):
        self.flat, self.params, self.sheet, self.spiral = flat, settings.layout, settings.sheet, settings.spiral
        self.progress = progress
        found = symmetries(flat.layout.mesh, progress=progress.quiet()) if self.params.symmetric else []
        self.mirrored: list[Symmetry] = keeping(found, flat.layout.cut)
        self.known: dict[bytes, list[np.ndarray]] = {}  # the cuts through a patch, by its quads
        self.hulls: dict[bytes, float] = {}  # square metres, by the quads
        self.end = time.monotonic() + LONGEST * self.sheet.nesting_seconds
        self.first = joints(flat.layout)

    def all(self) -> list[FlatPatches]:
        """Layouts with more cuts that are expected to pay, the best first."""
        found: list[tuple[float, FlatPatches]] = []
        beam, paid, idle = [self.flat], 0.0, 0
        start = self._by_hulls(self.flat, _filled(self.flat, self.spiral), self.flat.layout.cut)
        for turn in range(MOST):
            tick = partial(self.progress, turn / MOST, "looking where panels could be cut")
            made = self._beyond(beam, start, tick)
            found += made
            beam = [some for _, some in made]
            most = max((pays for pays, _ in made), default=-np.inf)
            idle = idle + 1 if most <= paid else 0
            paid = max(paid, most)
            if not beam or idle == PATIENCE or time.monotonic() > self.end:
                break
        judged = self._packed_too(found) if found else []
        # the best one of every number of joints: layouts of as many are mostly the same but for a row of quads
        kept: dict[int, FlatPatches] = {}
        for pays, some in sorted(judged, key=lambda one: -one[0]):
            if pays > 0.0:
                kept.setdefault(joints(some.layout), some)
        return list(kept.values())

    def _packed_too(self, found: list[tuple[float, FlatPatches]]) -> list[tuple[float, FlatPatches]]:
        """The layouts with what they pay by the quick packing where that is more, as far as time allows; those of few cuts come first."""
        before = [self._packed(self.flat, cells) for cells in RASTERS]
        judged = []
        for pays, some in found:
            least = np.inf
            for need, cells in zip(before, RASTERS, strict=True):
                if least > pays and time.monotonic() < self.end:
                    least = min(least, self._pays(need - self._packed(some, cells), some.layout.cut))
            judged.append((max(pays, least) if np.isfinite(least) else pays, some))
        return judged

    def _beyond(
        self, beam: list[FlatPatches], start: float, tick: Callable[[], None]
    ) -> list[tuple[float, FlatPatches]]:
        """The best layouts with one cut more than those of the beam have, and what each is expected to pay in joints."""
        rated: dict[bytes, tuple[float, FlatPatches, np.ndarray]] = {}
        for flat in beam:
            points = _filled(flat, self.spiral)
            for edges in self._candidates(flat, tick):
                cut = self._with(flat, edges)
                key = np.packbits(cut).tobytes()
                if key not in rated:
                    rated[key] = self._pays(start - self._by_hulls(flat, points, cut), cut), flat, cut
        made: list[tuple[float, FlatPatches]] = []
        for pays, flat, cut in sorted(rated.values(), key=lambda one: -one[0]):
            if len(made) == BEAM or (made and time.monotonic() > self.end):
                break
            with suppress(FlexMapsError):  # a cut and its images may cross
                made.append((pays, with_cuts(flat, cut, self.params, self.progress.quiet())))
        return made

    def _pays(self, saved: float, cut: Bool[np.ndarray, " edges"]) -> float:
        """What saving so many sheets by these cuts pays, in joints."""
        return _worth(saved, int(np.count_nonzero(cut)) - self.first, self.sheet)

    def _with(self, flat: FlatPatches, edges: np.ndarray) -> Bool[np.ndarray, " edges"]:
        """The cuts with a run and its mirror images."""
        cut = flat.layout.cut.copy()
        for image in (edges, *(one.edges[edges] for one in self.mirrored)):
            cut[image] = True
        return cut

    def _by_hulls(
        self, flat: FlatPatches, points: Float[np.ndarray, "vertices 2"], cut: Bool[np.ndarray, " edges"]
    ) -> float:
        """Sheets that the patches between cuts are expected to need; more cuts than the flat patches' own are allowed.

        A hull is kept from the first layout that has these quads in one piece: in another they lie nearly alike.
        """
        areas = []
        for quads in PatchLayout(flat.layout.mesh, cut).patches:
            key = quads.tobytes()
            if key not in self.hulls:
                self.hulls[key] = hull_area(points[flat.layout.flat_corners[quads]].reshape(-1, 2))
            areas.append(self.hulls[key])
        return by_hulls(areas, self.sheet)

    def _packed(self, flat: FlatPatches, cells: int) -> float:
        """Sheets that the quick packing needs."""
        p, shapes = self.sheet, outlines(flat, self.spiral)
        found = pack(
            shapes, (p.sheet_width, p.sheet_height), p.margin, p.spacing, self.progress.quiet(), p.rotation, cells
        )
        return sheets_needed(found, shapes, p)

    def _candidates(self, flat: FlatPatches, tick: Callable[[], None]) -> Iterator[np.ndarray]:
        """The edges of straight cuts through patches into parts of several shares, as far as time allows."""
        for patch, quads in enumerate(flat.layout.patches):
            tick()
            if time.monotonic() > self.end:
                return
            key = quads.tobytes()
            if key not in self.known:
                self.known[key] = self._straight(flat, patch, tick)
            yield from self.known[key]

    def _straight(self, flat: FlatPatches, patch: int, tick: Callable[[], None]) -> list[np.ndarray]:
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
        piece, found = Piece.of(flat, patch), list[np.ndarray]()
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
                    found.append(edges)
        return found

"""Search for sets of panels that fill a sheet; spyrrow finds out whether a set fits (see ``strip``).

Sheets are filled one after the other. Each begins with the largest panel that is left. Random sets with this panel are
tried, first those that probably fit and cover the largest area, as many at once as there are cores.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from ...arrays import Float
from ...params import SheetParams
from ...progress import Progress
from ...surface.checking.finding import with_count
from ...workers import WorkerDied, Workers, as_completed
from .outlines import HULL_SHARE_DEVIATION, MEAN_HULL_SHARE, grow_outline, hull_area
from .packing import Packing, find_fitting_rotation, min_area_box, pack, preferred_box, used_length
from .strip import PackedStrip, StripTask, pack_strip

ROTATION_STEP = 5.0  # degrees between the rotations tried for a panel; smaller packs tighter and takes longer
# Concave bays of the outlines are closed before nesting up to twice this width in metres; the value is limited to a
# quarter of the narrowest panel's width. Larger: fewer points and a faster search, but small panels no longer lie in
# bays
BAY_HALF_WIDTH = 0.012
ROUNDING = 2e-5  # metres added to the spacing because spyrrow calculates in single precision
FIRST_SECONDS = 1  # search time per set of panels at first, seconds; doubled after PATIENCE rounds without improvement
# minimum share of the time limit reserved for compacting the emptiest sheet; larger leaves less time to save sheets
COMPACTING_SHARE = 0.25
# number of consecutive searches, each with a new random seed, that a core makes to compact the emptiest sheet; more
# leave less time for each, but several short searches beat a long one
STARTS = 4
# stop compacting once a new search leaves the strip longer than this share of the shortest strip so far
MIN_SHORTENING = 0.999
RANDOM_SETS = 400  # random sets generated per sheet (10 ms), of which a few are tried; more find better sets
# A set is tried only if the total hull area of its panels is at most this share of that of the set tried before; closer
# to 1, the sets differ less
HULL_STEP = 0.985
TRIES = 8  # maximum number of sets tried for one sheet; more fill a sheet better and leave time for fewer rounds
# PATIENCE: the time per set is doubled after this many rounds without improvement; a round packs all panels. MIN_SETS:
# the search ends when the time per set would allow fewer sets than this within the time limit. Larger: more, shorter
# searches
PATIENCE, MIN_SETS = 4, 12

Places = dict[int, tuple[float, np.ndarray]]  # rotation (radians) and shift (2,) in metres, by index of the panel


class SheetSearch:
    """Search for a packing on few sheets within a time limit, with the sets of panels tried so far.

    separation : distance in metres that nesting keeps between shapes
    outlines : simplified shapes, offset outwards by half of ``separation``, so that they may touch
    rotations : rotations in degrees at which each shape fits on a sheet, least extent along x first; empty if too large
    results : for every set of panels, their positions on a sheet, or None if the set did not fit
    """

    def __init__(
        self, shapes: list[Float[np.ndarray, "_ 2"]], params: SheetParams, workers: Workers, progress: Progress
    ):
        import shapely

        self.shapes, self.params, self.workers, self.progress = shapes, params, workers, progress
        self.begin = time.monotonic()
        self.usable_size = np.array([params.sheet_width, params.sheet_height]) - 2.0 * params.margin
        self.separation = params.spacing + ROUNDING
        bay = max(
            min(BAY_HALF_WIDTH, 0.25 * min(float(min_area_box(s)[1].min()) for s in shapes)), 0.5 * params.spacing
        )
        each = progress.part(0.0, 0.0).each(shapes, "simplifying the panels")
        self.outlines = [grow_outline(shape, 0.5 * self.separation, bay) for shape in each]
        self.rotations = [self._fitting_rotations(outline) for outline in self.outlines]
        self.hull_areas = np.array([hull_area(s) for s in shapes])
        self.areas = np.array([shapely.Polygon(outline).area for outline in self.outlines])
        self.results: dict[frozenset[int], Places | None] = {}
        self.seconds_per_set = FIRST_SECONDS

    def find_best_packing(self, quick: Packing) -> Packing:
        """Return the best packing found within the time limit; ``quick`` if no better one is found."""
        best, idle, rng = quick, 0, np.random.default_rng(self.params.seed)
        while len(best.sizes) > 1 and self._has_time_left:
            made = self._fill_sheets(rng, quick)
            idle += 1
            if self._rank(made) < self._rank(best) and self._keeps_distances(made):
                best, idle = made, 0
            elif idle == PATIENCE:  # try sets that did not fit again, with more time
                idle, self.seconds_per_set = 0, 2 * self.seconds_per_set
                self.results = {members: places for members, places in self.results.items() if places}
                if self.seconds_per_set * MIN_SETS > self._seconds:
                    break
        made = self._compact_emptiest_sheet(best)
        return made if self._keeps_distances(made) else best

    @property
    def _seconds(self) -> float:
        """The time limit in seconds."""
        return max(self.params.nesting_seconds, 1e-9)

    @property
    def share_of_time(self) -> float:
        """The share of the time limit that has elapsed."""
        return (time.monotonic() - self.begin) / self._seconds

    @property
    def _has_time_left(self) -> bool:
        """Whether time is left to try more sets."""
        return self.share_of_time < 1.0 - max(COMPACTING_SHARE, 0.5 * FIRST_SECONDS / self._seconds)

    def _rank(self, packing: Packing) -> tuple[int, float]:
        """Return the rank of a packing, lower is better: number of sheets, then hull area on the emptiest sheet, m2."""
        return len(packing.sizes), float(np.bincount(packing.sheet, self.hull_areas, len(packing.sizes)).min())

    def _fitting_rotations(self, shape: np.ndarray) -> list[float]:
        """Return the rotations in degrees at which an outline fits on a sheet; least extent along x first.

        shape : outline, offset outwards by half of ``separation``
        """
        room = self.usable_size + self.separation
        base = np.degrees(preferred_box(shape, self.params.rotation)[0])
        step = {"FREE": ROTATION_STEP, "QUARTER": 90.0, "GRAIN": 180.0}[self.params.rotation]
        angles = base + np.arange(0.0, 360.0, step)
        turn = find_fitting_rotation(shape, (float(room[0]), float(room[1])), 0.0, self.params.rotation)
        if turn is not None:
            angles = np.concatenate([angles, np.degrees(turn) + np.array([0.0, 180.0])])
        cos, sin = np.cos(np.radians(angles)), np.sin(np.radians(angles))
        wide = np.ptp(shape[:, :1] * cos - shape[:, 1:] * sin, axis=0)
        high = np.ptp(shape[:, :1] * sin + shape[:, 1:] * cos, axis=0)
        order = np.argsort(wide, kind="stable")
        return angles[order][(wide <= room[0])[order] & (high <= room[1])[order]].tolist()

    def _keeps_distances(self, packing: Packing) -> bool:
        """Return whether the true shapes keep margin and spacing."""
        import shapely
        from shapely import affinity

        placed = []
        for i, shape in enumerate(self.shapes):
            turned = affinity.rotate(shapely.Polygon(shape), packing.rotation[i], origin=(0, 0), use_radians=True)
            placed.append(affinity.translate(turned, *packing.shift[i]))
            x0, y0, x1, y1 = placed[-1].bounds
            width, height = packing.sizes[packing.sheet[i]]
            if min(x0, y0, width - x1, height - y1) < self.params.margin - 1e-9:
                return False
        tree = shapely.STRtree(placed)
        one, two = tree.query(placed, predicate="dwithin", distance=max(self.params.spacing - 1e-9, 0.0))
        together = (one < two) & (packing.sheet[one] == packing.sheet[two])
        return not bool(together.any())

    # -- filling sheets ------------------------------------------------------------------------------------------------

    def _fill_sheets(self, rng: np.random.Generator, rough: Packing) -> Packing:
        """Pack all panels: fill sheets one by one, large panels first, slightly shuffled except in the first round.

        The panels on a sheet must have a larger total area than those on the sheet of the quick packing ``rough`` that
        contains the same first panel. Panels left when the time has elapsed, and panels larger than a sheet, are packed
        by ``pack``.
        """
        order = self.areas * np.exp(0.25 * rng.standard_normal(len(self.areas)) * bool(self.results))
        rest = [i for i in np.argsort(-order, kind="stable").tolist() if self.rotations[i]]
        sheets: list[Places] = []
        while rest and self._has_time_left:
            beside = np.flatnonzero(rough.sheet == rough.sheet[rest[0]]).tolist()
            least = float(self.areas[[i for i in beside if i in rest]].sum())
            sheets.append(self._fill_sheet(rest, least, rng))
            rest = [i for i in rest if i not in sheets[-1]]
        sizes = [(self.params.sheet_width, self.params.sheet_height)] * len(sheets)
        if left := [*rest, *(i for i, turns in enumerate(self.rotations) if not turns)]:
            last = self._pack_quickly(left)
            sheets += _places_by_sheet(last, left)
            sizes += [(width, height) for width, height in last.sizes.tolist()]
        sheet, rotation, shift = np.zeros(len(order), dtype=np.int64), np.zeros(len(order)), np.zeros((len(order), 2))
        for k, places in enumerate(sheets):
            for i, (turn, move) in places.items():
                sheet[i], rotation[i], shift[i] = k, turn, move
        return Packing(sheet, rotation, shift, np.array(sizes))

    def _fill_sheet(self, rest: list[int], least: float, rng: np.random.Generator) -> Places:
        """Fill a sheet as well as possible with panels of ``rest``, including ``rest[0]``, and return their positions.

        If no set that fits has outlines of more than ``least`` m2 in total, pack all of ``rest`` quickly, and return
        the sheet that contains ``rest[0]``.
        """
        at_once, limit = max(self.workers.count, 2), np.inf
        for _ in range(max(TRIES // at_once, 1)):
            sets = list[frozenset[int]]()
            for members in self._random_sets(rest, least, rng) if self._has_time_left else ():
                hulls = float(self.hull_areas[list(members)].sum())
                if hulls <= limit and len(sets) < at_once:
                    sets.append(members)
                    limit = HULL_STEP * hulls
            self._try_sets(sets)
            if not sets or any(self.results[members] for members in sets):
                break
        left = frozenset(rest)
        fit = [
            m for m, places in self.results.items() if places and rest[0] in m <= left and self._total_area(m) > least
        ]
        if fit:
            places = self.results[max(fit, key=self._total_area)]
            assert places is not None
            return places
        return next(places for places in _places_by_sheet(self._pack_quickly(rest), rest) if rest[0] in places)

    def _total_area(self, members: frozenset[int]) -> float:
        """Return the total area of the outlines of panels in m2."""
        return float(self.areas[list(members)].sum())

    def _random_sets(self, rest: list[int], least: float, rng: np.random.Generator) -> list[frozenset[int]]:
        """Return new random sets with panel ``rest[0]`` that cover more than ``least`` m2, most promising first.

        Sets are ordered by the area they cover beyond ``least``, times the probability that they fit. The share of the
        sheet up to which hulls fit is assumed to have a logistic distribution with mean ``MEAN_HULL_SHARE`` and
        standard deviation ``HULL_SHARE_DEVIATION``.
        """
        first, others, sheet = rest[0], np.array(rest[1:], dtype=np.int64), float(self.usable_size.prod())
        failed = [members for members, places in self.results.items() if places is None]
        found: dict[frozenset[int], float] = {}
        for _ in range(RANDOM_SETS if len(others) else 0):
            some, left = (
                {first},
                (MEAN_HULL_SHARE + rng.uniform(-2.0, 1.5) * HULL_SHARE_DEVIATION) * sheet - self.hull_areas[first],
            )
            for i in rng.permutation(others).tolist():
                if self.hull_areas[i] <= left:
                    some.add(i)
                    left -= self.hull_areas[i]
            members = frozenset(some)
            gain = self._total_area(members) - least
            if gain > 0.0 and members not in self.results and not any(fewer <= members for fewer in failed):
                beyond = float(self.hull_areas[list(members)].sum()) / sheet - MEAN_HULL_SHARE
                found[members] = gain / (1.0 + math.exp(beyond * math.pi / (math.sqrt(3.0) * HULL_SHARE_DEVIATION)))
        return sorted(found, key=lambda members: -found[members])

    def _try_sets(self, sets: Sequence[frozenset[int]]) -> None:
        """Try to pack every set of panels on a sheet of its own, and store the results in ``results``."""
        found = self._pack_strips(
            [self._strip_task(members, self.seconds_per_set, 0, float(self.usable_size[0])) for members in sets]
        )
        for members, strip in zip(sets, found, strict=True):
            self.results[members] = self._places_on_sheet(strip)

    def _pack_quickly(self, panels: list[int]) -> Packing:
        """Pack the panels with these indices quickly, with ``packing.pack``."""
        p = self.params
        size = p.sheet_width, p.sheet_height
        return pack([self.shapes[i] for i in panels], size, p.margin, p.spacing, rotation=p.rotation)

    # -- strips --------------------------------------------------------------------------------------------------------

    def pack_shortest_strip(self, members: frozenset[int], seconds: float) -> PackedStrip | None:
        """Return the shortest strip (metres) of panels ``members`` that any core finds in ``seconds``, or else None.

        Every core searches several times with new seeds, because results differ more by seed than by duration.
        """
        end, turn, start = time.monotonic() + seconds, max(FIRST_SECONDS, int(seconds / STARTS)), 0
        best: PackedStrip | None = None
        while best is None or time.monotonic() + turn <= end:
            tasks = [self._strip_task(members, turn, start + k) for k in range(self.workers.count)]
            found = min((s for s in self._pack_strips(tasks) if s is not None), key=lambda s: s.length, default=None)
            if found is None or (best is not None and found.length > MIN_SHORTENING * best.length):
                break
            best, start = found, start + len(tasks)
        return best

    def _compact_emptiest_sheet(self, packing: Packing) -> Packing:
        """Compact the panels of the emptiest sheet, so that a larger offcut is left."""
        k = int(np.argmin(np.bincount(packing.sheet, self.hull_areas, len(packing.sizes))))
        members = frozenset(np.flatnonzero(packing.sheet == k).tolist())
        if not all(self.rotations[i] for i in members):
            return packing
        places = self._place_alone(*members) if len(members) == 1 else None
        places = places or self._places_on_sheet(
            self.pack_shortest_strip(members, (1.0 - self.share_of_time) * self._seconds)
        )
        if places is None:
            return packing
        rotation, shift = packing.rotation.copy(), packing.shift.copy()
        for i, (turn, move) in places.items():
            rotation[i], shift[i] = turn, move
        made = Packing(packing.sheet, rotation, shift, packing.sizes)
        return min(packing, made, key=lambda one: used_length(one, self.shapes, k))

    def _place_alone(self, i: int) -> Places:
        """Place a single panel in the corner of its sheet, turned so that it takes the least of the sheet's length."""
        turn = math.radians(self.rotations[i][0])
        cos, sin = math.cos(turn), math.sin(turn)
        return {i: (turn, self.params.margin - (self.shapes[i] @ np.array([[cos, sin], [-sin, cos]])).min(axis=0))}

    def _strip_task(self, members: frozenset[int], seconds: int, start: int, enough: float = 0.0) -> StripTask:
        """Return the task (in millimetres) of packing the panels ``members`` into a strip as high as a sheet.

        The search takes ``seconds``, or ends early once the strip is no longer than ``enough`` metres, if that is not
        0. Its seed is that of the settings plus ``start``.
        """
        items = [
            (i, [(x, y) for x, y in (1e3 * self.outlines[i]).tolist()], self.rotations[i]) for i in sorted(members)
        ]
        high = 1e3 * float(self.usable_size[1] + self.separation)
        return StripTask(
            items, high, seconds, self.params.seed + start, 1e3 * (enough + self.separation) if enough else 0.0
        )

    def _pack_strips(self, tasks: Sequence[StripTask]) -> list[PackedStrip | None]:
        """Pack strips in parallel; return them in metres, or None for tasks that failed.

        The positions start at the lower left corner of the sheet's area within its margin.
        """
        most = max((len(task.items) for task in tasks), default=0)
        progress = self.progress.at(min(self.share_of_time, 1.0), f"nesting {with_count(most, 'panel', 'panels')}")
        found: list[PackedStrip | None] = [None] * len(tasks)
        for number, future in as_completed(self.workers, pack_strip, tasks, progress):
            with suppress(WorkerDied):  # for lack of memory, for example; the task then fails
                found[number] = future.result()
        return [strip and self._in_metres(strip) for strip in found]

    def _in_metres(self, strip: PackedStrip) -> PackedStrip:
        """Convert a strip of ``outlines`` in millimetres to a strip of the true shapes, not offset, in metres."""
        half = 0.5 * self.separation
        places = {i: (turn, (1e-3 * x - half, 1e-3 * y - half)) for i, (turn, (x, y)) in strip.places.items()}
        return PackedStrip(1e-3 * strip.length - self.separation, places)

    def _places_on_sheet(self, strip: PackedStrip | None) -> Places | None:
        """Return the positions of a strip's panels on a sheet; None if the strip is longer than the sheet."""
        if strip is None or strip.length > self.usable_size[0]:
            return None
        margin = self.params.margin
        return {i: (math.radians(turn), np.array(move) + margin) for i, (turn, move) in strip.places.items()}


def _places_by_sheet(packing: Packing, panels: Sequence[int]) -> list[Places]:
    """Return the positions in ``packing``, one dictionary per sheet; ``panels`` are the indices of the panels in it."""
    sheets: list[Places] = [{} for _ in packing.sizes]
    for k, i in enumerate(panels):
        sheets[packing.sheet[k]][i] = float(packing.rotation[k]), packing.shift[k]
    return sheets

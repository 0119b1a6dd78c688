"""Search for full sheets: sets of panels about as large as a sheet can hold, each tried by spyrrow (see ``strip``).

Sheets are filled in turn: the first panel is the largest that is left, and among the sets with this panel those that
probably fit and cover most are tried first, as many at once as there are cores.
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
from ...workers import WorkerDied, Workers, as_done
from .outlines import HULLS, SPREAD, grow_outline, hull_area
from .packing import Packing, least_box, lying_box, pack, turn_that_fits, used_length
from .strip import PackedStrip, StripTask, pack_strip

STEP = 5.0  # degrees between the orientations tried for a panel
BAY = 0.012  # metres; bays narrower than twice this, or than half of the narrowest panel, are closed
ROUNDING = 2e-5  # metres added to the spacing because spyrrow calculates in single precision
TURN = 1  # seconds for one set of panels at first
LAST = 0.25  # minimum share of the time limit for compacting the emptiest sheet
# starts per core for the shortest strip of a set: starts differ by 4 %, and three seconds gain 0.3 % over one
STARTS = 4
SHORTER = 0.999  # a further start continues the search if its strip is at most this many times as long
RANDOM_SETS = 400  # random sets generated per sheet, of which a few are tried; 10 ms
HULL_STEP = 0.985  # hulls of the next set to try cover at most this share of the last one's
TRIES = 8  # maximum number of sets tried for one sheet
# Successive orders without an improvement before the time per set is doubled, and minimum number of sets in the time limit
PATIENCE, FEWEST = 4, 12

Places = dict[int, tuple[float, np.ndarray]]  # angle (radians) and shift (2,), metres, by panel


class SheetSearch:
    """The sets of panels tried so far, and the remaining time.

    outlines : simplified shapes grown by half of the separation, so that they may touch
    turns : for each shape the angles in degrees in which it fits on a sheet, the narrowest first; none if it is too large
    tried : places of the panels on a sheet by set, None for sets that did not fit
    """

    def __init__(
        self, shapes: list[Float[np.ndarray, "_ 2"]], params: SheetParams, workers: Workers, progress: Progress
    ):
        import shapely

        self.shapes, self.params, self.workers, self.progress = shapes, params, workers, progress
        self.begin = time.monotonic()
        self.free = np.array([params.sheet_width, params.sheet_height]) - 2.0 * params.margin
        self.separation = params.spacing + ROUNDING
        bay = max(min(BAY, 0.25 * min(float(least_box(s)[1].min()) for s in shapes)), 0.5 * params.spacing)
        each = progress.part(0.0, 0.0).each(shapes, "simplifying the panels")
        self.outlines = [grow_outline(shape, 0.5 * self.separation, bay) for shape in each]
        self.turns = [self._turns(outline) for outline in self.outlines]
        self.hull = np.array([hull_area(s) for s in shapes])
        self.area = np.array([shapely.Polygon(outline).area for outline in self.outlines])
        self.tried: dict[frozenset[int], Places | None] = {}
        self.turn = TURN

    def best(self, rough: Packing) -> Packing:
        """Return the best packing found in time, or the rough one."""
        best, idle, rng = rough, 0, np.random.default_rng(self.params.seed)
        while len(best.sizes) > 1 and self._going:
            made = self._filled(rng, rough)
            idle += 1
            if self._rank(made) < self._rank(best) and self._keeps_distances(made):
                best, idle = made, 0
            elif idle == PATIENCE:  # give sets that did not fit more time
                idle, self.turn = 0, 2 * self.turn
                self.tried = {members: places for members, places in self.tried.items() if places}
                if self.turn * FEWEST > self._seconds:
                    break
        made = self._shortened(best)
        return made if self._keeps_distances(made) else best

    @property
    def _seconds(self) -> float:
        """The time limit."""
        return max(self.params.nesting_seconds, 1e-9)

    @property
    def share_of_time(self) -> float:
        """The share of the time limit that has elapsed."""
        return (time.monotonic() - self.begin) / self._seconds

    @property
    def _going(self) -> bool:
        """Whether time is left to try more sets."""
        return self.share_of_time < 1.0 - max(LAST, 0.5 * TURN / self._seconds)

    def _rank(self, packing: Packing) -> tuple[int, float]:
        """Return the number of sheets, and the area in m2 of the hulls on the emptiest, which decides its length."""
        return len(packing.sizes), float(np.bincount(packing.sheet, self.hull, len(packing.sizes)).min())

    def _turns(self, shape: np.ndarray) -> list[float]:
        """Return the angles in degrees in which a grown shape fits on a sheet."""
        room = self.free + self.separation
        base = np.degrees(lying_box(shape, self.params.rotation)[0])
        step = {"FREE": STEP, "QUARTER": 90.0, "GRAIN": 180.0}[self.params.rotation]
        angles = base + np.arange(0.0, 360.0, step)
        turn = turn_that_fits(shape, (float(room[0]), float(room[1])), 0.0, self.params.rotation)
        if turn is not None:
            angles = np.concatenate([angles, np.degrees(turn) + np.array([0.0, 180.0])])
        cos, sin = np.cos(np.radians(angles)), np.sin(np.radians(angles))
        wide = np.ptp(shape[:, :1] * cos - shape[:, 1:] * sin, axis=0)
        high = np.ptp(shape[:, :1] * sin + shape[:, 1:] * cos, axis=0)
        order = np.argsort(wide, kind="stable")
        return angles[order][(wide <= room[0])[order] & (high <= room[1])[order]].tolist()

    def _keeps_distances(self, packing: Packing) -> bool:
        """Return whether the true shapes keep the required distances exactly."""
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

    def _filled(self, rng: np.random.Generator, rough: Packing) -> Packing:
        """Fill sheets one by one, large panels first, in a slightly shuffled order once sets have been tried.

        Panels left when the time has elapsed, and those larger than a sheet, are packed the quick way.
        """
        order = self.area * np.exp(0.25 * rng.standard_normal(len(self.area)) * bool(self.tried))
        rest = [i for i in np.argsort(-order, kind="stable").tolist() if self.turns[i]]
        sheets: list[Places] = []
        while rest and self._going:
            beside = np.flatnonzero(rough.sheet == rough.sheet[rest[0]]).tolist()
            least = float(self.area[[i for i in beside if i in rest]].sum())
            sheets.append(self._fullest(rest, least, rng))
            rest = [i for i in rest if i not in sheets[-1]]
        sizes = [(self.params.sheet_width, self.params.sheet_height)] * len(sheets)
        if left := [*rest, *(i for i, turns in enumerate(self.turns) if not turns)]:
            last = self._pack(left)
            sheets += _places(last, left)
            sizes += [(width, height) for width, height in last.sizes.tolist()]
        sheet, rotation, shift = np.zeros(len(order), dtype=np.int64), np.zeros(len(order)), np.zeros((len(order), 2))
        for k, places in enumerate(sheets):
            for i, (turn, move) in places.items():
                sheet[i], rotation[i], shift[i] = k, turn, move
        return Packing(sheet, rotation, shift, np.array(sizes))

    def _fullest(self, rest: list[int], least: float, rng: np.random.Generator) -> Places:
        """Return the fullest sheet found with the first of some panels that covers more than ``least`` m2.

        If none is found, return the sheet of the quick packing that has the first panel.
        """
        at_once, limit = max(self.workers.count, 2), np.inf
        for _ in range(max(TRIES // at_once, 1)):
            sets = list[frozenset[int]]()
            for members in self._random_sets(rest, least, rng) if self._going else ():
                hulls = float(self.hull[list(members)].sum())
                if hulls <= limit and len(sets) < at_once:
                    sets.append(members)
                    limit = HULL_STEP * hulls
            self._try(sets)
            if not sets or any(self.tried[members] for members in sets):
                break
        left = frozenset(rest)
        fit = [m for m, places in self.tried.items() if places and rest[0] in m <= left and self._cover(m) > least]
        if fit:
            places = self.tried[max(fit, key=self._cover)]
            assert places is not None
            return places
        return next(places for places in _places(self._pack(rest), rest) if rest[0] in places)

    def _cover(self, members: frozenset[int]) -> float:
        """Return the area in m2 that panels cover."""
        return float(self.area[list(members)].sum())

    def _random_sets(self, rest: list[int], least: float, rng: np.random.Generator) -> list[frozenset[int]]:
        """Return new random sets with the first of some panels that cover more than ``least`` m2, most promising first.

        The probability that a set fits is a logistic distribution with the mean and standard deviation of ``HULLS``.
        """
        first, others, sheet = rest[0], np.array(rest[1:], dtype=np.int64), float(self.free.prod())
        failed = [members for members, places in self.tried.items() if places is None]
        found: dict[frozenset[int], float] = {}
        for _ in range(RANDOM_SETS if len(others) else 0):
            some, left = {first}, (HULLS + rng.uniform(-2.0, 1.5) * SPREAD) * sheet - self.hull[first]
            for i in rng.permutation(others).tolist():
                if self.hull[i] <= left:
                    some.add(i)
                    left -= self.hull[i]
            members = frozenset(some)
            gain = self._cover(members) - least
            if gain > 0.0 and members not in self.tried and not any(fewer <= members for fewer in failed):
                beyond = float(self.hull[list(members)].sum()) / sheet - HULLS
                found[members] = gain / (1.0 + math.exp(beyond * math.pi / (math.sqrt(3.0) * SPREAD)))
        return sorted(found, key=lambda members: -found[members])

    def _try(self, sets: Sequence[frozenset[int]]) -> None:
        """Determine whether sets of panels fit on a sheet each."""
        found = self._strips([self._task(members, self.turn, 0, float(self.free[0])) for members in sets])
        for members, strip in zip(sets, found, strict=True):
            self.tried[members] = self._on_sheet(strip)

    def _pack(self, some: list[int]) -> Packing:
        """Return the quick packing of some panels."""
        p = self.params
        size = p.sheet_width, p.sheet_height
        return pack([self.shapes[i] for i in some], size, p.margin, p.spacing, rotation=p.rotation)

    # -- strips --------------------------------------------------------------------------------------------------------

    def shortest(self, members: frozenset[int], seconds: float) -> PackedStrip | None:
        """Return the shortest strip of some panels that all cores find in some seconds, in metres.

        Every core starts repeatedly, because starts differ by more than a longer search gains.
        """
        end, turn, start = time.monotonic() + seconds, max(TURN, int(seconds / STARTS)), 0
        best: PackedStrip | None = None
        while best is None or time.monotonic() + turn <= end:
            tasks = [self._task(members, turn, start + k) for k in range(self.workers.count)]
            found = min((s for s in self._strips(tasks) if s is not None), key=lambda s: s.length, default=None)
            if found is None or (best is not None and found.length > SHORTER * best.length):
                break
            best, start = found, start + len(tasks)
        return best

    def _shortened(self, packing: Packing) -> Packing:
        """Compact the panels of the emptiest sheet, so that a larger offcut is left."""
        k = int(np.argmin(np.bincount(packing.sheet, self.hull, len(packing.sizes))))
        members = frozenset(np.flatnonzero(packing.sheet == k).tolist())
        if not all(self.turns[i] for i in members):
            return packing
        places = self._alone(*members) if len(members) == 1 else None
        places = places or self._on_sheet(self.shortest(members, (1.0 - self.share_of_time) * self._seconds))
        if places is None:
            return packing
        rotation, shift = packing.rotation.copy(), packing.shift.copy()
        for i, (turn, move) in places.items():
            rotation[i], shift[i] = turn, move
        made = Packing(packing.sheet, rotation, shift, packing.sizes)
        return min(packing, made, key=lambda one: used_length(one, self.shapes, k))

    def _alone(self, i: int) -> Places:
        """Return a panel by itself, turned to take the least of its sheet's length."""
        turn = math.radians(self.turns[i][0])
        cos, sin = math.cos(turn), math.sin(turn)
        return {i: (turn, self.params.margin - (self.shapes[i] @ np.array([[cos, sin], [-sin, cos]])).min(axis=0))}

    def _task(self, members: frozenset[int], seconds: int, start: int, enough: float = 0.0) -> StripTask:
        """Return the task of packing panels into a strip as high as a sheet; ``enough`` metres are short enough."""
        items = [(i, [(x, y) for x, y in (1e3 * self.outlines[i]).tolist()], self.turns[i]) for i in sorted(members)]
        high = 1e3 * float(self.free[1] + self.separation)
        return StripTask(
            items, high, seconds, self.params.seed + start, 1e3 * (enough + self.separation) if enough else 0.0
        )

    def _strips(self, tasks: Sequence[StripTask]) -> list[PackedStrip | None]:
        """Return the strips of some tasks, packed at once, in metres within the margins of a sheet."""
        most = max((len(task.items) for task in tasks), default=0)
        progress = self.progress.at(min(self.share_of_time, 1.0), f"nesting {with_count(most, 'panel', 'panels')}")
        found: list[PackedStrip | None] = [None] * len(tasks)
        for number, future in as_done(self.workers, pack_strip, tasks, progress):
            with suppress(WorkerDied):  # there may be too little memory
                found[number] = future.result()
        return [strip and self._in_metres(strip) for strip in found]

    def _in_metres(self, strip: PackedStrip) -> PackedStrip:
        """Convert a strip of grown shapes in millimetres to one of shapes in metres."""
        half = 0.5 * self.separation
        places = {i: (turn, (1e-3 * x - half, 1e-3 * y - half)) for i, (turn, (x, y)) in strip.places.items()}
        return PackedStrip(1e-3 * strip.length - self.separation, places)

    def _on_sheet(self, strip: PackedStrip | None) -> Places | None:
        """Return the places of a strip's panels on a sheet; None if the strip is longer."""
        if strip is None or strip.length > self.free[0]:
            return None
        margin = self.params.margin
        return {i: (math.radians(turn), np.array(move) + margin) for i, (turn, move) in strip.places.items()}


def _places(packing: Packing, some: Sequence[int]) -> list[Places]:
    """Return the places of panels ``some`` in their packing, by sheet."""
    sheets: list[Places] = [{} for _ in packing.sizes]
    for k, i in enumerate(some):
        sheets[packing.sheet[k]][i] = float(packing.rotation[k]), packing.shift[k]
    return sheets

"""Nesting: the true shapes of the panels laid on sheets of one size as tightly as a time limit allows, by spyrrow.

spyrrow (the sparrow algorithm of Gardeyn, Vanden Berghe and Wauters 2025) packs a strip of fixed height as short as it
can. Sheets are filled one panel at a time, the large ones first: a set of panels goes on a sheet if its strip is no longer
than the sheet. What the quick packing finds is the first answer, so that there is one however short the time is.
"""

from __future__ import annotations

import importlib.util
import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...arrays import Float
from ...params import SheetParams
from ...progress import SILENT, Progress
from .odd import on_remnants
from .packing import Packing, least_box, lying_box, pack, turn_that_fits, used_length
from .process import Strip, Worker, python
from .remnants import read

STEP = 5.0  # degrees between the directions in which a panel is tried
STRAYS = (1e-4, 2e-4, 4e-4, 8e-4, 1.6e-3)  # metres by which shapes may be simplified, outwards only
POINTS = 80  # most points that a simplified shape should have: spyrrow takes a second to read a few hundred
BAY = 0.012  # metres; bays narrower than twice this are closed, and those narrower than half of the narrowest panel
# share of that width in a first round, and metres by which outlines may stray between the rounds: on 21 panels of 180 quads with
# 12,500 points each 0.9 s instead of 9.7 s, and shapes whose areas differ by 3 in 10,000
SLOT, COARSE = 0.125, 8e-5
ROUNDING = 2e-5  # metres added to the spacing, for spyrrow reckons with single precision
FULLEST = 1.05  # share of a sheet that the convex hulls of a set of panels may have for the set to be tried
PATIENCE = 4  # orders tried in a row without an improvement before the search ends
TURN = 1  # seconds for one set of panels
GRACE = 1.0  # seconds that spyrrow may take longer than it was told; it is stopped then, and the best that it told of counts
MANY = 400  # most panels that are searched for; the quick packing fills sheets with so many as well as time allows
LAST = 0.25  # least share of the time limit for drawing the panels of the last sheet together


def nest(shapes: list[Float[np.ndarray, "_ 2"]], params: SheetParams, progress: Progress = SILENT) -> Packing:
    """Lay closed outlines (M, 2), in metres, on as few sheets as found within ``params.nesting_seconds``.

    Those that are to lie along the grain are given with their grain along x.

    Never worse than ``packing.pack``, which it returns where spyrrow is missing or nothing better is found. The seed makes
    the search repeatable as far as a limit in seconds can be. Remnants come first, and are filled by ``odd``.
    """
    remnants = read(params.remnants) if params.remnants.strip() else []
    if remnants:
        odd, rest = on_remnants(shapes, remnants, params, progress.part(0.0, 0.2))
        whole = replace(params, remnants="")
        return _both(odd, rest, nest([shapes[i] for i in rest], whole, progress.part(0.2, 1.0)) if rest else None)
    sheet = (params.sheet_width, params.sheet_height)
    rough = pack(shapes, sheet, params.margin, params.spacing, progress.part(0.0, 0.1), params.rotation)
    if params.nesting != "TRUE" or not available() or not 2 <= len(shapes) <= MANY:
        return rough
    search = _Search(shapes, params, progress.part(0.1, 1.0))
    try:
        return _searched(search, rough)
    finally:
        search.finish()


def strip(
    shapes: list[Float[np.ndarray, "_ 2"]], params: SheetParams, seconds: float, progress: Progress = SILENT
) -> Strip | None:
    """Closed outlines (M, 2) in metres on one endless strip as high as a sheet less its margins, as short as is found in some seconds.

    None without spyrrow, or where a shape is larger than the sheet. The strip begins at 0.
    """
    if not available():
        return None
    search = _Search(shapes, params, progress)
    try:
        found = None if search.large else search._solve(frozenset(range(len(shapes))), 0.0, max(TURN, round(seconds)))
    finally:
        search.finish()
    if found is None:
        return None
    # spyrrow keeps the separation from the border of its strip too
    places = {i: (turn, move - search.separation) for i, (turn, move) in found.places.items()}
    return Strip(found.width - 2.0 * search.separation, places)


def _both(odd: Packing, rest: list[int], whole: Packing | None) -> Packing:
    """Remnants, and after them whole sheets for the panels that found no room on those."""
    if whole is None:
        return odd
    sheet, rotation, shift = odd.sheet.copy(), odd.rotation.copy(), odd.shift.copy()
    sheet[rest], rotation[rest], shift[rest] = len(odd.sizes) + whole.sheet, whole.rotation, whole.shift
    return Packing(sheet, rotation, shift, np.concatenate([odd.sizes, whole.sizes]), odd.remnants)


def _searched(search: _Search, rough: Packing) -> Packing:
    """The best packing that the search finds, or the rough one."""
    shapes, params = search.shapes, search.params
    best, best_worth = rough, _worth(rough, shapes)
    emptied = search.emptied(rough)
    if _worth(emptied, shapes) < best_worth and _sound(emptied, shapes, params):
        best, best_worth = emptied, _worth(emptied, shapes)
    rng = np.random.default_rng(params.seed)
    idle = 0
    while idle < PATIENCE and len(best.sizes) > search.fewest and search.spent() < 1.0 - LAST:
        found = search.fill(rng)
        idle += 1
        if _worth(found, shapes) < best_worth and _sound(found, shapes, params):
            best, best_worth, idle = found, _worth(found, shapes), 0
    tighter = search.shortened(best)
    return tighter if _worth(tighter, shapes) < best_worth and _sound(tighter, shapes, params) else best


def available() -> bool:
    """Whether spyrrow is installed here, and a Python that can be started to run it."""
    return importlib.util.find_spec("spyrrow") is not None and python() is not None


def _worth(packing: Packing, shapes: list[np.ndarray]) -> tuple[int, float]:
    """What is to be small: the number of sheets, then the used length of the emptiest one."""
    lengths = [used_length(packing, shapes, k) for k in range(len(packing.sizes))]
    return len(lengths), round(min(lengths), 6)


def _sound(packing: Packing, shapes: list[np.ndarray], params: SheetParams) -> bool:
    """Whether the asked distances hold between the true shapes, exactly."""
    import shapely
    from shapely import affinity

    placed = []
    for i, shape in enumerate(shapes):
        turned = affinity.rotate(shapely.Polygon(shape), packing.rotation[i], origin=(0, 0), use_radians=True)
        placed.append(affinity.translate(turned, *packing.shift[i]))
        x0, y0, x1, y1 = placed[-1].bounds
        width, height = packing.sizes[packing.sheet[i]]
        if min(x0, y0, width - x1, height - y1) < params.margin - 1e-9:
            return False
    tree = shapely.STRtree(placed)
    one, two = tree.query(placed, predicate="dwithin", distance=max(params.spacing - 1e-9, 0.0))
    together = (one < two) & (packing.sheet[one] == packing.sheet[two])
    return not bool(together.any())


@dataclass(frozen=True, eq=False)
class _Set:
    """Panels that lie together on one sheet: ``places`` holds turn (radians) and shift (2,) metres of every one."""

    places: dict[int, tuple[float, np.ndarray]]
    area: float


class _Search:
    """Shapes made ready for spyrrow, what is known of sets of them, and the time that is left."""

    def __init__(self, shapes: list[np.ndarray], params: SheetParams, progress: Progress):
        self.shapes, self.params, self.progress = shapes, params, progress
        self.begin = time.monotonic()
        self.free = np.array([params.sheet_width, params.sheet_height]) - 2.0 * params.margin
        self.separation = params.spacing + ROUNDING
        bay = min(BAY, 0.25 * min(float(least_box(s)[1].min()) for s in shapes))
        simple = []
        for s in shapes:
            progress(0.0, "simplifying the panels")
            simple.append(_simplified(s, max(bay, 0.5 * params.spacing)))
        self.hull = np.array([_hull_area(s) for s in simple])
        self.area = np.array([0.5 * abs(_twice_area(s)) for s in simple])
        self.turns = []
        for s in simple:
            progress(0.0, "simplifying the panels")
            self.turns.append(self._turns(s))
        self.large = [i for i, turns in enumerate(self.turns) if not turns]
        self.simple = simple
        fit = [i for i in range(len(shapes)) if self.turns[i]]
        self.fewest = len(self.large) + int(np.ceil(self.area[fit].sum() / self.free.prod() - 1e-9))
        self.known: dict[frozenset[int], _Set | None] = {}
        self.worker = Worker()

    def finish(self) -> None:
        """Stop what still runs."""
        self.worker.stop()

    def spent(self) -> float:
        """The share of the time limit that has passed."""
        return (time.monotonic() - self.begin) / max(self.params.nesting_seconds, 1e-9)

    def _turns(self, shape: np.ndarray) -> list[float]:
        """Degrees in which a shape fits on the sheet; none for one that is too large."""
        base = np.degrees(lying_box(shape, self.params.rotation)[0])
        step = {"FREE": STEP, "QUARTER": 90.0, "GRAIN": 180.0}[self.params.rotation]
        angles = base + np.arange(0.0, 360.0, step)
        turn = turn_that_fits(shape, tuple(self.free), 0.0, self.params.rotation)
        if turn is not None:
            angles = np.concatenate([angles, np.degrees(turn) + np.array([0.0, 180.0])])
        cos, sin = np.cos(np.radians(angles)), np.sin(np.radians(angles))
        wide = np.ptp(shape[:, :1] * cos - shape[:, 1:] * sin, axis=0)
        high = np.ptp(shape[:, :1] * sin + shape[:, 1:] * cos, axis=0)
        return angles[(wide <= self.free[0]) & (high <= self.free[1])].tolist()

    # -- filling sheets ------------------------------------------------------------------------------------------------

    def fill(self, rng: np.random.Generator) -> Packing:
        """All panels on sheets, the large ones first, the order shuffled a little from the second time on.

        What has found no place when time is up is laid on more sheets the quick way.
        """
        order = self.area * np.exp(0.25 * rng.standard_normal(len(self.area)) * bool(self.known))
        sets: list[_Set] = []
        rest: list[int] = []
        for i in np.argsort(-order, kind="stable").tolist():
            if i in self.large:
                continue
            if self.spent() >= 1.0 - LAST:
                rest.append(i)
                continue
            for k in sorted(range(len(sets)), key=lambda k: -sets[k].area):
                found = self._together(frozenset(sets[k].places) | {i})
                if found is not None:
                    sets[k] = found
                    break
            else:
                sets.append(self._alone(i))
        return self._packing(sets + self._quick(rest))

    def _together(self, members: frozenset[int]) -> _Set | None:
        """These panels on one sheet, if that is found in ``TURN`` seconds."""
        if members not in self.known:
            hopeless = self.hull[list(members)].sum() > FULLEST * self.free.prod() or any(
                found is None and fewer <= members for fewer, found in self.known.items()
            )
            self.known[members] = None if hopeless else self._strip(members, float(self.free[0]))
        return self.known[members]

    def _alone(self, i: int) -> _Set:
        """A panel by itself, turned so that it takes the least of its sheet's width."""

        def at(degrees: float) -> np.ndarray:
            cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
            return self.shapes[i] @ np.array([[cos, sin], [-sin, cos]])

        best = min(self.turns[i], key=lambda degrees: float(np.ptp(at(degrees)[:, 0])))
        return _Set({i: (float(np.radians(best)), self.params.margin - at(best).min(axis=0))}, float(self.area[i]))

    def emptied(self, packing: Packing) -> Packing:
        """Panels of the emptiest sheet moved to the others one by one, as far as they have room: sheet after sheet."""
        if len(packing.sizes) < 2:
            return packing
        sets = []
        for k in range(len(packing.sizes)):
            on = [i for i in np.flatnonzero(packing.sheet == k).tolist() if i not in self.large]
            if on:
                places = {i: (float(packing.rotation[i]), packing.shift[i]) for i in on}
                sets.append(_Set(places, float(self.area[on].sum())))
        while len(sets) > 1:
            least = min(range(len(sets)), key=lambda k: sets[k].area)
            source = sets.pop(least)
            for i in sorted(source.places, key=lambda i: -self.area[i]):
                for k in sorted(range(len(sets)), key=lambda k: sets[k].area):
                    if self.spent() >= 1.0 - LAST:
                        return self._packing([*sets, source])
                    found = self._together(frozenset(sets[k].places) | {i})
                    if found is not None:
                        sets[k] = found
                        places = {j: place for j, place in source.places.items() if j != i}
                        source = _Set(places, source.area - float(self.area[i]))
                        break
            if source.places:
                return self._packing([*sets, source])
        return self._packing(sets)

    def _quick(self, rest: list[int]) -> list[_Set]:
        """Panels on sheets of their own, by the quick packing."""
        if not rest:
            return []
        p = self.params
        found = pack([self.shapes[i] for i in rest], self._size(), p.margin, p.spacing, rotation=p.rotation)
        sheets: list[dict[int, tuple[float, np.ndarray]]] = [{} for _ in found.sizes]
        for k, i in enumerate(rest):
            sheets[found.sheet[k]][i] = float(found.rotation[k]), found.shift[k]
        return [_Set(places, float(self.area[list(places)].sum())) for places in sheets]

    def _packing(self, sets: list[_Set]) -> Packing:
        count = len(self.shapes)
        sheet, rotation, shift = np.zeros(count, dtype=np.int64), np.zeros(count), np.zeros((count, 2))
        sizes = [np.array([self.params.sheet_width, self.params.sheet_height])] * len(sets)
        for k, group in enumerate(sorted(sets, key=lambda s: -s.area)):
            for i, (turn, move) in group.places.items():
                sheet[i], rotation[i], shift[i] = k, turn, move
        for i in self.large:
            alone = pack([self.shapes[i]], tuple(sizes[0]) if sizes else self._size(), self.params.margin,
                         self.params.spacing, rotation=self.params.rotation)  # fmt: skip
            sheet[i], rotation[i], shift[i] = len(sizes), alone.rotation[0], alone.shift[0]
            sizes.append(alone.sizes[0])
        return Packing(sheet, rotation, shift, np.array(sizes).reshape(-1, 2))

    def _size(self) -> tuple[float, float]:
        return self.params.sheet_width, self.params.sheet_height

    def shortened(self, packing: Packing) -> Packing:
        """The same with the panels of the emptiest sheet drawn together, so that a larger piece of it is left over."""
        lengths = [used_length(packing, self.shapes, k) for k in range(len(packing.sizes))]
        k = int(np.argmin(lengths))
        members = frozenset(np.flatnonzero(packing.sheet == k).tolist())
        if not members or members & set(self.large):
            return packing
        seconds = max(TURN, int((1.0 - self.spent()) * self.params.nesting_seconds))
        found = self._alone(next(iter(members))) if len(members) == 1 else self._strip(members, 0.0, seconds)
        if found is None:
            return packing
        rotation, shift = packing.rotation.copy(), packing.shift.copy()
        for i, (turn, move) in found.places.items():
            rotation[i], shift[i] = turn, move
        return Packing(packing.sheet, rotation, shift, packing.sizes)

    # -- one call of spyrrow -------------------------------------------------------------------------------------------

    def _strip(self, members: frozenset[int], enough: float, seconds: int = TURN) -> _Set | None:
        """Panels packed in a strip as high as the sheet, if it is no longer than the sheet; ends once it is ``enough``."""
        found = self._solve(members, enough, seconds)
        if found is None or found.width - 2.0 * self.separation > self.free[0]:
            return None
        # spyrrow keeps the separation from the border of its strip too
        move = self.params.margin - self.separation
        return _Set(
            {i: (turn, shift + move) for i, (turn, shift) in found.places.items()},
            float(self.area[list(members)].sum()),
        )

    def _solve(self, members: frozenset[int], enough: float, seconds: int) -> Strip | None:
        """spyrrow's shortest feasible strip for some panels; ``None`` without one."""
        task = {
            "items": [(str(i), (self.simple[i] * 1e3).tolist(), self.turns[i]) for i in sorted(members)],
            "high": float(self.free[1] + 2.0 * self.separation) * 1e3,
            "seconds": seconds,
            "separation": self.separation * 1e3,
            "seed": self.params.seed,
        }
        best = None
        for solution in self.worker.solutions(task, seconds + GRACE):
            best = solution if solution is not None else best
            if best is not None and best.width <= enough + 2.0 * self.separation:
                self.worker.stop()
                break
            self.progress(min(self.spent(), 1.0), f"nesting {len(members)} panels on a sheet")
        return best


def _simplified(shape: np.ndarray, bay: float) -> np.ndarray:
    """A coarser outline (M', 2) round a shape, without bays that are narrower than twice ``bay`` metres."""
    import shapely

    outline = shapely.Polygon(shape)
    closed = outline.simplify(COARSE)
    # first the slots alone: what is left has few points, and closing both at once gives the same
    for radius in (SLOT * bay, bay):
        closed = _largest(closed.buffer(radius, quad_segs=4).buffer(-radius, quad_segs=4)).simplify(COARSE)
    # buffers round corners off by less than they should: the outline itself makes up for it
    largest = _largest(closed.union(outline))
    for stray in STRAYS:
        grown = largest.simplify(0.9 * stray).buffer(stray, join_style="mitre")
        if len(grown.exterior.coords) <= POINTS:
            break
    return np.asarray(grown.exterior.coords)[:-1]


def _largest(shape: Any) -> Any:
    """The largest part of a shape of shapely's, without its holes."""
    import shapely

    return shapely.Polygon(max(getattr(shape, "geoms", [shape]), key=lambda part: part.area).exterior)


def _hull_area(points: np.ndarray) -> float:
    from scipy.spatial import ConvexHull

    return float(ConvexHull(points).volume)  # what it calls volume is the area in the plane


def _twice_area(points: np.ndarray) -> float:
    after = np.roll(points, -1, axis=0)
    return float((points[:, 0] * after[:, 1] - points[:, 1] * after[:, 0]).sum())

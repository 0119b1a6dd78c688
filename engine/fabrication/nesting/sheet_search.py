"""Search for full sheets: sets of panels about as large as a sheet can hold, each tried by spyrrow (see ``strips``).

Sheets are filled in turn: the first panel is the largest that is left, and among the sets with this panel those that
cover most are tried first, as many at once as there are cores.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations

import numpy as np

from ...arrays import Float
from ...params import SheetParams
from ...progress import Progress
from ...surface.checking.finding import counted
from .outlines import HULLS, SPREAD, hull_area
from .packing import Packing, pack
from .process import PackedStrip
from .strips import TURN, Strips

LAST = 0.25  # minimum share of the time limit for compacting the emptiest sheet
RANDOM_SETS = 400  # random sets generated per sheet, of which a few are tried; 10 ms
HULL_STEP = 0.985  # after a set that did not fit, hulls of the next set cover at most this share of its hulls
TRIES = 8  # maximum number of successive sets that do not fit
EQUAL_LENGTH = 1e-3  # strips whose lengths differ by a smaller share are assumed to be limited by the same panels
# Minimum chance of an exchange that is tried, and maximum number of successive failures; from sets with more than FEW
# panels a single panel may come back, from others two
MIN_CHANCE, EXCHANGES, FEW = 0.1, 30, 12


@dataclass(frozen=True, eq=False)
class _Set:
    """Panels that lie together on one sheet.

    places : angle (radians) and shift (2,), metres, by panel
    area : m2 covered, by simplified outlines
    """

    places: dict[int, tuple[float, np.ndarray]]
    area: float


class NestingSearch:
    """Results for the sets of panels tried so far, and the remaining time."""

    def __init__(self, shapes: list[Float[np.ndarray, "_ 2"]], params: SheetParams, progress: Progress):
        import shapely

        self.shapes, self.params, self.progress = shapes, params, progress
        self.begin = time.monotonic()
        end = self.begin + params.nesting_seconds
        self.strips = Strips(shapes, params, end, partial(progress, 0.0, "simplifying the panels"), self.tell)
        self.free = self.strips.free
        self.hull = np.array([hull_area(s) for s in shapes])
        self.area = np.array([shapely.Polygon(s).area for s in self.strips.simple.values()])
        self.large = [i for i, turns in enumerate(self.strips.turns) if not turns]
        self.known: dict[frozenset[int], _Set | None] = {}
        self.long_sets: dict[frozenset[int], float] = {}  # length in metres of the strips of sets that did not fit
        # minimum length in metres of a strip with each panel
        self.long = np.array(
            [self.strips.alone(i)[1] if turns else self.free[0] for i, turns in enumerate(self.strips.turns)]
        )

    def finish(self) -> None:
        """Stop all running work."""
        self.strips.finish()

    def tell(self, panels: int) -> None:
        """Report progress; raises ``Cancelled`` when the user cancels."""
        self.progress(min(self.spent(), 1.0), f"nesting {counted(panels, 'panel', 'panels')}")

    def spent(self) -> float:
        """The share of the time limit that has elapsed."""
        return (time.monotonic() - self.begin) / max(self.params.nesting_seconds, 1e-9)

    @property
    def going(self) -> bool:
        """Whether time is left to try more sets.

        Part of the time limit is reserved for compacting the last sheet: the share ``LAST``, or ``TURN`` seconds if
        more, but at most half.
        """
        seconds = max(self.params.nesting_seconds, 1e-9)
        return self.spent() < 1.0 - max(LAST, min(TURN / seconds, 0.5))

    def needed(self, packing: Packing) -> float:
        """Return the number of sheets of a packing; the emptiest is counted by its expected length after compacting."""
        long = self.hull / (HULLS * self.free[1])
        least = [
            max(float(long[packing.sheet == k].sum()), float(self.long[packing.sheet == k].max(initial=0.0)))
            for k in range(len(packing.sizes))
        ]
        return len(least) - 1 + min(min(least) / float(self.free[0]), 1.0)

    # -- filling sheets ------------------------------------------------------------------------------------------------

    def fill(self, rng: np.random.Generator, rough: Packing) -> Packing:
        """Fill sheets one by one, large panels first, in a slightly shuffled order once sets have been tried.

        Only sets that cover more of a sheet than the rough packing are tried. Panels left when the time has elapsed are
        packed the quick way.
        """
        quick = {i: one.places for one in self._sets(rough) for i in one.places}
        order = self.area * np.exp(0.25 * rng.standard_normal(len(self.area)) * bool(self.known))
        rest = [i for i in np.argsort(-order, kind="stable").tolist() if i not in self.large]
        sets: list[_Set] = []
        while rest and self.going:
            least = float(self.area[[i for i in quick[rest[0]] if i in rest]].sum())
            sets.append(self._fullest(rest, least, rng))
            rest = [i for i in rest if i not in sets[-1].places]
        return self._packing(sets + self._quick(rest))

    def harder(self) -> bool:
        """Double the time per set and forget the sets that failed; return whether there are any and that is worthwhile."""
        fitting: dict[frozenset[int], _Set | None] = {one: found for one, found in self.known.items() if found}
        again = self.strips.harder() and len(fitting) < len(self.known)
        self.known, self.long_sets = fitting, {}
        return again

    def _fullest(self, rest: list[int], least: float, rng: np.random.Generator) -> _Set:
        """Return the fullest sheet found with the first of some panels that covers more than ``least`` m2.

        If none is found, return the sheet of the quick packing that has the first panel.
        """
        best, together = self._best(rest, least), max(self.strips.count, 2)
        limit, failed = np.inf, len(self.known)
        for _ in range(max(1, TRIES // together)):
            tries: list[frozenset[int]] = []
            for members in self._random_sets(rest, least if best is None else best.area, rng):
                hulls = float(self.hull[list(members)].sum())
                # Do not try sets with the same two largest panels together: if those two do not fit side by side, all
                # these sets fail
                pair = frozenset(sorted(members, key=lambda i: -self.hull[i])[:2])
                if hulls <= limit and len(tries) < together and not any(pair <= one for one in tries):
                    tries.append(members)
                    limit = HULL_STEP * hulls
            if not tries or self._first(tries) is not None:
                break
            if len(self.known) > failed + len(tries):  # a subset is known not to fit
                limit = np.inf
            failed = len(self.known)
        return self._best(rest, least) or next(one for one in self._quick(rest) if rest[0] in one.places)

    def _best(self, rest: list[int], least: float) -> _Set | None:
        """Return the fullest known set with the first of some panels, if it covers more than ``least`` m2."""
        left = frozenset(rest)
        known = (one for members, one in self.known.items() if one is not None and rest[0] in members <= left)
        return max((one for one in known if one.area > least), key=lambda one: one.area, default=None)

    def _first(self, tries: Sequence[frozenset[int]]) -> int | None:
        """Return the index of the first set found to fit on a sheet, as far as time allows."""
        for k, members in enumerate(tries):
            if members not in self.known:
                if not self.going:
                    return None
                self._try([one for one in tries[k:] if one not in self.known])
            if self.known.get(members) is not None:
                return k
        return None

    def _try(self, sets: Sequence[frozenset[int]]) -> None:
        """Determine whether the first of some sets, and following ones up to the number of cores, fit on a sheet."""
        fresh: list[frozenset[int]] = []
        for members in sets:
            if self._fails(members):
                self.known[members] = None
            elif len(fresh) < self.strips.count and members not in fresh:
                fresh.append(members)
        for members, found in self.strips.on_a_sheet(fresh).items():
            self.known[members] = self._set(found)
            if found is not None and self.known[members] is None:
                self._record_common(members, found.width)

    def _fails(self, members: frozenset[int]) -> bool:
        """Return whether a subset of these panels is known not to fit."""
        return any(found is None and fewer <= members for fewer, found in self.known.items())

    def _record_common(self, members: frozenset[int], length: float) -> None:
        """Record that the panels common to two sets with strips of equal length do not fit."""
        for other, known in self.long_sets.items():
            common = members & other
            fit = any(found is not None and common <= one for one, found in self.known.items())
            if abs(known - length) < EQUAL_LENGTH * length and len(common) > 1 and not fit:
                self.known.setdefault(common, None)
        self.long_sets[members] = length

    def _random_sets(self, rest: list[int], least: float, rng: np.random.Generator) -> list[frozenset[int]]:
        """Return random sets with the first of some panels that cover more than ``least`` m2, most promising first."""
        first, others = rest[0], np.array(rest[1:], dtype=np.int64)
        found: dict[frozenset[int], float] = {}
        for _ in range(RANDOM_SETS if len(others) else 0):
            members, left = {first}, (HULLS + rng.uniform(-2.0, 1.5) * SPREAD) * self.free.prod() - self.hull[first]
            for i in rng.permutation(others).tolist():
                if self.hull[i] <= left:
                    members.add(i)
                    left -= self.hull[i]
            some = list(members)
            gain = float(self.area[some].sum()) - least
            if gain > 0.0 and not self._fails(frozenset(members)):
                found[frozenset(members)] = gain * self._chance(float(self.hull[some].sum()))
        return sorted(found, key=lambda members: -found[members])

    def _chance(self, hulls: float) -> float:
        """Return the probability that panels with this area of convex hulls (m2) fit on a sheet.

        Logistic distribution with the mean and standard deviation of ``HULLS``.
        """
        return 1.0 / (1.0 + math.exp((hulls / float(self.free.prod()) - HULLS) * math.pi / (math.sqrt(3.0) * SPREAD)))

    def emptied(self, packing: Packing) -> Packing:
        """Move panels of the emptiest sheet to others, or exchange them for smaller ones, as long as time allows."""
        sets = self._sets(packing)
        while len(sets) > 1 and self.going:
            sets.sort(key=lambda one: one.area)
            moved = self._move_one(sets)
            if moved is None:
                break
            sets = moved
        return self._packing(sets)

    def _move_one(self, sets: list[_Set]) -> list[_Set] | None:
        """Return the sets after moving one panel of the first set to another set; None without such a move.

        Up to two smaller panels may come back in exchange.
        """
        left = self._exchanges(sets)[:EXCHANGES]
        fuller = [(frozenset(sets[k].places) | {i}) - back for _, i, k, back in left]
        while (number := self._first(fuller)) is not None:
            (_, i, k, back), more = left[number], self.known[fuller[number]]
            assert more is not None
            others = [*sets[1:k], more, *sets[k + 1 :]]
            if len(sets[0].places) == 1 and not back:
                return others
            emptier = self._fit_together((frozenset(sets[0].places) - {i}) | back)
            if emptier is not None:
                return [emptier, *others]
            left, fuller = left[number + 1 :], fuller[number + 1 :]
        return None

    def _exchanges(self, sets: list[_Set]) -> list[tuple[float, int, int, frozenset[int]]]:
        """Return exchanges between the first set and others, best expected gain first.

        Each is the expected gain (m2), the panel that moves, the index of the other set and the panels that come back.
        """
        found = []
        for k, other in enumerate(sets[1:], 1):
            hulls = float(self.hull[list(other.places)].sum())
            most = 2 if len(other.places) <= FEW else 1
            for back in (frozenset(b) for n in range(most + 1) for b in combinations(other.places, n)):
                for i in sets[0].places:
                    gain = float(self.area[i] - self.area[list(back)].sum())
                    if gain > 0.0:
                        chance = self._chance(hulls + float(self.hull[i] - self.hull[list(back)].sum()))
                        if chance > MIN_CHANCE:
                            found.append((gain * chance, i, k, back))
        return sorted(found, key=lambda one: -one[0])

    def _sets(self, packing: Packing) -> list[_Set]:
        """Return the sets of panels on the sheets of a packing."""
        sets = []
        for k in range(len(packing.sizes)):
            on = [i for i in np.flatnonzero(packing.sheet == k).tolist() if i not in self.large]
            if on:
                places = {i: (float(packing.rotation[i]), packing.shift[i]) for i in on}
                sets.append(_Set(places, float(self.area[on].sum())))
        return sets

    def _fit_together(self, members: frozenset[int]) -> _Set | None:
        """Return these panels on one sheet, or None if no such placement is found."""
        if members not in self.known:
            self._try([members])
        return self.known[members]

    def _alone(self, i: int) -> _Set:
        """Return a panel by itself, turned to take the least of its sheet's width."""
        turn = float(np.radians(self.strips.alone(i)[0]))
        cos, sin = np.cos(turn), np.sin(turn)
        least = (self.shapes[i] @ np.array([[cos, sin], [-sin, cos]])).min(axis=0)
        return _Set({i: (turn, self.params.margin - least)}, float(self.area[i]))

    def _quick(self, rest: list[int]) -> list[_Set]:
        """Return panels on sheets of their own by the quick packing."""
        if not rest:
            return []
        p = self.params
        found = pack([self.shapes[i] for i in rest], self._size(), p.margin, p.spacing, rotation=p.rotation)
        sheets: list[dict[int, tuple[float, np.ndarray]]] = [{} for _ in found.sizes]
        for k, i in enumerate(rest):
            sheets[found.sheet[k]][i] = float(found.rotation[k]), found.shift[k]
        return [_Set(places, float(self.area[list(places)].sum())) for places in sheets]

    def _packing(self, sets: list[_Set]) -> Packing:
        """Return the packing of some sets, fullest first, with panels larger than a sheet after them."""
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
        """Return the width and height of a sheet in metres."""
        return self.params.sheet_width, self.params.sheet_height

    def shortened(self, packing: Packing, share: float, fine: bool = False) -> Packing:
        """Compact the panels of the emptiest sheet, so that a larger offcut is left.

        ``share`` is the part of the time limit to use; ``fine`` selects the fine outlines.
        """
        k = int(np.argmin(np.bincount(packing.sheet, self.hull, len(packing.sizes))))
        members = frozenset(np.flatnonzero(packing.sheet == k).tolist())
        if not members or members & set(self.large):
            return packing
        if len(members) == 1:
            found: _Set | None = self._alone(next(iter(members)))
        else:
            seconds = max(TURN, int(share * self.params.nesting_seconds))
            found = self._set(self.strips.shortest(members, seconds, fine))
        if found is None:
            return packing
        rotation, shift = packing.rotation.copy(), packing.shift.copy()
        for i, (turn, move) in found.places.items():
            rotation[i], shift[i] = turn, move
        return Packing(packing.sheet, rotation, shift, packing.sizes)

    def _set(self, found: PackedStrip | None) -> _Set | None:
        """Place the panels of a strip on a sheet; None if the strip is longer."""
        if found is None or found.width > self.free[0]:
            return None
        places = {i: (turn, shift + self.params.margin) for i, (turn, shift) in found.places.items()}
        return _Set(places, float(self.area[list(places)].sum()))

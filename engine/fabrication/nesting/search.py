"""The search for full sheets: sets of panels that together are as large as a sheet may bear, each tried by spyrrow (see ``strips``).

Sheet after sheet is filled: its first panel is the largest that is left, and of the sets that hold it those are tried first
that cover most, as many at once as there are cores.
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
from .process import Strip
from .strips import TURN, Strips

LAST = 0.25  # least share of the time limit for drawing the panels of the emptiest sheets together
DRAWS = 400  # sets that are drawn for a sheet, of which a few are tried; 10 ms
LOWER = 0.985  # share that the hulls of the next set cover at most after one did not fit
TRIES = 8  # sets in a row that may not fit
SAME = 1e-3  # two strips whose lengths differ by less than this share are taken to be blocked by the same panels
# chance of the exchanges that are tried, and how many in a row may not fit; of larger sets one panel comes back, of others two may
LEAST, EXCHANGES, FEW = 0.1, 30, 12


@dataclass(frozen=True, eq=False)
class _Set:
    """Panels that lie together on one sheet: ``places`` holds turn (radians) and shift (2,) metres of every one."""

    places: dict[int, tuple[float, np.ndarray]]
    area: float


class Search:
    """What is known of sets of panels, and the time that is left."""

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
        self.long_sets: dict[frozenset[int], float] = {}  # metres, of sets that did not fit
        # metres, how long a strip of each panel is at least
        self.long = np.array(
            [self.strips.alone(i)[1] if turns else self.free[0] for i, turns in enumerate(self.strips.turns)]
        )

    def finish(self) -> None:
        """Stop what still runs."""
        self.strips.finish()

    def tell(self, panels: int) -> None:
        """Say what is going on; raises ``Cancelled`` when the user wants to stop."""
        self.progress(min(self.spent(), 1.0), f"nesting {counted(panels, 'panel', 'panels')}")

    def spent(self) -> float:
        """The share of the time limit that has passed."""
        return (time.monotonic() - self.begin) / max(self.params.nesting_seconds, 1e-9)

    @property
    def going(self) -> bool:
        """Whether there is time to try more sets; the rest is kept for drawing panels together: at least one turn, at most half of all."""
        seconds = max(self.params.nesting_seconds, 1e-9)
        return self.spent() < 1.0 - max(LAST, min(TURN / seconds, 0.5))

    def needed(self, packing: Packing) -> float:
        """The sheets of a packing, of which the emptiest counts as far as its panels are expected to need it once they are drawn together."""
        long = self.hull / (HULLS * self.free[1])
        least = [
            max(float(long[packing.sheet == k].sum()), float(self.long[packing.sheet == k].max(initial=0.0)))
            for k in range(len(packing.sizes))
        ]
        return len(least) - 1 + min(min(least) / float(self.free[0]), 1.0)

    # -- filling sheets ------------------------------------------------------------------------------------------------

    def fill(self, rng: np.random.Generator, rough: Packing) -> Packing:
        """All panels on sheets, the large ones first, the order shuffled a little once sets were tried.

        Sets are tried that cover more of a sheet than the rough packing does. What has found no place when time is up is laid on more
        sheets the quick way.
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
        """From now on try sets for twice as long, those again that did not fit; whether there are any and that is worth it."""
        fitting: dict[frozenset[int], _Set | None] = {one: found for one, found in self.known.items() if found}
        again = self.strips.harder() and len(fitting) < len(self.known)
        self.known, self.long_sets = fitting, {}
        return again

    def _fullest(self, rest: list[int], least: float, rng: np.random.Generator) -> _Set:
        """A sheet with the first of some panels and others that together cover more than ``least``, as many as are found to fit.

        Where none are found, return the fullest known sheet with the first panel, or that of the quick packing if none is known.
        """
        best, together = self._best(rest, least), max(self.strips.count, 2)
        limit, failed = np.inf, len(self.known)
        for _ in range(max(1, TRIES // together)):
            tries: list[frozenset[int]] = []
            for members in self._drawn(rest, least if best is None else best.area, rng):
                hulls = float(self.hull[list(members)].sum())
                # different panels beside the first one: if two large ones do not fit beside each other, all sets with both fail
                pair = frozenset(sorted(members, key=lambda i: -self.hull[i])[:2])
                if hulls <= limit and len(tries) < together and not any(pair <= one for one in tries):
                    tries.append(members)
                    limit = LOWER * hulls
            if not tries or self._first(tries) is not None:
                break
            if len(self.known) > failed + len(tries):  # it is known which panels do not fit
                limit = np.inf
            failed = len(self.known)
        return self._best(rest, least) or next(one for one in self._quick(rest) if rest[0] in one.places)

    def _best(self, rest: list[int], least: float) -> _Set | None:
        """The fullest known sheet with the first of some panels and others of them, if one covers more than ``least``."""
        left = frozenset(rest)
        known = (one for members, one in self.known.items() if one is not None and rest[0] in members <= left)
        return max((one for one in known if one.area > least), key=lambda one: one.area, default=None)

    def _first(self, tries: Sequence[frozenset[int]]) -> int | None:
        """The first of some sets that is found to lie on a sheet, as far as time allows."""
        for k, members in enumerate(tries):
            if members not in self.known:
                if not self.going:
                    return None
                self._try([one for one in tries[k:] if one not in self.known])
            if self.known.get(members) is not None:
                return k
        return None

    def _try(self, sets: Sequence[frozenset[int]]) -> None:
        """Find out of the first of some sets, and of as many after it as there are cores, whether they lie on a sheet."""
        fresh: list[frozenset[int]] = []
        for members in sets:
            if self._fails(members):
                self.known[members] = None
            elif len(fresh) < self.strips.count and members not in fresh:
                fresh.append(members)
        for members, found in self.strips.on_a_sheet(fresh).items():
            self.known[members] = self._set(found)
            if found is not None and self.known[members] is None:
                self._blame(members, found.width)

    def _fails(self, members: frozenset[int]) -> bool:
        """Whether some of these panels are known not to fit."""
        return any(found is None and fewer <= members for fewer, found in self.known.items())

    def _blame(self, members: frozenset[int], length: float) -> None:
        """Note of a set that was too long, and of another one just as long, that what they share does not fit."""
        for other, known in self.long_sets.items():
            common = members & other
            fit = any(found is not None and common <= one for one, found in self.known.items())
            if abs(known - length) < SAME * length and len(common) > 1 and not fit:
                self.known.setdefault(common, None)
        self.long_sets[members] = length

    def _drawn(self, rest: list[int], least: float, rng: np.random.Generator) -> list[frozenset[int]]:
        """Sets of the first of some panels and others drawn at random that cover more than ``least``; the most promising come first."""
        first, others = rest[0], np.array(rest[1:], dtype=np.int64)
        found: dict[frozenset[int], float] = {}
        for _ in range(DRAWS if len(others) else 0):
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
        """That panels fit on a sheet whose convex hulls cover so many square metres: the distribution of ``HULLS`` as a logistic one."""
        return 1.0 / (1.0 + math.exp((hulls / float(self.free.prod()) - HULLS) * math.pi / (math.sqrt(3.0) * SPREAD)))

    def emptied(self, packing: Packing) -> Packing:
        """Panels of the emptiest sheet moved to the others, or exchanged for smaller ones of theirs, as long as time allows."""
        sets = self._sets(packing)
        while len(sets) > 1 and self.going:
            sets.sort(key=lambda one: one.area)
            moved = self._moved(sets)
            if moved is None:
                break
            sets = moved
        return self._packing(sets)

    def _moved(self, sets: list[_Set]) -> list[_Set] | None:
        """The sets with one panel of the first in another one, for which smaller ones may have come back; ``None`` where none was found."""
        left = self._exchanges(sets)[:EXCHANGES]
        fuller = [(frozenset(sets[k].places) | {i}) - back for _, i, k, back in left]
        while (number := self._first(fuller)) is not None:
            (_, i, k, back), more = left[number], self.known[fuller[number]]
            assert more is not None
            others = [*sets[1:k], more, *sets[k + 1 :]]
            if len(sets[0].places) == 1 and not back:
                return others
            emptier = self._together((frozenset(sets[0].places) - {i}) | back)
            if emptier is not None:
                return [emptier, *others]
            left, fuller = left[number + 1 :], fuller[number + 1 :]
        return None

    def _exchanges(self, sets: list[_Set]) -> list[tuple[float, int, int, frozenset[int]]]:
        """Panels of the first set and what may come back for them from another one, with what is to be expected from it; the most first."""
        found = []
        for k, other in enumerate(sets[1:], 1):
            hulls = float(self.hull[list(other.places)].sum())
            most = 2 if len(other.places) <= FEW else 1
            for back in (frozenset(b) for n in range(most + 1) for b in combinations(other.places, n)):
                for i in sets[0].places:
                    gain = float(self.area[i] - self.area[list(back)].sum())
                    if gain > 0.0:
                        chance = self._chance(hulls + float(self.hull[i] - self.hull[list(back)].sum()))
                        if chance > LEAST:
                            found.append((gain * chance, i, k, back))
        return sorted(found, key=lambda one: -one[0])

    def _sets(self, packing: Packing) -> list[_Set]:
        """What lies on the sheets of a packing."""
        sets = []
        for k in range(len(packing.sizes)):
            on = [i for i in np.flatnonzero(packing.sheet == k).tolist() if i not in self.large]
            if on:
                places = {i: (float(packing.rotation[i]), packing.shift[i]) for i in on}
                sets.append(_Set(places, float(self.area[on].sum())))
        return sets

    def _together(self, members: frozenset[int]) -> _Set | None:
        """These panels on one sheet, if that is found."""
        if members not in self.known:
            self._try([members])
        return self.known[members]

    def _alone(self, i: int) -> _Set:
        """A panel by itself, turned so that it takes the least of its sheet's width."""
        turn = float(np.radians(self.strips.alone(i)[0]))
        cos, sin = np.cos(turn), np.sin(turn)
        least = (self.shapes[i] @ np.array([[cos, sin], [-sin, cos]])).min(axis=0)
        return _Set({i: (turn, self.params.margin - least)}, float(self.area[i]))

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

    def shortened(self, packing: Packing, share: float, fine: bool = False) -> Packing:
        """The same with the panels of one sheet drawn together in a share of the time limit, so that a larger piece of it is left over.

        It is the sheet that bears least. By the simple outlines or the fine ones.
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

    def strip(self, seconds: int) -> Strip | None:
        """All panels on one strip that begins at 0 and is as high as a sheet less its margins, as short as is found."""
        return None if self.large else self.strips.shortest(frozenset(range(len(self.shapes))), seconds)

    def _set(self, found: Strip | None) -> _Set | None:
        """What lies on a strip, on a sheet; ``None`` where it is longer than one."""
        if found is None or found.width > self.free[0]:
            return None
        places = {i: (turn, shift + self.params.margin) for i, (turn, shift) in found.places.items()}
        return _Set(places, float(self.area[list(places)].sum()))

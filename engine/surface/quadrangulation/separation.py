"""What must not fall together when a seamless map is rounded to whole numbers (Campen et al. 2015, section 4).

Two irregular points that come to lie on one point of the grid, or change sides, fold the map between them; so do a point and
a border or sharp fold, and the two borders of a strip. What lies near each other is looked up once on the surface; every
such pair says that a sum of whole numbers has to stay positive.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from math import hypot

import numpy as np
from scipy.sparse import csr_array

from ...arrays import Float, Int, Num
from ...errors import FlexMapsError
from ...progress import SILENT, Progress
from .seamless import SIGN, TAKEN, Maps

TOO_MANY_FOLDS = "The surface has too many sharp folds for a map"
NEAR = 2.0  # quads: irregular points farther apart than this stay apart by themselves
ACROSS = 1.2  # quads: the same of borders and folds
BESIDE = 0.6  # quads: a point is beside a border if it lies no farther off along it
SAME_PLACE = 1e-6  # quads: what lies no farther off has no side, but for rounding errors
# pairs: Suzanne with 500 quads has 785 at most, other objects of Blender's own up to 76; of noise or of many pleats there are 70,000 and
# more, which take half a gigabyte and minutes
MANY = 5000
DIGITS = 9  # factors of whole numbers that differ by less are equal, but for rounding errors
LEAST = 0.05  # quads: irregular points keep their sides if the grid's step between them goes as far the right way


@dataclass(frozen=True, eq=False)
class Apart:
    """Sums of whole numbers that have to stay positive.

    rows : factors of the whole numbers
    least : what each sum has to reach
    """

    rows: Float[np.ndarray, "pairs whole"]
    least: Float[np.ndarray, " pairs"]

    def hold(self, whole: Num[np.ndarray, " whole"]) -> bool:
        """Whether these whole numbers keep all of them apart."""
        return not len(self.least) or bool((self.rows @ whole >= self.least).all())


NOTHING = Apart(np.empty((0, 0)), np.empty(0))  # is held by all


def apart(maps: Maps, edge: float, progress: Progress = SILENT) -> Apart:
    """Return what lies so near each other that quads of this edge (metres) might bring it together.

    Raises ``FlexMapsError`` where that is too much for a map.
    """
    search = _Search(maps, edge)
    every = [(int(corner), radius) for held, radius in ((2, NEAR), (1, ACROSS)) for corner in search.held_in(held)]
    for corner, radius in progress.each(every, "Looking for what lies near each other"):
        search.look_round(corner, radius)
        if len(search.found) > MANY:
            raise FlexMapsError(TOO_MANY_FOLDS)
    found = list(search.found.values())
    rows = np.array([row for row, _ in found], dtype=float).reshape(-1, maps.lattice.whole.shape[1])
    return Apart(rows, np.array([least for _, least in found], dtype=float))


class _Search:
    """Walks over the triangles round points that lie on whole numbers.

    A frame gives coordinates where a walk began from those of the triangle that it has come to: a turn times these plus a
    shift by whole numbers. Walks come to the same frames again and again, so that each is computed once and has a number.
    """

    def __init__(self, maps: Maps, edge: float):
        from scipy.spatial import cKDTree

        self.chart, self.mesh, self.edge = maps.chart, maps.chart.field.mesh, edge
        self.whole: csr_array = maps.lattice.whole
        self.relaxed = maps.relaxed(edge)
        held = (np.diff(maps.lattice.free.indptr) == 0).reshape(-1, 2)[self.chart.wedge]
        self._counts = held.sum(axis=1)
        middles = self.mesh.vertices[self.mesh.corners].mean(axis=1)
        self._tree = cKDTree(middles)
        # plain lists: a walk looks up one number after another, for which arrays are slow
        self._opposite, self._cut, self._vertex, self._wedge = (
            x.tolist() for x in (self.mesh.opposite, self.chart.cut, self.mesh.corners.ravel(), self.chart.wedge)
        )
        self._held, self._any_held = held.tolist(), held.any(axis=1).tolist()
        self._uv = maps.map(edge, self.relaxed).reshape(-1, 2).tolist()
        other = self.mesh.opposite.reshape(-1, 3)  # at the border the last triangle, to which no walk goes
        self._way = np.linalg.norm(middles[other // 3] - middles[:, None], axis=2).ravel().tolist()
        self.found: dict[bytes, tuple[np.ndarray, float]] = {}
        self._rows: dict[int, np.ndarray] = {}
        self._steps: dict[int, int] = {}  # side -> number of what is between the frames of its two triangles
        self._moves = _Numbered()
        self._frames = _Numbered()
        self._frames.add(np.eye(2, dtype=np.int64), np.zeros((2, self.whole.shape[1]), dtype=np.int64))
        self._next: dict[tuple[int, int], int] = {}  # frame and step -> frame
        self._plain: dict[int, tuple[list[list[int]], list[float]]] = {}  # frame -> turn and shift, as plain numbers

    def held_in(self, number: int) -> Int[np.ndarray, " corners"]:
        """One corner of every point of the cut mesh of which so many coordinates are whole numbers."""
        at = np.flatnonzero(self._counts == number)
        return at[np.unique(self.chart.wedge[at], return_index=True)[1]]

    def look_round(self, corner: int, radius: float) -> None:
        """Note what lies within so many quads of a corner."""
        vertex, opposite, wedge, cut, way = self._vertex, self._opposite, self._wedge, self._cut, self._way
        near_enough = set(self._tree.query_ball_point(self.mesh.vertices[vertex[corner]], radius * self.edge))
        todo = [(0.0, corner // 3, 0)]
        seen, compared = set[int](), set[tuple[int, int]]()  # triangles round a point share it
        while todo:
            far, f, frame = heapq.heappop(todo)
            if f in seen:
                continue
            seen.add(f)
            for h in range(3 * f, 3 * f + 3):
                point = wedge[h], frame
                if self._any_held[h] and vertex[h] != vertex[corner] and point not in compared:
                    compared.add(point)
                    self._compare(corner, h, frame)
                g = opposite[h] // 3  # -1 at the border, which is near to nothing
                if g not in seen and g in near_enough:
                    heapq.heappush(todo, (far + way[h], g, self._over(frame, h) if cut[h] else frame))

    def _compare(self, corner: int, h: int, frame: int) -> None:
        """Note what a point held in both coordinates asks of another such one, or one held in one of a line."""
        turn, shift = self._plain_frame(frame)
        (u, v), here, held, there = self._uv[h], self._uv[corner], self._held[corner], self._held[h]
        way = [turn[c][0] * u + turn[c][1] * v + shift[c] - here[c] for c in (0, 1)]
        both = [held[c] and (there[0] if turn[c][0] else there[1]) for c in (0, 1)]
        if all(both):
            if max(abs(way[0]), abs(way[1])) < NEAR and (size := hypot(*way)) > SAME_PLACE:
                row = self._difference(corner, h, frame)
                if row.any():
                    self._note(np.array(way) @ row / size, LEAST)
            return
        for c in (0, 1):
            if both[c] and SAME_PLACE < abs(way[c]) < ACROSS and abs(way[1 - c]) < BESIDE:
                row = self._difference(corner, h, frame)[c]
                if row.any():
                    self._note(row if way[c] > 0 else -row, 1.0)

    def _difference(self, corner: int, h: int, frame: int) -> np.ndarray:
        """(2, whole): the whole numbers by which a corner lies beside the one where the walk began."""
        turn, shift = self._frames[frame]
        return turn @ self._row(h) + shift - self._row(corner)

    def _plain_frame(self, frame: int) -> tuple[list[list[int]], list[float]]:
        if frame not in self._plain:
            turn, shift = self._frames[frame]
            self._plain[frame] = turn.tolist(), (shift @ self.relaxed).tolist()
        return self._plain[frame]

    def _note(self, row: np.ndarray, least: float) -> None:
        """Note a pair once: it is met from both of its ends, and over several ways."""
        self.found.setdefault((np.round(row, DIGITS) + 0.0).tobytes(), (row, least))

    def _row(self, h: int) -> np.ndarray:
        """(2, whole): u and v of a corner by the whole numbers."""
        wedge = self._wedge[h]
        if wedge not in self._rows:
            self._rows[wedge] = self.whole[2 * wedge : 2 * wedge + 2].toarray().astype(np.int64)
        return self._rows[wedge]

    def _over(self, frame: int, s: int) -> int:
        """The frame of the neighbour over side s of the cut, from that of the triangle."""
        move = self._step(s)
        if (frame, move) not in self._next:
            (turn, shift), (of_step, by) = self._frames[frame], self._moves[move]
            back = turn @ of_step.T
            self._next[frame, move] = self._frames.add(back, shift - back @ by)
        return self._next[frame, move]

    def _step(self, s: int) -> int:
        """How coordinates of this triangle become those of the neighbour over side s of the cut: turned, then shifted."""
        if s not in self._steps:
            o, q = self._opposite[s], int(self.chart.jump[s])
            turn = np.zeros((2, 2), dtype=np.int64)
            turn[[0, 1], TAKEN[q]] = SIGN[q]
            after = o - o % 3 + (o + 1) % 3
            self._steps[s] = self._moves.add(turn, self._row(after) - turn @ self._row(s))
        return self._steps[s]


class _Numbered(list[tuple[np.ndarray, np.ndarray]]):
    """Turns and shifts, each pair once."""

    def __init__(self) -> None:
        super().__init__()
        self._number: dict[bytes, int] = {}

    def add(self, turn: Int[np.ndarray, "2 2"], shift: Int[np.ndarray, "2 whole"]) -> int:
        """Return the number of a pair, which is new or was there before."""
        key = turn.tobytes() + shift.tobytes()
        if key not in self._number:
            self._number[key] = len(self)
            self.append((turn, shift))
        return self._number[key]

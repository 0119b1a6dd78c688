"""What must not fall together when a seamless map is rounded to whole numbers (Campen et al. 2015, section 4).

Two irregular points that come to lie on one point of the grid, or change sides, fold the map between them; so do a point and
a border or sharp fold, and the two borders of a strip. What lies near each other is looked up once on the surface; every
such pair says that a sum of whole numbers has to stay positive.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from itertools import count

import numpy as np
from scipy.sparse import csr_array

from ...arrays import Float, Int, Num
from ...progress import SILENT, Progress
from .seamless import SIGN, TAKEN, Maps

NEAR = 2.0  # quads: irregular points farther apart than this stay apart by themselves
ACROSS = 1.2  # quads: the same of borders and folds
BESIDE = 0.6  # quads: a point is beside a border if it lies no farther off along it
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


@dataclass(frozen=True, eq=False)
class _Frame:
    """Coordinates where a walk began, from those of the triangle that it has come to: turn times these plus shift."""

    turn: Int[np.ndarray, "2 2"]
    shift: Int[np.ndarray, "2 whole"]

    def over(self, turn: np.ndarray, shift: np.ndarray) -> _Frame:
        """The frame of the next triangle, whose coordinates are turn times those of this one plus shift."""
        back = self.turn @ turn.T
        return _Frame(back, self.shift - back @ shift)


def apart(maps: Maps, edge: float, progress: Progress = SILENT) -> Apart:
    """What lies so near each other that quads of this edge (metres) might bring it together."""
    search = _Search(maps, edge)
    every = [(int(corner), radius) for held, radius in ((2, NEAR), (1, ACROSS)) for corner in search.held_in(held)]
    for corner, radius in progress.each(every, "Looking for what lies near each other"):
        search.look_round(corner, radius)
    found = list(search.found.values())
    rows = np.array([row for row, _ in found], dtype=float).reshape(-1, maps.lattice.whole.shape[1])
    return Apart(rows, np.array([least for _, least in found], dtype=float))


class _Search:
    """Walks over the triangles round points that lie on whole numbers."""

    def __init__(self, maps: Maps, edge: float):
        from scipy.spatial import cKDTree

        self.chart, self.mesh, self.edge = maps.chart, maps.chart.field.mesh, edge
        self.whole: csr_array = maps.lattice.whole
        self.relaxed = maps.relaxed(edge)
        self.uv = maps.map(edge, self.relaxed).reshape(-1, 2)
        self.held = (np.diff(maps.lattice.free.indptr) == 0).reshape(-1, 2)[self.chart.wedge]
        middles = self.mesh.vertices[self.mesh.corners].mean(axis=1)
        self._tree = cKDTree(middles)
        # plain lists: a walk looks up one number after another, for which arrays are slow
        self._opposite, self._cut, self._vertex, self._wedge = (
            x.tolist() for x in (self.mesh.opposite, self.chart.cut, self.mesh.corners.ravel(), self.chart.wedge)
        )
        self._any_held = self.held.any(axis=1).tolist()
        other = self.mesh.opposite.reshape(-1, 3)  # at the border the last triangle, to which no walk goes
        self._way = np.linalg.norm(middles[other // 3] - middles[:, None], axis=2).ravel().tolist()
        self.found: dict[bytes, tuple[np.ndarray, float]] = {}
        self._rows: dict[int, np.ndarray] = {}
        self._steps: dict[int, tuple[np.ndarray, np.ndarray]] = {}

    def held_in(self, number: int) -> Int[np.ndarray, " corners"]:
        """One corner of every point of the cut mesh of which so many coordinates are whole numbers."""
        at = np.flatnonzero(self.held.sum(axis=1) == number)
        return at[np.unique(self.chart.wedge[at], return_index=True)[1]]

    def look_round(self, corner: int, radius: float) -> None:
        """Note what lies within so many quads of a corner."""
        vertex, opposite = self._vertex, self._opposite
        near_enough = set(self._tree.query_ball_point(self.mesh.vertices[vertex[corner]], radius * self.edge))
        start = _Frame(np.eye(2, dtype=np.int64), np.zeros((2, self.whole.shape[1]), dtype=np.int64))
        order = count()
        todo = [(0.0, next(order), corner // 3, start)]
        seen: set[int] = set()
        lines: dict[bytes, tuple[float, np.ndarray]] = {}
        # triangles round a point share it: it is compared once in every frame; those are kept, so that none takes another's identity
        compared, frames, wedge = set[tuple[int, int]](), [start], self._wedge
        while todo:
            far, _, f, frame = heapq.heappop(todo)
            if f in seen:
                continue
            seen.add(f)
            for h in range(3 * f, 3 * f + 3):
                point = wedge[h], id(frame)
                if self._any_held[h] and vertex[h] != vertex[corner] and point not in compared:
                    compared.add(point)
                    self._compare(corner, h, frame, lines)
                g = opposite[h] // 3  # -1 at the border, which is near to nothing
                if g in seen or g not in near_enough:
                    continue
                next_frame = frame
                if self._cut[h]:
                    next_frame = frame.over(*self._step(h))
                    frames.append(next_frame)
                heapq.heappush(todo, (far + self._way[h], next(order), g, next_frame))
        for along, row in lines.values():
            if along < BESIDE:
                self._note(row, 1.0)

    def _compare(self, corner: int, h: int, frame: _Frame, lines: dict[bytes, tuple[float, np.ndarray]]) -> None:
        """What a point held in both coordinates asks of another such one, or one held in one of a line."""
        row = frame.turn @ self._row(h) + frame.shift - self._row(corner)
        way = frame.turn @ self.uv[h] + frame.shift @ self.relaxed - self.uv[corner]
        held = self.held[corner] & (np.abs(frame.turn) @ self.held[h] > 0)
        if held.all():
            if np.abs(row).max() and np.abs(way).max() < NEAR:
                size = np.linalg.norm(way)
                if size > 1e-6:
                    self._note(way @ row / size, LEAST)
            return
        for c in np.flatnonzero(held):
            if np.abs(row[c]).max() and 1e-6 < np.abs(way[c]) < ACROSS:
                key, along = (np.sign(way[c]) * row[c]).tobytes(), float(np.abs(way[1 - c]))
                if key not in lines or along < lines[key][0]:
                    lines[key] = along, np.sign(way[c]) * row[c]

    def _note(self, row: np.ndarray, least: float) -> None:
        self.found.setdefault(row.tobytes(), (row, least))

    def _row(self, h: int) -> np.ndarray:
        """(2, whole): u and v of a corner by the whole numbers."""
        wedge = int(self.chart.wedge[h])
        if wedge not in self._rows:
            self._rows[wedge] = self.whole[2 * wedge : 2 * wedge + 2].toarray().astype(np.int64)
        return self._rows[wedge]

    def _step(self, s: int) -> tuple[np.ndarray, np.ndarray]:
        """How coordinates of this triangle become those of the neighbour over side s of the cut."""
        if s not in self._steps:
            o, q = int(self.mesh.opposite[s]), int(self.chart.jump[s])
            turn = np.zeros((2, 2), dtype=np.int64)
            turn[[0, 1], TAKEN[q]] = SIGN[q]
            after = o - o % 3 + (o + 1) % 3
            self._steps[s] = turn, self._row(after) - turn @ self._row(s)
        return self._steps[s]

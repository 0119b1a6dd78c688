"""Constraints that keep points apart when a seamless map is rounded to integers (Campen et al. 2015, section 4).

The map folds where rounding puts two irregular points on one grid point, or swaps them. It also folds where rounding does
so with a point and a border or sharp fold, or with the two borders of a strip. All pairs that are near each other on the
surface are found once; each pair gives one constraint: a weighted sum of the map's integers must stay positive.
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
from ...tolerances import SINGLE_TOL
from .seamless import ROTATED_AXIS, ROTATED_SIGN, SeamlessMaps

TOO_MANY_FOLDS = "The surface has too many sharp folds for a map"
# Largest distance of two irregular points that get a constraint, in quads. Larger: slower, fewer folds.
MAX_POINT_DISTANCE = 2.0
# Largest distance of a point from a border or fold with which it gets a constraint, in quads. Larger: slower, fewer folds.
MAX_LINE_DISTANCE = 1.2
# A point lies beside a vertex of a border or fold if their offset along this line is below this number of quads. Larger:
# more constraints, slower.
MAX_LINE_OFFSET = 0.6
MAX_PAIRS = (
    5000  # largest number of constraints; noise or many pleats give far more, which take too much time and memory
)
ROW_DECIMALS = 9  # decimals to which the factors of two constraints must agree for the constraints to be equal
# Smallest offset between two irregular points after rounding, in quads, along the direction of their offset before
# rounding: above zero, so that they do not coincide or swap. Larger: fewer roundings are possible.
MIN_SEPARATION = 0.05


@dataclass(frozen=True, eq=False)
class MapConstraints:
    """Linear constraints on the map's integers x: ``rows`` @ x >= ``lower_bounds``, with positive lower bounds."""

    rows: Float[np.ndarray, "pairs whole"]
    lower_bounds: Float[np.ndarray, " pairs"]

    def are_satisfied(self, whole: Num[np.ndarray, " whole"]) -> bool:
        """Return whether the values ``whole`` of the integers satisfy all constraints."""
        return not len(self.lower_bounds) or bool((self.rows @ whole >= self.lower_bounds).all())


NO_CONSTRAINTS = MapConstraints(np.empty((0, 0)), np.empty(0))  # satisfied by all integers


def separation_constraints(maps: SeamlessMaps, edge: float, progress: Progress = SILENT) -> MapConstraints:
    """Return constraints that keep nearby irregular points, borders and folds apart when the map is rounded.

    Parameters
    ----------
    maps : all seamless maps of the surface
    edge : quad edge, metres
    progress : called with the fraction done

    Raises
    ------
    FlexMapsError : there are more than ``MAX_PAIRS`` pairs of nearby points
    """
    search = _NeighbourWalk(maps, edge)
    every = [
        (int(corner), radius)
        for held, radius in ((2, MAX_POINT_DISTANCE), (1, MAX_LINE_DISTANCE))
        for corner in search.corners_on_integers(held)
    ]
    for corner, radius in progress.each(every, "Looking for what lies near each other"):
        search.add_constraints_near(corner, radius)
        if len(search.constraints) > MAX_PAIRS:
            raise FlexMapsError(TOO_MANY_FOLDS)
    found = list(search.constraints.values())
    rows = np.array([row for row, _ in found], dtype=float).reshape(-1, maps.parametrisation.integer_factors.shape[1])
    return MapConstraints(rows, np.array([least for _, least in found], dtype=float))


class _NeighbourWalk:
    """Walks over the triangles round points with integer coordinates, to find points near them.

    A frame is the transformation (rotation and integer shift) from map coordinates in the current triangle to those in
    the triangle where the walk began. Walks meet the same frames repeatedly, so each is computed once and numbered.
    ``constraints`` maps the rounded factors of a constraint to its factors and its lower bound.
    """

    def __init__(self, maps: SeamlessMaps, edge: float):
        from scipy.spatial import cKDTree

        self.chart, self.mesh, self.edge = maps.chart, maps.chart.field.mesh, edge
        self.whole: csr_array = maps.parametrisation.integer_factors
        self.real_optimum = maps.real_optimum(edge)
        held = (np.diff(maps.parametrisation.real_factors.indptr) == 0).reshape(-1, 2)[self.chart.wedge]
        self._counts = held.sum(axis=1)
        middles = self.mesh.vertices[self.mesh.corners].mean(axis=1)
        self._tree = cKDTree(middles)
        # plain lists, because a walk looks up single numbers, which is slow with arrays
        self._opposite, self._cut, self._vertex, self._wedge = (
            x.tolist() for x in (self.mesh.opposite, self.chart.cut, self.mesh.corners.ravel(), self.chart.wedge)
        )
        self._held, self._any_held = held.tolist(), held.any(axis=1).tolist()
        self._uv = maps.uv_coordinates(edge, self.real_optimum).reshape(-1, 2).tolist()
        # at the border ``opposite`` is -1, which selects the last triangle: harmless, as no walk crosses the border
        other = self.mesh.opposite.reshape(-1, 3)
        self._way = np.linalg.norm(middles[other // 3] - middles[:, None], axis=2).ravel().tolist()
        self.constraints: dict[bytes, tuple[np.ndarray, float]] = {}
        self._rows: dict[int, np.ndarray] = {}
        self._steps: dict[int, int] = {}  # side -> number of the transition between its two triangles
        self._moves = _IndexedMotions()
        self._frames = _IndexedMotions()
        self._frames.index_of(np.eye(2, dtype=np.int64), np.zeros((2, self.whole.shape[1]), dtype=np.int64))
        self._next: dict[tuple[int, int], int] = {}  # frame and transition -> frame
        self._plain: dict[int, tuple[list[list[int]], list[float]]] = {}  # frame -> rotation and shift as lists

    def corners_on_integers(self, number: int) -> Int[np.ndarray, " corners"]:
        """Return one corner of every vertex of the cut mesh at which ``number`` of u and v (1 or 2) must be integers."""
        at = np.flatnonzero(self._counts == number)
        return at[np.unique(self.chart.wedge[at], return_index=True)[1]]

    def add_constraints_near(self, corner: int, radius: float) -> None:
        """Record the constraints between a corner and the points within ``radius`` quads of it."""
        vertex, opposite, wedge, cut, way = self._vertex, self._opposite, self._wedge, self._cut, self._way
        near_enough = set(self._tree.query_ball_point(self.mesh.vertices[vertex[corner]], radius * self.edge))
        todo = [(0.0, corner // 3, 0)]
        seen, compared = set[int](), set[tuple[int, int]]()  # several triangles share a point
        while todo:
            far, f, frame = heapq.heappop(todo)
            if f in seen:
                continue
            seen.add(f)
            for h in range(3 * f, 3 * f + 3):
                point = wedge[h], frame
                if self._any_held[h] and vertex[h] != vertex[corner] and point not in compared:
                    compared.add(point)
                    self._add_pair(corner, h, frame)
                g = opposite[h] // 3  # -1 at the border, which is never near enough
                if g not in seen and g in near_enough:
                    heapq.heappush(todo, (far + way[h], g, self._frame_across(frame, h) if cut[h] else frame))

    def _add_pair(self, corner: int, h: int, frame: int) -> None:
        """Record the constraint between the corner where the walk began and corner ``h``, if they need a constraint.

        If both coordinates of both points are integers, the points must keep their order; otherwise each coordinate
        that is an integer at both points (a border or fold) must differ by at least 1. ``frame`` is the number of the
        frame at ``h``.
        """
        turn, shift = self._plain_frame(frame)
        (u, v), here, held, there = self._uv[h], self._uv[corner], self._held[corner], self._held[h]
        way = [turn[c][0] * u + turn[c][1] * v + shift[c] - here[c] for c in (0, 1)]
        both = [held[c] and (there[0] if turn[c][0] else there[1]) for c in (0, 1)]
        if all(both):
            if max(abs(way[0]), abs(way[1])) < MAX_POINT_DISTANCE and (size := hypot(*way)) > SINGLE_TOL:
                row = self._difference(corner, h, frame)
                if row.any():
                    self._record(np.array(way) @ row / size, MIN_SEPARATION)
            return
        for c in (0, 1):
            if both[c] and SINGLE_TOL < abs(way[c]) < MAX_LINE_DISTANCE and abs(way[1 - c]) < MAX_LINE_OFFSET:
                row = self._difference(corner, h, frame)[c]
                if row.any():
                    self._record(row if way[c] > 0 else -row, 1.0)

    def _difference(self, corner: int, h: int, frame: int) -> np.ndarray:
        """Return the offset from ``corner`` to ``h`` in u and v, as factors of the map's integers, (2, whole)."""
        turn, shift = self._frames[frame]
        return turn @ self._coordinate_rows(h) + shift - self._coordinate_rows(corner)

    def _plain_frame(self, frame: int) -> tuple[list[list[int]], list[float]]:
        """Return the rotation of a frame and its shift in quads, computed with unrounded integers, as lists."""
        if frame not in self._plain:
            turn, shift = self._frames[frame]
            self._plain[frame] = turn.tolist(), (shift @ self.real_optimum).tolist()
        return self._plain[frame]

    def _record(self, row: np.ndarray, least: float) -> None:
        """Record the constraint ``row`` @ x >= ``least``, once: walks meet a pair from both ends and along several ways."""
        self.constraints.setdefault((np.round(row, ROW_DECIMALS) + 0.0).tobytes(), (row, least))

    def _coordinate_rows(self, h: int) -> np.ndarray:
        """Return u and v of a corner as factors of the map's integers, (2, whole)."""
        wedge = self._wedge[h]
        if wedge not in self._rows:
            self._rows[wedge] = self.whole[2 * wedge : 2 * wedge + 2].toarray().astype(np.int64)
        return self._rows[wedge]

    def _frame_across(self, frame: int, s: int) -> int:
        """Return the number of the frame after a step across side ``s`` of the cut, from the frame number ``frame``."""
        move = self._transition_across(s)
        if (frame, move) not in self._next:
            (turn, shift), (of_step, by) = self._frames[frame], self._moves[move]
            back = turn @ of_step.T
            self._next[frame, move] = self._frames.index_of(back, shift - back @ by)
        return self._next[frame, move]

    def _transition_across(self, s: int) -> int:
        """Return the number of the transition across side ``s`` of the cut: a rotation, then a shift."""
        if s not in self._steps:
            o, q = self._opposite[s], int(self.chart.period_jumps[s])
            turn = np.zeros((2, 2), dtype=np.int64)
            turn[[0, 1], ROTATED_AXIS[q]] = ROTATED_SIGN[q]
            after = o - o % 3 + (o + 1) % 3
            self._steps[s] = self._moves.index_of(turn, self._coordinate_rows(after) - turn @ self._coordinate_rows(s))
        return self._steps[s]


class _IndexedMotions(list[tuple[np.ndarray, np.ndarray]]):
    """List of pairs of a rotation and a shift, without duplicates."""

    def __init__(self) -> None:
        super().__init__()
        self._number: dict[bytes, int] = {}

    def index_of(self, turn: Int[np.ndarray, "2 2"], shift: Int[np.ndarray, "2 whole"]) -> int:
        """Return the position in the list of the rotation ``turn`` with ``shift``; append the pair if it is new."""
        key = turn.tobytes() + shift.tobytes()
        if key not in self._number:
            self._number[key] = len(self)
            self.append((turn, shift))
        return self._number[key]

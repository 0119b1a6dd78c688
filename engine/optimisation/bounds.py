"""Bounds of a search that are exact at every step: the box of the coordinates, and the room between the arms.

The room of a gap is a smooth function of the design (see ``spirals.room``). Near a design it is linear, so that a step keeps
``rooms + slopes step >= 0``; what curvature is left after the step is taken back along the slopes, and where that does
not help, spirals go part of the way only. So every design on the way can be cut.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import coo_array, csr_array

from ..arrays import Bool, Float
from ..linalg import Pattern, SparseCholesky
from ..spirals.room import Terms

Product = Callable[[np.ndarray], np.ndarray]
# How often a step is sought at the most, again where it has run into bounds. A third of the coordinates lie at an end of their range: with one round
# steps brought 1 to 90 % of the fall that the bounds allow
ROUNDS = 2
TURNS = 1  # looks at where its direction leads before it is followed
LOOK = 5  # rounds of conjugate gradients that tell what a direction would run into
BENT = 6  # halvings of a step until the model falls along the way that is bent at the bounds
WORTH = 0.05  # share of the model's fall that another round must bring
CG_PRECISION = 0.1  # share of the gradient that a step may leave
# The same where rooms are opened. What nearly alike rows miss unlike much would else take moves that are many times as long as
# the step: on a surface of 986 quads they took half of every step away, with this 3 to 10 %
SOFT = 0.1
MORE = 1.0 + SOFT  # of what is missing is asked for, which opens a room by itself at once
RESTORED = 8  # times that a step is brought back along the slopes of the rooms that it has closed
HALVINGS = 6  # of a spiral's own share of the step before it stays where it is
LONGEST = 50  # rounds in which spirals are found that have to go less far
# Added to the products of the rows of unit length, so that alike ones, of the four slots of a regular quad, do no harm
ALIKE = 1e-6
DENSE = 250  # rows up to which their products are factored as a full matrix, which is quicker there
TOUCHING = 1e-3  # room below which a gap counts as closed by a step towards it; the same unit as of the coordinates
LEFT = 5e-4  # room that is left where a step has been brought back, likewise


@dataclass(frozen=True, eq=False)
class Rooms:
    """The rooms near a design, in rows of unit length.

    room : what is left, in units of the coordinates; slope : derivatives by all coordinates
    """

    room: Float[np.ndarray, " rows"]
    slope: csr_array

    @classmethod
    def of(cls, value: Float[np.ndarray, " rows"], slope: csr_array) -> Rooms:
        """From rooms and slopes in any unit; what no coordinate changes is left out."""
        length = _lengths(slope)
        kept = length > 0.0
        if not kept.all():
            value, length, slope = value[kept], length[kept], slope[kept]
        return cls(value / length, _scale_rows(slope, 1.0 / length))

    @classmethod
    def none(cls, size: int) -> Rooms:
        """For so many coordinates."""
        return cls(np.zeros(0), csr_array((0, size)))

    def scaled(self, units: Float[np.ndarray, " coordinates"]) -> Rooms:
        """The same, by coordinates in these units; rows are not of unit length any more."""
        return Rooms(self.room, _scale_columns(self.slope, units))

    def of_rows(self, rows: np.ndarray) -> Rooms:
        return Rooms(self.room[rows], self.slope[rows])

    def part(self, free: Bool[np.ndarray, " coordinates"]) -> csr_array:
        """The slopes with zeros for coordinates that are not free."""
        return _scale_columns(self.slope, free)


def _lengths(rows: csr_array) -> Float[np.ndarray, " rows"]:
    row = np.repeat(np.arange(rows.shape[0]), np.diff(rows.indptr))
    return np.sqrt(np.bincount(row, rows.data * rows.data, rows.shape[0]))


# these two go without products of sparse matrices, whose making costs more than their numbers
def _scale_columns(rows: csr_array, factor: np.ndarray) -> csr_array:
    return csr_array((rows.data * factor[rows.indices], rows.indices, rows.indptr), shape=rows.shape)


def _scale_rows(rows: csr_array, factor: np.ndarray) -> csr_array:
    data = rows.data * np.repeat(factor, np.diff(rows.indptr))
    return csr_array((data, rows.indices, rows.indptr), shape=rows.shape)


def lowest(terms: Terms) -> Terms:
    """Of the gaps of two arms, which are measured at several places, only the narrowest."""
    order = np.lexsort((terms.value, *terms.arms.T))
    arms = terms.arms[order]
    first = np.ones(len(order), dtype=bool)
    first[1:] = (arms[1:] != arms[:-1]).any(axis=1)
    kept = order[first]
    by_flat = None if terms.by_flat is None else terms.by_flat[kept]
    return Terms(terms.value[kept], terms.by_design[kept], by_flat, terms.arms[kept])


class Projection:
    """Onto the steps that leave rows as they are; the least step that changes them by so much."""

    def __init__(self, rows: csr_array, soft: float = ALIKE):
        length = _lengths(rows)
        self._length = np.where(length > 0.0, length, 1.0)
        self._rows = _scale_rows(rows, 1.0 / self._length)
        self._back = self._rows.T
        self._solve = _factored(self._rows @ self._back, soft)

    def multipliers(self, way: np.ndarray) -> Float[np.ndarray, " rows"]:
        """The combination of the rows, in rows of unit length, that is nearest to a way."""
        return self._solve(self._rows @ way)

    def along(self, way: np.ndarray) -> np.ndarray:
        """What of a way leaves the rows as they are."""
        return way - self._back @ self.multipliers(way)

    def least(self, change: Float[np.ndarray, " rows"]) -> np.ndarray:
        """The shortest way that changes the rows by so much."""
        return self._back @ self._solve(change / self._length)


def _factored(square: csr_array, soft: float) -> Callable[[np.ndarray], np.ndarray]:
    """Return what solves with a positive semidefinite matrix to whose diagonal ``soft`` is added."""
    count = square.shape[0]
    if 0 < count <= DENSE:
        full = square.toarray()
        full[np.diag_indices(count)] += soft
        factor = cho_factor(full, lower=True, overwrite_a=True, check_finite=False)
        return lambda rhs: cho_solve(factor, rhs, check_finite=False)
    entries = coo_array(square)
    pattern = Pattern(entries.coords[0], entries.coords[1], count)
    values = pattern.sum(entries.data).astype(float)
    values[pattern.indices == pattern.columns] += soft
    sparse = SparseCholesky(pattern)
    sparse.factor(values)
    return sparse.solve


def bounded_step(
    x: Float[np.ndarray, " coordinates"],
    gradient: Float[np.ndarray, " coordinates"],
    product: Product,
    rooms: Rooms,
    most: int,
    units: Float[np.ndarray, " coordinates"] | None = None,
) -> Float[np.ndarray, " coordinates"]:
    """The step that nearly minimises a convex quadratic model within the bounds.

    product : of the model's matrix; most : rounds of conjugate gradients
    units : of the coordinates, in which it is sought and in which what a bound takes away is least; those of the box if None
    Conjugate gradients among the coordinates and rooms that are free, a search along the way that is bent at the bounds, and
    again with what is free then (Moré and Toraldo 1991). The model falls in every round.
    """
    if units is not None:
        product, rooms = _scaled(product, units), rooms.scaled(units)
    unit = np.ones_like(x) if units is None else units
    low, high = -x / unit, (1.0 - x) / unit
    step, slope, fallen = np.zeros_like(x), unit * gradient, 0.0
    for _ in range(ROUNDS):
        ends = np.where(step <= low, -1.0, np.where(step >= high, 1.0, 0.0))
        way = _way(slope, ends, rooms.slope[rooms.room + rooms.slope @ step < TOUCHING], product, most)
        for turn in range(BENT):
            trial = _inside(step + 0.5**turn * way, low, high, rooms)
            pulled = product(trial - step)
            fall = float((trial - step) @ (slope + 0.5 * pulled))
            if fall < 0.0:
                break
        else:
            break
        step, slope, fallen = trial, slope + pulled, fallen + fall
        if fall > WORTH * fallen:
            break
    return np.clip(unit * step, -x, 1.0 - x)  # without what rounding adds


def _scaled(product: Product, units: np.ndarray) -> Product:
    return lambda way: units * product(units * way)


def _way(
    slope: np.ndarray, ends: Float[np.ndarray, " coordinates"], closed: csr_array, product: Product, most: int
) -> Float[np.ndarray, " coordinates"]:
    """The way to the model's minimum that leaves the box nowhere and closes none of the closed rooms further.

    ends : -1 and 1 where coordinates are at the lower and the upper end of their range, else 0
    """
    fixed, onto = ends * slope < 0.0, None

    def along(way: np.ndarray) -> np.ndarray:
        way = np.where(fixed, 0.0, way)
        return way if onto is None else onto.along(way)

    held = np.zeros(closed.shape[0], dtype=bool)
    if len(held):
        held = Projection(_scale_columns(closed, ~fixed)).multipliers(np.where(fixed, 0.0, slope)) > 0.0
    for most_now in (LOOK,) * TURNS + (most,):
        onto = Projection(_scale_columns(closed[held], ~fixed)) if held.any() else None
        way = conjugate_gradients(product, along, -along(slope), min(most_now, most))
        out, further = ~fixed & (ends * way > 0.0), ~held & (closed @ way < 0.0)
        fixed, held = fixed | out, held | further
    return way


def _inside(step: np.ndarray, low: np.ndarray, high: np.ndarray, rooms: Rooms) -> Float[np.ndarray, " coordinates"]:
    """A step brought back into the box and to the rooms that it closes."""
    step = np.clip(step, low, high)
    for _ in range(RESTORED):
        closed = rooms.room + rooms.slope @ step < -0.5 * TOUCHING
        if not closed.any():
            break
        rows = rooms.of_rows(closed)
        free = (step > low) & (step < high)
        onto = Projection(rows.part(free), SOFT)
        step = np.clip(step + onto.least(-MORE * (rows.room + rows.slope @ step)), low, high)
    return step


def conjugate_gradients(
    product: Product,
    along: Callable[[np.ndarray], np.ndarray],
    rhs: np.ndarray,
    most: int,
) -> np.ndarray:
    """Solve product(v) = rhs among the ways that the projection ``along`` leaves, to a share of the right-hand side."""
    v, r = np.zeros_like(rhs), rhs.copy()
    p, rr = r.copy(), float(r @ r)
    goal = CG_PRECISION**2 * float(rhs @ rhs)
    for _ in range(most):
        if rr <= goal or rr == 0.0:
            break
        q = along(product(p))
        bend = float(p @ q)
        if bend <= 0.0:
            break
        alpha = rr / bend
        v += alpha * p
        r -= alpha * q
        old, rr = rr, float(r @ r)
        p = r + (rr / old) * p
    return v


@dataclass(frozen=True, eq=False)
class Within:
    """What ``restored`` asks of a problem.

    rooms : those that coordinates close, or would nearly, by the ``own`` first coordinates; of the rooms in which some spirals have a
        part, if given
    shut : which spirals have a part in a closed one, likewise
    spread : the share of every coordinate from those of the spirals; spirals : how many there are
    own : so many of the coordinates, as many for each spiral, may be moved to open a room
    """

    rooms: Callable[[np.ndarray, np.ndarray | None], Rooms]
    shut: Callable[[np.ndarray, np.ndarray | None], Bool[np.ndarray, " spirals"]]
    spread: Callable[[np.ndarray], np.ndarray]
    spirals: int
    own: int


def restored(
    x: Float[np.ndarray, " coordinates"], inner: Float[np.ndarray, " coordinates"], within: Within
) -> Float[np.ndarray, " coordinates"]:
    """Coordinates of a design that can be cut, near to x; ``inner`` are those of one that can."""
    x, own, quads = x.copy(), within.own, None
    for _ in range(RESTORED):
        near = within.rooms(x, quads)
        closed = near.room <= 0.0
        if not closed.any():
            return x
        rows = near.of_rows(closed)
        x[:own] = np.clip(x[:own] + Projection(rows.slope, SOFT).least(MORE * (LEFT - rows.room)), 0.0, 1.0)
        # whatever closes now has a part in what was moved
        quads = (abs(rows.slope).sum(axis=0) > 0.0).reshape(within.spirals, -1).any(axis=1)
    share, quads, found = np.ones(within.spirals), None, x
    for turn in range(LONGEST):
        quads = within.shut(found, quads)
        if not quads.any():
            return found
        if turn > HALVINGS and not share[quads].any():
            break  # what closes does not hang on them
        share[quads] = 0.5 * share[quads] if turn < HALVINGS else 0.0
        found = inner + within.spread(share) * (x - inner)
    return inner

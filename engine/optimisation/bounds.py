"""Exact bounds of a search at every step: the box of the coordinates, and the clearance between the arms.

The clearance of a gap is a smooth function of the design (see ``spirals.clearance.room``). A step keeps its linearisation
``room + slope @ step >= 0``. Gaps that still close, because clearance is curved, are opened again along the slopes; where that
fails, single spirals take only part of the step. So every design of the search can be cut.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import coo_array, csr_array

from ..arrays import Bool, Float
from ..linalg import Pattern, SparseCholesky
from ..spirals.clearance.room import Terms

Product = Callable[[np.ndarray], np.ndarray]
# Largest number of rounds a step; each starts again with the bounds that the one before has reached. A third of the coordinates are
# at an end of their range: with one round, steps brought 1 to 90 % of the decrease that the bounds allow
MAX_ROUNDS = 2
PROBES = 1  # short solves that find the bounds which a direction would run into, before the full solve
PROBE_ITERATIONS = 5  # of conjugate gradients in such a short solve
MAX_BACKTRACKS = 6  # halvings of a projected step until the model decreases
MIN_GAIN = 0.05  # share of the decrease so far that a round must bring for another one to follow
CG_PRECISION = 0.1  # norm of the residual, as a share of the right-hand side, at which conjugate gradients stop
# Tikhonov term of the least-squares problem that restores clearances. Without it, nearly parallel rows with different residuals lead to
# moves many times as long as the step: on a surface of 986 quads these undid half of every step, with this term 3 to 10 %
RESTORE_RIDGE = 0.1
OVERSHOOT = 1.0 + RESTORE_RIDGE  # factor on the missing clearance that makes up for the Tikhonov term on a single gap
MAX_RESTORATIONS = 8  # largest number of rounds that open closed gaps again along the slopes of their clearances
HALVINGS = 6  # of the share of a step that a spiral takes, before it takes none
MAX_SHORTENINGS = 50  # rounds that look for spirals which must take a smaller share
# Added to the diagonal of the Gram matrix of unit rows: the four slots of a regular quad have the same row, which makes it singular
RIDGE = 1e-6
DENSE = 250  # rows up to which the Gram matrix is factored dense, which is quicker there
CLOSED_BELOW = 1e-3  # clearance, in units of the coordinates, below which a gap counts as an active bound
MIN_CLEARANCE = 5e-4  # clearance, in units of the coordinates, that a restored gap gets


@dataclass(frozen=True, eq=False)
class LinearClearances:
    """Clearances of the gaps near a design, linearised, each scaled so that its gradient has unit length.

    room : clearances, in units of the coordinates; slope : (rows, coordinates) their derivatives
    """

    room: Float[np.ndarray, " rows"]
    slope: csr_array

    @classmethod
    def from_clearances(cls, value: Float[np.ndarray, " rows"], slope: csr_array) -> LinearClearances:
        """Normalise clearances and their derivatives, given in any unit; leave out gaps that no coordinate changes."""
        length = _lengths(slope)
        kept = length > 0.0
        if not kept.all():
            value, length, slope = value[kept], length[kept], slope[kept]
        return cls(value / length, _scale_rows(slope, 1.0 / length))

    @classmethod
    def none(cls, size: int) -> LinearClearances:
        """Return no clearances, for ``size`` coordinates."""
        return cls(np.zeros(0), csr_array((0, size)))

    def in_units(self, units: Float[np.ndarray, " coordinates"]) -> LinearClearances:
        """Return the derivatives by coordinates in these units; rows then no longer have unit length."""
        return LinearClearances(self.room, _scale_columns(self.slope, units))

    def of_rows(self, rows: np.ndarray) -> LinearClearances:
        return LinearClearances(self.room[rows], self.slope[rows])

    def part(self, free: Bool[np.ndarray, " coordinates"]) -> csr_array:
        """Return ``slope`` with zeros for coordinates that are not free."""
        return _scale_columns(self.slope, free)


def _lengths(rows: csr_array) -> Float[np.ndarray, " rows"]:
    """Return the Euclidean norm of every row."""
    row = np.repeat(np.arange(rows.shape[0]), np.diff(rows.indptr))
    return np.sqrt(np.bincount(row, rows.data * rows.data, rows.shape[0]))


# both functions below scale the stored entries, because a sparse matrix product takes longer to build than to compute
def _scale_columns(rows: csr_array, factor: np.ndarray) -> csr_array:
    return csr_array((rows.data * factor[rows.indices], rows.indices, rows.indptr), shape=rows.shape)


def _scale_rows(rows: csr_array, factor: np.ndarray) -> csr_array:
    data = rows.data * np.repeat(factor, np.diff(rows.indptr))
    return csr_array((data, rows.indices, rows.indptr), shape=rows.shape)


def narrowest_per_pair(terms: Terms) -> Terms:
    """Keep the narrowest gap of every two arms, out of the several places where it is measured."""
    order = np.lexsort((terms.value, *terms.arms.T))
    arms = terms.arms[order]
    first = np.ones(len(order), dtype=bool)
    first[1:] = (arms[1:] != arms[:-1]).any(axis=1)
    kept = order[first]
    by_flat = None if terms.by_flat is None else terms.by_flat[kept]
    return Terms(terms.value[kept], terms.by_design[kept], by_flat, terms.arms[kept])


class Projection:
    """Orthogonal projection onto the null space of ``rows``, and their least-norm solution, both with a Tikhonov term ``soft``."""

    def __init__(self, rows: csr_array, soft: float = RIDGE):
        length = _lengths(rows)
        self._length = np.where(length > 0.0, length, 1.0)
        self._rows = _scale_rows(rows, 1.0 / self._length)
        self._back = self._rows.T
        self._solve = _make_solver(self._rows @ self._back, soft)

    def multipliers(self, way: np.ndarray) -> Float[np.ndarray, " rows"]:
        """Return the coefficients of the combination of unit rows that is nearest to the vector ``way``."""
        return self._solve(self._rows @ way)

    def along(self, way: np.ndarray) -> np.ndarray:
        """Return the component of ``way`` that leaves the values of the rows unchanged."""
        return way - self._back @ self.multipliers(way)

    def least(self, change: Float[np.ndarray, " rows"]) -> np.ndarray:
        """Return the shortest vector that changes the values of the rows by ``change``."""
        return self._back @ self._solve(change / self._length)


def _make_solver(square: csr_array, soft: float) -> Callable[[np.ndarray], np.ndarray]:
    """Factor a positive semidefinite matrix plus ``soft`` on its diagonal; return a function that solves with it."""
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
    rooms: LinearClearances,
    most: int,
    units: Float[np.ndarray, " coordinates"] | None = None,
) -> Float[np.ndarray, " coordinates"]:
    """Return the step that nearly minimises a convex quadratic model within the box and the clearances.

    Conjugate gradients on the free coordinates and gaps, a line search projected onto the bounds, then again with the bounds that are
    free now (Moré and Toraldo 1991). The model decreases in every round.

    Parameters
    ----------
    x : present coordinates, in [0, 1]
    gradient : of the model at ``x``
    product : of the model's matrix with a vector (coordinates,)
    rooms : linearised clearances at ``x``
    most : largest number of iterations of conjugate gradients
    units : of the coordinates, which precondition the search and define the norm of projections; ones if None

    Returns
    -------
    The step; ``x`` plus the step lies in the box.
    """
    if units is not None:
        product, rooms = _scale_product(product, units), rooms.in_units(units)
    unit = np.ones_like(x) if units is None else units
    low, high = -x / unit, (1.0 - x) / unit
    step, slope, fallen = np.zeros_like(x), unit * gradient, 0.0
    for _ in range(MAX_ROUNDS):
        ends = np.where(step <= low, -1.0, np.where(step >= high, 1.0, 0.0))
        way = _search_direction(slope, ends, rooms.slope[rooms.room + rooms.slope @ step < CLOSED_BELOW], product, most)
        for turn in range(MAX_BACKTRACKS):
            trial = _project(step + 0.5**turn * way, low, high, rooms)
            pulled = product(trial - step)
            fall = float((trial - step) @ (slope + 0.5 * pulled))
            if fall < 0.0:
                break
        else:
            break
        step, slope, fallen = trial, slope + pulled, fallen + fall
        if fall > MIN_GAIN * fallen:
            break
    return np.clip(unit * step, -x, 1.0 - x)  # rounding may leave the box


def _scale_product(product: Product, units: np.ndarray) -> Product:
    """Return the product with the matrix by coordinates in these units."""
    return lambda way: units * product(units * way)


def _search_direction(
    slope: np.ndarray, ends: Float[np.ndarray, " coordinates"], closed: csr_array, product: Product, most: int
) -> Float[np.ndarray, " coordinates"]:
    """Return the direction to the model's minimum that neither leaves the box nor narrows a closed gap.

    ends : -1 and 1 where coordinates are at the lower and the upper end of their range, else 0; closed : slopes of closed gaps
    """
    fixed, onto = ends * slope < 0.0, None

    def along(way: np.ndarray) -> np.ndarray:
        way = np.where(fixed, 0.0, way)
        return way if onto is None else onto.along(way)

    held = np.zeros(closed.shape[0], dtype=bool)
    if len(held):
        held = Projection(_scale_columns(closed, ~fixed)).multipliers(np.where(fixed, 0.0, slope)) > 0.0
    for most_now in (PROBE_ITERATIONS,) * PROBES + (most,):
        onto = Projection(_scale_columns(closed[held], ~fixed)) if held.any() else None
        way = conjugate_gradients(product, along, -along(slope), min(most_now, most))
        out, further = ~fixed & (ends * way > 0.0), ~held & (closed @ way < 0.0)
        fixed, held = fixed | out, held | further
    return way


def _project(
    step: np.ndarray, low: np.ndarray, high: np.ndarray, rooms: LinearClearances
) -> Float[np.ndarray, " coordinates"]:
    """Bring a step back into the box, and open the gaps that it closes."""
    step = np.clip(step, low, high)
    for _ in range(MAX_RESTORATIONS):
        closed = rooms.room + rooms.slope @ step < -0.5 * CLOSED_BELOW
        if not closed.any():
            break
        rows = rooms.of_rows(closed)
        free = (step > low) & (step < high)
        onto = Projection(rows.part(free), RESTORE_RIDGE)
        step = np.clip(step + onto.least(-OVERSHOOT * (rows.room + rows.slope @ step)), low, high)
    return step


def conjugate_gradients(
    product: Product,
    along: Callable[[np.ndarray], np.ndarray],
    rhs: np.ndarray,
    most: int,
) -> np.ndarray:
    """Solve product(v) = rhs in the subspace that ``along`` projects onto, to a relative residual of ``CG_PRECISION``.

    ``most`` : largest number of iterations; ``rhs`` lies in that subspace.
    """
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
class ClearanceProblem:
    """Clearances of a problem, as ``restore_clearances`` needs them.

    rooms(x, mask) : clearances, by the first ``own`` coordinates, of closed and nearly closed gaps at the arms of the masked spirals
    shut(x, mask) : mask of the spirals with an arm in a closed gap, out of the gaps at the arms of the masked spirals
    spread : repeats a value of every spiral for each of its coordinates
    spirals : number of spirals; own : number of coordinates that may move to open a gap, equally many for each spiral
    A mask of None stands for all spirals.
    """

    rooms: Callable[[np.ndarray, np.ndarray | None], LinearClearances]
    shut: Callable[[np.ndarray, np.ndarray | None], Bool[np.ndarray, " spirals"]]
    spread: Callable[[np.ndarray], np.ndarray]
    spirals: int
    own: int


def restore_clearances(
    x: Float[np.ndarray, " coordinates"], inner: Float[np.ndarray, " coordinates"], within: ClearanceProblem
) -> Float[np.ndarray, " coordinates"]:
    """Return the coordinates of a design near ``x`` that can be cut; ``inner`` are the coordinates of a design that can be cut."""
    x, own, quads = x.copy(), within.own, None
    for _ in range(MAX_RESTORATIONS):
        near = within.rooms(x, quads)
        closed = near.room <= 0.0
        if not closed.any():
            return x
        rows = near.of_rows(closed)
        x[:own] = np.clip(
            x[:own] + Projection(rows.slope, RESTORE_RIDGE).least(OVERSHOOT * (MIN_CLEARANCE - rows.room)), 0.0, 1.0
        )
        # only gaps at spirals that have just moved can have closed
        quads = (abs(rows.slope).sum(axis=0) > 0.0).reshape(within.spirals, -1).any(axis=1)
    share, quads, found = np.ones(within.spirals), None, x
    for turn in range(MAX_SHORTENINGS):
        quads = within.shut(found, quads)
        if not quads.any():
            return found
        if turn > HALVINGS and not share[quads].any():
            break  # the remaining closed gaps do not depend on these spirals
        share[quads] = 0.5 * share[quads] if turn < HALVINGS else 0.0
        found = inner + within.spread(share) * (x - inner)
    return inner

"""Linear bounds of a step of the design variables, a box and linearised clearances, and projection into them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import coo_array, csr_array

from ..arrays import Bool, Float
from ..linalg import SparseCholesky, SparsityPattern

# Tikhonov term added to the unit diagonal of the Gram matrix of the clearances' gradients. The matrix is singular where
# slots have equal gradients, as the four slots of a regular quad. Larger: less accurate projections
RIDGE = 1e-6
MAX_DENSE_ROWS = (
    250  # largest number of rows for which the Gram matrix is factored as a dense matrix, which is quicker there
)
# Iteration of a projection: range of the spectral step length, largest number of steps, and of halvings of a step. A
# wider range and more steps are more accurate where many gaps have nearly equal gradients, and slower (docs/tuning.md)
STEP_LENGTH_RANGE, MAX_STEPS, MAX_HALVINGS = (1e-3, 100.0), 1000, 20
# Number of recent values of the dual function; a step must end below the largest of them (Grippo, Lampariello and
# Lucidi 1986). More values allow longer steps
NONMONOTONE_MEMORY = 10
ARMIJO = 1e-4  # smallest share of the predicted decrease that a step must bring (Nocedal and Wright, section 3.1)
# Largest violation of a clearance after a projection, as a share of the largest component of the projected step.
# Larger: quicker, less accurate projections (docs/tuning.md)
CLEARANCE_TOL = 3e-4
# ``CLEARANCE_TOL`` refers at least to this share of the largest component of the step before its projection, because
# closed gaps may reduce a step to almost 0. Larger: less accurate short steps
MIN_LENGTH_SHARE = 1e-3


@dataclass(frozen=True, eq=False)
class LinearClearances:
    """Linearised clearances of gaps near a design, each divided by the norm of its gradient.

    clearance : (rows,) clearances, in units of the design variables
    slope : (rows, coordinates) their gradients by the design variables, of unit length
    """

    clearance: Float[np.ndarray, " rows"]
    slope: csr_array

    @classmethod
    def from_clearances(cls, value: Float[np.ndarray, " rows"], slope: csr_array) -> LinearClearances:
        """Divide each clearance, in any unit, and its gradient by the gradient's norm; drop gaps of zero gradient."""
        length = _row_norms(slope)
        kept = length > 0.0
        if not kept.all():
            value, length, slope = value[kept], length[kept], slope[kept]
        return cls(value / length, _scale_rows(slope, 1.0 / length))

    @classmethod
    def empty(cls, size: int) -> LinearClearances:
        """Return an empty set of clearances, for ``size`` design variables."""
        return cls(np.zeros(0), csr_array((0, size)))

    def scaled(self, units: Float[np.ndarray, " coordinates"]) -> LinearClearances:
        """Return the clearances as functions of the design variables divided by ``units``, normalised anew."""
        return self.from_clearances(self.clearance, scale_columns(self.slope, units))

    def subset(self, rows: np.ndarray) -> LinearClearances:
        return LinearClearances(self.clearance[rows], self.slope[rows])


def _row_norms(rows: csr_array) -> Float[np.ndarray, " rows"]:
    """Return the Euclidean norm of every row."""
    row = np.repeat(np.arange(rows.shape[0]), np.diff(rows.indptr))
    return np.sqrt(np.bincount(row, rows.data * rows.data, rows.shape[0]))


# both functions below scale the stored entries, because a sparse matrix product takes longer to build than to compute
def scale_columns(rows: csr_array, factor: np.ndarray) -> csr_array:
    """Return a matrix with every column multiplied by its ``factor``."""
    return csr_array((rows.data * factor[rows.indices], rows.indices, rows.indptr), shape=rows.shape)


def _scale_rows(rows: csr_array, factor: np.ndarray) -> csr_array:
    data = rows.data * np.repeat(factor, np.diff(rows.indptr))
    return csr_array((data, rows.indices, rows.indptr), shape=rows.shape)


class Projection:
    """Projection onto the null space of the matrix ``rows``, and least-norm solutions with it.

    soft : Tikhonov term of both, added to the Gram matrix of the normalised rows
    """

    def __init__(self, rows: csr_array, soft: float = RIDGE):
        length = _row_norms(rows)
        self._length = np.where(length > 0.0, length, 1.0)
        self._rows = _scale_rows(rows, 1.0 / self._length)
        self._back = self._rows.T
        self._solve = _make_solver(self._rows @ self._back, soft)

    def project(self, way: np.ndarray) -> np.ndarray:
        """Return the component of the vector ``way`` in the null space of the rows."""
        return way - self._back @ self._solve(self._rows @ way)

    def least_norm_solution(self, change: Float[np.ndarray, " rows"]) -> np.ndarray:
        """Return the shortest vector v with rows @ v = ``change``."""
        return self._back @ self._solve(change / self._length)


def _make_solver(square: csr_array, soft: float) -> Callable[[np.ndarray], np.ndarray]:
    """Factor a positive semidefinite matrix plus ``soft`` on its diagonal; return a function that solves with it."""
    count = square.shape[0]
    if 0 < count <= MAX_DENSE_ROWS:
        full = square.toarray()
        full[np.diag_indices(count)] += soft
        factor = cho_factor(full, lower=True, overwrite_a=True, check_finite=False)
        return lambda rhs: cho_solve(factor, rhs, check_finite=False)
    entries = coo_array(square)
    pattern = SparsityPattern(entries.coords[0], entries.coords[1], count)
    values = pattern.sum(entries.data).astype(float)
    values[pattern.indices == pattern.columns] += soft
    sparse = SparseCholesky(pattern)
    sparse.factor(values)
    return sparse.solve


class NearestPoint(NamedTuple):
    """Point of a polytope nearest to a step; active : mask of the clearances that are active there."""

    point: Float[np.ndarray, " coordinates"]
    active: Bool[np.ndarray, " rows"]


class _DualPoint(NamedTuple):
    """Dual function of a projection, evaluated at some multipliers.

    multipliers : of the clearances, not negative
    value, slope : the dual function and its gradient; the gradient equals the clearances at ``point``
    point : the step, moved by the multipliers and clipped to the box
    """

    multipliers: Float[np.ndarray, " rows"]
    value: float
    slope: Float[np.ndarray, " rows"]
    point: Float[np.ndarray, " coordinates"]

    @property
    def violation(self) -> float:
        """Largest residual of the KKT conditions: negative clearances, and those not 0 with a positive multiplier."""
        return float(np.where(self.multipliers > 0.0, abs(self.slope), -self.slope).max(initial=0.0))


class Polytope:
    """Set of the steps within a box whose linearised clearances are not negative; it contains the step 0.

    low, high : (coordinates,) bounds of the step
    linear_clearances : clearances before the step; negative clearances count as 0
    """

    def __init__(
        self,
        low: Float[np.ndarray, " coordinates"],
        high: Float[np.ndarray, " coordinates"],
        linear_clearances: LinearClearances,
    ):
        self.low, self.high, self.slope = low, high, linear_clearances.slope
        self._room, self._back = np.maximum(linear_clearances.clearance, 0.0), csr_array(linear_clearances.slope.T)
        self._multipliers = np.zeros(len(linear_clearances.clearance))

    def clearances(self, step: np.ndarray) -> Float[np.ndarray, " rows"]:
        """Return the linearised clearances after a step."""
        return self._room + self.slope @ step

    def nearest(self, step: np.ndarray) -> NearestPoint:
        """Return the step of the polytope that is nearest to ``step``.

        The multipliers of the clearances minimise a dual function (Boyd and Vandenberghe 2004, section 5.1.6), which is
        convex and piecewise quadratic, by spectral projected gradients (Birgin, Martínez and Raydan 2000).
        """
        # the multipliers of the last projection are often a good start
        here, last = self._dual(step, np.zeros_like(self._multipliers)), self._multipliers
        if last.any():
            here = min(here, self._dual(step, last), key=lambda one: one.value)
        best, blocked, length, recent = (
            here,
            MIN_LENGTH_SHARE * abs(step).max(initial=0.0),
            1.0,
            deque([here.value], NONMONOTONE_MEMORY),
        )
        for _ in range(MAX_STEPS):
            if here.violation <= CLEARANCE_TOL * max(abs(here.point).max(initial=0.0), blocked):
                break
            there = self._descend(step, here, length, max(recent))
            if there is None:
                break
            change = there.multipliers - here.multipliers
            bend = float(change @ (there.slope - here.slope))
            length = float(np.clip(change @ change / bend, *STEP_LENGTH_RANGE)) if bend > 0.0 else STEP_LENGTH_RANGE[1]
            here, best = there, min(best, there, key=lambda one: one.violation)
            recent.append(here.value)
        self._multipliers = best.multipliers
        return NearestPoint(best.point, best.multipliers > 0.0)

    def _dual(self, step: np.ndarray, multipliers: np.ndarray) -> _DualPoint:
        place = step + self._back @ multipliers
        point = np.clip(place, self.low, self.high)
        beyond = place - point
        value = 0.5 * float(place @ place - beyond @ beyond) + float(self._room @ multipliers)
        return _DualPoint(multipliers, value, self.clearances(point), point)

    def _descend(self, step: np.ndarray, here: _DualPoint, length: float, largest: float) -> _DualPoint | None:
        """Take a projected gradient step from ``here``, halved until the dual is sufficiently below ``largest``.

        Return None if no halving is enough.
        """
        way = np.maximum(here.multipliers - length * here.slope, 0.0) - here.multipliers
        slope, share = float(here.slope @ way), 1.0
        for _ in range(MAX_HALVINGS):
            there = self._dual(step, here.multipliers + share * way)
            if there.value <= largest + ARMIJO * share * slope:
                return there
            share *= 0.5
        return None

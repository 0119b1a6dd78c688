"""Steps of the design variables that minimise a convex quadratic model, within [0, 1] and linearised clearances."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..arrays import Bool, Float
from .polytope import LinearClearances, NearestPoint, Polytope, Projection, scale_columns

Product = Callable[[np.ndarray], np.ndarray]
# The constants of this module bring 86 % of the exact decrease in the median, with a mean of 72 products of matrix and
# vector per step (docs/tuning.md)
MAX_ROUNDS = 10  # largest number of rounds in a step
# Share of the model's decrease so far that a round must add for another to follow. Smaller: larger decrease, more
# products
MIN_GAIN = 0.1
# Iterations of conjugate gradients: in a short solve, which finds the bounds that a direction would cross, and in the
# full solve within these bounds. More and fewer of either bring less (docs/tuning.md)
PROBE_ITERATIONS, FULL_ITERATIONS = 5, 15
# Norm of the residual over the right-hand side at which conjugate gradients stop. Larger: fewer products, smaller
# decrease
CG_TOL = 0.1
# Largest factor by which the projected gradient step grows or shrinks between two rounds. Smaller: smaller decrease
MAX_LENGTH_CHANGE = 10.0
MAX_HALVINGS = 6  # largest number of halvings of a direction until its projection lowers the model
# AT_BOUND: distance of a design variable from its bound, as a share of its range, below which it is at the bound.
# CLOSED_BELOW: linearised clearance below which a gap between arms is closed. Larger: slightly smaller decrease
# (docs/tuning.md)
AT_BOUND, CLOSED_BELOW = 1e-9, 1e-6


def bounded_step(
    x: Float[np.ndarray, " coordinates"],
    gradient: Float[np.ndarray, " coordinates"],
    product: Product,
    linear_clearances: LinearClearances,
    units: Float[np.ndarray, " coordinates"] | None = None,
) -> Float[np.ndarray, " coordinates"]:
    """Return the step that nearly minimises a convex quadratic model, with x in [0, 1] and no negative clearance.

    Every round takes a projected gradient step, which finds the active bounds and clearances, and then a step by
    conjugate gradients along them (Moré and Toraldo 1991). The model decreases in every round.

    Parameters
    ----------
    x : present design variables, in [0, 1]
    gradient : of the model at ``x``
    product : function that multiplies the model's matrix by a vector (coordinates,)
    linear_clearances : linearised clearances at ``x``
    units : scales of the design variables; they precondition the search and define the norm of projections; None: ones

    Returns
    -------
    The step; ``x`` plus the step lies in [0, 1].
    """
    unit = np.ones_like(x) if units is None else units
    bounds = Polytope(-x / unit, (1.0 - x) / unit, linear_clearances.scaled(unit))
    model = _Model(lambda way: unit * product(unit * way), np.zeros_like(x), unit * gradient)
    length = 1.0
    for _ in range(MAX_ROUNDS):
        before = model.decrease
        ahead = bounds.nearest(model.step - length * model.slope)
        length *= np.clip(model.descend(ahead.point - model.step), 1.0 / MAX_LENGTH_CHANGE, MAX_LENGTH_CHANGE)
        way = _search_direction(model, bounds, ahead)
        for turn in range(MAX_HALVINGS):
            change = bounds.nearest(model.step + 0.5**turn * way).point - model.step
            if change @ model.slope < 0.0:
                model.descend(change)
                break
        if model.decrease - before <= MIN_GAIN * model.decrease:
            break
    return np.clip(unit * model.step, -x, 1.0 - x)  # rounding may leave the box


@dataclass(eq=False)
class _Model:
    """A quadratic model: product with its matrix, present step, gradient there, and decrease since the step 0."""

    product: Product
    step: np.ndarray
    slope: np.ndarray
    decrease: float = 0.0

    def descend(self, change: np.ndarray) -> float:
        """Add to ``step`` the multiple of ``change``, at most 1, that minimises the model.

        Return the multiple without the limit 1; 1 if the model does not fall along ``change``.
        """
        project = -float(change @ self.slope)
        if project <= 0.0:
            return 1.0
        image = self.product(change)
        bend = float(change @ image)
        whole = project / bend if bend > 0.0 else np.inf
        share = min(whole, 1.0)
        self.step, self.slope = self.step + share * change, self.slope + share * image
        self.decrease += share * (project - 0.5 * share * bend)
        return whole


def _search_direction(model: _Model, bounds: Polytope, ahead: NearestPoint) -> Float[np.ndarray, " coordinates"]:
    """Return the direction to the model's minimum on the face of the polytope that the projected gradient step reaches.

    ahead : end of the projected gradient step, with the clearances that are active there
    """
    step, span = model.step, bounds.high - bounds.low
    low, high = step <= bounds.low + AT_BOUND * span, step >= bounds.high - AT_BOUND * span
    fixed = (low & (ahead.point <= bounds.low)) | (high & (ahead.point >= bounds.high))
    held = ahead.active & (bounds.clearances(step) < CLOSED_BELOW)
    trial = step + _minimise_on_face(model, bounds, fixed, held, PROBE_ITERATIONS)
    fixed |= (trial < bounds.low) | (trial > bounds.high)
    held |= bounds.clearances(trial) < 0.0
    return _minimise_on_face(model, bounds, fixed, held, FULL_ITERATIONS)


def _minimise_on_face(
    model: _Model,
    bounds: Polytope,
    fixed: Bool[np.ndarray, " coordinates"],
    held: Bool[np.ndarray, " rows"],
    most: int,
) -> Float[np.ndarray, " coordinates"]:
    """Return the step that minimises the model on a face of the polytope, by conjugate gradients.

    fixed : mask of the design variables that do not change; held : mask of the linearised clearances that do not change
    most : largest number of iterations
    """
    onto = Projection(scale_columns(bounds.slope[held], ~fixed)) if held.any() else None

    def project(way: np.ndarray) -> np.ndarray:
        way = np.where(fixed, 0.0, way)
        return way if onto is None else onto.project(way)

    return conjugate_gradients(model.product, project, -project(model.slope), most)


def conjugate_gradients(
    product: Product,
    project: Callable[[np.ndarray], np.ndarray],
    rhs: np.ndarray,
    most: int,
) -> np.ndarray:
    """Solve product(v) = rhs in a subspace, to a relative residual of ``CG_TOL``.

    Parameters
    ----------
    product : of a symmetric matrix with a vector
    project : projection onto the subspace
    rhs : right-hand side, in the subspace
    most : largest number of iterations
    """
    v, r = np.zeros_like(rhs), rhs.copy()
    p, rr = r.copy(), float(r @ r)
    goal = CG_TOL**2 * float(rhs @ rhs)
    for _ in range(most):
        if rr <= goal or rr == 0.0:
            break
        q = project(product(p))
        bend = float(p @ q)
        if bend <= 0.0:
            break
        alpha = rr / bend
        v += alpha * p
        r -= alpha * q
        old, rr = rr, float(r @ r)
        p = r + (rr / old) * p
    return v

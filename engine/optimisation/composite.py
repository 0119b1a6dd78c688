"""Steps that minimise a composite model: slot widths, strains and centres are linearised, their penalties are exact.

A quadratic model at the start of a step does not see arms and slots that come near their limits along the step. So the
step is composed of parts, and the penalties are expanded anew after every part, without another equilibrium (Lewis and
Wright 2016, A Proximal Method for Composite Minimization).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..arrays import Float
from .bounded_step import bounded_step
from .costs import Cost
from .inverse import DesignPoint
from .polytope import LinearClearances
from .terms import Term, rotation_damping_gradient

MAX_PARTS = 6  # largest number of parts of a step, for each of which the penalties are expanded anew; more: slower
# Share of the damped model's decrease so far that a part must add for another to follow. Smaller: longer steps, for
# which the linearised motion of the hubs is too inaccurate (docs/tuning.md)
MIN_GAIN = 0.3
# Factor on a part along which the damped model does not decrease, and largest number of trials, the whole part included
SHRINK_FACTOR, HALVINGS = 0.4, 5


@dataclass(frozen=True, eq=False)
class ModelState:
    """The model after a step of the design variables.

    step : of the design variables; increments : (n, 6) linearised increments of the hubs
    terms, costs : of the objective after the step; value : of the objective; damped : objective plus damping
    """

    step: Float[np.ndarray, " coordinates"]
    increments: Float[np.ndarray, "spirals 6"]
    terms: list[Term]
    costs: tuple[Cost, ...]
    value: float
    damped: float


@dataclass(frozen=True, eq=False)
class CompositeModel:
    """The objective near a point, damped in the design variables and in the rotations of the hubs.

    damping : weight of half the squared step of the design variables
    following : weight of half the hubs' squared rotations, radians
    units : of the design variables, see ``bounded_step``; watch : raises Cancelled
    """

    point: DesignPoint
    damping: float
    following: float
    units: Float[np.ndarray, " coordinates"]
    watch: Callable[[], None]

    def start(self) -> ModelState:
        """Return the model at the point itself, after a step of 0."""
        point = self.point
        increments = np.zeros((point.problem.assembly.whole.size, 6))
        return ModelState(np.zeros_like(point.x), increments, list(point.terms), point.costs, point.value, point.value)

    def after(self, step: np.ndarray, increments: np.ndarray) -> ModelState:
        """Return the model after a step of the design variables, with these linearised increments of the hubs."""
        terms = [term.after_step(increments, step) for term in self.point.terms]
        costs = self.point.problem.costs(self.point.x + step)
        value = sum(term.value for term in terms) + sum(cost.value for cost in costs)
        turns = 0.5 * self.following * float((increments[:, 3:] ** 2).sum())
        return ModelState(
            step, increments, terms, costs, value, value + 0.5 * self.damping * float(step @ step) + turns
        )

    def minimise(self) -> ModelState:
        """Return the model after the step that nearly minimises it, within bounds, clearances and flat limits."""
        start = here = self.start()
        for _ in range(MAX_PARTS):
            further = self._next_part(here)
            if further is None:
                break
            fall, here = here.damped - further.damped, further
            if fall < MIN_GAIN * (start.damped - here.damped) or self.point.problem.work.is_over:
                break
        return here

    def _next_part(self, here: ModelState) -> ModelState | None:
        """Return the model after one more part of the step; None if no fraction of it lowers the damped model."""
        point, problem, linear_clearances = self.point, self.point.problem, self.point.linear_clearances
        at = point.x + here.step

        def product(way: np.ndarray) -> np.ndarray:
            self.watch()
            return point.gauss_newton_product_of(way, here.terms, here.costs, self.following) + self.damping * way

        gradients = [
            rotation_damping_gradient(self.following, here.increments),
            *(term.gradient for term in here.terms),
        ]
        gradient = (
            sum((cost.gradient for cost in here.costs), point.total_gradient(gradients)) + self.damping * here.step
        )
        left = LinearClearances(
            linear_clearances.clearance + linear_clearances.slope @ here.step, linear_clearances.slope
        )
        change = bounded_step(at, gradient, product, left, self.units)
        change = problem.clip_flat_shapes(np.clip(at + change, 0.0, 1.0), at) - at
        increments, share = point.hub_increments(change), 1.0
        for _ in range(HALVINGS):
            found = self.after(here.step + share * change, here.increments + share * increments)
            if found.damped < here.damped:
                return found
            share *= SHRINK_FACTOR
        return None

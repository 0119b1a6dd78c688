"""Terms of the objective that depend on the equilibrium, with derivatives by hub increments and design variables.

A ``DesignPoint`` sums the terms, and applies the adjoint of the equilibrium once to the sum.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple, Protocol, Self

import numpy as np
from scipy.sparse import csr_array

from ..arrays import Float, Int
from ..materials import Material
from .objective import Mismatch

# The search bounds strains at the strain limit less this share of it, so that a small remaining excess does not violate
# the limit. Larger: worse match (docs/tuning.md)
LIMIT_MARGIN = 0.02
# Penalty parameter of the augmented Lagrangian, on squared relative excesses. Larger: shorter steps (docs/tuning.md)
PENALTY_PARAMETER = 1.0
# Weight of excess strain, as a multiple of the mismatch at the start of the search. Larger: worse match; smaller:
# strains end beyond the limit (docs/tuning.md)
STRAIN_WEIGHT = 100.0
# Arms whose strain is below the limit by less than this share of it are part of a step's model. Smaller: steps may
# strain arms beyond the limit that are not in the model, and are refused; larger: slower (docs/tuning.md)
ACTIVE_DISTANCE = 0.5
# WEIGHT_GROWTH: factor on the weight of excess strain at an update of the multipliers, if the largest excess has not
# fallen below SUFFICIENT_DECREASE times the largest excess at the previous update. Larger factor: strains fall to the
# limit sooner (docs/tuning.md)
WEIGHT_GROWTH, SUFFICIENT_DECREASE = 2.0, 0.5
# Largest multiplier of an arm, chosen by eye. Larger: a few arms that no spirals can relieve outweigh all other terms
MAX_MULTIPLIER = 1.0
# Penalty on excess strain when results are ranked: growth of log(merit) per relative excess. NO: after a cancel. MILD:
# when compared with the given design, and after the time limit. FULL: within a completed search
NO_STRAIN_PENALTY, MILD_STRAIN_PENALTY, FULL_STRAIN_PENALTY = 0.0, 5.0, 20.0


class Gradient(NamedTuple):
    """Derivatives of a scalar by hubs and design variables.

    by_hubs : (n, 6) with respect to the hubs' increments
    by_coordinates : (coordinates,) with respect to the design variables at fixed hubs
    A 0 stands for an array of zeros.
    """

    by_hubs: np.ndarray | float
    by_coordinates: np.ndarray | float


class Term(Protocol):
    """A summand of the objective at one equilibrium."""

    @property
    def value(self) -> float: ...

    @property
    def gradient(self) -> Gradient: ...

    def gauss_newton_product(self, increments: np.ndarray, change: np.ndarray) -> Gradient:
        """Multiply the term's Gauss-Newton matrix by hub increments (n, 6) and a change of the design variables."""

    def after_step(self, increments: np.ndarray, change: np.ndarray) -> Term:
        """Return the term after a step: its strains, slot widths or distances linearised, their penalty exact.

        increments, change : of the hubs (n, 6), and of the design variables (coordinates,)
        """


@dataclass(frozen=True, eq=False)
class Jacobian:
    """Jacobian of K quantities by hubs and design variables.

    by_hubs : (K, 6 n) with respect to the increments of the hubs
    by_coordinates : (K, coordinates) with respect to the design variables at fixed hubs
    """

    by_hubs: csr_array
    by_coordinates: csr_array

    def jvp(self, increments: np.ndarray, change: np.ndarray) -> Float[np.ndarray, " k"]:
        """Return the product with increments (n, 6) of the hubs and a change of the design variables (jvp)."""
        return self.by_hubs @ increments.ravel() + self.by_coordinates @ change

    def vjp(self, weight: Float[np.ndarray, " k"]) -> Gradient:
        """Return the gradient of the sum of the K quantities, each times its ``weight`` (vjp)."""
        return Gradient((self._transposed[0] @ weight).reshape(-1, 6), self._transposed[1] @ weight)

    def drop_zero_curvature(self, curvature: Float[np.ndarray, " k"]) -> tuple[Float[np.ndarray, " some"], Jacobian]:
        """Return the second derivatives that are not 0, and the Jacobian of only the quantities that they belong to.

        curvature : second derivatives of a scalar with respect to the K quantities
        """
        some = np.flatnonzero(curvature)
        if len(some) == len(curvature):
            return curvature, self
        return curvature[some], Jacobian(self.by_hubs[some], self.by_coordinates[some])

    @cached_property
    def _transposed(self) -> tuple[csr_array, csr_array]:
        return csr_array(self.by_hubs.T), csr_array(self.by_coordinates.T)


@dataclass(frozen=True, eq=False)
class LeastSquares(Term):
    """Half the squared norm of a dimensionless residual that is linearised along a step.

    A subclass defines ``residual``, ``jvp`` and ``vjp``; value, gradient and Gauss-Newton product follow. For an
    example see docs/extend.md.

    residual_change : change of the residual by a step; None at the equilibrium itself
    """

    residual_change: np.ndarray | None = field(default=None, kw_only=True)

    @property
    def residual(self) -> np.ndarray:
        """Residual at the equilibrium."""
        raise NotImplementedError

    def jvp(self, increments: np.ndarray, change: np.ndarray) -> np.ndarray:
        """Return the change of the residual for hub increments (n, 6) and a change of the design variables."""
        raise NotImplementedError

    def vjp(self, weight: np.ndarray) -> Gradient:
        """Return the derivatives, by hubs and design variables, of the residual's scalar product with ``weight``."""
        raise NotImplementedError

    @property
    def _residual_after_step(self) -> np.ndarray:
        """Residual after the step."""
        return self.residual if self.residual_change is None else self.residual + self.residual_change

    @property
    def value(self) -> float:
        return 0.5 * float((self._residual_after_step**2).sum())

    @property
    def gradient(self) -> Gradient:
        return self.vjp(self._residual_after_step)

    def gauss_newton_product(self, increments: np.ndarray, change: np.ndarray) -> Gradient:
        return self.vjp(self.jvp(increments, change))

    def after_step(self, increments: np.ndarray, change: np.ndarray) -> Self:
        return replace(self, residual_change=self.jvp(increments, change))


@dataclass(frozen=True, eq=False)
class MismatchTerm(LeastSquares):
    """The mismatch as a term of the objective."""

    mismatch: Mismatch

    @property
    def residual(self) -> np.ndarray:
        return self.mismatch.residual

    def jvp(self, increments: np.ndarray, change: np.ndarray) -> np.ndarray:
        return self.mismatch.jvp(self._shifts(increments))

    def vjp(self, weight: np.ndarray) -> Gradient:
        return gradient_by_centres(self.mismatch.vjp(weight))

    @property
    def gradient(self) -> Gradient:
        # at the equilibrium the derivative of the best rotation contributes nothing (envelope theorem)
        further = 0.0 if self.residual_change is None else self.mismatch.vjp(self.residual_change)
        return gradient_by_centres(self.mismatch.gradient + further)

    def gauss_newton_product(self, increments: np.ndarray, change: np.ndarray) -> Gradient:
        return gradient_by_centres(
            self.mismatch.gauss_newton_product(self._shifts(increments))
        )  # quicker than jvp, then vjp

    def _shifts(self, increments: np.ndarray) -> Float[np.ndarray, "spirals 3"]:
        """Return the translations of the hubs, without the nodes of a rim."""
        return increments[: len(self.mismatch.target.points), :3]


@dataclass(frozen=True, eq=False)
class StrainLimit:
    """Limit of the arms' strains, enforced by an augmented Lagrangian (Nocedal and Wright, section 17.3).

    material, share : the limit is ``share`` times the material's safe strain
    weight : of the squared excesses in the objective
    multipliers : (m, 2) multipliers of both arms of every joint; None before the first update
    last_excess : largest relative excess at the last update of the multipliers
    """

    material: Material
    share: float
    weight: float = 1.0
    multipliers: Float[np.ndarray, "joints 2"] | None = None
    last_excess: float = np.inf

    @property
    def limit(self) -> float:
        """Largest allowed strain, dimensionless."""
        return self.share * self.material.safe_strain

    def excess(self, strains: Float[np.ndarray, "joints 2"]) -> Float[np.ndarray, "joints 2"]:
        """Return strains (m, 2) over (1 - ``LIMIT_MARGIN``) times the limit, minus 1; negative below that bound."""
        return strains / ((1.0 - LIMIT_MARGIN) * self.limit) - 1.0

    def with_updated_multipliers(self, strains: Float[np.ndarray, "joints 2"]) -> StrainLimit:
        """Return a copy with multipliers updated from the arms' largest strains (m, 2).

        The weight grows if the largest excess is above ``SUFFICIENT_DECREASE`` times that at the last update.
        """
        known, excess = 0.0 if self.multipliers is None else self.multipliers, self.excess(strains)
        worst = max(float(excess.max(initial=0.0)), 0.0)
        stiffer = WEIGHT_GROWTH if worst > SUFFICIENT_DECREASE * self.last_excess else 1.0
        multipliers = np.clip(known + PENALTY_PARAMETER * excess, 0.0, MAX_MULTIPLIER) / stiffer
        return replace(self, weight=stiffer * self.weight, multipliers=multipliers, last_excess=worst)

    def with_weight_at_least(self, weight: float) -> StrainLimit:
        """Return a copy with at least this weight; multipliers are scaled so that weight times multiplier is kept."""
        more = max(1.0, weight / self.weight)
        return replace(
            self, weight=more * self.weight, multipliers=None if self.multipliers is None else self.multipliers / more
        )

    def merit(self, value: float, max_strain: float, strain_penalty: float) -> float:
        """Return an objective times a penalty on strain beyond the limit, to rank designs.

        Parameters
        ----------
        value : of the objective
        max_strain : largest strain of the piece
        strain_penalty : ``NO_STRAIN_PENALTY``, ``MILD_STRAIN_PENALTY`` or ``FULL_STRAIN_PENALTY``
        """
        return value * float(np.exp(strain_penalty * np.clip(max_strain / self.limit - 1.0, 0.0, 1.0)))


@dataclass(frozen=True, eq=False)
class StrainTerm(Term):
    """Augmented Lagrangian of the strain limits: mean over all arms of half the squared positive multiplier estimates.

    The multiplier estimate of an arm is its multiplier plus ``PENALTY_PARAMETER`` times its relative excess; beyond
    ``MAX_MULTIPLIER`` the term is linear (Huber's loss).

    strains : (m, 2) of both arms of every joint
    jacobian_of : function from indices of arms, 2 * joint + (0 or 1), to the Jacobian of their largest strains
    """

    strain_limit: StrainLimit
    strains: Float[np.ndarray, "joints 2"]
    jacobian_of: Callable[[np.ndarray], Jacobian]

    @cached_property
    def _active_estimates(self) -> Float[np.ndarray, " k"]:
        """Multiplier estimates of the active arms, not clipped to ``MAX_MULTIPLIER``."""
        return self._estimates[self._active]

    @cached_property
    def _estimates(self) -> Float[np.ndarray, " arms"]:
        """Multiplier estimates of all arms: multiplier plus ``PENALTY_PARAMETER`` times the relative excess."""
        known = 0.0 if self.strain_limit.multipliers is None else self.strain_limit.multipliers
        return (known + PENALTY_PARAMETER * self.strain_limit.excess(self.strains)).ravel()

    @cached_property
    def _active(self) -> Int[np.ndarray, " k"]:
        """Indices of the active arms, which are in a step's model: their estimate exceeds -``ACTIVE_DISTANCE``."""
        return np.flatnonzero(self._estimates > -ACTIVE_DISTANCE)

    @cached_property
    def _jacobian(self) -> Jacobian:
        """Jacobian of the active arms' largest strains."""
        return self.jacobian_of(self._active)

    @property
    def _weight_per_arm(self) -> float:
        """Weight of one arm in the objective."""
        return self.strain_limit.weight / (2 * len(self.strains))

    @property
    def _excess_per_strain(self) -> float:
        """Derivative of the relative excess with respect to the strain."""
        return 1.0 / ((1.0 - LIMIT_MARGIN) * self.strain_limit.limit)

    def value_at(self, estimate: Float[np.ndarray, " k"]) -> float:
        """Return the value of the term at these multiplier estimates (k,) of the active arms."""
        return self._weight_per_arm / PENALTY_PARAMETER * _huber_loss(estimate)

    def gradient_at(self, estimate: Float[np.ndarray, " k"]) -> Gradient:
        """Return the gradient of the term at these multiplier estimates (k,) of the active arms."""
        return self._jacobian.vjp(
            self._weight_per_arm * self._excess_per_strain * np.clip(estimate, 0.0, MAX_MULTIPLIER)
        )

    def curvature_at(
        self, estimate: Float[np.ndarray, " k"], negative_factor: Float[np.ndarray, " k"] | float
    ) -> np.ndarray:
        """Return the second derivatives (k,) of the term with respect to the active arms' strains.

        Where Huber's loss is linear, a parabola of equal slope replaces it.

        estimate : (k,) multiplier estimates of the active arms
        negative_factor : factor on the second derivatives of arms with a negative estimate
        """
        share = np.where(
            estimate > 0.0, np.minimum(1.0, MAX_MULTIPLIER / np.maximum(estimate, MAX_MULTIPLIER)), negative_factor
        )
        return self._weight_per_arm * PENALTY_PARAMETER * self._excess_per_strain**2 * share

    @property
    def value(self) -> float:
        return self.value_at(self._active_estimates)

    @property
    def gradient(self) -> Gradient:
        return self.gradient_at(self._active_estimates)

    @cached_property
    def _curvature(self) -> Float[np.ndarray, " k"]:
        """Second derivatives with respect to the active strains; they fade to 0 for arms far below the limit."""
        return self.curvature_at(self._active_estimates, 1.0 + self._active_estimates / ACTIVE_DISTANCE)

    def gauss_newton_product(self, increments: np.ndarray, change: np.ndarray) -> Gradient:
        return self._jacobian.vjp(self._curvature * self._jacobian.jvp(increments, change))

    def after_step(self, increments: np.ndarray, change: np.ndarray) -> StrainTermAtStep:
        return StrainTermAtStep(
            self, PENALTY_PARAMETER * self._excess_per_strain * self._jacobian.jvp(increments, change)
        )


@dataclass(frozen=True, eq=False)
class StrainTermAtStep(Term):
    """``StrainTerm`` after a step; change : (k,) linearised changes of the active arms' multiplier estimates."""

    start: StrainTerm
    change: Float[np.ndarray, " k"]

    @property
    def _active_estimates(self) -> Float[np.ndarray, " k"]:
        return self.start._active_estimates + self.change

    @property
    def value(self) -> float:
        return self.start.value_at(self._active_estimates)

    @property
    def gradient(self) -> Gradient:
        return self.start.gradient_at(self._active_estimates)

    @cached_property
    def _curvature_and_jacobian(self) -> tuple[Float[np.ndarray, " k"], Jacobian]:
        return self.start._jacobian.drop_zero_curvature(self.start.curvature_at(self._active_estimates, 0.0))

    def gauss_newton_product(self, increments: np.ndarray, change: np.ndarray) -> Gradient:
        curvature, rows = self._curvature_and_jacobian
        return rows.vjp(curvature * rows.jvp(increments, change))

    def after_step(self, increments: np.ndarray, change: np.ndarray) -> StrainTermAtStep:
        return self.start.after_step(increments, change)


def _huber_loss(estimate: Float[np.ndarray, " k"]) -> float:
    """Return the sum of Huber's losses of the positive estimates: half the square, linear beyond ``MAX_MULTIPLIER``."""
    estimate = np.maximum(estimate, 0.0)
    near = np.minimum(estimate, MAX_MULTIPLIER)
    return float((near * (estimate - 0.5 * near)).sum())


def rotation_damping_gradient(weight: float, increments: np.ndarray) -> Gradient:
    """Return the gradient of ``weight`` / 2 times the sum of the squared rotations in the hubs' ``increments``."""
    if not weight:
        return Gradient(0.0, 0.0)
    return Gradient(np.concatenate([np.zeros_like(increments[:, :3]), weight * increments[:, 3:]], axis=1), 0.0)


def sum_gradients(parts: list[Gradient], size: int, coordinates: int) -> tuple[np.ndarray, np.ndarray]:
    """Sum gradients of several scalars; return the sums by hubs and rim nodes (size, 6), and by design variables."""
    hubs, own = np.zeros((size, 6)), np.zeros(coordinates)
    for part in parts:
        if isinstance(part.by_hubs, np.ndarray):
            hubs[: len(part.by_hubs)] += part.by_hubs  # a part may hold the hubs only, without the nodes of a rim
        own += part.by_coordinates
    return hubs, own


def gradient_by_centres(pull: Float[np.ndarray, "spirals 3"]) -> Gradient:
    """Convert derivatives (n, 3) with respect to the hubs' centres to derivatives with respect to their increments."""
    return Gradient(np.concatenate([pull, np.zeros_like(pull)], axis=1), 0.0)


def sparse_from_runs(values: Float[np.ndarray, "k 2 n"], first: Int[np.ndarray, "k 2"], columns: int) -> csr_array:
    """Return a sparse matrix (K, columns) with two runs of n consecutive values in every row.

    first : (K, 2) column where each run begins
    """
    column = first[..., None] + np.arange(values.shape[2])
    start = np.arange(0, column.size + 1, column[0].size if len(column) else 1)
    return csr_array((values.ravel(), column.ravel(), start), shape=(len(values), columns))

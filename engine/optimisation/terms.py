"""Terms of the objective that depend on the equilibrium, with derivatives with respect to hubs and coordinates.

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

# Safety distance of the bound on strains below the limit, as a share of it, so that a small remaining excess does not
# violate the limit. Larger: worse match (docs/tuning.md)
MARGIN = 0.02
# Penalty parameter of the augmented Lagrangian, on squared relative excesses. Larger: shorter steps (docs/tuning.md)
PENALTY = 1.0
# Weight of excess strain, as a multiple of the mismatch at the start of the search. Larger: worse match; smaller:
# strains end beyond the limit (docs/tuning.md)
WEIGHT = 100.0
# Relative distance below the limit within which arms are part of a step's model. Smaller: steps may strain many other
# arms beyond the limit and are refused; larger: slower (docs/tuning.md)
ACTIVE_FROM = 0.5
# Factor on the weight after an update of the multipliers, if the largest excess is above this share of the excess at
# the update before. Larger factor: strains reach the limit sooner (docs/tuning.md)
WEIGHT_GROWTH, ENOUGH_DECREASE = 2.0, 0.5
# Largest multiplier of an arm, chosen by eye. Larger: a few arms that no spirals can relieve outweigh all other terms
MAX_MULTIPLIER = 1.0
# Penalty on excess strain when ranking results, as the growth of log(merit) per relative excess: after a cancel;
# against the given design, and after the time limit; within a completed search
LOOSE, LENIENT, STRICT = 0.0, 5.0, 20.0


class ScalarChange(NamedTuple):
    """Derivatives of a scalar.

    hubs : (n, 6) with respect to the hubs' increments; own : (coordinates,) with respect to the coordinates at fixed
        hubs
    A 0 stands for an array of zeros.
    """

    hubs: np.ndarray | float
    own: np.ndarray | float


class Term(Protocol):
    """A summand of the objective at one equilibrium."""

    @property
    def value(self) -> float: ...

    @property
    def gradient(self) -> ScalarChange: ...

    def product(self, moves: np.ndarray, change: np.ndarray) -> ScalarChange:
        """Return the product of its Gauss-Newton matrix with hub increments (n, 6) and a change of the coordinates."""

    def ahead(self, moves: np.ndarray, change: np.ndarray) -> Term:
        """Return the term after a step: linearise strains, gaps and distances, evaluate their penalty exactly."""


@dataclass(frozen=True, eq=False)
class Rows:
    """Jacobian of K quantities.

    hubs : (K, 6 n) with respect to the increments of the hubs
    own : (K, coordinates) with respect to the coordinates at fixed hubs
    """

    hubs: csr_array
    own: csr_array

    def forward(self, moves: np.ndarray, change: np.ndarray) -> Float[np.ndarray, " k"]:
        """Return the product with increments (n, 6) of the hubs and a change of the coordinates (jvp)."""
        return self.hubs @ moves.ravel() + self.own @ change

    def backward(self, weight: Float[np.ndarray, " k"]) -> ScalarChange:
        """Return the transposed product (vjp)."""
        return ScalarChange((self._transposed[0] @ weight).reshape(-1, 6), self._transposed[1] @ weight)

    def curved(self, curvature: Float[np.ndarray, " k"]) -> tuple[Float[np.ndarray, " some"], Rows]:
        """Return the second derivatives that are not 0, and the Jacobian of only the quantities that these belong to.

        curvature : second derivatives of a scalar with respect to the K quantities
        """
        some = np.flatnonzero(curvature)
        if len(some) == len(curvature):
            return curvature, self
        return curvature[some], Rows(self.hubs[some], self.own[some])

    @cached_property
    def _transposed(self) -> tuple[csr_array, csr_array]:
        return csr_array(self.hubs.T), csr_array(self.own.T)


@dataclass(frozen=True, eq=False)
class LeastSquares(Term):
    """Half the squared norm of a dimensionless residual that is linearised along a step.

    A subclass defines ``residual``, ``jvp`` and ``vjp``; value, gradient and Gauss-Newton product follow. For an
    example see docs/extend.md.

    moved : change of the residual by a step; None at the equilibrium itself
    """

    moved: np.ndarray | None = field(default=None, kw_only=True)

    @property
    def residual(self) -> np.ndarray:
        """Residual at the equilibrium."""
        raise NotImplementedError

    def jvp(self, moves: np.ndarray, change: np.ndarray) -> np.ndarray:
        """Return the change of the residual for hub increments (n, 6) and a change of the coordinates."""
        raise NotImplementedError

    def vjp(self, weight: np.ndarray) -> ScalarChange:
        """Return the derivative of the residual's scalar product with ``weight``."""
        raise NotImplementedError

    @property
    def _here(self) -> np.ndarray:
        """Residual after the step."""
        return self.residual if self.moved is None else self.residual + self.moved

    @property
    def value(self) -> float:
        return 0.5 * float((self._here**2).sum())

    @property
    def gradient(self) -> ScalarChange:
        return self.vjp(self._here)

    def product(self, moves: np.ndarray, change: np.ndarray) -> ScalarChange:
        return self.vjp(self.jvp(moves, change))

    def ahead(self, moves: np.ndarray, change: np.ndarray) -> Self:
        return replace(self, moved=self.jvp(moves, change))


@dataclass(frozen=True, eq=False)
class MismatchTerm(LeastSquares):
    """The mismatch as a term of the objective."""

    mismatch: Mismatch

    @property
    def residual(self) -> np.ndarray:
        return self.mismatch.residual

    def jvp(self, moves: np.ndarray, change: np.ndarray) -> np.ndarray:
        return self.mismatch.forward(self._shifts(moves))

    def vjp(self, weight: np.ndarray) -> ScalarChange:
        return by_centres(self.mismatch.backward(weight))

    @property
    def gradient(self) -> ScalarChange:
        # at the equilibrium the derivative of the best rotation contributes nothing (envelope theorem)
        further = 0.0 if self.moved is None else self.mismatch.backward(self.moved)
        return by_centres(self.mismatch.gradient + further)

    def product(self, moves: np.ndarray, change: np.ndarray) -> ScalarChange:
        return by_centres(self.mismatch.product(self._shifts(moves)))  # quicker than jvp, then vjp

    def _shifts(self, moves: np.ndarray) -> Float[np.ndarray, "spirals 3"]:
        """Return the translations of the hubs, without the nodes of a rim."""
        return moves[: len(self.mismatch.target.points), :3]


@dataclass(frozen=True, eq=False)
class StrainLimit:
    """Limit of the arms' strains, enforced by an augmented Lagrangian (Nocedal and Wright, section 17.3).

    material, share : the limit is ``share`` times the material's safe strain
    weight : of the squared excesses in the objective
    pushes : (m, 2) multipliers of both arms of every joint; None before the first update
    worst : largest relative excess at the last update of the multipliers
    """

    material: Material
    share: float
    weight: float = 1.0
    pushes: Float[np.ndarray, "joints 2"] | None = None
    worst: float = np.inf

    @property
    def limit(self) -> float:
        """Largest allowed strain, dimensionless."""
        return self.share * self.material.safe_strain

    def excess(self, strains: Float[np.ndarray, "joints 2"]) -> Float[np.ndarray, "joints 2"]:
        """Return the relative excess (m, 2) of strains over the limit less ``MARGIN``; negative below it."""
        return strains / ((1.0 - MARGIN) * self.limit) - 1.0

    def pressed(self, strains: Float[np.ndarray, "joints 2"]) -> StrainLimit:
        """Return a copy with multipliers updated from these strains.

        The weight grows if the excess is not below ``ENOUGH_DECREASE`` of the excess at the last update.
        """
        known, excess = 0.0 if self.pushes is None else self.pushes, self.excess(strains)
        worst = max(float(excess.max(initial=0.0)), 0.0)
        stiffer = WEIGHT_GROWTH if worst > ENOUGH_DECREASE * self.worst else 1.0
        pushes = np.clip(known + PENALTY * excess, 0.0, MAX_MULTIPLIER) / stiffer
        return replace(self, weight=stiffer * self.weight, pushes=pushes, worst=worst)

    def weighed(self, weight: float) -> StrainLimit:
        """Return a copy with at least this weight; multipliers are scaled so that weight times multiplier is kept."""
        more = max(1.0, weight / self.weight)
        return replace(self, weight=more * self.weight, pushes=None if self.pushes is None else self.pushes / more)

    def merit(self, value: float, largest: float, strictness: float) -> float:
        """Return an objective times a penalty on strain beyond the limit, to rank designs.

        Parameters
        ----------
        value : of the objective
        largest : largest strain of the piece
        strictness : ``LOOSE``, ``LENIENT`` or ``STRICT``
        """
        return value * float(np.exp(strictness * np.clip(largest / self.limit - 1.0, 0.0, 1.0)))


@dataclass(frozen=True, eq=False)
class StrainTerm(Term):
    """Augmented Lagrangian of the strain limits: half the squared positive pushes of arms, as a mean over all arms.

    An arm's push is its multiplier plus ``PENALTY`` times its relative excess; beyond ``MAX_MULTIPLIER`` the term is
    linear (Huber's loss).

    strains : (m, 2) of both arms of every joint
    changes : function from numbers of arms (2 * joint + side) to the Jacobian of their strains
    """

    bearing: StrainLimit
    strains: Float[np.ndarray, "joints 2"]
    changes: Callable[[np.ndarray], Rows]

    @cached_property
    def _push(self) -> Float[np.ndarray, " k"]:
        """Pushes of the active arms, not clipped to ``MAX_MULTIPLIER``."""
        return self._pushes[self._active]

    @cached_property
    def _pushes(self) -> Float[np.ndarray, " arms"]:
        """Pushes of all arms: multiplier plus ``PENALTY`` times the relative excess."""
        known = 0.0 if self.bearing.pushes is None else self.bearing.pushes
        return (known + PENALTY * self.bearing.excess(self.strains)).ravel()

    @cached_property
    def _active(self) -> Int[np.ndarray, " k"]:
        """Numbers of the arms in the model of a step: those whose push exceeds -``ACTIVE_FROM``."""
        return np.flatnonzero(self._pushes > -ACTIVE_FROM)

    @cached_property
    def _rows(self) -> Rows:
        """Jacobian of the active arms' strains."""
        return self.changes(self._active)

    @property
    def _unit(self) -> float:
        """Weight of one arm in the objective."""
        return self.bearing.weight / (2 * len(self.strains))

    @property
    def _by_strain(self) -> float:
        """Derivative of the relative excess with respect to the strain."""
        return 1.0 / ((1.0 - MARGIN) * self.bearing.limit)

    def value_at(self, push: Float[np.ndarray, " k"]) -> float:
        """Return the value at these pushes of the active arms."""
        return self._unit / PENALTY * _huber(push)

    def gradient_at(self, push: Float[np.ndarray, " k"]) -> ScalarChange:
        """Return the gradient at these pushes of the active arms."""
        return self._rows.backward(self._unit * self._by_strain * np.clip(push, 0.0, MAX_MULTIPLIER))

    def curvature_at(self, push: Float[np.ndarray, " k"], below: Float[np.ndarray, " k"] | float) -> np.ndarray:
        """Return the second derivatives (k,) with respect to the strains.

        In the linear part of Huber's loss they are replaced by those of a parabola of equal slope.

        push : (k,) pushes of the active arms; below : factor on the second derivative for arms with a negative push
        """
        share = np.where(push > 0.0, np.minimum(1.0, MAX_MULTIPLIER / np.maximum(push, MAX_MULTIPLIER)), below)
        return self._unit * PENALTY * self._by_strain**2 * share

    @property
    def value(self) -> float:
        return self.value_at(self._push)

    @property
    def gradient(self) -> ScalarChange:
        return self.gradient_at(self._push)

    @cached_property
    def _curvature(self) -> Float[np.ndarray, " k"]:
        """Second derivatives with respect to the active strains; they fade to 0 for arms far below the limit."""
        return self.curvature_at(self._push, 1.0 + self._push / ACTIVE_FROM)

    def product(self, moves: np.ndarray, change: np.ndarray) -> ScalarChange:
        return self._rows.backward(self._curvature * self._rows.forward(moves, change))

    def ahead(self, moves: np.ndarray, change: np.ndarray) -> StrainTermAtStep:
        return StrainTermAtStep(self, PENALTY * self._by_strain * self._rows.forward(moves, change))


@dataclass(frozen=True, eq=False)
class StrainTermAtStep(Term):
    """``StrainTerm`` after a step; change : (k,) linearised changes of the active arms' pushes."""

    start: StrainTerm
    change: Float[np.ndarray, " k"]

    @property
    def _push(self) -> Float[np.ndarray, " k"]:
        return self.start._push + self.change

    @property
    def value(self) -> float:
        return self.start.value_at(self._push)

    @property
    def gradient(self) -> ScalarChange:
        return self.start.gradient_at(self._push)

    @cached_property
    def _curved(self) -> tuple[Float[np.ndarray, " k"], Rows]:
        return self.start._rows.curved(self.start.curvature_at(self._push, 0.0))

    def product(self, moves: np.ndarray, change: np.ndarray) -> ScalarChange:
        curvature, rows = self._curved
        return rows.backward(curvature * rows.forward(moves, change))

    def ahead(self, moves: np.ndarray, change: np.ndarray) -> StrainTermAtStep:
        return self.start.ahead(moves, change)


def _huber(push: Float[np.ndarray, " k"]) -> float:
    """Return the sum of Huber's loss of the positive pushes: half the square, linear beyond ``MAX_MULTIPLIER``."""
    push = np.maximum(push, 0.0)
    near = np.minimum(push, MAX_MULTIPLIER)
    return float((near * (push - 0.5 * near)).sum())


def turning(weight: float, moves: np.ndarray) -> ScalarChange:
    """Return the gradient of the rotation damping: of ``weight`` / 2 times the squared rotations (radians) of hubs."""
    if not weight:
        return ScalarChange(0.0, 0.0)
    return ScalarChange(np.concatenate([np.zeros_like(moves[:, :3]), weight * moves[:, 3:]], axis=1), 0.0)


def total(parts: list[ScalarChange], size: int, coordinates: int) -> tuple[np.ndarray, np.ndarray]:
    """Sum derivatives of several scalars; return the sums for hubs and rim nodes (size, 6), and for coordinates."""
    hubs, own = np.zeros((size, 6)), np.zeros(coordinates)
    for part in parts:
        if isinstance(part.hubs, np.ndarray):
            hubs[: len(part.hubs)] += part.hubs  # a part may hold the hubs only, without the nodes of a rim
        own += part.own
    return hubs, own


def by_centres(pull: Float[np.ndarray, "spirals 3"]) -> ScalarChange:
    """Convert derivatives (n, 3) with respect to the hubs' centres to derivatives with respect to their increments."""
    return ScalarChange(np.concatenate([pull, np.zeros_like(pull)], axis=1), 0.0)


def rows_in_runs(values: Float[np.ndarray, "k 2 n"], first: Int[np.ndarray, "k 2"], columns: int) -> csr_array:
    """Return a sparse matrix (K, columns) with two runs of n consecutive values in every row.

    first : (K, 2) column where each run begins
    """
    column = first[..., None] + np.arange(values.shape[2])
    start = np.arange(0, column.size + 1, column[0].size if len(column) else 1)
    return csr_array((values.ravel(), column.ravel(), start), shape=(len(values), columns))

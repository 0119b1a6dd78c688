"""Terms of the objective that depend on the equilibrium; each has a value, and derivatives by the hubs and by the coordinates.

A point sums up the terms, and applies the adjoint of the equilibrium once to the sum.
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

# Relative distance below the limit at which strains are held, so that a small remaining excess does not violate it: with 0.01, four of
# nine surfaces of 150 to 544 quads ended at 1.000 to 1.003 of the limit, with 0.02 six of seven at 0.98 to 0.995. Larger ones match worse
MARGIN = 0.02
# Penalty parameter of the augmented Lagrangian, on squared relative excesses. With 5, the first stage on a sphere of 150 spirals got
# half as far
PENALTY = 1.0
# Weight of the excesses, in mismatches at the start of the search: a piece far from its target strains its arms more. On a surface of 986
# quads the error ended at 0.33 mm with 400, and at 0.28 with 100 and with 30; with 30 the limit was not kept
WEIGHT = 100.0
# Relative distance below the limit from which arms are part of a step's model; with less, a step may strain many arms beyond it at
# once. On a shell of 1296 quads three of the first steps with the flat shapes were refused with 0.3, none with 0.5
ACTIVE_FROM = 0.5
# Factor on the weight where the largest excess is more than this share of the one before. On that surface strains ended at 1.00 of their
# limit with factors of 2 and 4, at 1.02 with 1
WEIGHT_GROWTH, ENOUGH_DECREASE = 2.0, 0.5
MAX_MULTIPLIER = 1.0  # chosen by eye; without a bound, a few arms that no spirals can relieve outweigh all other terms
# Rates at which the logarithm of a design's merit grows with the largest relative excess of strain: after a cancel; against the given
# design, and after the time limit; among the designs of a completed search
LOOSE, LENIENT, STRICT = 0.0, 5.0, 20.0


class ScalarChange(NamedTuple):
    """Derivatives of a scalar; hubs : (n, 6) by the hubs' increments; own : (coordinates,) at fixed hubs; 0 for none."""

    hubs: np.ndarray | float
    own: np.ndarray | float


class Term(Protocol):
    """A summand of the objective at one equilibrium."""

    @property
    def value(self) -> float: ...

    @property
    def gradient(self) -> ScalarChange: ...

    def product(self, moves: np.ndarray, change: np.ndarray) -> ScalarChange:
        """Return the product of its Gauss-Newton matrix with increments (n, 6) of the hubs and a change of the coordinates."""

    def ahead(self, moves: np.ndarray, change: np.ndarray) -> Term:
        """Return the term after a step: strains, gaps and distances are linearised, their penalty is evaluated exactly."""


@dataclass(frozen=True, eq=False)
class Rows:
    """Jacobian of K quantities.

    hubs : (K, 6 n) by the increments of the hubs; own : (K, coordinates) by the coordinates at fixed hubs
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
        """Return the second derivatives that are not 0, and the Jacobian of these quantities only, which is enough for products."""
        some = np.flatnonzero(curvature)
        if len(some) == len(curvature):
            return curvature, self
        return curvature[some], Rows(self.hubs[some], self.own[some])

    @cached_property
    def _transposed(self) -> tuple[csr_array, csr_array]:
        return csr_array(self.hubs.T), csr_array(self.own.T)


@dataclass(frozen=True, eq=False)
class LeastSquares(Term):
    """Half the squared norm of a residual, without unit like the mismatch; the residual is linear along a step.

    A subclass defines ``residual``, ``jvp`` and ``vjp``; value, gradient and Gauss-Newton product follow. docs/extend.md shows one.

    moved : change of the residual by a step; None at the equilibrium itself
    """

    moved: np.ndarray | None = field(default=None, kw_only=True)

    @property
    def residual(self) -> np.ndarray:
        """Residual at the equilibrium."""
        raise NotImplementedError

    def jvp(self, moves: np.ndarray, change: np.ndarray) -> np.ndarray:
        """Return the change of the residual for increments (n, 6) of the hubs and a change of the coordinates."""
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
    """The mismatch as a term."""

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
        # the best rotation adds nothing at the equilibrium itself
        further = 0.0 if self.moved is None else self.mismatch.backward(self.moved)
        return by_centres(self.mismatch.gradient + further)

    def product(self, moves: np.ndarray, change: np.ndarray) -> ScalarChange:
        return by_centres(self.mismatch.product(self._shifts(moves)))  # quicker than one after the other

    def _shifts(self, moves: np.ndarray) -> Float[np.ndarray, "spirals 3"]:
        """Return the shifts of the centres, without those of the nodes of a rim."""
        return moves[: len(self.mismatch.target.points), :3]


@dataclass(frozen=True, eq=False)
class StrainLimit:
    """Limit of the arms' strains, enforced by an augmented Lagrangian (Nocedal and Wright, Numerical Optimization, section 17.3).

    material, share : the limit is this share of the material's safe strain; weight : of the squared excesses in the objective
    pushes : (m, 2) multipliers of both arms of every joint, None at the beginning; worst : largest excess when these were set last
    """

    material: Material
    share: float
    weight: float = 1.0
    pushes: Float[np.ndarray, "joints 2"] | None = None
    worst: float = np.inf

    @property
    def limit(self) -> float:
        """Largest allowed strain, without unit."""
        return self.share * self.material.safe_strain

    def excess(self, strains: Float[np.ndarray, "joints 2"]) -> Float[np.ndarray, "joints 2"]:
        """Return the relative excess (m, 2) of strains over the limit less ``MARGIN``; negative below it."""
        return strains / ((1.0 - MARGIN) * self.limit) - 1.0

    def pressed(self, strains: Float[np.ndarray, "joints 2"]) -> StrainLimit:
        """Return a copy with multipliers updated from these strains, and a larger weight if the last ones have not halved the excess."""
        known, excess = 0.0 if self.pushes is None else self.pushes, self.excess(strains)
        worst = max(float(excess.max(initial=0.0)), 0.0)
        stiffer = WEIGHT_GROWTH if worst > ENOUGH_DECREASE * self.worst else 1.0
        pushes = np.clip(known + PENALTY * excess, 0.0, MAX_MULTIPLIER) / stiffer
        return replace(self, weight=stiffer * self.weight, pushes=pushes, worst=worst)

    def weighed(self, weight: float) -> StrainLimit:
        """Return a copy with at least this weight, whose multipliers push as hard as before."""
        more = max(1.0, weight / self.weight)
        return replace(self, weight=more * self.weight, pushes=None if self.pushes is None else self.pushes / more)

    def merit(self, value: float, largest: float, strictness: float) -> float:
        """Return an objective times a penalty on the largest strain beyond the limit; strictness : ``LOOSE`` to ``STRICT``."""
        return value * float(np.exp(strictness * np.clip(largest / self.limit - 1.0, 0.0, 1.0)))


@dataclass(frozen=True, eq=False)
class StrainTerm(Term):
    """Augmented Lagrangian of the strain limits: half the squared push of every overstrained arm, as a mean over all arms.

    An arm's push is its multiplier plus ``PENALTY`` times its excess. Beyond ``MAX_MULTIPLIER`` the term is linear (Huber's loss).

    strains : (m, 2) of both arms of every joint
    changes : from numbers of arms (2 joint + side) to the Jacobian of their strains
    """

    bearing: StrainLimit
    strains: Float[np.ndarray, "joints 2"]
    changes: Callable[[np.ndarray], Rows]

    @cached_property
    def _push(self) -> Float[np.ndarray, " k"]:
        """Pushes of the active arms, unbounded."""
        return self._pushes[self._active]

    @cached_property
    def _pushes(self) -> Float[np.ndarray, " arms"]:
        """Pushes of all arms: multiplier plus ``PENALTY`` times the relative excess."""
        known = 0.0 if self.bearing.pushes is None else self.bearing.pushes
        return (known + PENALTY * self.bearing.excess(self.strains)).ravel()

    @cached_property
    def _active(self) -> Int[np.ndarray, " k"]:
        """Numbers of the arms that are part of the model of a step."""
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
        """Derivative of the relative excess by the strain."""
        return 1.0 / ((1.0 - MARGIN) * self.bearing.limit)

    def value_at(self, push: Float[np.ndarray, " k"]) -> float:
        """Return the value at these pushes of the active arms."""
        return self._unit / PENALTY * _huber(push)

    def gradient_at(self, push: Float[np.ndarray, " k"]) -> ScalarChange:
        """Return the gradient at these pushes of the active arms."""
        return self._rows.backward(self._unit * self._by_strain * np.clip(push, 0.0, MAX_MULTIPLIER))

    def curvature_at(self, push: Float[np.ndarray, " k"], below: Float[np.ndarray, " k"] | float) -> np.ndarray:
        """Return the second derivatives (k,) by the strains; in Huber's linear part those of a parabola with equal slope.

        below : factor on the second derivative for arms with a negative push
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
        """Second derivatives by the active strains; they fade out towards arms far below the limit."""
        return self.curvature_at(self._push, 1.0 + self._push / ACTIVE_FROM)

    def product(self, moves: np.ndarray, change: np.ndarray) -> ScalarChange:
        return self._rows.backward(self._curvature * self._rows.forward(moves, change))

    def ahead(self, moves: np.ndarray, change: np.ndarray) -> StrainTermAtStep:
        return StrainTermAtStep(self, PENALTY * self._by_strain * self._rows.forward(moves, change))


@dataclass(frozen=True, eq=False)
class StrainTermAtStep(Term):
    """``StrainTerm`` after a step; change : (k,) linearised change of the active arms' pushes."""

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
    """Return the sum of half the squares of positive pushes, linear beyond ``MAX_MULTIPLIER``."""
    push = np.maximum(push, 0.0)
    near = np.minimum(push, MAX_MULTIPLIER)
    return float((near * (push - 0.5 * near)).sum())


def turning(weight: float, moves: np.ndarray) -> ScalarChange:
    """Return the Hessian product of the damping: ``weight`` times half the squared rotations of the hubs, radians."""
    if not weight:
        return ScalarChange(0.0, 0.0)
    return ScalarChange(np.concatenate([np.zeros_like(moves[:, :3]), weight * moves[:, 3:]], axis=1), 0.0)


def total(parts: list[ScalarChange], size: int, coordinates: int) -> tuple[np.ndarray, np.ndarray]:
    """Sum up derivatives; return those by all hubs and rim nodes (size, 6), and those by the coordinates."""
    hubs, own = np.zeros((size, 6)), np.zeros(coordinates)
    for part in parts:
        if isinstance(part.hubs, np.ndarray):
            hubs[: len(part.hubs)] += part.hubs  # some parts leave out the nodes of a rim
        own += part.own
    return hubs, own


def by_centres(pull: Float[np.ndarray, "spirals 3"]) -> ScalarChange:
    """Return derivatives (n, 3) by the centres as derivatives by the hubs' increments."""
    return ScalarChange(np.concatenate([pull, np.zeros_like(pull)], axis=1), 0.0)


def rows_in_runs(values: Float[np.ndarray, "k 2 n"], first: Int[np.ndarray, "k 2"], columns: int) -> csr_array:
    """Return a sparse matrix (K, columns) whose rows hold two runs of values; first : (K, 2) column where each run begins."""
    column = first[..., None] + np.arange(values.shape[2])
    start = np.arange(0, column.size + 1, column[0].size if len(column) else 1)
    return csr_array((values.ravel(), column.ravel(), start), shape=(len(values), columns))

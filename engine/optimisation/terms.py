"""The terms of the objective: each knows its value, and how it changes with the hubs and with the coordinates.

A point sums them up, and takes the way through the equilibrium once for all of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from scipy.sparse import csr_array

from ..arrays import Float, Int
from ..materials import Material
from .objective import Mismatch

# Strains are held a little below their limit, so that what the last steps leave of an excess is none: with 0.01, four of nine
# surfaces of 150 to 544 quads ended at 1.000 to 1.003 of it, with 0.02 six of seven at 0.98 to 0.995
MARGIN = 0.02
# of the squares of relative excesses. With 5 the first stage on a sphere of 150 spirals came to its last step half as far on
STIFF = 1.0
# so many times the mismatch at the start is the weight of the excesses: what is far from its target pulls more on its arms. On a
# surface of 986 quads the error ended at 0.33 mm with 400, 0.28 with 100 and with 30, where the limit was not kept any more
WEIGHT = 100.0
# Relative distance below the limit within which arms belong to the model of a step; without them a step may strain many beyond it at
# once. On a shell of 1296 quads three of the first steps with the flat shapes were refused with 0.3, none with 0.5
NEAR = 0.5
# How the weight grows where the largest excess is more than this share of what it was before. On that surface strains ended at
# 1.00 of their limit with 2 and 4, at 1.02 without
GROWTH, LESS = 2.0, 0.5
HOPELESS = 1.0  # the largest multiplier, by eye: a few arms that no spirals could save would else outweigh all the rest
# By so much the logarithm of a design's merit grows with the largest relative excess: where somebody stops a search that has not
# come to hold its strains yet, and what was in sight is kept; where a result is compared with the design that was given, or time was
# over; and among the designs of a search that came to its end
LOOSE, LENIENT, STRICT = 0.0, 5.0, 20.0


class Change(NamedTuple):
    """Of a term: hubs (n, 6) by the hubs' increments; own : by every coordinate at hubs that stay; 0 where it does not change"""

    hubs: np.ndarray | float
    own: np.ndarray | float


class Term(Protocol):
    """A share of the objective at one equilibrium."""

    @property
    def value(self) -> float: ...

    @property
    def gradient(self) -> Change: ...

    def product(self, moves: np.ndarray, change: np.ndarray) -> Change:
        """Of its Gauss-Newton matrix with moves (n, 6) of the hubs and a change of the coordinates."""

    def ahead(self, moves: np.ndarray, change: np.ndarray) -> Term:
        """Return the term after a step: its strains, gaps and distances follow to first order, their penalty is evaluated anew."""


@dataclass(frozen=True, eq=False)
class Rows:
    """Derivatives of K quantities at an equilibrium.

    hubs : (K, 6 n) by the increments of the hubs; own : (K, coordinates) at hubs that stay
    """

    hubs: csr_array
    own: csr_array

    def forward(self, moves: np.ndarray, change: np.ndarray) -> Float[np.ndarray, " k"]:
        """How they change with moves (n, 6) of the hubs and a change of the coordinates."""
        return self.hubs @ moves.ravel() + self.own @ change

    def backward(self, weight: Float[np.ndarray, " k"]) -> Change:
        """Its transpose."""
        return Change((self._transposed[0] @ weight).reshape(-1, 6), self._transposed[1] @ weight)

    def curved(self, curvature: Float[np.ndarray, " k"]) -> tuple[Float[np.ndarray, " some"], Rows]:
        """Return the second derivatives that are not zero, and their rows: a product needs no others."""
        some = np.flatnonzero(curvature)
        if len(some) == len(curvature):
            return curvature, self
        return curvature[some], Rows(self.hubs[some], self.own[some])

    @cached_property
    def _transposed(self) -> tuple[csr_array, csr_array]:
        return csr_array(self.hubs.T), csr_array(self.own.T)


@dataclass(frozen=True, eq=False)
class Apart(Term):
    """How far the shape is from its target, as a term; moved : (m, 3) change of the residual, None for none"""

    mismatch: Mismatch
    moved: np.ndarray | None = None

    @property
    def value(self) -> float:
        if self.moved is None:
            return self.mismatch.value
        return 0.5 * float(((self.mismatch.residual + self.moved) ** 2).sum())

    @property
    def gradient(self) -> Change:
        further = 0.0 if self.moved is None else self.mismatch.backward(self.moved)
        return Change(_shifts(self.mismatch.gradient + further), 0.0)

    def product(self, moves: np.ndarray, change: np.ndarray) -> Change:
        return Change(_shifts(self.mismatch.backward(self._forward(moves))), 0.0)

    def ahead(self, moves: np.ndarray, change: np.ndarray) -> Apart:
        return Apart(self.mismatch, self._forward(moves))

    def _forward(self, moves: np.ndarray) -> Float[np.ndarray, "m 3"]:
        return self.mismatch.forward(moves[: len(self.mismatch.target.points), :3])


@dataclass(frozen=True, eq=False)
class Bearing:
    """What arms bear: strains up to a share of the material's limit, held there by an augmented Lagrangian.

    weight : of the squares of the excesses in the objective; pushes : (m, 2) multipliers of the limits, None at the beginning (Hestenes 1969, Powell 1969; Nocedal and Wright,
    Numerical Optimization, section 17.3); worst : the largest excess when they were last set
    """

    material: Material
    share: float
    weight: float = 1.0
    pushes: Float[np.ndarray, "joints 2"] | None = None
    worst: float = np.inf

    @property
    def limit(self) -> float:
        return self.share * self.material.safe_strain

    def excess(self, strains: Float[np.ndarray, "joints 2"]) -> Float[np.ndarray, "joints 2"]:
        """(m, 2) of strains beyond a little less than the limit, as a share; negative below."""
        return strains / ((1.0 - MARGIN) * self.limit) - 1.0

    def pressed(self, strains: Float[np.ndarray, "joints 2"]) -> Bearing:
        """With the multipliers that these strains ask for, and a larger weight where the last ones have not halved the excess."""
        known, excess = 0.0 if self.pushes is None else self.pushes, self.excess(strains)
        worst = max(float(excess.max(initial=0.0)), 0.0)
        stiffer = GROWTH if worst > LESS * self.worst else 1.0
        pushes = np.clip(known + STIFF * excess, 0.0, HOPELESS) / stiffer
        return replace(self, weight=stiffer * self.weight, pushes=pushes, worst=worst)

    def merit(self, value: float, largest: float, strictness: float) -> float:
        """A mismatch, weighed by the largest of all strains: whatever lies beyond the limit is dear, whatever is below is alike."""
        return value * float(np.exp(strictness * np.clip(largest / self.limit - 1.0, 0.0, 1.0)))


@dataclass(frozen=True, eq=False)
class Excess(Term):
    """Strains beyond what arms bear, as a mean over all arms: half of the square of what pushes them back.

    Beyond ``HOPELESS`` it goes on in a straight line (Huber's loss).

    strains : (m, 2) of both arms of every joint; changes : derivatives of those of some arms, by their numbers when both arms of one
        joint follow each other
    """

    bearing: Bearing
    strains: Float[np.ndarray, "joints 2"]
    changes: Callable[[np.ndarray], Rows]

    @cached_property
    def _push(self) -> Float[np.ndarray, " k"]:
        """Of the arms that are pushed back, before it is bounded from above."""
        return self._pushes[self._felt]

    @cached_property
    def _pushes(self) -> Float[np.ndarray, " arms"]:
        known = 0.0 if self.bearing.pushes is None else self.bearing.pushes
        return (known + STIFF * self.bearing.excess(self.strains)).ravel()

    @cached_property
    def _felt(self) -> Int[np.ndarray, " k"]:
        return np.flatnonzero(self._pushes > -NEAR)

    @cached_property
    def _rows(self) -> Rows:
        return self.changes(self._felt)

    @property
    def _unit(self) -> float:
        return self.bearing.weight / (2 * len(self.strains))

    @property
    def _by_strain(self) -> float:
        return 1.0 / ((1.0 - MARGIN) * self.bearing.limit)

    def value_at(self, push: Float[np.ndarray, " k"]) -> float:
        """Return the value where the arms are pushed back by so much."""
        return self._unit / STIFF * _huber(push)

    def gradient_at(self, push: Float[np.ndarray, " k"]) -> Change:
        """Return the gradient where the arms are pushed back by so much."""
        return self._rows.backward(self._unit * self._by_strain * np.clip(push, 0.0, HOPELESS))

    def curvature_at(self, push: Float[np.ndarray, " k"], below: Float[np.ndarray, " k"] | float) -> np.ndarray:
        """Return (k,) second derivatives by the strains: of the parabola with the same slope, so that Gauss-Newton steps go down.

        below : their share of the full one for arms that are not pushed back
        """
        share = np.where(push > 0.0, np.minimum(1.0, HOPELESS / np.maximum(push, HOPELESS)), below)
        return self._unit * STIFF * self._by_strain**2 * share

    @property
    def value(self) -> float:
        return self.value_at(self._push)

    @property
    def gradient(self) -> Change:
        return self.gradient_at(self._push)

    @cached_property
    def _curvature(self) -> Float[np.ndarray, " k"]:
        return self.curvature_at(self._push, 1.0 + self._push / NEAR)

    def product(self, moves: np.ndarray, change: np.ndarray) -> Change:
        return self._rows.backward(self._curvature * self._rows.forward(moves, change))

    def ahead(self, moves: np.ndarray, change: np.ndarray) -> ExcessAhead:
        return ExcessAhead(self, STIFF * self._by_strain * self._rows.forward(moves, change))


@dataclass(frozen=True, eq=False)
class ExcessAhead(Term):
    """``Excess`` after a step.

    change : (k,) how much more the arms in the model are pushed back than at its start
    """

    start: Excess
    change: Float[np.ndarray, " k"]

    @property
    def _push(self) -> Float[np.ndarray, " k"]:
        return self.start._push + self.change

    @property
    def value(self) -> float:
        return self.start.value_at(self._push)

    @property
    def gradient(self) -> Change:
        return self.start.gradient_at(self._push)

    @cached_property
    def _curved(self) -> tuple[Float[np.ndarray, " k"], Rows]:
        return self.start._rows.curved(self.start.curvature_at(self._push, 0.0))

    def product(self, moves: np.ndarray, change: np.ndarray) -> Change:
        curvature, rows = self._curved
        return rows.backward(curvature * rows.forward(moves, change))

    def ahead(self, moves: np.ndarray, change: np.ndarray) -> ExcessAhead:
        return self.start.ahead(moves, change)


def _huber(push: Float[np.ndarray, " k"]) -> float:
    """Sum of half of the squares of positive pushes, in a straight line beyond ``HOPELESS``."""
    push = np.maximum(push, 0.0)
    near = np.minimum(push, HOPELESS)
    return float((near * (push - 0.5 * near)).sum())


def turning(weight: float, moves: np.ndarray) -> Change:
    """Product of half of the squares of the hubs' turns in radians, by a weight: no term, but damps steps."""
    return Change(np.concatenate([np.zeros_like(moves[:, :3]), weight * moves[:, 3:]], axis=1), 0.0)


def total(parts: list[Change], size: int, coordinates: int) -> tuple[np.ndarray, np.ndarray]:
    """Sums of changes, as (size, 6), the nodes of a rim included, and (coordinates,)."""
    hubs, own = np.zeros((size, 6)), np.zeros(coordinates)
    for part in parts:
        if isinstance(part.hubs, np.ndarray):
            hubs[: len(part.hubs)] += part.hubs  # some know nothing of a rim's nodes
        own += part.own
    return hubs, own


def _shifts(pull: np.ndarray) -> np.ndarray:
    return np.concatenate([pull, np.zeros_like(pull)], axis=1)


def rows_in_runs(values: Float[np.ndarray, "k 2 n"], first: Int[np.ndarray, "k 2"], columns: int) -> csr_array:
    """(K, columns) rows with two runs of values each, from these columns on."""
    column = first[..., None] + np.arange(values.shape[2])
    start = np.arange(0, column.size + 1, column[0].size if len(column) else 1)
    return csr_array((values.ravel(), column.ravel(), start), shape=(len(values), columns))

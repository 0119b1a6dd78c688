"""What every elastic model of an assembly offers, so that equilibrium and design take any of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from scipy.sparse import csr_array

from ..arrays import Float, Int
from .assembly import Assembly, Pose
from .beyond import Beyond


@dataclass(frozen=True, eq=False)
class Expansion:
    """The elastic energy about a state, to second order in the increments of ``Pose.moved``.

    energy : joules; per_joint : (m,) joules
    gradient : (n, 6) newtons and newton metres
    hessian : (m, 12, 12) of every joint, in the order first spiral's shift, its turn, second spiral's shift, its turn
    convex : (m, 12, 12) the positive semi-definite part of it, without the curvature of the strains (Gauss-Newton)
    """

    energy: float
    per_joint: Float[np.ndarray, " joints"]
    gradient: Float[np.ndarray, "spirals 6"]
    hessian: Float[np.ndarray, "joints 12 12"]
    convex: Float[np.ndarray, "joints 12 12"]


class State(Protocol):
    """A configuration: the hubs' pose and whatever else a model carries along. Never changed in place."""

    @property
    def pose(self) -> Pose: ...


class ElasticModel(Protocol):
    """An elastic model of n spirals with m joints.

    name : "arm" or "rod"; assembly : spirals and joints at rest; pairs : (m, 2) int, the spirals of every joint
    """

    @property
    def name(self) -> str: ...

    @property
    def assembly(self) -> Assembly: ...

    @property
    def pairs(self) -> np.ndarray: ...

    def part(self, hubs: np.ndarray, joints: np.ndarray) -> ElasticModel:
        """The model of some spirals and some of the joints between them, as ``Assembly.part``: the other joints are open."""

    def weakened(self, share: np.ndarray) -> ElasticModel:
        """The model with joints of these shares (m,) of their stiffness."""

    def start(self, pose: Pose) -> Any:
        """The state at a pose, as if reached straight from rest."""

    def energy(self, state: Any) -> float:
        """Joules; not a number where the state is beyond the model."""

    def expand(self, state: Any, ahead: bool = False) -> Expansion:
        """Energy, gradient and Hessian.

        With ``ahead``, the curvature of the strains is weighted not by the stresses of the state, but by those that the
        step which led there predicted to first order: the mixed iteration of Magisano, Leonetti and Garcea (2017).
        Thin shells bend much farther with every step, for a finite step along a bend stretches them at first.
        """

    def moved(self, state: Any, step: np.ndarray) -> Any:
        """The state moved by (n, 6) as in ``Pose.moved``."""

    def gradient_by_design(self, state: Any) -> Float[np.ndarray, "joints 12 2 5"]:
        """(m, 12, 2, 2): derivative of every joint's share of the gradient by the design, at a fixed pose.

        Rows as in ``Expansion.hessian``; then the side of the joint; then width (per metre) and twist (per radian) of the
        spiral on that side.
        """

    def beyond(self) -> list[Beyond]:
        """The spirals that count as their nearest neighbours in what the model was fitted to, quantity by quantity."""

    def torsion(self, state: Any) -> Float[np.ndarray, " joints"]:
        """(m,) radians: how far the two hubs of every joint are turned against each other about the line across it."""


def summed(blocks: np.ndarray, pairs: Int[np.ndarray, "joints 2"], size: int) -> Float[np.ndarray, "spirals 6"]:
    """(n, 6) sums of per-joint vectors (m, 12) over the spirals of ``pairs`` (m, 2)."""
    index = (pairs[..., None] * 6 + np.arange(6)).ravel()
    return np.bincount(index, weights=blocks.ravel(), minlength=6 * size).reshape(size, 6)


class JointSum:
    """Sums joints' blocks (m, 12, 2 K) into a matrix (6 n, K n): from K numbers a spiral to six a spiral, or node of a rim.

    Where its entries are is worked out once for many sums.
    """

    def __init__(self, assembly: Assembly, each: int):
        """assembly : with its rim; each : K"""
        row = (assembly.pairs[..., None] * 6 + np.arange(6)).reshape(-1, 12, 1)
        column = (assembly.owners[..., None] * each + np.arange(each)).reshape(-1, 1, 2 * each)
        self._shape = (6 * assembly.size, each * assembly.spirals)
        entries, self._slot = np.unique((row * self._shape[1] + column).ravel(), return_inverse=True)
        self._indices = (entries % self._shape[1]).astype(np.int32)
        starts = np.arange(self._shape[0] + 1) * self._shape[1]
        self._indptr = np.searchsorted(entries, starts).astype(np.int32)

    def __call__(self, blocks: np.ndarray) -> csr_array:
        """The matrix of these blocks."""
        values = np.bincount(self._slot.ravel(), weights=blocks.ravel(), minlength=len(self._indices))
        return csr_array((values, self._indices, self._indptr), shape=self._shape)

"""Interface of the elastic models of an assembly, so that equilibrium and design work with any of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from scipy.sparse import csr_array

from ..arrays import Float, Int
from ..materials import Material
from .assembly import Assembly, Pose
from .beyond import Beyond


@dataclass(frozen=True, eq=False)
class Expansion:
    """The elastic energy about a state, to second order in the increments of ``Pose.moved``.

    energy : joules; per_joint : (m,) joules
    gradient : (n, 6) newtons and newton metres
    hessian : (m, 12, 12) of every joint, in the order: shift of the first spiral, its turn, shift of the second, its
        turn
    convex : (m, 12, 12) positive semi-definite part of the Hessian, without the curvature of the strains (Gauss-Newton)
    """

    energy: float
    per_joint: Float[np.ndarray, " joints"]
    gradient: Float[np.ndarray, "spirals 6"]
    hessian: Float[np.ndarray, "joints 12 12"]
    convex: Float[np.ndarray, "joints 12 12"]


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
        """Select spirals and joints between them, as ``Assembly.part``; all other joints are open.

        Parameters
        ----------
        hubs : (k,) int
        joints : (j,) int
        """

    def scale_stiffness(self, share: np.ndarray) -> ElasticModel:
        """Multiply the joints' stiffness by ``share`` (m,)."""

    def start(self, pose: Pose) -> Any:
        """State at a pose, as if reached straight from rest."""

    def energy(self, state: Any) -> float:
        """Energy in joules; not a number outside the model's range."""

    def expand(self, state: Any, ahead: bool = False) -> Expansion:
        """Compute energy, gradient and Hessian.

        Parameters
        ----------
        state : where
        ahead : weight the curvature of the strains by the stresses that the last step predicted to first order, not by
            those of the state: the mixed iteration of Magisano, Leonetti and Garcea (2017). Thin shells then bend much
            farther per step, because a finite step along a bend first stretches them.
        """

    def moved(self, state: Any, step: np.ndarray) -> Any:
        """Move a state.

        Parameters
        ----------
        state : where the step begins
        step : (n, 6) increments, as in ``Pose.moved``
        """

    def gradient_by_design(self, state: Any) -> Float[np.ndarray, "joints 12 2 5"]:
        """Differentiate every joint's share of the gradient by the design, at a fixed pose.

        Returns
        -------
        (m, 12, 2, 5) : rows as in ``Expansion.hessian``; side of the joint; four widths (per metre), then the twist
        (per radian) of the spiral on that side
        """

    def beyond(self) -> list[Beyond]:
        """List the quantities outside the model's range, with the spirals concerned."""

    def torsion(self, state: Any) -> Float[np.ndarray, " joints"]:
        """(m,) radians, turn of the two hubs of every joint relative to each other about the line across it."""

    def rebuilt(self, assembly: Assembly, material: Material) -> ElasticModel:
        """Build the model of a slightly changed assembly of the same joints; what hardly changes may be kept.

        Parameters
        ----------
        assembly : spirals and joints at rest
        material : elastic constants
        """

    def with_bending(self, factor: float) -> ElasticModel | None:
        """Multiply the stiffness against bending out of the sheet; None where that has no stiffness of its own."""

    def wrenches(self, state: Any) -> Float[np.ndarray, "joints 6"] | None:
        """(m, 6) wrench, N and N m, that the second arm of every joint exerts on the first, at the joint; None if unknown."""

    def strains(self, state: Any, material: Material) -> Float[np.ndarray, "joints 2"] | None:
        """(m, 2) largest strain on the surface of both arms of every joint, without fillets; None if unknown.

        Parameters
        ----------
        state, material : where the joints are, and the sheet
        """

    def in_plane_energy(self, state: Any) -> Float[np.ndarray, " joints"] | None:
        """(m,) joules, energy of every joint from motions in the plane of the sheet; None if unknown."""


class JointsOnly:
    """Base of models that know joints as a whole but not their arms: the arms' quantities are unknown."""

    def with_bending(self, factor: float) -> None:
        return None

    def wrenches(self, state: Any) -> None:
        return None

    def strains(self, state: Any, material: Material) -> None:
        return None

    def in_plane_energy(self, state: Any) -> None:
        return None


def sum_joint_vectors(
    blocks: np.ndarray, pairs: Int[np.ndarray, "joints 2"], size: int
) -> Float[np.ndarray, "spirals 6"]:
    """Sum vectors of joints over the spirals.

    Parameters
    ----------
    blocks : (m, 12), in the order of ``Expansion.hessian``
    pairs : (m, 2) int, the spirals of every joint
    size : n, number of spirals

    Returns
    -------
    (n, 6)
    """
    index = (pairs[..., None] * 6 + np.arange(6)).ravel()
    return np.bincount(index, weights=blocks.ravel(), minlength=6 * size).reshape(size, 6)


class JointSum:
    """Sums blocks of joints (m, 12, 2 K) to a sparse matrix (6 n, K n): derivatives of six numbers per body by K per
    spiral.

    The sparsity pattern is computed once for many sums.
    """

    def __init__(self, assembly: Assembly, each: int):
        """Compute the sparsity pattern for an assembly with its rim, and ``each`` = K numbers per spiral."""
        row = (assembly.pairs[..., None] * 6 + np.arange(6)).reshape(-1, 12, 1)
        column = (assembly.owners[..., None] * each + np.arange(each)).reshape(-1, 1, 2 * each)
        self._shape = (6 * assembly.size, each * assembly.spirals)
        entries, self._slot = np.unique((row * self._shape[1] + column).ravel(), return_inverse=True)
        self._indices = (entries % self._shape[1]).astype(np.int32)
        starts = np.arange(self._shape[0] + 1) * self._shape[1]
        self._indptr = np.searchsorted(entries, starts).astype(np.int32)

    def __call__(self, blocks: np.ndarray) -> csr_array:
        """Sum blocks."""
        values = np.bincount(self._slot.ravel(), weights=blocks.ravel(), minlength=len(self._indices))
        return csr_array((values, self._indices, self._indptr), shape=self._shape)

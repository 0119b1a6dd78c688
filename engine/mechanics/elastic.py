"""Interface of the elastic models of an assembly, so that equilibrium and design work with any of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from scipy.sparse import csr_array

from ..arrays import Float, Int
from ..materials import Material
from .assembly import Assembly, Pose
from .out_of_range import OutOfRange


@dataclass(frozen=True, eq=False)
class Expansion:
    """The elastic energy near a state, to second order in the increments of ``Pose.moved``.

    energy : joules; per_joint : (m,) joules, of every joint
    gradient : (n, 6) newtons and newton metres
    hessian : (m, 12, 12) block of every joint; rows and columns: shift and turn of its first spiral, shift and turn of
        its second
    convex : (m, 12, 12) Gauss-Newton part of the Hessian, positive semi-definite: without second derivatives of strains
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
        """Return the model of some spirals and some joints between them, without all other joints.

        Parameters
        ----------
        hubs : (k,) int
        joints : (j,) int
        """

    def scale_stiffness(self, share: np.ndarray) -> ElasticModel:
        """Return the model with the stiffness of every joint multiplied by ``share`` (m,)."""

    def start(self, pose: Pose) -> Any:
        """Return the state at a pose, as if it were reached directly from rest."""

    def energy(self, state: Any) -> float:
        """Return the energy in joules; NaN outside the model's range."""

    def expand(self, state: Any, ahead: bool = False) -> Expansion:
        """Compute energy, gradient and Hessian by the increments of the hubs.

        Parameters
        ----------
        state : about which the energy is expanded
        ahead : weight the second derivatives of the strains with the stresses that the last step predicted to first
            order, not with the state's stresses (mixed iteration of Magisano, Leonetti and Garcea, 2017). Thin shells
            then bend much farther per step, because a finite step along a bend first stretches them.
        """

    def moved(self, state: Any, step: np.ndarray) -> Any:
        """Return the state after a step.

        Parameters
        ----------
        state : where the step begins
        step : (n, 6) increments, as in ``Pose.moved``
        """

    def gradient_by_design(self, state: Any) -> Float[np.ndarray, "joints 12 2 5"]:
        """Differentiate every joint's contribution to the gradient by widths and twists, at a fixed pose.

        Returns
        -------
        (m, 12, 2, 5) : rows as in ``Expansion.hessian``; side of the joint; four widths (per metre), then the twist
        (per radian) of the spiral on that side
        """

    def beyond(self) -> list[OutOfRange]:
        """List the quantities outside the model's range, with the spirals concerned."""

    def torsion(self, state: Any) -> Float[np.ndarray, " joints"]:
        """Return the torsions (m,) of the joints, radians.

        The torsion is the turn of a joint's two hubs against each other about the line across the joint.
        """

    def rebuilt(self, assembly: Assembly, material: Material) -> ElasticModel:
        """Build the model of a slightly changed assembly with the same joints; it may reuse parts that hardly change.

        Parameters
        ----------
        assembly : spirals and joints at rest
        material : elastic constants
        """

    def with_bending(self, factor: float) -> ElasticModel | None:
        """Return the model with its stiffness against bending out of the sheet multiplied by ``factor``.

        Return None if the model has no separate stiffness for this bending.
        """

    def wrenches(self, state: Any) -> Float[np.ndarray, "joints 6"] | None:
        """Return the wrenches (m, 6), N and N m, of the second arm on the first at every joint; None if unknown."""

    def strains(self, state: Any, material: Material) -> Float[np.ndarray, "joints 2"] | None:
        """Return the largest surface strains (m, 2) of both arms of every joint, without fillets; None if unknown.

        Parameters
        ----------
        state : of the joints
        material : of the sheet
        """

    def in_plane_energy(self, state: Any) -> Float[np.ndarray, " joints"] | None:
        """Return the energy (m,) of every joint from motions in the plane of the sheet, joules; None if unknown."""


class JointsOnly:
    """Base class of models without separate arms: it returns None for all quantities of arms."""

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
    """Return for every spiral the sum of its parts of the joints' vectors.

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


class JointAssembler:
    """Assembler of sparse matrices from blocks (m, 12, 2 K) of the joints; their sparsity pattern is computed once.

    A matrix (6 n, K s) holds the derivatives of six quantities per body by K quantities per spiral. The n bodies are
    the s spirals, then the rim's nodes.
    """

    def __init__(self, assembly: Assembly, each: int):
        """Compute the sparsity pattern for an assembly with its rim, and ``each`` = K numbers per spiral."""
        row = (assembly.pairs[..., None] * 6 + np.arange(6)).reshape(-1, 12, 1)
        column = (assembly.hub_pairs[..., None] * each + np.arange(each)).reshape(-1, 1, 2 * each)
        self._shape = (6 * assembly.size, each * assembly.spirals)
        entries, self._slot = np.unique((row * self._shape[1] + column).ravel(), return_inverse=True)
        self._indices = (entries % self._shape[1]).astype(np.int32)
        starts = np.arange(self._shape[0] + 1) * self._shape[1]
        self._indptr = np.searchsorted(entries, starts).astype(np.int32)

    def __call__(self, blocks: np.ndarray) -> csr_array:
        """Assemble the matrix from blocks (m, 12, 2 K)."""
        values = np.bincount(self._slot.ravel(), weights=blocks.ravel(), minlength=len(self._indices))
        return csr_array((values, self._indices, self._indptr), shape=self._shape)

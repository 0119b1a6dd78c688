"""The interface that the elastic models of an assembly share; equilibrium and the search for designs use only this."""

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
    """The elastic energy near a state, to second order in the increments of the n hubs (see ``Pose.moved``).

    energy : joules
    per_joint : (m,) energy of every joint, joules
    gradient : (n, 6) derivatives by shift and turn of every hub, newtons and newton metres
    hessian : (m, 12, 12) contribution of every joint to the Hessian. Rows and columns: increments of the joint's first
        hub (shift 3, turn 3), then of its second
    convex : (m, 12, 12) Gauss-Newton part of ``hessian``, without the second derivatives of strains; positive
        semi-definite
    """

    energy: float
    per_joint: Float[np.ndarray, " joints"]
    gradient: Float[np.ndarray, "spirals 6"]
    hessian: Float[np.ndarray, "joints 12 12"]
    convex: Float[np.ndarray, "joints 12 12"]


class ElasticModel(Protocol):
    """An elastic model of n spirals with m joints.

    A state is an object of the model that holds a pose (``state.pose``) and what was computed for it.

    name : "arm" or "rod"
    assembly : spirals and joints at rest
    pairs : (m, 2) indices of the spirals of every joint
    """

    @property
    def name(self) -> str: ...

    @property
    def assembly(self) -> Assembly: ...

    @property
    def pairs(self) -> np.ndarray: ...

    def part(self, hubs: np.ndarray, joints: np.ndarray) -> ElasticModel:
        """Return the model of k spirals and j of the joints between them, without all other joints.

        Parameters
        ----------
        hubs : (k,) indices of the spirals
        joints : (j,) indices of the joints
        """

    def scale_stiffness(self, share: np.ndarray) -> ElasticModel:
        """Return the model with the stiffness of every joint multiplied by ``share`` (m,)."""

    def start(self, pose: Pose) -> Any:
        """Return the state at a pose, where a search starts."""

    def energy(self, state: Any) -> float:
        """Return the elastic energy in joules; NaN where the model cannot be evaluated."""

    def expand(self, state: Any, ahead: bool = False) -> Expansion:
        """Compute energy, gradient and Hessian by the increments of the hubs.

        Parameters
        ----------
        state : about which the energy is expanded
        ahead : weight the second derivatives of the strains with the stresses that the last step predicted to first
            order, instead of the stresses of the state (mixed iteration of Magisano, Leonetti and Garcea, 2017). A
            finite step along a bend also stretches a thin shell, and the large stresses from that would shorten the
            next steps; the predicted stresses are without them
        """

    def moved(self, state: Any, step: np.ndarray) -> Any:
        """Return the state after a step.

        Parameters
        ----------
        state : where the step begins
        step : (n, 6) increments, as in ``Pose.moved``
        """

    def gradient_by_design(self, state: Any) -> Float[np.ndarray, "joints 12 2 5"]:
        """Differentiate every joint's contribution to the energy's gradient by widths and twists, at a fixed pose.

        Returns
        -------
        (m, 12, 2, 5) : axis 1: increments of both hubs, as in ``Expansion.hessian``; axis 2: side of the joint; axis 3:
            four widths of the spiral on this side (per metre), then its twist (per radian)
        """

    def beyond(self) -> list[OutOfRange]:
        """Return the quantities that are outside the range of the model, with the spirals that have them."""

    def torsion(self, state: Any) -> Float[np.ndarray, " joints"]:
        """Return the torsions (m,) of the joints, radians.

        The torsion is the turn of a joint's two hubs against each other about the line across the joint.
        """

    def rebuilt(self, assembly: Assembly, material: Material) -> ElasticModel:
        """Build the model of a slightly changed assembly; parts of this model that hardly change may be reused.

        Parameters
        ----------
        assembly : spirals and joints at rest, with the joints of this model
        material : of the sheet
        """

    def with_bending(self, factor: float) -> ElasticModel | None:
        """Return a copy whose stiffness against bending out of the sheet is multiplied by ``factor``.

        Returns None if the model has no separate stiffness for this bending.
        """

    def wrenches(self, state: Any) -> Float[np.ndarray, "joints 6"] | None:
        """Return the wrenches (m, 6) of the second arm on the first at every joint, N and N m.

        Returns None if the model has no separate arms.
        """

    def strains(self, state: Any, material: Material) -> Float[np.ndarray, "joints 2"] | None:
        """Return the largest strain (m, 2) on the surface of both arms of every joint, except in the fillets.

        Returns None if the model has no separate arms.

        Parameters
        ----------
        state : state of the model
        material : material of the sheet
        """

    def in_plane_energy(self, state: Any) -> Float[np.ndarray, " joints"] | None:
        """Return the part (m,) of every joint's energy that comes from motions in the plane of the sheet, joules.

        Returns None if the model cannot separate this part.
        """


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
    """Sum vectors of joints, such as gradients, over the joints of every spiral.

    Parameters
    ----------
    blocks : (m, 12) vectors of the joints: six components for the first spiral, six for the second
    pairs : (m, 2) indices of the spirals of every joint
    size : number n of spirals

    Returns
    -------
    (n, 6) : for every spiral the sum of its six components over its joints
    """
    index = (pairs[..., None] * 6 + np.arange(6)).ravel()
    return np.bincount(index, weights=blocks.ravel(), minlength=6 * size).reshape(size, 6)


class JointAssembler:
    """Assembles sparse matrices from blocks of the m joints, with a sparsity pattern that is computed once.

    A matrix (6 n, K s) holds derivatives of six quantities of every body by K quantities of every spiral. The n bodies
    are the s spirals, then the rim's nodes. A joint's block (12, 2 K) holds the rows of its two bodies and the columns
    of its two spirals.
    """

    def __init__(self, assembly: Assembly, each: int):
        """Compute the sparsity pattern.

        assembly : with its rim (``Assembly.whole``); each : K, the number of columns per spiral
        """
        row = (assembly.pairs[..., None] * 6 + np.arange(6)).reshape(-1, 12, 1)
        column = (assembly.hub_pairs[..., None] * each + np.arange(each)).reshape(-1, 1, 2 * each)
        self._shape = (6 * assembly.size, each * assembly.spirals)
        entries, self._slot = np.unique((row * self._shape[1] + column).ravel(), return_inverse=True)
        self._indices = (entries % self._shape[1]).astype(np.int32)
        starts = np.arange(self._shape[0] + 1) * self._shape[1]
        self._indptr = np.searchsorted(entries, starts).astype(np.int32)

    def __call__(self, blocks: np.ndarray) -> csr_array:
        """Assemble the matrix (6 n, K s) from the joints' blocks (m, 12, 2 K)."""
        values = np.bincount(self._slot.ravel(), weights=blocks.ravel(), minlength=len(self._indices))
        return csr_array((values, self._indices, self._indptr), shape=self._shape)

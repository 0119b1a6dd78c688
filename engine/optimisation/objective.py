"""Mismatch between an equilibrium and the target, with its derivatives by the hubs' centres (FlexMaps section 7, eq. 6 to 10)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array, vstack

from ..arrays import Float, Int
from ..mechanics.assembly import Pose, nearest_rotation
from ..mechanics.laplacian import uniform_laplacian
from ..params import OptimiseParams
from .wishes import Wishes


@dataclass(frozen=True, eq=False)
class Target:
    """Target of the spirals' centres, and the measure of a mismatch.

    pairs : (m, 2) int, joined spirals; points : (n, 3) metres, the target of every centre
    lies : 0 compares curvature: Laplacian coordinates (eq. 9); 1 compares positions. Laplacian coordinates hardly see bends longer
        than about 30 spirals, so a piece may match in all of them and still lie far from the target. Values in between compare
        slopes too, the differences of neighbours. This is a Sobolev norm: deviations longer than (1 - lies) / lies spirals
        count by position, shorter ones by curvature
    free : whether the object may lie anywhere; it is then rotated and shifted onto the target before comparing
    wishes : further target places of some spirals; urge : weight of their mean square distance, in ``unit``
    """

    pairs: Int[np.ndarray, "joints 2"]
    points: Float[np.ndarray, "spirals 3"]
    lies: float = OptimiseParams.lies
    free: bool = True
    wishes: Wishes | None = None
    urge: float = OptimiseParams.urge

    @cached_property
    def unit(self) -> float:
        """Unit of length of the mismatch, metres: the mean distance of joined spirals."""
        a, b = self.pairs.T
        return float(np.linalg.norm(self.points[b] - self.points[a], axis=1).mean())

    @cached_property
    def weights(self) -> tuple[float, float, float]:
        """Weights of curvature, slopes and positions; their squares sum up to 1."""
        bends, slopes, places = (1.0 - self.lies) ** 2, self.lies * (1.0 - self.lies), self.lies**2
        norm = float(np.sqrt(bends**2 + slopes**2 + places**2))
        return bends / norm, slopes / norm, places / norm

    @cached_property
    def operator(self) -> csr_array:
        """Matrix (rows, n) from the centres to the compared coordinates, divided by ``unit`` and by the square root of n.

        Rows in the order Laplacian coordinates, slopes, positions (each if its weight is not 0), then the spirals with wishes,
        divided by the square root of their number instead.
        """
        n, m = len(self.points), max(len(self.pairs), 1)
        ends = np.tile([-1.0, 1.0], len(self.pairs)), (np.repeat(np.arange(len(self.pairs)), 2), self.pairs.ravel())
        slopes = csr_array(ends, shape=(len(self.pairs), n)) * np.sqrt(n / m)  # so that m rows count like n
        places = csr_array((np.ones(n), (np.arange(n), np.arange(n))), shape=(n, n))
        parts = zip(self.weights, (uniform_laplacian(self.pairs, n), slopes, places), strict=True)
        compared = vstack([weight * part for weight, part in parts if weight]) / (self.unit * np.sqrt(n))
        if self.wishes is None:
            return csr_array(compared)
        wished = places[self.wishes.quads].toarray() - (1.0 / n if self.free else 0.0)
        return csr_array(vstack([compared, csr_array(self._wish_factor * wished)]))

    @property
    def _wish_factor(self) -> float:
        """Factor on the distance of one spiral from its wished place, per metre."""
        assert self.wishes is not None
        return self.urge / (self.unit * np.sqrt(max(len(self.wishes.quads), 1)))

    @cached_property
    def back(self) -> csr_array:
        """Transpose of the operator."""
        return csr_array(self.operator.T)

    @cached_property
    def wanted(self) -> Float[np.ndarray, "joints 3"]:
        """Compared coordinates (rows, 3) of the target."""
        found = self.centred(self.operator @ self.points)
        if self.wishes is not None:
            quads, places = self.wishes.quads, self.wishes.places
            found[len(found) - len(quads) :] += self._wish_factor * (places - self.points[quads])
        return found

    def centred(self, values: np.ndarray) -> np.ndarray:
        """Return compared coordinates (rows, 3) with the mean of the positions subtracted, where the object is free."""
        if not (self.free and self.weights[2]):
            return values
        end = len(values) - (0 if self.wishes is None else len(self.wishes.quads))
        first = end - len(self.points)
        places = values[first:end]
        return np.concatenate([values[:first], places - places.mean(axis=0), values[end:]])

    def laid(self, pose: Pose) -> Pose:
        """Return a pose aligned with the target where the object is free, else the pose itself."""
        return pose.aligned(self.points) if self.free else pose

    def distance(self, pose: Pose) -> float:
        """Return the RMS distance of a pose's centres from the target's, in units of ``unit``."""
        return float(np.sqrt(((self.laid(pose).centres - self.points) ** 2).sum(axis=1).mean())) / self.unit

    @property
    def reach(self) -> float:
        """Distance of the farthest wish from the target, in units of ``unit``; 0 without wishes."""
        if self.wishes is None:
            return 0.0
        apart = self.wishes.places - self.points[self.wishes.quads]
        return float(np.sqrt((apart**2).sum(axis=1).max(initial=0.0))) / self.unit

    def compare(self, centres: Float[np.ndarray, "spirals 3"]) -> Mismatch:
        """Return the mismatch of centres (n, 3), metres."""
        own = self.centred(self.operator @ centres)
        rotation = nearest_rotation(own.T @ self.wanted) if self.free else np.eye(3)
        return Mismatch(self, own @ rotation.T, rotation)


@dataclass(frozen=True, eq=False)
class Mismatch:
    """One comparison with the target; its value is half the sum of the squared residuals.

    own : (rows, 3) compared coordinates of the centres, rotated by ``rotation`` (3, 3) onto the target's
    """

    target: Target
    own: Float[np.ndarray, "joints 3"]
    rotation: np.ndarray

    @property
    def residual(self) -> Float[np.ndarray, "joints 3"]:
        """Differences (rows, 3) of the compared coordinates, scaled as in ``Target.operator``."""
        return self.own - self.target.wanted

    @property
    def value(self) -> float:
        return 0.5 * float((self.residual**2).sum())

    @property
    def rmse(self) -> float:
        """RMSE of the Laplacian coordinates, metres; of the positions where Laplacian coordinates are not compared."""
        weight = self.target.weights[0] or self.target.weights[2]
        compared = self.residual[: len(self.target.points)]
        return float(np.sqrt((compared**2).sum())) * self.target.unit / weight

    @property
    def wished(self) -> float:
        """RMS distance of the spirals with wishes from their wished places, metres; 0 without wishes."""
        wishes = self.target.wishes
        if wishes is None:
            return 0.0
        rows = self.residual[len(self.own) - len(wishes.quads) :]
        return float(np.sqrt((rows**2).sum())) * self.target.unit / max(self.target.urge, 1e-30)

    @property
    def gradient(self) -> Float[np.ndarray, "spirals 3"]:
        """Gradient of the value by the centres, per metre; the best rotation adds nothing to it (envelope theorem)."""
        return self.backward(self.residual, project=False)

    @cached_property
    def _rotation_basis(self) -> Float[np.ndarray, "_ some"]:
        """Orthonormal basis (3 rows, k) of the residual's changes under small rotations of the piece; empty where it is held."""
        if not self.target.free:
            return np.zeros((self.own.size, 0))
        turned = np.stack([np.cross(axis, self.own).ravel() for axis in np.eye(3)], axis=1)
        return np.linalg.qr(turned)[0]

    def forward(self, shift: np.ndarray) -> Float[np.ndarray, "joints 3"]:
        """Return the linearised change (rows, 3) of the residual for shifts (n, 3) of the centres, metres; the rotation adjusts."""
        return self._project_out_rotations(self.target.centred(self.target.operator @ shift) @ self.rotation.T)

    def backward(self, change: np.ndarray, project: bool = True) -> np.ndarray:
        """Return the transposed product of ``forward``; if not ``project``, with the rotation held fixed."""
        kept = self._project_out_rotations(change) if project else change
        return self.target.back @ self.target.centred(kept @ self.rotation)

    def product(self, shift: Float[np.ndarray, "spirals 3"]) -> Float[np.ndarray, "spirals 3"]:
        """Return ``backward`` of ``forward``: the product of the Gauss-Newton matrix by the centres."""
        found = self.target.back @ (self.target.operator @ shift)
        return found - (self._undone @ (self._undone.T @ shift.ravel())).reshape(-1, 3)

    @cached_property
    def _undone(self) -> Float[np.ndarray, "_ some"]:
        """Derivatives (3 n, k) by the centres of the components that centring and ``_project_out_rotations`` take away."""
        turned = (self._rotation_basis.reshape(*self.own.shape, -1).swapaxes(1, 2) @ self.rotation).swapaxes(1, 2)
        place = np.ones((len(self.own), 1)) - self.target.centred(np.ones((len(self.own), 1)))
        shifted = (place / max(float(np.linalg.norm(place)), 1.0))[:, :, None] * np.eye(3)
        both = np.concatenate([shifted, turned], axis=2)
        return (self.target.back @ both.reshape(len(both), -1)).reshape(3 * self.target.back.shape[0], -1)

    def _project_out_rotations(self, change: np.ndarray) -> np.ndarray:
        """Subtract from a change of the residual the component that a small rotation of the piece undoes."""
        flat = change.ravel()
        return (flat - self._rotation_basis @ (self._rotation_basis.T @ flat)).reshape(change.shape)

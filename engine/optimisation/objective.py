"""How far an equilibrium is from the target, and how that changes with the design (FlexMaps section 7, eq. 6 to 10)."""

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
    """What the centres of the spirals are compared with.

    pairs : (m, 2) int, joined spirals; points : (n, 3) metres, the target of every centre
    lies : from 0, how the surface bends: Laplacian coordinates alone (eq. 9), to 1, where it lies: places alone. Laplacian
        coordinates hardly feel bends that are longer than some 30 spirals, so that a piece may match in all of them and
        still lie far away. In between, slopes count too: the differences of neighbours. Together they are a norm of
        Sobolev in which what is longer than (1 - lies) / lies spirals counts by its place and what is shorter by its bends
    free : the object may lie anywhere: before comparing it is turned, and shifted, onto the target
    wishes : places where some spirals shall come to beside that; urge : how much their mean square distance counts, in ``unit``
    """

    pairs: Int[np.ndarray, "joints 2"]
    points: Float[np.ndarray, "spirals 3"]
    lies: float = OptimiseParams.lies
    free: bool = True
    wishes: Wishes | None = None
    urge: float = OptimiseParams.urge

    @cached_property
    def unit(self) -> float:
        """Metres, the distance that counts as one: the mean distance of joined spirals."""
        a, b = self.pairs.T
        return float(np.linalg.norm(self.points[b] - self.points[a], axis=1).mean())

    @cached_property
    def weights(self) -> tuple[float, float, float]:
        """Of bends, slopes and places; their squares sum up to 1."""
        bends, slopes, places = (1.0 - self.lies) ** 2, self.lies * (1.0 - self.lies), self.lies**2
        norm = float(np.sqrt(bends**2 + slopes**2 + places**2))
        return bends / norm, slopes / norm, places / norm

    @cached_property
    def operator(self) -> csr_array:
        """(m, n): takes centres to the coordinates that are compared, over ``unit`` and the root of n; places come last, and then those
        of which somebody wishes something, over the root of their number.
        """
        n, m = len(self.points), max(len(self.pairs), 1)
        ends = np.tile([-1.0, 1.0], len(self.pairs)), (np.repeat(np.arange(len(self.pairs)), 2), self.pairs.ravel())
        slopes = csr_array(ends, shape=(len(self.pairs), n)) * np.sqrt(n / m)  # as much as one for every spiral
        places = csr_array((np.ones(n), (np.arange(n), np.arange(n))), shape=(n, n))
        parts = zip(self.weights, (uniform_laplacian(self.pairs, n), slopes, places), strict=True)
        compared = vstack([weight * part for weight, part in parts if weight]) / (self.unit * np.sqrt(n))
        if self.wishes is None:
            return csr_array(compared)
        wished = places[self.wishes.quads].toarray() - (1.0 / n if self.free else 0.0)
        return csr_array(vstack([compared, csr_array(self._wish * wished)]))

    @property
    def _wish(self) -> float:
        """What the distance of one spiral from its wished place counts, a metre."""
        assert self.wishes is not None
        return self.urge / (self.unit * np.sqrt(max(len(self.wishes.quads), 1)))

    @cached_property
    def back(self) -> csr_array:
        """The operator's transpose."""
        return csr_array(self.operator.T)

    @cached_property
    def wanted(self) -> Float[np.ndarray, "joints 3"]:
        """(m, 3) the target's coordinates."""
        found = self.centred(self.operator @ self.points)
        if self.wishes is not None:
            quads, places = self.wishes.quads, self.wishes.places
            found[len(found) - len(quads) :] += self._wish * (places - self.points[quads])
        return found

    def centred(self, values: np.ndarray) -> np.ndarray:
        """Compared rows (m, 3), places without their mean where the object is free."""
        if not (self.free and self.weights[2]):
            return values
        end = len(values) - (0 if self.wishes is None else len(self.wishes.quads))
        first = end - len(self.points)
        places = values[first:end]
        return np.concatenate([values[:first], places - places.mean(axis=0), values[end:]])

    def laid(self, pose: Pose) -> Pose:
        """A pose laid over the target where nothing holds the object."""
        return pose.aligned(self.points) if self.free else pose

    def distance(self, pose: Pose) -> float:
        """RMS distance of a pose's centres to the target's, in units of ``unit``."""
        return float(np.sqrt(((self.laid(pose).centres - self.points) ** 2).sum(axis=1).mean())) / self.unit

    @property
    def reach(self) -> float:
        """How far the wishes lie from the target, RMS over all spirals, in units of ``unit``."""
        if self.wishes is None:
            return 0.0
        apart = self.wishes.places - self.points[self.wishes.quads]
        return float(np.sqrt((apart**2).sum(axis=1).max(initial=0.0))) / self.unit

    def compare(self, centres: Float[np.ndarray, "spirals 3"]) -> Mismatch:
        """The mismatch of centres (n, 3) metres."""
        own = self.centred(self.operator @ centres)
        rotation = nearest_rotation(own.T @ self.wanted) if self.free else np.eye(3)
        return Mismatch(self, own @ rotation.T, rotation)


@dataclass(frozen=True, eq=False)
class Mismatch:
    """One comparison: value = half the mean square of the residual, in units of ``Target.unit``.

    own : (m, 3) the centres' coordinates, turned by ``rotation`` onto the target's
    """

    target: Target
    own: Float[np.ndarray, "joints 3"]
    rotation: np.ndarray

    @property
    def residual(self) -> Float[np.ndarray, "joints 3"]:
        """(m, 3)"""
        return self.own - self.target.wanted

    @property
    def value(self) -> float:
        return 0.5 * float((self.residual**2).sum())

    @property
    def rmse(self) -> float:
        """Metres, of the Laplacian coordinates where those are compared."""
        weight = self.target.weights[0] or self.target.weights[2]
        compared = self.residual[: len(self.target.points)]
        return float(np.sqrt((compared**2).sum())) * self.target.unit / weight

    @property
    def wished(self) -> float:
        """Metres, RMS distance of the spirals that somebody wishes something of to where they are wished."""
        wishes = self.target.wishes
        if wishes is None:
            return 0.0
        rows = self.residual[len(self.own) - len(wishes.quads) :]
        return float(np.sqrt((rows**2).sum())) * self.target.unit / max(self.target.urge, 1e-30)

    @property
    def gradient(self) -> Float[np.ndarray, "spirals 3"]:
        """(n, 3) per metre of the centres; the best rotation adds nothing to it (envelope theorem)."""
        return self.backward(self.residual, project=False)

    @cached_property
    def _turns(self) -> Float[np.ndarray, "_ some"]:
        """(3n, k) orthonormal: what small turns of the whole do to the residual; none where it is held."""
        if not self.target.free:
            return np.zeros((self.own.size, 0))
        turned = np.stack([np.cross(axis, self.own).ravel() for axis in np.eye(3)], axis=1)
        return np.linalg.qr(turned)[0]

    def forward(self, shift: np.ndarray) -> Float[np.ndarray, "joints 3"]:
        """(m, 3) change of the residual with shifts (n, 3) metres of the centres, best rotation included to first order."""
        return self._without_turns(self.target.centred(self.target.operator @ shift) @ self.rotation.T)

    def backward(self, change: np.ndarray, project: bool = True) -> np.ndarray:
        """The transpose of ``forward``."""
        kept = self._without_turns(change) if project else change
        return self.target.back @ self.target.centred(kept @ self.rotation)

    def _without_turns(self, change: np.ndarray) -> np.ndarray:
        flat = change.ravel()
        return (flat - self._turns @ (self._turns.T @ flat)).reshape(change.shape)

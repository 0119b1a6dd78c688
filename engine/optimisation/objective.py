"""How far an equilibrium is from the target, and how that changes with the design (FlexMaps section 7, eq. 6 to 10)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array, vstack

from ..arrays import Float, Int
from ..mechanics.assembly import Pose, nearest_rotation
from ..mechanics.laplacian import uniform_laplacian

# How much a place counts beside the Laplacian coordinates, which hardly feel bends that are longer than some 30 spirals: a piece
# may match in all of them and still lie far away. On 12 surfaces of 78 to 986 quads the RMS distance to the target fell with 0.05
# to between a third and 0.94 of what it was without, while the Laplacian RMSE changed by -29 to +38 %, by +3 % in the middle;
# with 0.02 the distances gained half of that.
PLACES = 0.05


@dataclass(frozen=True, eq=False)
class Target:
    """What the centres of the spirals are compared with.

    pairs : (m, 2) int, joined spirals; points : (n, 3) metres, the target of every centre
    laplacian : compare in Laplacian coordinates (eq. 9) and, with a small weight, in places; else in places alone
    free : the object may lie anywhere: before comparing it is turned, and shifted, onto the target
    """

    pairs: Int[np.ndarray, "joints 2"]
    points: Float[np.ndarray, "spirals 3"]
    laplacian: bool = True
    free: bool = True

    @cached_property
    def unit(self) -> float:
        """Metres, the distance that counts as one: the mean distance of joined spirals."""
        a, b = self.pairs.T
        return float(np.linalg.norm(self.points[b] - self.points[a], axis=1).mean())

    @cached_property
    def operator(self) -> csr_array:
        """(m, n): takes centres to the coordinates that are compared, over ``unit`` and the root of n; places come last."""
        n = len(self.points)
        places = csr_array((np.ones(n), (np.arange(n), np.arange(n))), shape=(n, n))
        matrix = vstack([uniform_laplacian(self.pairs, n), PLACES * places]) if self.laplacian else places
        return csr_array(matrix / (self.unit * np.sqrt(n)))

    @property
    def bends(self) -> int:
        """So many of the compared rows are Laplacian coordinates; the others are places."""
        return len(self.points) if self.laplacian else 0

    @cached_property
    def back(self) -> csr_array:
        """The operator's transpose."""
        return csr_array(self.operator.T)

    @cached_property
    def wanted(self) -> Float[np.ndarray, "joints 3"]:
        """(m, 3) the target's coordinates."""
        return self.centred(self.operator @ self.points)

    def centred(self, values: np.ndarray) -> np.ndarray:
        """Compared rows (m, 3), places without their mean where the object is free."""
        if not self.free:
            return values
        bends, places = values[: self.bends], values[self.bends :]
        return np.concatenate([bends, places - places.mean(axis=0)])

    def laid(self, pose: Pose) -> Pose:
        """A pose laid over the target where nothing holds the object."""
        return pose.aligned(self.points) if self.free else pose

    def distance(self, pose: Pose) -> float:
        """RMS distance of a pose's centres to the target's, in units of ``unit``."""
        return float(np.sqrt(((self.laid(pose).centres - self.points) ** 2).sum(axis=1).mean())) / self.unit

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
        compared = self.residual[: self.target.bends or None]
        return float(np.sqrt((compared**2).sum())) * self.target.unit

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

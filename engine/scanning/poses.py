"""Many poses of a scan at once, each fitted to a surface by weighted least squares.

A point that lies far from the surface has little say (Geman and McClure 1985: weight 1 / (1 + (r / reach)^2)^2), so that what
the scan shows beside the piece is left out, however far it is; a reach that shrinks leads there from afar (Zhou, Park and Koltun
2016, "Fast global registration"; Yang et al. 2020, "Graduated non-convexity"). Scan points look for the surface, not the
reverse: what the scan does not show then has no say either. Lengths are shares of the piece's size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Float, Int
from .surface import Distances

AT_ONCE = (
    256  # poses in one array: 256 poses of 400 points and six columns are 5 MB, which a processor's cache nearly holds
)
DAMPED = (
    1e-3  # share of the mean stiffness added in every direction: steps stay short where the surface slides in itself
)
LONGEST = 0.3  # radians and shares of the size: the longest step, for a pose that nothing holds


@dataclass(frozen=True, eq=False)
class Poses:
    """Rigid motions: a point p goes to ``turn @ p + shift``."""

    turns: Float[np.ndarray, "poses 3 3"]
    shifts: Float[np.ndarray, "poses 3"]

    def __len__(self) -> int:
        return len(self.turns)

    def __getitem__(self, chosen: slice | Int[np.ndarray, " chosen"]) -> Poses:
        return Poses(self.turns[chosen], self.shifts[chosen])

    @staticmethod
    def joined(parts: Sequence[Poses]) -> Poses:
        """All poses of some groups, one after the other."""
        return Poses(np.concatenate([one.turns for one in parts]), np.concatenate([one.shifts for one in parts]))

    def repeated(self, count: int) -> Poses:
        """Every pose ``count`` times."""
        return Poses(np.repeat(self.turns, count, axis=0), np.repeat(self.shifts, count, axis=0))

    def laid(self, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "poses points 3"]:
        """The points where each pose puts them."""
        return points @ self.turns.transpose(0, 2, 1).astype(points.dtype) + self.shifts[:, None].astype(points.dtype)

    def moved(self, about: Float[np.ndarray, "poses 3"], twists: Float[np.ndarray, "poses 6"]) -> Poses:
        """Each pose after a screw motion about a point of its own.

        twists : rotation vector and velocity of that point; the motion is their exponential (Murray, Li and Sastry 1994,
        eq. 2.36), so that a turn about a far axis stays on its circle
        """
        from scipy.spatial.transform import Rotation

        spin, speed = twists[:, :3], twists[:, 3:]
        angle = np.linalg.norm(spin, axis=1, keepdims=True)
        axis = spin / np.maximum(angle, 1e-12)
        along = np.sinc(angle / np.pi)  # sin(angle) / angle
        across = np.where(angle > 1e-6, (1 - np.cos(angle)) / np.maximum(angle, 1e-12), 0.5 * angle)
        turn = Rotation.from_rotvec(spin).as_matrix()
        way = along * speed + (1 - along) * axis * np.sum(axis * speed, axis=1, keepdims=True)
        way = way + across * np.cross(axis, speed)
        return Poses(turn @ self.turns, np.einsum("bij,bj->bi", turn, self.shifts - about) + about + way)


@dataclass(frozen=True, eq=False)
class Fit:
    """What poses are fitted by: the distances from a surface, a scan's points, and how much each counts."""

    distances: Distances
    points: Float[np.ndarray, "points 3"]
    weights: Float[np.ndarray, " points"]

    def cost(self, poses: Poses, reach: float) -> Float[np.ndarray, " poses"]:
        """Geman and McClure's mean cost of each pose: 0 with all points on the surface, 1 with all far from it."""
        return np.concatenate([self._cost(poses[k : k + AT_ONCE], reach) for k in range(0, len(poses), AT_ONCE)])

    def fitted(self, poses: Poses, reach: float, rounds: int, damped: float = DAMPED) -> Poses:
        """The poses after some rounds of Gauss and Newton."""
        parts = [poses[k : k + AT_ONCE] for k in range(0, len(poses), AT_ONCE)]
        return Poses.joined([self._fitted(part, reach, rounds, damped) for part in parts])

    def spread(self, poses: Poses, reach: float, steps: Sequence[float], ways: int = 2) -> Poses:
        """The poses, and those some steps away from them along the ``ways`` in which the surface holds them least.

        A dome turned about its pole, or a vault shifted along its ridge, leaves the points on the surface until some cross a
        border: only trying tells where on such a way the scan belongs.
        """
        square, _, about = self._normal(poses, reach)
        weak = np.linalg.eigh(square)[1][:, :, :ways]
        both = np.concatenate([steps, -np.asarray(steps)])
        found = [poses]
        for way in range(ways):
            twists = both[None, :, None] * weak[:, None, :, way]
            found.append(poses.repeated(len(both)).moved(np.repeat(about, len(both), axis=0), twists.reshape(-1, 6)))
        return Poses.joined(found)

    def _cost(self, poses: Poses, reach: float) -> np.ndarray:
        squared = self.distances(poses.laid(self.points))[1] ** 2
        return (self.weights * squared / (squared + reach**2)).mean(axis=1)

    def _normal(self, poses: Poses, reach: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(poses, 6, 6) normal matrix, (poses, 6) right side, and (poses, 3) middle of the points, about which they turn."""
        laid = poses.laid(self.points)
        direction, distance = self.distances(laid)
        weight = self.weights / (1 + (distance / reach) ** 2) ** 2
        about = laid.mean(axis=1)
        rows = np.concatenate([np.cross(laid - about[:, None], direction), direction], axis=2)
        square = rows.transpose(0, 2, 1) @ (rows * weight[..., None])
        return square, -np.einsum("bni,bn->bi", rows, weight * distance), about

    def _fitted(self, poses: Poses, reach: float, rounds: int, damped: float) -> Poses:
        for _ in range(rounds):
            square, right, about = self._normal(poses, reach)
            mean = np.trace(square, axis1=1, axis2=2)[:, None, None] / 6
            step = np.linalg.solve(square + (damped * mean + 1e-9) * np.eye(6), right[..., None])[..., 0]
            step *= np.minimum(1.0, LONGEST / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-12))
            poses = poses.moved(about.astype(float), step.astype(float))
            if np.abs(step).max() < 1e-7:
                break
        return poses


def distinct(poses: Poses, cost: np.ndarray, probes: Float[np.ndarray, "probes 3"], most: int, apart: float) -> Poses:
    """The best poses, at most ``most``, no two of which put the probes within ``apart`` of each other."""
    order = np.argsort(cost)
    laid = poses[order].laid(probes).reshape(len(order), -1)
    kept: list[int] = []
    for k, one in enumerate(laid):
        if not kept or np.abs(laid[kept] - one).max(axis=1).min() > apart:
            kept.append(k)
            if len(kept) == most:
                break
    return poses[order[kept]]

"""Fit many poses of a scan to a surface at once by weighted least squares.

Points far from the surface count little (Geman and McClure 1985: weight 1 / (1 + (r / reach)^2)^2), so other objects in
the scan are ignored at any distance; a decreasing reach leads there from far away (Zhou, Park and Koltun 2016, "Fast
global registration"; Yang et al. 2020, "Graduated non-convexity"). Distances are measured from scan points to the
surface, not the reverse, so missing parts of the scan do not count either. Lengths are shares of the piece's size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import Float, Int
from .scan_target import Distances

# poses per array: 256 poses of 400 points and six columns are 5 MB, about the size of a processor's cache
AT_ONCE = 256
DAMPING = 1e-3  # damping as a share of the mean stiffness: keeps steps short where the surface can slide in itself
MAX_STEP = 0.3  # longest step in radians and shares of the size, for a pose that nothing constrains


@dataclass(frozen=True, eq=False)
class Poses:
    """Rigid motions: a point p is moved to ``turn @ p + shift``."""

    turns: Float[np.ndarray, "poses 3 3"]
    shifts: Float[np.ndarray, "poses 3"]

    def __len__(self) -> int:
        return len(self.turns)

    def __getitem__(self, chosen: slice | Int[np.ndarray, " chosen"]) -> Poses:
        return Poses(self.turns[chosen], self.shifts[chosen])

    @staticmethod
    def concatenate(parts: Sequence[Poses]) -> Poses:
        """Concatenate groups of poses."""
        return Poses(np.concatenate([one.turns for one in parts]), np.concatenate([one.shifts for one in parts]))

    def repeat(self, count: int) -> Poses:
        """Return every pose ``count`` times."""
        return Poses(np.repeat(self.turns, count, axis=0), np.repeat(self.shifts, count, axis=0))

    def apply(self, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "poses points 3"]:
        """Return the points moved by each pose."""
        return points @ self.turns.transpose(0, 2, 1).astype(points.dtype) + self.shifts[:, None].astype(points.dtype)

    def screw(self, about: Float[np.ndarray, "poses 3"], twists: Float[np.ndarray, "poses 6"]) -> Poses:
        """Return each pose followed by a screw motion about its own point.

        twists : rotation vector, and velocity of that point; the motion is their exponential (Murray, Li and Sastry
            1994, eq. 2.36), so that a rotation about a distant axis stays on its circle
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
class ScanFit:
    """Objective of the fit: distances from a surface, points of a scan and their weights."""

    distances: Distances
    points: Float[np.ndarray, "points 3"]
    weights: Float[np.ndarray, " points"]

    def cost(self, poses: Poses, reach: float) -> Float[np.ndarray, " poses"]:
        """Return the mean cost of each pose (Geman and McClure): 0 with all points on the surface, 1 with all far away."""
        return np.concatenate([self._cost(poses[k : k + AT_ONCE], reach) for k in range(0, len(poses), AT_ONCE)])

    def fit(self, poses: Poses, reach: float, rounds: int, damped: float = DAMPING) -> Poses:
        """Return the poses after some Gauss-Newton iterations."""
        parts = [poses[k : k + AT_ONCE] for k in range(0, len(poses), AT_ONCE)]
        return Poses.concatenate([self._fitted(part, reach, rounds, damped) for part in parts])

    def spread(self, poses: Poses, reach: float, steps: Sequence[float], ways: int = 2) -> Poses:
        """Return the poses and poses some steps away along the ``ways`` directions that the surface constrains least.

        A dome rotated about its pole, or a vault shifted along its ridge, keeps the points on the surface until some
        cross a border: only trying shows where along such a direction the scan belongs.
        """
        square, _, about = self._normal(poses, reach)
        weak = np.linalg.eigh(square)[1][:, :, :ways]
        both = np.concatenate([steps, -np.asarray(steps)])
        found = [poses]
        for way in range(ways):
            twists = both[None, :, None] * weak[:, None, :, way]
            found.append(poses.repeat(len(both)).screw(np.repeat(about, len(both), axis=0), twists.reshape(-1, 6)))
        return Poses.concatenate(found)

    def _cost(self, poses: Poses, reach: float) -> np.ndarray:
        """Return the mean cost of poses in one array."""
        squared = self.distances(poses.apply(self.points))[1] ** 2
        return (self.weights * squared / (squared + reach**2)).mean(axis=1)

    def _normal(self, poses: Poses, reach: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return normal matrices (poses, 6, 6), right sides (poses, 6) and centres of rotation (poses, 3)."""
        laid = poses.apply(self.points)
        direction, distance = self.distances(laid)
        weight = self.weights / (1 + (distance / reach) ** 2) ** 2
        about = laid.mean(axis=1)
        rows = np.concatenate([np.cross(laid - about[:, None], direction), direction], axis=2)
        square = rows.transpose(0, 2, 1) @ (rows * weight[..., None])
        return square, -np.einsum("bni,bn->bi", rows, weight * distance), about

    def _fitted(self, poses: Poses, reach: float, rounds: int, damped: float) -> Poses:
        """Return poses in one array after some Gauss-Newton iterations."""
        for _ in range(rounds):
            square, right, about = self._normal(poses, reach)
            mean = np.trace(square, axis1=1, axis2=2)[:, None, None] / 6
            step = np.linalg.solve(square + (damped * mean + 1e-9) * np.eye(6), right[..., None])[..., 0]
            step *= np.minimum(1.0, MAX_STEP / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-12))
            poses = poses.screw(about.astype(float), step.astype(float))
            if np.abs(step).max() < 1e-7:
                break
        return poses


def distinct(poses: Poses, cost: np.ndarray, probes: Float[np.ndarray, "probes 3"], most: int, apart: float) -> Poses:
    """Return the best poses, at most ``most``, that move some probe more than ``apart`` from each other."""
    order = np.argsort(cost)
    laid = poses[order].apply(probes).reshape(len(order), -1)
    kept: list[int] = []
    for k, one in enumerate(laid):
        if not kept or np.abs(laid[kept] - one).max(axis=1).min() > apart:
            kept.append(k)
            if len(kept) == most:
                break
    return poses[order[kept]]

"""Fit many poses of a scan to a surface at once by robust, iteratively reweighted least squares.

A point at the distance r from the surface has the weight 1 / (1 + (r / reach)^2)^2 (Geman and McClure 1985), so that
other objects in the scan are ignored. The scale ``reach`` decreases from fit to fit, so that poses that are far off
converge too (Zhou, Park and Koltun 2016, "Fast global registration"; Yang et al. 2020, "Graduated non-convexity").
Distances are measured from scan points to the surface, not the reverse, so that missing parts of the scan do not count.
Lengths are shares of the piece's size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import Float, Int
from .scan_target import Distances

BATCH_SIZE = 256  # number of poses that are fitted in one array; larger: slower, as arrays exceed the processor's cache
# damping, as a share of the mean diagonal entry of the normal matrix; larger: shorter steps along directions in which
# the surface can slide in itself
DAMPING = 1e-3
MAX_STEP = 0.3  # longest Gauss-Newton step, radians and shares of the size; limits poses that nothing constrains


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
        """Return every pose ``count`` times in a row."""
        return Poses(np.repeat(self.turns, count, axis=0), np.repeat(self.shifts, count, axis=0))

    def apply(self, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "poses points 3"]:
        """Return the points moved by each pose."""
        return points @ self.turns.transpose(0, 2, 1).astype(points.dtype) + self.shifts[:, None].astype(points.dtype)

    def screw(self, about: Float[np.ndarray, "poses 3"], twists: Float[np.ndarray, "poses 6"]) -> Poses:
        """Return each pose followed by a screw motion.

        The motion is the exponential of a twist (Murray, Li and Sastry 1994, eq. 2.36), so that a rotation about a
        distant axis moves points on exact circles.

        Parameters
        ----------
        about : reference point of each twist
        twists : rotation vector, radians, and velocity of the reference point
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
    """Objective of the fit: distance function of a surface, points of a scan and their weights."""

    distances: Distances
    points: Float[np.ndarray, "points 3"]
    weights: Float[np.ndarray, " points"]

    def cost(self, poses: Poses, reach: float) -> Float[np.ndarray, " poses"]:
        """Return the mean Geman-McClure cost of each pose: 0 with all points on the surface, 1 with all far away.

        Parameters
        ----------
        poses : the poses
        reach : scale of the robust weights, share of the size
        """
        return np.concatenate([self._cost(poses[k : k + BATCH_SIZE], reach) for k in range(0, len(poses), BATCH_SIZE)])

    def fit(self, poses: Poses, reach: float, rounds: int, damped: float = DAMPING) -> Poses:
        """Return the poses after at most ``rounds`` Gauss-Newton iterations.

        Parameters
        ----------
        poses : initial poses
        reach : scale of the robust weights, share of the size
        rounds : largest number of iterations
        damped : damping, see ``DAMPING``
        """
        parts = [poses[k : k + BATCH_SIZE] for k in range(0, len(poses), BATCH_SIZE)]
        return Poses.concatenate([self._fitted(part, reach, rounds, damped) for part in parts])

    def spread(self, poses: Poses, reach: float, steps: Sequence[float], ways: int = 2) -> Poses:
        """Return the poses, and others at given steps from them along the directions that the surface constrains least.

        A dome rotated about its pole, or a vault shifted along its ridge, keeps the points on the surface until some
        cross a border: only trying shows where along such a direction the scan belongs.

        Parameters
        ----------
        poses : initial poses
        reach : scale of the robust weights, share of the size
        steps : lengths of the steps, taken to both sides; radians or shares of the size
        ways : number of directions
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
        """Return the mean cost of each pose, as ``cost``, but for all poses in one array."""
        squared = self.distances(poses.apply(self.points))[1] ** 2
        return (self.weights * squared / (squared + reach**2)).mean(axis=1)

    def _normal(self, poses: Poses, reach: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return normal matrix (6, 6), right-hand side (6,) and centre of rotation (3,) of each pose's next step."""
        laid = poses.apply(self.points)
        direction, distance = self.distances(laid)
        weight = self.weights / (1 + (distance / reach) ** 2) ** 2
        about = laid.mean(axis=1)
        rows = np.concatenate([np.cross(laid - about[:, None], direction), direction], axis=2)
        square = rows.transpose(0, 2, 1) @ (rows * weight[..., None])
        return square, -np.einsum("bni,bn->bi", rows, weight * distance), about

    def _fitted(self, poses: Poses, reach: float, rounds: int, damped: float) -> Poses:
        """Return the poses after at most ``rounds`` Gauss-Newton iterations, as ``fit``, but for all in one array."""
        for _ in range(rounds):
            square, right, about = self._normal(poses, reach)
            mean = np.trace(square, axis1=1, axis2=2)[:, None, None] / 6
            step = np.linalg.solve(square + (damped * mean + 1e-9) * np.eye(6), right[..., None])[..., 0]
            step *= np.minimum(1.0, MAX_STEP / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-12))
            poses = poses.screw(about.astype(float), step.astype(float))
            if np.abs(step).max() < 1e-7:
                break
        return poses


def select_distinct(
    poses: Poses, cost: np.ndarray, probes: Float[np.ndarray, "probes 3"], most: int, apart: float
) -> Poses:
    """Return the best poses that differ from each other.

    Parameters
    ----------
    poses, cost : the poses and their costs
    probes : points by which poses are compared
    most : largest number of poses to return
    apart : two poses differ if a coordinate of a probe differs by more than this, share of the size
    """
    order = np.argsort(cost)
    laid = poses[order].apply(probes).reshape(len(order), -1)
    kept: list[int] = []
    for k, one in enumerate(laid):
        if not kept or np.abs(laid[kept] - one).max(axis=1).min() > apart:
            kept.append(k)
            if len(kept) == most:
                break
    return poses[order[kept]]

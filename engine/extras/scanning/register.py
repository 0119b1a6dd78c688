"""Find the rigid motion that registers a scan to a surface, without markers.

Thousands of initial poses are fitted at once to a table of closest points (``scan_target``, ``poses``), then fewer and
fewer of them with more points and a shorter reach. Each round also searches along directions in which the surface can
slide in itself. The final choice uses all points with a reach that matches the scan's noise, and with reduced weights
for the table on which the piece stood.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from ...arrays import Float
from ...progress import SILENT, Progress
from .poses import Poses, ScanFit, distinct
from .scan_target import ClosestPoints, TriangleSurface

# Measured on 26 surfaces of the zoo, 20 scans each: with 3 offsets instead of 5 and reaches from 0.12, a coil was
# registered between its own turns; without the search along weakly constrained directions a third of all gables and a
# tenth of all barrels were wrong
TILTS = (0.0, 1), (12.0, 6), (25.0, 14)
WIDEST = 45.0  # degrees: poses rotated further are discarded, because a symmetric piece fits several orientations
ANYWHERE = 600  # rotations tried for arbitrary orientation: the median distance to the nearest is 15 degrees
OFFSETS = (-0.25, -0.125, 0.0, 0.125, 0.25)  # offsets of the scan's centre from the surface's, in shares of its extents
FEW_OFFSETS = (-0.2, 0.0, 0.2)  # offsets for arbitrary orientation
FIRST = (0.04, 0.02)  # reaches for initial poses
SIEVED = 120  # initial poses that are kept
# Reach of each round, and its steps along weakly constrained directions: a scan of three fifths of the piece is
# initially up to 0.3 off along a ridge
LOOKS = ((0.03, (0.04, 0.08, 0.16, 0.3)), (0.015, (0.02, 0.04, 0.08, 0.16)), (0.007, (0.02, 0.04, 0.08, 0.16)))
# steps along weakly constrained directions at the final reach
LAST_LOOKS = ((0.03, 0.06, 0.12), (0.005, 0.01, 0.02), (0.0015, 0.003, 0.006))
POINTS = (120, 400, 1500, 3000)  # points of the scan used with many, few and very few poses, and at the end
NOISES = 3.0  # final reach in standard deviations of the scan's noise: 95 % of a normal distribution weigh over 0.47
SHARPEST, BLUNTEST = 0.0005, 0.03  # limits of the final reach as shares of the size
# share of the size beyond which points do not belong to the piece; a badly built piece, bent by 4 %, still belongs
BACKGROUND = 0.05
# A plane is removed as a table or wall if it holds at least these shares of the background points and of all points;
# 200 outliers in a cube around the piece never form such a plane
FLAT, WORTH = 0.2, 0.005
# Maximum distance of a plane's points from it as a share of the size. With 0.03 much of a dome was removed as planes
# and the rest was fitted to a torus; with 0.01 scans of 7 other objects are rejected. None of 8 surfaces lost points to
# planes without a table, at a noise of 0.005
PLANE_TOLERANCE = 0.01
PLANES = 3  # maximum number of planes: a table and two walls
# random planes through three points: a plane with a tenth of the points is hit by 26 % of such searches, with a fifth
# by 91 %
TRIES = 300


@dataclass(frozen=True, eq=False)
class Registration:
    """Pose of a scan.

    turn, shift : ``scan @ turn.T + shift`` lies on the surface
    weights : of the points; for a plane's points, the share of them that the piece explains
    reach : three standard deviations of the scan's noise, in shares of the size
    """

    turn: Float[np.ndarray, "3 3"]
    shift: Float[np.ndarray, " 3"]
    weights: Float[np.ndarray, " points"]
    reach: float


def register(
    surface: TriangleSurface, scan: Float[np.ndarray, "points 3"], anywhere: bool = False, progress: Progress = SILENT
) -> Registration:
    """Register a scan's points, in any order, to a surface around the origin; lengths in shares of its size.

    Without ``anywhere`` the scan is assumed to be rotated by at most 30 degrees.
    """
    table = ClosestPoints(surface)
    points = scan[np.random.default_rng(0).permutation(len(scan))]
    rough = [ScanFit(table, points[:count].astype(np.float32), np.ones(min(count, len(points)))) for count in POINTS]
    poses = _best_guesses(rough[0], _guesses(surface, points, anywhere), anywhere, progress.part(0.0, 0.5))
    for k, (reach, steps) in enumerate(LOOKS):
        progress(0.5 + 0.1 * k, "Scan: looking along the surface")
        poses = _search_nearby(rough[1], poses, reach, steps, reach / 2, 30, 0.02)
        poses = poses if anywhere else _upright(poses)
    poses = distinct(poses, rough[3].cost(poses, 0.005), points[:4], 8, 0.01)
    progress(0.8, "Scan: measuring its noise")
    exact = ScanFit(surface, points[: POINTS[2]], rough[2].weights)
    poses = exact.fit(poses, 0.005, 6)
    exact = ScanFit(surface, points[: POINTS[3]], rough[3].weights)
    poses = poses[np.argsort(exact.cost(poses, 0.005))[:4]]
    reach = _noise(exact, poses[:1])
    weights = _weights(surface, points, poses[:1], reach)
    poses = _final_pose(surface, table, points, weights, poses, reach, progress.part(0.85, 1.0))
    back = np.empty(len(points))
    back[np.random.default_rng(0).permutation(len(scan))] = weights
    return Registration(poses.turns[0], poses.shifts[0], back, reach)


def _guesses(surface: TriangleSurface, points: np.ndarray, anywhere: bool) -> Poses:
    """Return all initial rotations combined with all initial offsets."""
    from scipy.spatial.transform import Rotation

    if anywhere:
        turns = Rotation.random(ANYWHERE, rng=0).as_matrix()
    else:
        turns = Rotation.from_rotvec(
            np.concatenate([np.radians(tilt) * _ball(count) for tilt, count in TILTS])
        ).as_matrix()
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    offsets = (
        np.array(list(itertools.product(FEW_OFFSETS if anywhere else OFFSETS, repeat=3))) * (high - low)
        + (low + high) / 2
    )
    turns = np.repeat(turns, len(offsets), axis=0)
    return Poses(turns, np.tile(offsets, (len(turns) // len(offsets), 1)) - turns @ np.median(points, axis=0))


def _upright(poses: Poses) -> Poses:
    """Return the poses rotated by at most ``WIDEST``, or all if there are none."""
    cosine = (np.trace(poses.turns, axis1=1, axis2=2) - 1) / 2
    near = np.flatnonzero(cosine >= np.cos(np.radians(WIDEST)))
    return poses[near] if len(near) else poses


def _ball(count: int) -> np.ndarray:
    """Return (count, 3) unit vectors distributed over the sphere by the golden angle."""
    k = np.arange(count) + 0.5
    height, angle = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    across = np.sqrt(1 - height**2)
    return np.column_stack([across * np.cos(angle), across * np.sin(angle), height])


def _best_guesses(fit: ScanFit, poses: Poses, anywhere: bool, progress: Progress) -> Poses:
    """Return the best initial poses, fitted in parts so that the search can be cancelled."""
    parts = []
    for k in range(0, len(poses), 1024):
        progress(k / len(poses), "Scan: looking for its pose")
        part = poses[k : k + 1024]
        for reach in FIRST:
            part = fit.fit(part, reach, 4)
        parts.append(part)
    poses = Poses.concatenate(parts) if anywhere else _upright(Poses.concatenate(parts))
    return distinct(poses, fit.cost(poses, 0.01), fit.points[:4], SIEVED, 0.02)


def _search_nearby(
    fit: ScanFit, poses: Poses, reach: float, steps: tuple[float, ...], judged: float, most: int, apart: float
) -> Poses:
    """Return the best of the poses and of poses near them along weakly constrained directions, all fitted again."""
    poses = fit.fit(fit.spread(poses, reach, steps), reach, 3)
    return distinct(poses, fit.cost(poses, judged), fit.points[:4], most, apart)


def _noise(fit: ScanFit, pose: Poses) -> float:
    """Return ``NOISES`` standard deviations of points within that distance of the surface, estimated by the median."""
    off = np.abs(fit.distances(pose.apply(fit.points))[1][0])
    deviation = _deviation(off, BLUNTEST)
    for _ in range(5):
        deviation = _deviation(off, NOISES * deviation)
    return float(np.clip(NOISES * deviation, SHARPEST, BLUNTEST))


def _deviation(off: np.ndarray, within: float) -> float:
    """Return the standard deviation estimated from the median of distances below ``within``."""
    near = off[off < within]
    return 1.4826 * float(np.median(near)) if len(near) else within


def _weights(surface: TriangleSurface, points: np.ndarray, pose: Poses, reach: float) -> np.ndarray:
    """Return weights of 1, or for points of planes beyond the piece, the share of the plane that lies on the piece.

    Otherwise points of a table that meet the surface by chance would pull the piece along a weakly constrained
    direction, and points under a missing part of the scan would count as the piece. A face of the piece that stands on
    the table keeps some weight.
    """
    laid = pose.apply(points)[0]
    off, weights, rest = surface(laid)[1], np.ones(len(points)), np.ones(len(points), dtype=bool)
    near = min(reach, PLANE_TOLERANCE)
    for _ in range(PLANES):
        beside = laid[(off > BACKGROUND) & rest]
        least = max(FLAT * len(beside), WORTH * len(points), 3)
        if len(beside) < least:
            break
        normal, origin = _plane(beside, near)
        if np.count_nonzero(np.abs((beside - origin) @ normal) < near) < least:
            break
        on = (np.abs((laid - origin) @ normal) < near) & rest
        weights[on] = np.mean(off[on] < reach)
        rest &= ~on
    return weights


def _plane(points: np.ndarray, near: float) -> tuple[np.ndarray, np.ndarray]:
    """Return unit normal and a point of the plane with most points ``near`` it, fitted to these points.

    RANSAC (Fischler and Bolles 1981).
    """
    three = points[np.random.default_rng(0).integers(0, len(points), (TRIES, 3))]
    normals = np.cross(three[:, 1] - three[:, 0], three[:, 2] - three[:, 0])
    long = np.linalg.norm(normals, axis=1)
    three, normals = three[long > 1e-9], normals[long > 1e-9] / long[long > 1e-9, None]
    if not len(three):
        return np.array([0.0, 0.0, 1.0]), points[0]
    off = np.abs(points[: POINTS[2]] @ normals.T - np.einsum("ij,ij->i", normals, three[:, 0]))
    best = int(np.argmax(np.count_nonzero(off < near, axis=0)))
    normal, origin = normals[best], three[best, 0]
    for _ in range(3):
        on = points[np.abs((points - origin) @ normal) < near]
        if len(on) < 3:
            break
        origin = on.mean(axis=0)
        normal = np.linalg.svd(on - origin, full_matrices=False)[2][2]
    return normal, origin


def _final_pose(
    surface: TriangleSurface,
    table: ClosestPoints,
    points: np.ndarray,
    weights: np.ndarray,
    poses: Poses,
    reach: float,
    progress: Progress,
) -> Poses:
    """Return the pose that fits all points best with a reach that matches their noise."""
    some, most = POINTS[2:]
    quick = ScanFit(table, points[:some].astype(np.float32), weights[:some])
    exact = ScanFit(surface, points[:most], weights[:most])
    for k, steps in enumerate(LAST_LOOKS):
        progress(k / len(LAST_LOOKS), "Scan: fitting all points")
        if k < 2:
            poses = _search_nearby(quick, poses, reach, steps, reach, 6, 0.003)
        else:
            near = exact.spread(poses, reach, steps)
            poses = near[np.argsort(exact.cost(near, reach))[:4]]
        poses = exact.fit(poses, reach, 5)
    everything = ScanFit(surface, points, weights)
    poses = poses[np.argsort(exact.cost(poses, reach))[:2]]
    poses = poses[np.argsort(everything.cost(poses, reach))[:1]]
    return everything.fit(poses, reach, 10, 1e-6)

"""Find the rigid motion that registers a scan to a surface, without markers.

Thousands of initial poses are fitted at once to a table of closest points (``scan_target``, ``poses``). In each round,
fewer poses are fitted to more points with a shorter reach, which is the scale of the robust weights. Each round also
searches along the directions in which the surface can slide in itself. The final choice uses all points, a reach that
matches the scan's noise, and reduced weights for the table on which the piece stood. Lengths are shares of the piece's
size.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from ...arrays import Float
from ...progress import SILENT, Progress
from .poses import Poses, ScanFit, select_distinct
from .scan_target import ClosestPoints, TriangleSurface

# Initial rotations: angle in degrees and number of axes for each; more: safer, slower
TILTS = (0.0, 1), (12.0, 6), (25.0, 14)
# Largest rotation of the scan, degrees, unless its orientation is arbitrary; larger: symmetric pieces fit in wrong
# orientations
MAX_ROTATION = 45.0
ROTATIONS = 600  # number of initial rotations if the orientation is arbitrary (15 degrees apart); more: safer, slower
# Initial offsets of the scan's centre from the surface's centre along each axis, as shares of the surface's extent;
# more: safer, slower
OFFSETS = (-0.25, -0.125, 0.0, 0.125, 0.25)
FEW_OFFSETS = (-0.2, 0.0, 0.2)  # initial offsets if the orientation is arbitrary
FIRST_REACHES = (
    0.04,
    0.02,
)  # reaches for the two fits of every initial pose; larger: a scanned coil may settle between the turns of the surface
KEPT_POSES = 120  # number of initial poses that are kept; more: safer, slower
# For each round: the reach, and the lengths of steps along weakly constrained directions. Longer steps: the scan may
# cover a smaller part of the piece (0.3: three fifths)
SEARCH_ROUNDS = ((0.03, (0.04, 0.08, 0.16, 0.3)), (0.015, (0.02, 0.04, 0.08, 0.16)), (0.007, (0.02, 0.04, 0.08, 0.16)))
# for each round at the final reach: lengths of steps along weakly constrained directions
FINAL_STEPS = ((0.03, 0.06, 0.12), (0.005, 0.01, 0.02), (0.0015, 0.003, 0.006))
# numbers of points fitted: with thousands of poses, with some hundred, with a few, and in the last fits; more: slower
POINT_COUNTS = (120, 400, 1500, 3000)
REACH_DEVIATIONS = 3.0  # final reach in standard deviations of the scan's noise; larger: outliers count more
MIN_REACH, MAX_REACH = 0.0005, 0.03  # limits of the final reach; larger: outliers count more
BACKGROUND = 0.05  # distance beyond which points may belong to a table or wall; larger: less of these is found
# A plane counts as a table or wall if it has at least these shares of the background points and of all points; larger:
# fewer planes are found
MIN_BACKGROUND_SHARE, MIN_POINT_SHARE = 0.2, 0.005
PLANE_TOLERANCE = 0.01  # largest distance of a plane's points from it; larger: parts of a curved piece count as planes
MAX_PLANES = 3  # largest number of planes: a table and two walls
PLANE_TRIES = (
    300  # number of random planes through three points that are tried; more: small planes are found more surely
)


@dataclass(frozen=True, eq=False)
class Registration:
    """Pose of a scan on a surface.

    turn, shift : ``scan @ turn.T + shift`` lies on the surface
    weights : weight of every point; for points of a table or wall, the share of its points that lie on the piece
    reach : three standard deviations of the scan's noise, as a share of the size
    """

    turn: Float[np.ndarray, "3 3"]
    shift: Float[np.ndarray, " 3"]
    weights: Float[np.ndarray, " points"]
    reach: float


def register(
    surface: TriangleSurface, scan: Float[np.ndarray, "points 3"], anywhere: bool = False, progress: Progress = SILENT
) -> Registration:
    """Register the points of a scan to a surface around the origin.

    Parameters
    ----------
    surface : the surface; unit of length: the piece's size
    scan : points in any order, in the same unit
    anywhere : whether the orientation is arbitrary; if False, rotations of up to about 30 degrees are found
    progress : called with the fraction done; may cancel
    """
    table = ClosestPoints(surface)
    points = scan[np.random.default_rng(0).permutation(len(scan))]
    rough = [
        ScanFit(table, points[:count].astype(np.float32), np.ones(min(count, len(points)))) for count in POINT_COUNTS
    ]
    poses = _fit_initial_poses(rough[0], _initial_poses(surface, points, anywhere), anywhere, progress.part(0.0, 0.5))
    for k, (reach, steps) in enumerate(SEARCH_ROUNDS):
        progress(0.5 + 0.1 * k, "Scan: looking along the surface")
        poses = _search_nearby(rough[1], poses, reach, steps, reach / 2, 30, 0.02)
        poses = poses if anywhere else _limit_rotation(poses)
    poses = select_distinct(poses, rough[3].cost(poses, 0.005), points[:4], 8, 0.01)
    progress(0.8, "Scan: measuring its noise")
    exact = ScanFit(surface, points[: POINT_COUNTS[2]], rough[2].weights)
    poses = exact.fit(poses, 0.005, 6)
    exact = ScanFit(surface, points[: POINT_COUNTS[3]], rough[3].weights)
    poses = poses[np.argsort(exact.cost(poses, 0.005))[:4]]
    reach = _final_reach(exact, poses[:1])
    weights = _point_weights(surface, points, poses[:1], reach)
    poses = _final_pose(surface, table, points, weights, poses, reach, progress.part(0.85, 1.0))
    back = np.empty(len(points))
    back[np.random.default_rng(0).permutation(len(scan))] = weights
    return Registration(poses.turns[0], poses.shifts[0], back, reach)


def _initial_poses(surface: TriangleSurface, points: np.ndarray, anywhere: bool) -> Poses:
    """Return the initial poses: all initial rotations combined with all initial offsets."""
    from scipy.spatial.transform import Rotation

    if anywhere:
        turns = Rotation.random(ROTATIONS, rng=0).as_matrix()
    else:
        turns = Rotation.from_rotvec(
            np.concatenate([np.radians(tilt) * _sphere_directions(count) for tilt, count in TILTS])
        ).as_matrix()
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    offsets = (
        np.array(list(itertools.product(FEW_OFFSETS if anywhere else OFFSETS, repeat=3))) * (high - low)
        + (low + high) / 2
    )
    turns = np.repeat(turns, len(offsets), axis=0)
    return Poses(turns, np.tile(offsets, (len(turns) // len(offsets), 1)) - turns @ np.median(points, axis=0))


def _limit_rotation(poses: Poses) -> Poses:
    """Return the poses rotated by at most ``MAX_ROTATION`` degrees; if all are rotated farther, return all."""
    cosine = (np.trace(poses.turns, axis1=1, axis2=2) - 1) / 2
    near = np.flatnonzero(cosine >= np.cos(np.radians(MAX_ROTATION)))
    return poses[near] if len(near) else poses


def _sphere_directions(count: int) -> np.ndarray:
    """Return (count, 3) unit vectors distributed over the sphere by the golden angle."""
    k = np.arange(count) + 0.5
    height, angle = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    across = np.sqrt(1 - height**2)
    return np.column_stack([across * np.cos(angle), across * np.sin(angle), height])


def _fit_initial_poses(fit: ScanFit, poses: Poses, anywhere: bool, progress: Progress) -> Poses:
    """Fit the initial poses and return the best ``KEPT_POSES``; between batches of poses the user may cancel."""
    parts = []
    for k in range(0, len(poses), 1024):
        progress(k / len(poses), "Scan: looking for its pose")
        part = poses[k : k + 1024]
        for reach in FIRST_REACHES:
            part = fit.fit(part, reach, 4)
        parts.append(part)
    poses = Poses.concatenate(parts) if anywhere else _limit_rotation(Poses.concatenate(parts))
    return select_distinct(poses, fit.cost(poses, 0.01), fit.points[:4], KEPT_POSES, 0.02)


def _search_nearby(
    fit: ScanFit, poses: Poses, reach: float, steps: tuple[float, ...], judged: float, most: int, apart: float
) -> Poses:
    """Fit poses, and further poses at steps along weakly constrained directions; return the best of them.

    Parameters
    ----------
    fit : the objective
    poses, reach, steps : as in ``ScanFit.spread``
    judged : reach at which costs are compared
    most, apart : as in ``select_distinct``
    """
    poses = fit.fit(fit.spread(poses, reach, steps), reach, 3)
    return select_distinct(poses, fit.cost(poses, judged), fit.points[:4], most, apart)


def _final_reach(fit: ScanFit, pose: Poses) -> float:
    """Return the final reach: ``REACH_DEVIATIONS`` robust standard deviations of the scan's noise."""
    off = np.abs(fit.distances(pose.apply(fit.points))[1][0])
    deviation = _deviation(off, MAX_REACH)
    for _ in range(5):
        deviation = _deviation(off, REACH_DEVIATIONS * deviation)
    return float(np.clip(REACH_DEVIATIONS * deviation, MIN_REACH, MAX_REACH))


def _deviation(off: np.ndarray, within: float) -> float:
    """Return a robust standard deviation of distances: 1.4826 times the median of those below ``within``."""
    near = off[off < within]
    return 1.4826 * float(np.median(near)) if len(near) else within


def _point_weights(surface: TriangleSurface, points: np.ndarray, pose: Poses, reach: float) -> np.ndarray:
    """Return the weights of the points: 1, or for points of a table or wall, the share of them that lie on the piece.

    With full weights, points of a table that meet the surface by chance would pull the piece along a weakly constrained
    direction; and where the scan of the piece has a gap, points of the table would count as the piece. A face of the
    piece that stands on the table keeps some weight.
    """
    laid = pose.apply(points)[0]
    off, weights, rest = surface(laid)[1], np.ones(len(points)), np.ones(len(points), dtype=bool)
    near = min(reach, PLANE_TOLERANCE)
    for _ in range(MAX_PLANES):
        beside = laid[(off > BACKGROUND) & rest]
        least = max(MIN_BACKGROUND_SHARE * len(beside), MIN_POINT_SHARE * len(points), 3)
        if len(beside) < least:
            break
        normal, origin = _find_plane(beside, near)
        if np.count_nonzero(np.abs((beside - origin) @ normal) < near) < least:
            break
        on = (np.abs((laid - origin) @ normal) < near) & rest
        weights[on] = np.mean(off[on] < reach)
        rest &= ~on
    return weights


def _find_plane(points: np.ndarray, near: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the unit normal and a point of the plane that has the most points within the distance ``near``.

    The plane is found by RANSAC (Fischler and Bolles 1981) and fitted to the points near it.
    """
    three = points[np.random.default_rng(0).integers(0, len(points), (PLANE_TRIES, 3))]
    normals = np.cross(three[:, 1] - three[:, 0], three[:, 2] - three[:, 0])
    long = np.linalg.norm(normals, axis=1)
    three, normals = three[long > 1e-9], normals[long > 1e-9] / long[long > 1e-9, None]
    if not len(three):
        return np.array([0.0, 0.0, 1.0]), points[0]
    off = np.abs(points[: POINT_COUNTS[2]] @ normals.T - np.einsum("ij,ij->i", normals, three[:, 0]))
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
    """Return the pose that fits all points best.

    Parameters
    ----------
    surface, table : exact and tabulated distances
    points, weights : all points of the scan and their weights
    poses : the best poses so far
    reach : scale of the robust weights, which matches the noise
    progress : called with the fraction done; may cancel
    """
    some, most = POINT_COUNTS[2:]
    quick = ScanFit(table, points[:some].astype(np.float32), weights[:some])
    exact = ScanFit(surface, points[:most], weights[:most])
    for k, steps in enumerate(FINAL_STEPS):
        progress(k / len(FINAL_STEPS), "Scan: fitting all points")
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

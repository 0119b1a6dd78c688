"""The rigid motion that lays a scan over a surface, without markers.

Thousands of first guesses are fitted at once to a table of closest points (``surface``, ``poses``), then fewer and fewer of
them, with more points and a shorter reach. Each round also looks along the ways in which the surface slides in itself. What
decides in the end are all points at the reach of the scan's own noise, with the table that the piece stood on weighed down.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from ..arrays import Float
from ..progress import SILENT, Progress
from .poses import Fit, Poses, distinct
from .surface import Surface, Table

# Measured on 26 surfaces of the zoo, 20 scans each: with 3 offsets instead of 5 and reaches from 0.12 on, a coil was caught between
# its own turns; without the looks along the weak ways a third of all gables and a tenth of all barrels ended wrong.
TILTS = (
    (0.0, 1),
    (12.0, 6),
    (25.0, 14),
)  # degrees, turns so far from the given pose: any of 30 degrees is near one of them
WIDEST = (
    45.0  # degrees: poses turned further are left out, or a symmetric piece may be laid in another of its right poses
)
ANYWHERE = 600  # turns tried where any pose may be: the median of all poses is 15 degrees from the nearest
OFFSETS = (-0.25, -0.125, 0.0, 0.125, 0.25)  # shares of the surface's extents: its middle from that of the scan
FEW_OFFSETS = (-0.2, 0.0, 0.2)  # the same where any turn is tried
FIRST = (0.04, 0.02)  # reaches of the first guesses
SIEVED = 120  # guesses that go on from there
# reach of each round, and its steps along the weak ways: a scan of three fifths is at first up to 0.3 off along a ridge
LOOKS = ((0.03, (0.04, 0.08, 0.16, 0.3)), (0.015, (0.02, 0.04, 0.08, 0.16)), (0.007, (0.02, 0.04, 0.08, 0.16)))
LAST_LOOKS = ((0.03, 0.06, 0.12), (0.005, 0.01, 0.02), (0.0015, 0.003, 0.006))  # the same steps at the last reach
POINTS = (120, 400, 1500, 3000)  # of the scan: while guesses are many, few, very few, and at the end
NOISES = 3.0  # the last reach in standard deviations of the scan's noise: 95 % of a normal distribution weigh over 0.47
SHARPEST, BLUNTEST = 0.0005, 0.03  # shares of the size between which that reach stays
BESIDE = 0.05  # share of the size beyond which points are beside the piece: a piece that was built badly, bent by 4 %, is not
# A plane is one where it holds this share of the points beside the piece, and this share of all points; 200 outliers in a cube
# around the piece never come near to either, see ``bench make --tables``
FLAT, WORTH = 0.2, 0.005
# Share of the size, the farthest that a plane's points lie from it. With 0.03 much of a dome went as planes and the rest was laid over
# a torus; with 0.01 scans of 7 other objects are refused. Of 8 surfaces none lost points to planes without a table, at a noise of 0.005.
THIN = 0.01
PLANES = 3  # a table, and two walls in a corner
TRIES = 300  # planes through three points each: one in ten points on the plane is met in 26 % of such searches, one in five in 91 %


@dataclass(frozen=True, eq=False)
class Registration:
    """Where a scan belongs.

    turn, shift : ``scan @ turn.T + shift`` lies over the surface
    weights : how much each point of the scan counted; that of a plane's points is the share of it which the piece explains
    reach : shares of the size, what was taken for three standard deviations of the scan's noise
    """

    turn: Float[np.ndarray, "3 3"]
    shift: Float[np.ndarray, " 3"]
    weights: Float[np.ndarray, " points"]
    reach: float


def register(
    surface: Surface, scan: Float[np.ndarray, "points 3"], anywhere: bool = False, progress: Progress = SILENT
) -> Registration:
    """Where a scan's points, in any order, belong on a surface around the origin; lengths are shares of its size.

    Without ``anywhere`` the scan is taken to be turned by 30 degrees at most.
    """
    table = Table(surface)
    points = scan[np.random.default_rng(0).permutation(len(scan))]
    rough = [Fit(table, points[:count].astype(np.float32), np.ones(min(count, len(points)))) for count in POINTS]
    poses = _sieved(rough[0], _guesses(surface, points, anywhere), anywhere, progress.part(0.0, 0.5))
    for k, (reach, steps) in enumerate(LOOKS):
        progress(0.5 + 0.1 * k, "Scan: looking along the surface")
        poses = _looked(rough[1], poses, reach, steps, reach / 2, 30, 0.02)
        poses = poses if anywhere else _upright(poses)
    poses = distinct(poses, rough[3].cost(poses, 0.005), points[:4], 8, 0.01)
    progress(0.8, "Scan: measuring its noise")
    exact = Fit(surface, points[: POINTS[2]], rough[2].weights)
    poses = exact.fitted(poses, 0.005, 6)
    exact = Fit(surface, points[: POINTS[3]], rough[3].weights)
    poses = poses[np.argsort(exact.cost(poses, 0.005))[:4]]
    reach = _noise(exact, poses[:1])
    weights = _weights(surface, points, poses[:1], reach)
    poses = _last(surface, table, points, weights, poses, reach, progress.part(0.85, 1.0))
    back = np.empty(len(points))
    back[np.random.default_rng(0).permutation(len(scan))] = weights
    return Registration(poses.turns[0], poses.shifts[0], back, reach)


def _guesses(surface: Surface, points: np.ndarray, anywhere: bool) -> Poses:
    """All first turns with all first offsets."""
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
    """Those that are turned by ``WIDEST`` at most, or all where there is none."""
    cosine = (np.trace(poses.turns, axis1=1, axis2=2) - 1) / 2
    near = np.flatnonzero(cosine >= np.cos(np.radians(WIDEST)))
    return poses[near] if len(near) else poses


def _ball(count: int) -> np.ndarray:
    """(count, 3) unit vectors spread over the ball by the golden angle."""
    k = np.arange(count) + 0.5
    height, angle = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    across = np.sqrt(1 - height**2)
    return np.column_stack([across * np.cos(angle), across * np.sin(angle), height])


def _sieved(fit: Fit, poses: Poses, anywhere: bool, progress: Progress) -> Poses:
    """The best of the first guesses, fitted some at a time so that it can be stopped."""
    parts = []
    for k in range(0, len(poses), 1024):
        progress(k / len(poses), "Scan: looking for its pose")
        part = poses[k : k + 1024]
        for reach in FIRST:
            part = fit.fitted(part, reach, 4)
        parts.append(part)
    poses = Poses.joined(parts) if anywhere else _upright(Poses.joined(parts))
    return distinct(poses, fit.cost(poses, 0.01), fit.points[:4], SIEVED, 0.02)


def _looked(
    fit: Fit, poses: Poses, reach: float, steps: tuple[float, ...], judged: float, most: int, apart: float
) -> Poses:
    """The best of the poses and of those beside them along their weak ways, all fitted again."""
    poses = fit.fitted(fit.spread(poses, reach, steps), reach, 3)
    return distinct(poses, fit.cost(poses, judged), fit.points[:4], most, apart)


def _noise(fit: Fit, pose: Poses) -> float:
    """``NOISES`` standard deviations of the points about the surface, from the median of those that lie within the same."""
    off = np.abs(fit.distances(pose.laid(fit.points))[1][0])
    deviation = _deviation(off, BLUNTEST)
    for _ in range(5):
        deviation = _deviation(off, NOISES * deviation)
    return float(np.clip(NOISES * deviation, SHARPEST, BLUNTEST))


def _deviation(off: np.ndarray, within: float) -> float:
    """Standard deviation from the median of those distances that are ``within``."""
    near = off[off < within]
    return 1.4826 * float(np.median(near)) if len(near) else within


def _weights(surface: Surface, points: np.ndarray, pose: Poses, reach: float) -> np.ndarray:
    """1, but for the points of planes that reach beyond the piece: the share of each that lies on the piece.

    A table's points that meet the surface by chance would otherwise pull the piece along a weak way, and those close under a part
    that the scan does not show would be taken for it; those of a cube's own face that stands on the table still count for
    something.
    """
    laid = pose.laid(points)[0]
    off, weights, rest = surface(laid)[1], np.ones(len(points)), np.ones(len(points), dtype=bool)
    near = min(reach, THIN)
    for _ in range(PLANES):
        beside = laid[(off > BESIDE) & rest]
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
    """Unit normal and a point of the plane with most points ``near`` it (Fischler and Bolles 1981), fitted to these."""
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


def _last(
    surface: Surface,
    table: Table,
    points: np.ndarray,
    weights: np.ndarray,
    poses: Poses,
    reach: float,
    progress: Progress,
) -> Poses:
    """The one pose that the points hold best at the reach of their noise."""
    some, most = POINTS[2:]
    quick = Fit(table, points[:some].astype(np.float32), weights[:some])
    exact = Fit(surface, points[:most], weights[:most])
    for k, steps in enumerate(LAST_LOOKS):
        progress(k / len(LAST_LOOKS), "Scan: fitting all points")
        if k < 2:
            poses = _looked(quick, poses, reach, steps, reach, 6, 0.003)
        else:
            near = exact.spread(poses, reach, steps)
            poses = near[np.argsort(exact.cost(near, reach))[:4]]
        poses = exact.fitted(poses, reach, 5)
    everything = Fit(surface, points, weights)
    poses = poses[np.argsort(exact.cost(poses, reach))[:2]]
    poses = poses[np.argsort(everything.cost(poses, reach))[:1]]
    return everything.fitted(poses, reach, 10, 1e-6)

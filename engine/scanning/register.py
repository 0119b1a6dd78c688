"""The rigid motion that lays a scan over a surface, without markers.

Iterated closest points, point to plane (Chen and Medioni 1991), from many starts (Rusinkiewicz and Levoy 2001 compare the
variants), with every pair weighed down as it is far apart, so that missing parts, clutter and outliers have no say; what
Chetverikov et al. 2002 trim by rank is trimmed here by a distance that shrinks, as the overlap is not known.

Not reliable yet: of 60 scans of four surfaces, three fifths shown and turned by up to 30 degrees, 45 % ended within 0.1 % of the
size (all of a cube's, few of domes' and barrels'; ``bench make``). A result must be looked at.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Float
from ..progress import SILENT, Progress

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

Pose = tuple[np.ndarray, np.ndarray]  # R (3, 3) and t (3,)

ROUGH = (0.15, 0.08, 0.04)  # share of the size within which pairs count while starts compete
FINE = (0.03, 0.015, 0.008, 0.004)  # the same for those that are left, down to what noise leaves
NEAR = 0.02  # share of the size within which a point counts as met, when starts are compared
TILT = 25.0  # degrees of the starts beside the given pose: no turn of 30 degrees is further than 26 from one of them
ANYWHERE = 200  # turns tried where any pose may be: half of all poses are within 23 degrees of one, 99 % within 43
LEFT = 6  # starts that are refined


def register(
    points: Float[np.ndarray, "samples 3"],
    normals: Float[np.ndarray, "samples 3"],
    scan: Float[np.ndarray, "points 3"],
    anywhere: bool = False,
    progress: Progress = SILENT,
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, " 3"]]:
    """The turn R and shift t, so that ``scan @ R.T + t`` lies over the surface of ``points`` with unit ``normals``; metres.

    Without ``anywhere`` the scan is taken to be turned by 30 degrees at most.
    """
    from scipy.spatial import cKDTree
    from scipy.spatial.transform import Rotation

    size, tree = float(np.linalg.norm(np.ptp(points, axis=0))), cKDTree(scan)
    if anywhere:
        turns = Rotation.random(ANYWHERE, rng=0).as_matrix()
    else:
        tilts = np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)]) * np.radians(TILT)
        turns = Rotation.from_rotvec(tilts).as_matrix()
    few = slice(None, None, max(1, len(points) // 300))
    middles = (np.median(scan, axis=0), (scan.min(axis=0) + scan.max(axis=0)) / 2)
    found = []
    for k, turn in enumerate(turns):
        progress(0.8 * k / len(turns), "Scan: looking for its pose")
        for middle in middles:
            pose = turn, points.mean(axis=0) - turn @ middle
            pose = _closer(points[few], normals[few], tree, pose, ROUGH, size)
            found.append((_missed(points[few], tree, pose, size), pose))
    found.sort(key=lambda one: one[0])
    refined = [_closer(points, normals, tree, pose, FINE, size) for _, pose in found[:LEFT]]
    return min(refined, key=lambda pose: _missed(points, tree, pose, size))


def _missed(points: np.ndarray, tree: cKDTree, pose: Pose, size: float) -> float:
    """The mean squared distance of the points from the scan in shares of ``NEAR``, those beyond counted as one."""
    turn, shift = pose
    distance, _ = tree.query((points - shift) @ turn)
    return float(np.minimum(distance / (NEAR * size), 1.0).__pow__(2).mean())


def _closer(
    points: np.ndarray, normals: np.ndarray, tree: cKDTree, pose: Pose, reaches: tuple[float, ...], size: float
) -> Pose:
    """The pose after some rounds of closest points at every reach."""
    from scipy.spatial.transform import Rotation

    turn, shift = pose
    centre = points.mean(axis=0)
    for reach in reaches:
        for _ in range(8):
            distance, index = tree.query((points - shift) @ turn)
            weight = np.exp(-((distance / (reach * size)) ** 2))
            if weight.sum() < 1e-6 * len(points):
                return turn, shift
            moved = tree.data[index] @ turn.T + shift
            arms = (moved - centre) / size
            rows = np.concatenate([np.cross(arms, normals), normals], axis=1)
            off = np.einsum("ij,ij->i", normals, points - moved) / size
            square = rows.T @ (weight[:, None] * rows) + 1e-6 * weight.sum() * np.eye(6)
            step = np.linalg.solve(square, rows.T @ (weight * off))
            small = Rotation.from_rotvec(step[:3]).as_matrix()
            turn, shift = small @ turn, small @ (shift - centre) + centre + size * step[3:]
            if np.abs(step).max() < 1e-6:
                break
    return turn, shift

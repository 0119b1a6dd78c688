"""Interpolation between two poses that keeps joints closed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph
from scipy.sparse.linalg import splu

from ...arrays import Float, Int
from ...mechanics.assembly import Pose
from ...mechanics.vectors import matvec, rotation_matrix, rotation_vector


@dataclass(frozen=True, eq=False)
class PoseBlend:
    """Path from one pose (0) to another (1): hubs turn about fixed axes, and joined hubs move so that they stay joined.

    start, end : the two poses
    part : index of the connected component of hubs to which each hub belongs
    pairs : the two hubs of every joint
    lever : vectors from both hubs to the joint, in the frames of the hubs, metres
    turns : rotation vector of every hub, in space, from the first to the second pose
    gaps : gap vectors of the joints in both poses, in the frame half-way between their hubs, metres
    solve : function that returns the shifts (n, 3) of the hubs which change the gaps by given vectors (m, 3), in the
        least-squares sense
    """

    start: Pose
    end: Pose
    part: Int[np.ndarray, " hubs"]
    pairs: Int[np.ndarray, "joints 2"]
    lever: Float[np.ndarray, "joints 2 3"]
    turns: Float[np.ndarray, "hubs 3"]
    gaps: Float[np.ndarray, "2 joints 3"]
    solve: Callable[[np.ndarray], np.ndarray]

    @classmethod
    def between(cls, start: Pose, end: Pose, pairs: np.ndarray, lever: np.ndarray) -> PoseBlend:
        """Return the path between two poses of the same hubs.

        Parameters
        ----------
        start, end : the poses
        pairs, lever : joints that stay closed: their two hubs, and vectors (m, 2, 3) from these to the joint, metres
        """
        count, ones, rows = len(start.centres), np.ones(len(pairs)), np.arange(len(pairs))
        graph = sparse.coo_matrix((ones, (pairs[:, 0], pairs[:, 1])), (count, count)).tocsr()
        part = csgraph.connected_components(graph, directed=False)[1]
        back = np.swapaxes(start.rotations, 1, 2)
        turns = _unwind(rotation_vector(end.rotations @ back), graph, part)
        gaps = np.stack(
            [
                matvec(np.swapaxes(_half_way_frames(pose, pairs), 1, 2), _joint_gaps(pose, pairs, lever))
                for pose in (start, end)
            ]
        )
        # least squares over the joints' gaps; a weak spring on every hub makes the matrix regular
        ends = sparse.coo_matrix(
            (np.concatenate([ones, -ones]), (np.tile(rows, 2), np.concatenate([pairs[:, 1], pairs[:, 0]]))),
            (len(pairs), count),
        ).tocsr()
        solver = splu((ends.T @ ends + 1e-9 * sparse.identity(count)).tocsc())
        return cls(start, end, part, pairs, lever, turns, gaps, lambda wanted: solver.solve(ends.T @ wanted))

    def at(self, share: float) -> Pose:
        """Return the pose at a fraction of the path, from 0 to 1."""
        centres = (1.0 - share) * self.start.centres + share * self.end.centres
        here = Pose(centres, rotation_matrix(share * self.turns) @ self.start.rotations)
        left = (1.0 - share) * self.gaps[0] + share * self.gaps[1]
        wanted = matvec(_half_way_frames(here, self.pairs), left) - _joint_gaps(here, self.pairs, self.lever)
        moved = self.solve(wanted)
        # subtract the mean shift of each component, so that its centre moves along a straight line
        return Pose(centres + moved - part_means(moved, self.part)[self.part], here.rotations)


def part_means(points: Float[np.ndarray, "hubs k"], part: Int[np.ndarray, " hubs"]) -> Float[np.ndarray, "parts k"]:
    """Return the mean (parts, k) of the points in every part.

    Parameters
    ----------
    points : coordinates of the points
    part : index of the part to which each point belongs
    """
    count = np.bincount(part)
    return np.stack([np.bincount(part, x) for x in points.T], axis=1) / np.maximum(count, 1)[:, None]


def _joint_gaps(pose: Pose, pairs: np.ndarray, lever: np.ndarray) -> np.ndarray:
    """Return (m, 3) the gap vector of every joint, metres: from the first hub's end to the second hub's."""
    ends = pose.centres[pairs] + (pose.rotations[pairs] @ lever[..., None])[..., 0]
    return ends[:, 1] - ends[:, 0]


def _half_way_frames(pose: Pose, pairs: np.ndarray) -> np.ndarray:
    """Return (m, 3, 3) the rotation half-way between the two hubs of every joint."""
    first, second = pose.rotations[pairs[:, 0]], pose.rotations[pairs[:, 1]]
    return first @ rotation_matrix(0.5 * rotation_vector(np.swapaxes(first, 1, 2) @ second))


def _unwind(turns: np.ndarray, graph: sparse.csr_matrix, part: np.ndarray) -> np.ndarray:
    """Add whole turns to rotation vectors (n, 3), so that neighbours' differ little and rolled panels unroll."""
    out = turns.copy()
    size = np.linalg.norm(turns, axis=1)
    if size.max(initial=0.0) < 0.5 * np.pi:  # no rotation vector is ambiguous
        return out
    for label in range(int(part.max()) + 1):
        members = np.flatnonzero(part == label)
        start = members[np.argmin(size[members])]
        order, before = csgraph.breadth_first_order(graph, start, directed=False)
        for hub in order[1:].tolist():
            near = out[before[hub]]
            # add whole turns about the axis until the vector is closest to that of the previous hub
            axis = turns[hub] / size[hub] if size[hub] > 1e-9 else near / max(float(np.linalg.norm(near)), 1e-9)
            out[hub] += 2.0 * np.pi * np.round((near @ axis - size[hub]) / (2.0 * np.pi)) * axis
    return out

"""Rigid motions that the supports leave to the connected pieces of an assembly.

A piece without supports keeps all six. One hinge, which fixes the position of a spiral but not its direction, leaves
the three turns about it; hinges in a line leave the turn about the line. Such motions cost no energy, so the Newton
systems of the equilibrium are singular until as many increments of one hub are held. Holding them adds no force where
the loads do no work along the motions; where the loads do work, there is no equilibrium.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from ..arrays import Bool, Float, Int
from ..components import components
from .assembly import Pose
from .vectors import nearest_rotation, skew

# Supports prevent a turn of the piece if a turn of 1 rad would move the supported hubs by a mean square above this, in
# squared distances of neighbouring hubs. A larger value treats nearly collinear hinges as collinear.
MIN_SUPPORT_MOTION = 1e-6


@dataclass(frozen=True, eq=False)
class RigidFreedom:
    """Rigid motions that the supports leave to one connected piece.

    members : (k,) int, its hubs; hub : the member whose increments are held so that the piece cannot move as a whole
    motions : (d, 6) shift (m) at ``hub`` and turn (rad) of independent rigid motions, d = 6, 3, 1 in practice
    entries : (d,) int in 0..5, increments of ``hub`` to hold
    """

    members: Int[np.ndarray, " some"]
    hub: int
    motions: Float[np.ndarray, "d 6"]
    entries: Int[np.ndarray, " d"]

    @property
    def is_unsupported(self) -> bool:
        """True if nothing holds the piece."""
        return len(self.motions) == 6

    def work(self, centres: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the work (d,) of forces (n, 3), newtons, along the motions, and its maximum over force directions."""
        lever = centres[self.members] - centres[self.hub]
        moves = self.motions[:, None, :3] + np.cross(self.motions[:, None, 3:], lever)
        pull = force[self.members]
        most = np.linalg.norm(moves, axis=2) * np.linalg.norm(pull, axis=1)
        return (moves * pull).sum(axis=(1, 2)), most.sum(axis=1)

    def align(self, pose: Pose, target: Float[np.ndarray, "spirals 3"]) -> Pose:
        """Return the pose with this piece moved rigidly, as its supports allow, to lie closest to ``target``."""
        part, wanted = pose.part(self.members), target[self.members]
        if self.is_unsupported:
            moved = part.aligned_to(wanted)
        else:
            pivot = pose.centres[self.hub]
            covariance = (part.centres - pivot).T @ (wanted - pivot)
            if len(self.motions) == 1:
                axis = self.motions[0, 3:] / np.linalg.norm(self.motions[0, 3:])
                rotation = _best_turn_about(axis, covariance)
            else:
                rotation = nearest_rotation(covariance)
            moved = part.transform(rotation, pivot - rotation @ pivot)
        return pose.with_part(self.members, moved)


def connected_pieces(pairs: Int[np.ndarray, "joints 2"], size: int) -> Int[np.ndarray, " spirals"]:
    """Number the connected pieces and return the number of every hub's piece.

    Parameters
    ----------
    pairs : (m, 2) int, joined hubs
    size : number of hubs
    """
    return components(size, *pairs.T)


def movable_pieces(
    fixed: Bool[np.ndarray, "spirals 6"], pairs: Int[np.ndarray, "joints 2"], centres: Float[np.ndarray, "spirals 3"]
) -> list[RigidFreedom]:
    """List the pieces that can still move as a whole.

    Parameters
    ----------
    fixed : (n, 6) bool, shifts and turns of the hubs that are held
    pairs : (m, 2) int, joined hubs
    centres : (n, 3) metres
    """
    piece = connected_pieces(pairs, len(fixed))
    count = int(piece.max(initial=-1)) + 1
    spacing = float(np.linalg.norm(centres[pairs[:, 1]] - centres[pairs[:, 0]], axis=1).mean()) if len(pairs) else 1.0
    clamped = np.bincount(piece, weights=fixed.all(axis=1), minlength=count) > 0
    found = []
    for k in np.flatnonzero(~clamped):
        members = np.flatnonzero(piece == k)
        motions, hub = _free_motions(fixed, centres, members, spacing)
        if len(motions):
            entries = qr(motions * np.repeat([1.0, spacing], 3), mode="r", pivoting=True)[1][: len(motions)]
            found.append(RigidFreedom(members, hub, motions, np.sort(entries)))
    return found


def _free_motions(
    fixed: np.ndarray, centres: np.ndarray, members: np.ndarray, spacing: float
) -> tuple[np.ndarray, int]:
    """Return the rigid motions (d, 6) of a piece that its supports allow, and the hub where they are measured.

    fixed, centres : of all hubs; members : the piece's hubs; spacing : mean distance of neighbouring hubs, metres
    """
    held = members[fixed[members].any(axis=1)]
    if not len(held):
        middle = centres[members].mean(axis=0)
        return np.eye(6), int(members[np.linalg.norm(centres[members] - middle, axis=1).argmin()])
    # measured at a supported hub, so that only its own free turns need to be held
    hub = int(held[0])
    rows = np.zeros((len(held), 6, 6))
    rows[:, :3, :3] = rows[:, 3:, 3:] = np.eye(3)
    rows[:, :3, 3:] = -skew(centres[held] - centres[hub]) / spacing
    rows = rows[fixed[held]]
    size, ways = np.linalg.eigh(rows.T @ rows / len(held))
    return ways[:, size < MIN_SUPPORT_MOTION].T / np.repeat([1.0, spacing], 3), hub


def _best_turn_about(axis: np.ndarray, covariance: np.ndarray) -> Float[np.ndarray, "3 3"]:
    """Return the rotation R (3, 3) about a unit axis for which the trace of R @ covariance is largest."""
    around = skew(axis)
    # R = 1 + sin(a) K + (1 - cos(a)) K K
    sine, cosine = np.trace(around @ covariance), -np.trace(around @ around @ covariance)
    angle = np.arctan2(sine, cosine)
    return np.eye(3) + np.sin(angle) * around + (1.0 - np.cos(angle)) * around @ around

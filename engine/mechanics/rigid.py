"""Rigid motions that the supports of an assembly allow to its connected pieces.

A piece without supports can move in six ways. A hinge is a support that holds a hub's position but not its rotation:
one hinge allows the three turns about it, several hinges in a line allow the turn about the line. Such motions cost no
energy, so the Newton systems of the equilibrium are singular, until as many increments of one hub are held constant as
there are such motions. If the loads do no work along the motions, this adds no force; if they do, there is no
equilibrium.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from ..arrays import Bool, Float, Int
from ..components import components
from .assembly import Pose
from .vectors import nearest_rotation, skew

# Supports prevent a motion of the piece that would move their hubs. They do so if a turn of 1 rad would move the held
# hubs by a mean square distance above this, in units of the squared mean distance of neighbouring hubs. Larger treats
# hinges that are nearly in a line as if they were in a line.
MIN_SUPPORT_MOTION = 1e-6


@dataclass(frozen=True, eq=False)
class RigidFreedom:
    """Rigid motions that the supports allow to one connected piece.

    members : (k,) indices of the piece's hubs
    hub : index of the member of which d increments are to be held, so that the piece cannot move as a whole
    motions : (d, 6) d independent rigid motions: shift of ``hub`` (metres) and turn (radians); d is 6, 3 or 1 in
        practice
    entries : (d,) indices (0 to 5) of the increments of ``hub`` to hold
    """

    members: Int[np.ndarray, " some"]
    hub: int
    motions: Float[np.ndarray, "d 6"]
    entries: Int[np.ndarray, " d"]

    @property
    def is_unsupported(self) -> bool:
        """True if the piece has no support."""
        return len(self.motions) == 6

    def work(self, centres: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the work (d,) of forces along the motions, and the largest possible work (d,).

        The latter is the work if every force had the direction in which its hub moves.

        centres, force : (n, 3) of all hubs, metres and newtons
        """
        lever = centres[self.members] - centres[self.hub]
        moves = self.motions[:, None, :3] + np.cross(self.motions[:, None, 3:], lever)
        pull = force[self.members]
        most = np.linalg.norm(moves, axis=2) * np.linalg.norm(pull, axis=1)
        return (moves * pull).sum(axis=(1, 2)), most.sum(axis=1)

    def align(self, pose: Pose, target: Float[np.ndarray, "spirals 3"]) -> Pose:
        """Return ``pose`` with this piece moved rigidly to lie closest to ``target``, as far as its supports allow.

        target : (n, 3) centres of all hubs, metres
        """
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
    """Number the connected pieces of an assembly; return for every hub the number of its piece.

    Parameters
    ----------
    pairs : (m, 2) indices of joined hubs
    size : number of hubs
    """
    return components(size, *pairs.T)


def movable_pieces(
    fixed: Bool[np.ndarray, "spirals 6"], pairs: Int[np.ndarray, "joints 2"], centres: Float[np.ndarray, "spirals 3"]
) -> list[RigidFreedom]:
    """Return the connected pieces that can move rigidly in spite of their supports, with these motions.

    Parameters
    ----------
    fixed : (n, 6) mask of the increments of the hubs (three shifts, three turns) that supports hold
    pairs : (m, 2) indices of joined hubs
    centres : (n, 3) centres of the hubs, metres
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
    """Return ``motions`` and ``hub`` of ``RigidFreedom`` for one piece.

    Parameters
    ----------
    fixed, centres : of all hubs, as in ``movable_pieces``
    members : indices of the piece's hubs
    spacing : mean distance of neighbouring hubs, metres
    """
    held = members[fixed[members].any(axis=1)]
    if not len(held):
        middle = centres[members].mean(axis=0)
        return np.eye(6), int(members[np.linalg.norm(centres[members] - middle, axis=1).argmin()])
    # a supported hub is chosen, because its position is already held: only its free turns remain to be held
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
    # Rodrigues' formula: R = 1 + sin(angle) K + (1 - cos(angle)) K K, with K = ``around``
    sine, cosine = np.trace(around @ covariance), -np.trace(around @ around @ covariance)
    angle = np.arctan2(sine, cosine)
    return np.eye(3) + np.sin(angle) * around + (1.0 - np.cos(angle)) * around @ around

"""Mismatch between an equilibrium and the target, and its derivatives with respect to the hubs' centres.

The compared coordinates are Laplacian coordinates, slopes and positions of the centres, each with a weight (FlexMaps
section 7, eq. 6 to 10). Connected bodies without supports are aligned with the target before the comparison.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import orth
from scipy.sparse import csr_array, vstack

from ..arrays import Float, Int
from ..mechanics.assembly import Pose
from ..mechanics.laplacian import uniform_laplacian
from ..mechanics.rigid import connected_pieces
from ..mechanics.vectors import nearest_rotation
from ..params import OptimiseParams
from ..tolerances import DOUBLE_TOL
from .wishes import Wishes


@dataclass(frozen=True, eq=False)
class FreeBody:
    """A connected body of the piece without supports.

    hubs : (k,) int, its spirals; rows : its rows of ``Target.operator``; position_rows : the subset of ``rows`` with
        positions
    """

    hubs: Int[np.ndarray, " k"]
    rows: Int[np.ndarray, " rows"]
    position_rows: Int[np.ndarray, " places"]


@dataclass(frozen=True, eq=False)
class Target:
    """Target of the spirals' centres, and the measure of a mismatch.

    pairs : (m, 2) int, joined spirals; points : (n, 3) metres, target position of every hub's centre
    position_share : weight of position against curvature, 0 to 1. 0 compares only curvature, by Laplacian coordinates
        (eq. 9). Bends longer than about 30 spirals hardly change these, so a piece with small differences may be far
        from the target. 1 compares only positions. Values in between compare slopes (differences of neighbours) too.
        This is a Sobolev norm: deviations longer than (1 - position_share) / position_share spirals count by position,
        shorter deviations by curvature
    supports : (k,) int, spirals that are held; None for no supports. A connected body without supports may lie
        anywhere, so it is rotated and shifted onto the target before comparing
    wishes : target positions that the user sets for some spirals; wish_weight : of their mean square distance, in
        ``unit_length``
    """

    pairs: Int[np.ndarray, "joints 2"]
    points: Float[np.ndarray, "spirals 3"]
    position_share: float = OptimiseParams.lies
    supports: Int[np.ndarray, " k"] | None = None
    wishes: Wishes | None = None
    wish_weight: float = OptimiseParams.urge

    @cached_property
    def unit_length(self) -> float:
        """Unit of length of the mismatch, metres: the mean distance of joined spirals."""
        a, b = self.pairs.T
        return float(np.linalg.norm(self.points[b] - self.points[a], axis=1).mean())

    @cached_property
    def size(self) -> float:
        """Diagonal of the bounding box of ``points``, metres."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))

    @cached_property
    def weights(self) -> tuple[float, float, float]:
        """Weights of curvature, slopes and positions; their squares sum up to 1."""
        bends, slopes, places = (
            (1.0 - self.position_share) ** 2,
            self.position_share * (1.0 - self.position_share),
            self.position_share**2,
        )
        norm = float(np.sqrt(bends**2 + slopes**2 + places**2))
        return bends / norm, slopes / norm, places / norm

    @cached_property
    def operator(self) -> csr_array:
        """Matrix (rows, n) from the centres to the compared coordinates, over ``unit_length`` and the square root of n.

        Its rows are Laplacian coordinates, slopes and positions (each if its weight is not 0), then the positions of
        spirals with wishes, divided by the square root of their number instead.
        """
        n, m = len(self.points), max(len(self.pairs), 1)
        ends = np.tile([-1.0, 1.0], len(self.pairs)), (np.repeat(np.arange(len(self.pairs)), 2), self.pairs.ravel())
        slopes = csr_array(ends, shape=(len(self.pairs), n)) * np.sqrt(n / m)  # so that m rows weigh as much as n
        places = csr_array((np.ones(n), (np.arange(n), np.arange(n))), shape=(n, n))
        parts = zip(self.weights, (uniform_laplacian(self.pairs, n), slopes, places), strict=True)
        compared = vstack([weight * part for weight, part in parts if weight]) / (self.unit_length * np.sqrt(n))
        if self.wishes is None:
            return csr_array(compared)
        wished = places[self.wishes.quads].toarray()
        for body in self.free_bodies:
            wished[np.ix_(np.isin(self.wishes.quads, body.hubs), body.hubs)] -= 1.0 / len(body.hubs)
        return csr_array(vstack([compared, csr_array(self._wish_factor * wished)]))

    @cached_property
    def body_of_spiral(self) -> Int[np.ndarray, " spirals"]:
        """(n,) number of the connected body that every spiral belongs to."""
        return connected_pieces(self.pairs, len(self.points))

    @cached_property
    def spiral_of_row(self) -> Int[np.ndarray, " joints"]:
        """(rows,) spiral that every row of ``operator`` belongs to; for slopes, the first spiral of the pair."""
        n, wished = len(self.points), [] if self.wishes is None else [self.wishes.quads]
        parts = zip(self.weights, (np.arange(n), self.pairs[:, 0], np.arange(n)), strict=True)
        return np.concatenate([*(part for weight, part in parts if weight), *wished])

    @cached_property
    def free_bodies(self) -> list[FreeBody]:
        """The connected bodies without supports."""
        body_of, n = self.body_of_spiral, len(self.points)
        held = set() if self.supports is None else set(body_of[self.supports].tolist())
        end = len(self.spiral_of_row) - (0 if self.wishes is None else len(self.wishes.quads))
        found = []
        for k in sorted(set(body_of.tolist()) - held):
            rows = np.flatnonzero(body_of[self.spiral_of_row] == k)
            placed = (rows >= end - n) & (rows < end) if self.weights[2] else np.zeros(len(rows), bool)
            found.append(FreeBody(np.flatnonzero(body_of == k), rows, rows[placed]))
        return found

    @property
    def _wish_factor(self) -> float:
        """Factor on the distance of a spiral from its wished position, per metre."""
        assert self.wishes is not None
        return self.wish_weight / (self.unit_length * np.sqrt(max(len(self.wishes.quads), 1)))

    @cached_property
    def operator_transposed(self) -> csr_array:
        """Transpose of the operator."""
        return csr_array(self.operator.T)

    @cached_property
    def target_coordinates(self) -> Float[np.ndarray, "joints 3"]:
        """Compared coordinates (rows, 3) of the target positions, see ``operator``."""
        found = self.centre_free_bodies(self.operator @ self.points)
        if self.wishes is not None:
            quads, places = self.wishes.quads, self.wishes.places
            found[len(found) - len(quads) :] += self._wish_factor * (places - self.points[quads])
        return found

    def centre_free_bodies(self, values: np.ndarray) -> np.ndarray:
        """Return compared coordinates (rows, 3) with the positions of every free body relative to their mean."""
        centred = values.copy()
        for body in self.free_bodies:
            if len(body.position_rows):
                centred[body.position_rows] -= values[body.position_rows].mean(axis=0)
        return centred

    def align_pose(self, pose: Pose) -> Pose:
        """Return the pose with every free body moved rigidly to where it fits the target best."""
        for body in self.free_bodies:
            pose = pose.with_part(body.hubs, pose.part(body.hubs).aligned_to(self.points[body.hubs]))
        return pose

    def relative_distance(self, pose: Pose) -> float:
        """Return the RMS distance of a pose's centres from their target positions, in units of ``unit_length``."""
        return (
            float(np.sqrt(((self.align_pose(pose).centres - self.points) ** 2).sum(axis=1).mean())) / self.unit_length
        )

    @property
    def farthest_wish(self) -> float:
        """Distance of the farthest wish from the target, in units of ``unit_length``; 0 without wishes."""
        if self.wishes is None:
            return 0.0
        apart = self.wishes.places - self.points[self.wishes.quads]
        return float(np.sqrt((apart**2).sum(axis=1).max(initial=0.0))) / self.unit_length

    def compare(self, centres: Float[np.ndarray, "spirals 3"]) -> Mismatch:
        """Return the mismatch between these centres (n, 3), metres, and the target positions."""
        own = self.centre_free_bodies(self.operator @ centres)
        turns = [nearest_rotation(own[body.rows].T @ self.target_coordinates[body.rows]) for body in self.free_bodies]
        return Mismatch(self, self.rotate_free_bodies(own, turns), turns)

    def rotate_free_bodies(self, values: np.ndarray, turns: list[np.ndarray]) -> Float[np.ndarray, "joints 3"]:
        """Return compared coordinates (rows, 3), those of every free body rotated by its matrix (3, 3) in ``turns``."""
        turned = values.copy()
        for body, turn in zip(self.free_bodies, turns, strict=True):
            turned[body.rows] = values[body.rows] @ turn.T
        return turned


@dataclass(frozen=True, eq=False)
class Mismatch:
    """Mismatch of a pose; its value is half the sum of the squared residuals.

    target : what the pose is compared with; pose_coordinates : (rows, 3) compared coordinates of the pose, rotated onto
        the target
    rotations : rotation (3, 3) of every free body onto the target
    """

    target: Target
    pose_coordinates: Float[np.ndarray, "joints 3"]
    rotations: list[np.ndarray]

    @property
    def residual(self) -> Float[np.ndarray, "joints 3"]:
        """Differences (rows, 3) between pose and target in the compared coordinates of ``Target.operator``."""
        return self.pose_coordinates - self.target.target_coordinates

    @property
    def value(self) -> float:
        return 0.5 * float((self.residual**2).sum())

    @property
    def value_by_body(self) -> Float[np.ndarray, " bodies"]:
        """Contribution of every connected body to ``value``."""
        return 0.5 * np.bincount(self.target.body_of_spiral[self.target.spiral_of_row], (self.residual**2).sum(axis=1))

    @property
    def rmse(self) -> float:
        """RMSE of the Laplacian coordinates, metres; RMSE of the positions if only positions are compared."""
        weight = self.target.weights[0] or self.target.weights[2]
        compared = self.residual[: len(self.target.points)]
        return float(np.sqrt((compared**2).sum())) * self.target.unit_length / weight

    @property
    def wish_distance(self) -> float:
        """RMS distance of the spirals with wishes from their wished positions, metres; 0 without wishes."""
        wishes = self.target.wishes
        if wishes is None:
            return 0.0
        rows = self.residual[len(self.pose_coordinates) - len(wishes.quads) :]
        return float(np.sqrt((rows**2).sum())) * self.target.unit_length / max(self.target.wish_weight, 1e-30)

    @property
    def gradient(self) -> Float[np.ndarray, "spirals 3"]:
        """Gradient of the value with respect to the centres, per metre, at fixed rotations (envelope theorem)."""
        return self.vjp(self.residual, project=False)

    @cached_property
    def _rotation_bases(self) -> list[np.ndarray]:
        """For every free body, an orthonormal basis (3 rows, k) of the residual's changes under small rotations."""
        bases = []
        for body in self.target.free_bodies:
            turned = np.stack([np.cross(axis, self.pose_coordinates[body.rows]).ravel() for axis in np.eye(3)], axis=1)
            bases.append(orth(turned, rcond=DOUBLE_TOL))  # fewer than three for a body of one or two spirals
        return bases

    def jvp(self, shift: np.ndarray) -> Float[np.ndarray, "joints 3"]:
        """Return the linearised change (rows, 3) of the residual for shifts (n, 3) of the centres, metres (jvp).

        The rotations of free bodies are adapted.
        """
        target = self.target
        return self._project_out_rotations(
            target.rotate_free_bodies(target.centre_free_bodies(target.operator @ shift), self.rotations)
        )

    def vjp(self, change: np.ndarray, project: bool = True) -> np.ndarray:
        """Return the derivatives (n, 3) by the centres of the residual's scalar product with ``change`` (vjp).

        change : (rows, 3), constant
        project : whether the rotations of free bodies follow the centres; False keeps them fixed
        """
        kept = self._project_out_rotations(change) if project else change
        back = self.target.rotate_free_bodies(kept, [turn.T for turn in self.rotations])
        return self.target.operator_transposed @ self.target.centre_free_bodies(back)

    def gauss_newton_product(self, shift: Float[np.ndarray, "spirals 3"]) -> Float[np.ndarray, "spirals 3"]:
        """Return ``vjp(jvp(shift))``: the product of the Gauss-Newton matrix with shifts of the centres."""
        found = self.target.operator_transposed @ (self.target.operator @ shift)
        for body, undone in zip(self.target.free_bodies, self._cancelled_directions, strict=True):
            found[body.hubs] -= (undone @ (undone.T @ shift[body.hubs].ravel())).reshape(-1, 3)
        return found

    @cached_property
    def _cancelled_directions(self) -> list[np.ndarray]:
        """For every free body, the directions (3 k, some) of its centres that centring and best rotation cancel."""
        found = []
        for body, turn, basis in zip(self.target.free_bodies, self.rotations, self._rotation_bases, strict=True):
            both = np.zeros((len(self.pose_coordinates), 3, 3 + basis.shape[1]))
            if len(body.position_rows):
                both[body.position_rows, :, :3] = np.eye(3) / np.sqrt(len(body.position_rows))
            turned = basis.reshape(len(body.rows), 3, -1).swapaxes(1, 2) @ turn
            both[body.rows, :, 3:] = turned.swapaxes(1, 2)
            parts = (self.target.operator_transposed @ both.reshape(len(both), -1)).reshape(-1, 3, both.shape[2])
            found.append(parts[body.hubs].reshape(3 * len(body.hubs), -1))
        return found

    def _project_out_rotations(self, change: np.ndarray) -> np.ndarray:
        """Return a change (rows, 3) of the residual without the components that rotations of free bodies can undo."""
        kept = change.copy()
        for body, basis in zip(self.target.free_bodies, self._rotation_bases, strict=True):
            flat = change[body.rows].ravel()
            kept[body.rows] = (flat - basis @ (basis.T @ flat)).reshape(-1, 3)
        return kept

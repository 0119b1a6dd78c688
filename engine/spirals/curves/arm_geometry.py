"""Geometry of the flat quads, arm by arm, with derivatives by the flat points. Arm 4 f + k is arm k of quad f."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from ...arrays import Complex, Float, Int
from ...params import SpiralParams
from ...patches.flattening.flatten import FlatPatches
from .arm_curves import CENTRE_X, CENTRE_Y
from .blends import ANGLE, MATE_LEAN, OWN_LEAN, RADIUS, lean_angles
from .spiral import mate_signs, opposite_sides, spokes


@dataclass(frozen=True, eq=False)
class ArmGeometry:
    """Geometry of A arms that does not depend on widths and twists.

    centre : centre of the quad, metres
    radius, angle : length (metres) and direction (radians) from the centre to the joint
    lean : angle from the side's outward normal to that direction, radians
    mate : arm across the joint; at the border the arm itself
    sign : factor on the mate's wind (signed twist) and lean, see ``spiral.mate_signs``
    corner : (A, 4) flat points of the quad, beginning at the start of the arm's side
    corners : (A, 4) positions of these points, metres
    point_count : number of flat points
    """

    centre: Complex[np.ndarray, " arms"]
    radius: Float[np.ndarray, " arms"]
    angle: Float[np.ndarray, " arms"]
    lean: Float[np.ndarray, " arms"]
    mate: Int[np.ndarray, " arms"]
    sign: Float[np.ndarray, " arms"]
    corner: Int[np.ndarray, "arms 4"]
    corners: Complex[np.ndarray, "arms 4"]
    point_count: int

    @classmethod
    def from_flat(cls, flat: FlatPatches, params: SpiralParams) -> ArmGeometry:
        """Read the geometry of all arms from the flat patches.

        Parameters
        ----------
        flat : flat patches
        params : sense of the spirals
        """
        centre, radius, angle = spokes(flat.corners)
        mate, side = opposite_sides(flat.layout.mesh)
        turned = (np.arange(4)[:, None] + np.arange(4)) % 4
        corner = flat.layout.flat_corners[:, turned].reshape(-1, 4)
        return cls(
            np.repeat(centre @ np.array([1.0, 1j]), 4),
            radius.ravel(),
            angle.ravel(),
            lean_angles(flat.corners, angle).ravel(),
            (4 * mate + side).ravel(),
            mate_signs(flat.layout.mesh, params).ravel(),
            corner,
            flat.points[corner] @ np.array([1.0, 1j]),
            len(flat.points),
        )

    def by_points(self, arm: Int[np.ndarray, " k"], by: Float[np.ndarray, "k numbers"]) -> csr_array:
        """Turn derivatives by the arms' parameters into derivatives by the flat points (chain rule).

        Parameters
        ----------
        arm : (K,) arm on whose parameters each quantity depends
        by : (K, N_ARM_PARAMETERS) derivatives of K quantities, in the columns defined in ``arm_curves`` and ``blends``

        Returns
        -------
        (K, 2 V) derivatives, x and y of every flat point in turn
        """
        # g, h: complex gradients by the corners of the arm's quad and of its mate's quad; moving a corner by dz changes
        # the quantity by the real part of conj(g) dz
        spoke = np.exp(1j * self.angle[arm])
        weights = np.array([0.25, 0.25, -0.25, -0.25])
        radial, across = spoke[:, None] * weights, (1j * spoke / self.radius[arm])[:, None] * weights
        g = by[:, RADIUS, None] * radial + (by[:, ANGLE] + by[:, OWN_LEAN])[:, None] * across
        g = g + 0.25 * (by[:, CENTRE_X] + 1j * by[:, CENTRE_Y])[:, None]
        g[:, :2] -= by[:, OWN_LEAN, None] * self._side_slopes(arm)
        there, lean = self.mate[arm], (self.sign[arm] * by[:, MATE_LEAN])[:, None]
        h = lean * (1j * np.exp(1j * self.angle[there]) / self.radius[there])[:, None] * weights
        h[:, :2] -= lean * self._side_slopes(there)
        return self._matrix_by_points(
            np.arange(len(arm)), len(arm), np.hstack([self.corner[arm], self.corner[there]]), np.hstack([g, h])
        )

    def by_sides(
        self, row: np.ndarray, count: int, own: np.ndarray, there: np.ndarray, way: np.ndarray, place: np.ndarray
    ) -> csr_array:
        """Return the part of gaps' derivatives by flat points that comes from placing one quad beside another at a cut.

        Moving an end of either side of the cut moves the second quad's arms in the frame of the first quad.

        Parameters
        ----------
        row : (K,) row of every gap in the result
        count : number of rows of the result
        own, there : (K,) arms on both sides of the cut; the side of ``there`` is placed on the side of ``own``
        way : (K,) derivatives of the gaps by points on the second arm, complex
        place : (K,) these points, in the first quad's frame, complex, metres

        Returns
        -------
        (count, 2 V) derivatives, x and y of every flat point in turn
        """
        middle = 0.5 * (self.corners[own, 0] + self.corners[own, 1])
        # place = middle + turn (q - middle of ``there``); the rotation turn depends on the directions of both sides
        about = (np.conj(way) * 1j * (place - middle)).real[:, None]
        g = about * self._side_slopes(own) + 0.5 * way[:, None]
        along = (self.corners[own, 1] - self.corners[own, 0]) / (self.corners[there, 1] - self.corners[there, 0])
        turn = -along / np.abs(along)
        h = -about * self._side_slopes(there) - 0.5 * (np.conj(turn) * way)[:, None]
        points = np.hstack([self.corner[own, :2], self.corner[there, :2]])
        return self._matrix_by_points(row, count, points, np.hstack([g, h]))

    def _side_slopes(self, arm: np.ndarray) -> np.ndarray:
        """Return the derivative of the direction of an arm's side by its two corners, (K, 2) complex."""
        side = self.corners[arm, 1] - self.corners[arm, 0]
        across = 1j * side / np.abs(side) ** 2
        return np.stack([-across, across], axis=1)

    def _matrix_by_points(self, row: np.ndarray, count: int, points: np.ndarray, g: np.ndarray) -> csr_array:
        """Make a matrix (count, 2 V) whose rows ``row`` are the complex gradients ``g`` by flat points ``points``."""
        columns = np.stack([2 * points, 2 * points + 1], axis=-1)
        data = np.stack([g.real, g.imag], axis=-1)
        rows = np.broadcast_to(row[:, None, None], columns.shape)
        return csr_array((data.ravel(), (rows.ravel(), columns.ravel())), shape=(count, 2 * self.point_count))

"""Positions and rotations at which supports hold hubs: those that fit the hub's flat quad best to its target quad."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.spatial.transform import Rotation

from ..arrays import Float
from ..patches.layout import PatchLayout
from ..surface.mesh import QuadMesh
from .assembly import Pose, target_pose
from .loads import Loads
from .vectors import skew


@dataclass(frozen=True, eq=False)
class SupportPoses:
    """Positions and rotations at which the supports hold their hubs.

    They depend on the flat quads, because the rotation of a clamped hub is the one that fits its flat quad to the
    target.

    loads : with the supports
    surface : the target
    corners : (F, 4, 2) corners of the flat quads, metres
    """

    loads: Loads
    surface: QuadMesh
    corners: Float[np.ndarray, "quads 4 2"]

    @cached_property
    def fitted_pose(self) -> Pose:
        """Pose of all hubs, also of those without support, that fits every flat quad to its quad of the target."""
        return target_pose(self.surface, self.corners)

    def with_corners(self, corners: Float[np.ndarray, "quads 4 2"]) -> SupportPoses:
        """Return a copy for other flat quads."""
        return replace(self, corners=corners)

    def place_supports(self, pose: Pose) -> Pose:
        """Return a copy of the pose in which the supported hubs are where the supports hold them."""
        shifts, turns = self.loads.fixed[:, :3], self.loads.fixed[:, 3:4, None]
        centres = np.where(shifts, self.fitted_pose.centres, pose.centres)
        return replace(pose, centres=centres, rotations=np.where(turns, self.fitted_pose.rotations, pose.rotations))

    def correct_step(self, pose: Pose, step: Float[np.ndarray, "spirals 6"]) -> Float[np.ndarray, "spirals 6"]:
        """Return a copy of the step that brings the supported hubs to where the supports hold them.

        Parameters
        ----------
        pose : where the step begins
        step : (n, 6) increments, as in ``Pose.moved``
        """
        turns = Rotation.from_matrix(self.fitted_pose.rotations @ np.swapaxes(pose.rotations, 1, 2)).as_rotvec()
        exact = np.concatenate([self.fitted_pose.centres - pose.centres, turns], axis=1)
        step = step.copy()
        step[: len(exact)] = np.where(self.loads.fixed, exact, step[: len(exact)])
        return step

    def by_points(self, layout: PatchLayout, bodies: int) -> csr_array:
        """Differentiate the rotations at which clamped hubs are held by the vertices of the flat patches.

        Let p be the corners of a hub's flat quad, q those of its target quad and M = sum of p q^T. The rotation R that
        fits p to q best makes S = R M symmetric. When p changes by dp, R rotates by the vector w that solves
        (tr(S) 1 - S) w = sum of R dp x q.

        Parameters
        ----------
        layout : gives the flat vertices of every quad
        bodies : number of hubs and rim nodes

        Returns
        -------
        (6 bodies, 2 P) : sparse derivatives of the bodies' increments by x and y of the P flat vertices; only the rows
            of clamped hubs' rotations are not zero
        """
        clamped = np.flatnonzero(self.loads.fixed[:, 3])
        wanted = self.surface.vertices[self.surface.quads[clamped]]
        wanted = wanted - wanted.mean(axis=1, keepdims=True)
        flat = np.zeros_like(wanted)
        flat[..., :2] = self.corners[clamped] - self.corners[clamped].mean(axis=1, keepdims=True)
        rotation = self.fitted_pose.rotations[clamped]
        stretch = np.einsum("fij,fkj,fkl->fil", rotation, flat, wanted)
        stiff = np.trace(stretch, axis1=1, axis2=2)[:, None, None] * np.eye(3) - 0.5 * (
            stretch + np.swapaxes(stretch, 1, 2)
        )
        # the derivative of the right-hand side by coordinate c of corner k is R e_c x q_k, with the unit vector e_c
        around = np.einsum("fkij,fjc->fikc", -skew(wanted), rotation[:, :, :2])
        turns = np.linalg.solve(stiff, around.reshape(-1, 3, 8))
        row = np.broadcast_to((6 * clamped[:, None] + np.arange(3, 6))[..., None], turns.shape)
        corner = layout.flat_corners[clamped]
        column = np.broadcast_to((2 * corner[..., None] + np.arange(2)).reshape(-1, 1, 8), turns.shape)
        entries = (turns.ravel(), (row.ravel(), column.ravel()))
        return csr_array(coo_array(entries, shape=(6 * bodies, 2 * (int(layout.flat_corners.max()) + 1))))

"""Vertices that follow their hubs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from flexmaps.engine.mechanics.assembly import Pose
from flexmaps.engine.params import SpiralParams
from flexmaps.engine.patches.flattening.flatten import FlatPatches
from flexmaps.engine.simulation.simulate import move_vertices
from flexmaps.engine.spirals.fabricable import uniform_design
from flexmaps.engine.surface.mesh import QuadMesh
from scipy.spatial.transform import Rotation


def test_vertices_of_a_rigidly_moved_panel_move_with_it_and_strays_stay(flat_grid: Callable[..., FlatPatches]) -> None:
    design = uniform_design(flat_grid(3, 2), SpiralParams())
    flat, mesh = design.flat, design.flat.layout.mesh
    stray = QuadMesh(np.vstack([mesh.vertices, [[7.0, 8.0, 9.0]]]), mesh.quads)
    turn, shift = Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix(), np.array([0.1, 0.2, 0.3])
    centres = np.column_stack([flat.corners.mean(axis=1), np.zeros(len(mesh.quads))])
    pose = Pose(centres @ turn.T + shift, np.broadcast_to(turn, (len(centres), 3, 3)))
    moved = move_vertices(design, pose, stray)
    corners = np.concatenate([flat.corners, np.zeros((*flat.corners.shape[:2], 1))], axis=2)
    np.testing.assert_allclose(moved[mesh.quads], corners @ turn.T + shift, atol=1e-12)
    np.testing.assert_array_equal(moved[-1], [7.0, 8.0, 9.0])

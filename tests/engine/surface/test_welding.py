"""Welding of vertices that only noise separates."""

import numpy as np
import pytest
from flexmaps.engine.surface.mesh import PolygonMesh
from flexmaps.engine.surface.welding import weld


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e200, -1e308])
def test_coordinates_without_distances_are_left_to_the_checks(value):
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [9, 9, 9]])
    vertices[4, 0] = value
    mesh = PolygonMesh(vertices, np.arange(6), np.array([3, 3]))
    assert weld(mesh) is mesh


def test_doubled_vertices_become_one():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1e-6, 0], [1, 1, 0], [0, 1, 0]])
    mesh = weld(PolygonMesh(vertices, np.arange(6), np.array([3, 3])))
    assert len(np.unique(mesh.corners)) == 4

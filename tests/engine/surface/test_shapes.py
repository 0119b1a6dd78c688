"""The self-made surfaces are what they say."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.surface import curvature, shapes
from flexmaps.engine.surface.mesh import QuadMesh

# quads, Euler number, open
FACTS = {
    "demo": (432, 1, True),
    "cubesphere": (150, 2, False),
    "dome": (192, 1, True),
    "torus": (360, 0, False),
    "vault": (324, 1, True),
    "saddle": (196, 1, True),
    "strip": (108, 1, True),
    "three_holes": (1088, -4, False),
    "two_bodies": (246, 4, False),
    "quad": (1, 1, True),
}


@pytest.mark.parametrize("name", shapes.NAMES)
def test_topology_and_size(name):
    mesh = shapes.make(name, 0.015)
    quads, euler, is_open = FACTS[name]
    assert len(mesh.quads) == quads
    assert len(np.unique(mesh.quads)) == len(mesh.vertices)
    assert len(mesh.vertices) - len(mesh.edges) + quads == euler
    assert bool(mesh.border.any()) == is_open
    assert mesh.median_edge == pytest.approx(0.015)
    assert mesh.edge_lengths.min() > 0.2 * 0.015


@pytest.mark.parametrize("name", ["cubesphere", "torus", "three_holes", "two_bodies"])
def test_closed_shapes_look_outwards(name):
    mesh = shapes.make(name)
    assert np.einsum("fi,fi->", mesh.centroids, mesh.area_vectors) / 3 > 0


def test_closed_forms():
    sphere = shapes.cubesphere(12)
    np.testing.assert_allclose(np.linalg.norm(sphere.vertices, axis=1), 1, atol=1e-12)
    assert sphere.areas.sum() == pytest.approx(4 * np.pi, rel=0.01)
    torus = shapes.torus(80, 40, 0.4)
    assert torus.areas.sum() == pytest.approx(4 * np.pi**2 * 0.4, rel=0.01)
    volume = np.einsum("fi,fi->", torus.centroids, torus.area_vectors) / 3
    assert volume == pytest.approx(2 * np.pi**2 * 0.4**2, rel=0.02)


def test_demo_is_a_canopy_on_three_feet():
    mesh = shapes.make("demo")
    assert (mesh.normals[:, 2] > 0).all()
    feet = np.flatnonzero(mesh.valence == 2)
    assert len(feet) == 3
    np.testing.assert_allclose(mesh.vertices[feet, 2], mesh.vertices[:, 2].min(), atol=1e-12)
    assert 0.3 < np.ptp(mesh.vertices[:, 2]) < 0.5
    gauss = curvature.principal_curvatures(mesh).prod(axis=1)
    assert 0.2 < (gauss > 0).mean() < 0.8
    # the same after a third of a turn
    c, s = -0.5, np.sqrt(0.75)
    turned = mesh.vertices @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    gap = np.linalg.norm(turned[:, None] - mesh.vertices[None], axis=2).min(axis=1)
    assert gap.max() < 1e-12


def test_subdivision_of_a_cube():
    """Catmull and Clark's own first step: a cube's corners move to 5/9 of the way out."""
    cube = shapes.voxels(np.ones((1, 1, 1), dtype=bool))
    cube = QuadMesh(2 * cube.vertices - cube.vertices.max(axis=0) - cube.vertices.min(axis=0), cube.quads)
    finer = shapes.subdivide(cube)
    assert len(finer.quads) == 24
    extent = np.abs(finer.vertices)
    corners = extent[(extent > 0.3).all(axis=1)]
    assert len(corners) == 8
    np.testing.assert_allclose(corners, 5 / 9)
    np.testing.assert_allclose(np.sort(np.unique(extent.round(12))), [0, 5 / 9, 0.75, 1])


def test_unknown_shape():
    with pytest.raises(FlexMapsError, match=r"teapot.*demo"):
        shapes.make("teapot")


def test_connected_bodies_are_counted() -> None:
    assert (shapes.two_bodies().body_count, shapes.dome().body_count) == (2, 1)

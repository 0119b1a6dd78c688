"""Curvature against closed forms and against libigl."""

from __future__ import annotations

import igl
import numpy as np
import pytest
from flexmaps.engine.surface import curvature, shapes
from flexmaps.engine.surface.checking import check
from flexmaps.engine.surface.formats import meshio
from flexmaps.engine.surface.mesh import QuadMesh


def surface(columns, rows, position) -> QuadMesh:
    u, v, quads = shapes._grid(columns, rows)
    return QuadMesh(np.stack(position(u, v), axis=1), quads)


@pytest.mark.parametrize("n", [3, 5, 12])
@pytest.mark.parametrize("radius", [0.01, 1.0, 300.0])
def test_sphere(n, radius):
    mesh = shapes.cubesphere(n)
    mesh = mesh.with_vertices(radius * mesh.vertices)
    np.testing.assert_allclose(curvature.rms_curvature(mesh), 1 / radius, rtol=0.01)
    np.testing.assert_allclose(curvature.principal_curvatures(mesh), -1 / radius, rtol=0.03)


def test_signs():
    sphere = shapes.cubesphere(6)
    inside = QuadMesh(sphere.vertices, sphere.quads[:, ::-1].copy())
    np.testing.assert_allclose(curvature.principal_curvatures(inside), 1, rtol=0.03)


@pytest.mark.parametrize("columns", [12, 48])
def test_cylinder_with_its_borders(columns):
    mesh = surface(columns, 9, lambda u, v: (np.cos(u * np.pi / 2), np.sin(u * np.pi / 2), v))
    np.testing.assert_allclose(curvature.rms_curvature(mesh), np.sqrt(0.5), rtol=0.01)


@pytest.mark.parametrize("rows", [1, 2])
def test_narrow_strip_bends_one_way_only(rows):
    mesh = surface(30, rows, lambda u, v: (np.cos(u * np.pi / 2), np.sin(u * np.pi / 2), 0.05 * rows * v))
    np.testing.assert_allclose(curvature.rms_curvature(mesh), np.sqrt(0.5), rtol=0.01)


def test_torus():
    tube = 0.4
    mesh = shapes.torus(60, 24, tube)
    x, y, z = mesh.centroids.T
    angle = np.arctan2(z, np.hypot(x, y) - 1)
    along = np.cos(angle) / (1 + tube * np.cos(angle))
    expected = np.sort(-np.stack([np.full_like(along, 1 / tube), along], axis=1), axis=1)[:, ::-1]
    np.testing.assert_allclose(curvature.principal_curvatures(mesh), expected, atol=0.05 / tube)
    rms = np.sqrt((expected**2).mean(axis=1))
    np.testing.assert_allclose(curvature.rms_curvature(mesh), rms, rtol=0.01)


def test_saddle():
    mesh = shapes.saddle(20)
    x, y, _ = mesh.centroids.T
    d = np.full_like(x, 0.9)
    expected = curvature._graph_curvatures(0.9 * x, -0.9 * y, d, 0 * d, -d)
    got = curvature.principal_curvatures(mesh)
    inner = ~mesh.on_border[mesh.quads].any(axis=1)
    np.testing.assert_allclose(got[inner], expected[inner], atol=0.02 * 0.9)
    np.testing.assert_allclose(got, expected, atol=0.1 * 0.9)


def test_formula_of_a_graph():
    """A sphere as a graph away from its top, where slopes matter."""
    x, y = 0.3, -0.5
    z = np.sqrt(1 - x * x - y * y)
    b, c = -x / z, -y / z
    d, e, f = -(1 + b * b) / z, -b * c / z, -(1 + c * c) / z
    got = curvature._graph_curvatures(*(np.array([value]) for value in (b, c, d, e, f)))
    np.testing.assert_allclose(got, -1)


def test_flat_and_tiny_meshes():
    np.testing.assert_allclose(curvature.rms_curvature(surface(6, 6, lambda u, v: (u, v, 0 * u))), 0, atol=1e-9)
    np.testing.assert_allclose(curvature.rms_curvature(shapes.quad()), 0, atol=1e-9)


def test_noise_is_no_catastrophe():
    """Vertices off by 1 % of an edge change the curvature of a sphere by a small part of 1 / edge."""
    mesh = shapes.cubesphere(12)
    noise = np.random.default_rng(1).normal(size=mesh.vertices.shape) * 0.01 * mesh.median_edge
    got = curvature.rms_curvature(mesh.with_vertices(mesh.vertices + noise))
    assert np.abs(got - 1).max() * mesh.median_edge < 0.05


def test_turning_and_moving_changes_nothing():
    mesh = shapes.make("demo")
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    got = curvature.rms_curvature(mesh.with_vertices(mesh.vertices @ turn.T + 5.0))
    np.testing.assert_allclose(got, curvature.rms_curvature(mesh), rtol=1e-5)


def _by_igl(mesh: QuadMesh) -> np.ndarray:
    triangles = np.concatenate([mesh.quads[:, [0, 1, 2]], mesh.quads[:, [0, 2, 3]]]).astype(np.int64)
    _, _, one, two, _ = igl.principal_curvature(mesh.vertices, triangles, 2)
    return np.sqrt((one**2 + two**2) / 2)[mesh.quads].mean(axis=1)


@pytest.mark.parametrize("mesh", [shapes.torus(90, 36), shapes.make("three_holes")])
def test_against_libigl(mesh):
    got, other = curvature.rms_curvature(mesh), _by_igl(mesh)
    assert np.corrcoef(got, other)[0, 1] > 0.9
    assert np.median(got / other) == pytest.approx(1, abs=0.15)


def test_bunny_against_libigl(shared_meshes):
    mesh = check.as_quad_mesh(check.scale_to_metres(meshio.read_mesh(shared_meshes / "bunny.obj"), edge=0.02))
    got, other = curvature.rms_curvature(mesh), _by_igl(mesh)
    assert np.median(got / other) == pytest.approx(1, abs=0.1)
    assert np.isfinite(got).all()
    assert got.max() * mesh.median_edge < 2

"""The field of crosses: against Poincare and Hopf, against libigl's principal directions, along borders and folds."""

from __future__ import annotations

import igl
import numpy as np
import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.quadrangulation.field import CrossField, Triangles, cross_field


def grid(columns: int, rows: int, position) -> Triangles:
    """Points u, v from 0 to 1, triangles of alternating diagonals, equal points merged."""
    u, v, quads = shapes._grid(columns, rows)
    q = np.where((np.arange(len(quads)) % 2)[:, None] == 1, np.roll(quads, 1, axis=1), quads)
    u, v = 0.5 * (u + 1), 0.5 * (v + 1)
    points, where = np.unique(np.round(np.stack(position(u, v), axis=1), 9) + 0.0, axis=0, return_inverse=True)
    return Triangles(points, where.ravel()[np.concatenate([q[:, [0, 1, 2]], q[:, [0, 2, 3]]])])


def icosphere(levels: int = 3) -> Triangles:
    points, triangles = igl.icosahedron()
    points, triangles = igl.loop(points, triangles, levels)
    return Triangles(points / np.linalg.norm(points, axis=1)[:, None], triangles.astype(np.int64))


def ellipsoid() -> Triangles:
    sphere = icosphere(4)
    return Triangles(sphere.vertices * [1.0, 1.5, 2.5], sphere.corners)


def torus() -> Triangles:
    def place(u, v):
        around, along = 2 * np.pi * u, 2 * np.pi * v
        ring = 2 + 0.7 * np.cos(around)
        return ring * np.cos(along), ring * np.sin(along), 0.7 * np.sin(around)

    return grid(24, 60, place)


def barrel() -> Triangles:
    return grid(40, 20, lambda u, v: (np.cos(2 * np.pi * u), np.sin(2 * np.pi * u), 3 * v))


def cube() -> Triangles:
    mesh = shapes.cubesphere(4)
    points = np.tan(np.pi / 4 * mesh.vertices / np.abs(mesh.vertices).max(axis=1)[:, None])
    q = mesh.quads
    return Triangles(points, np.concatenate([q[:, [0, 1, 2]], q[:, [0, 2, 3]]]))


def off_axis(field: CrossField, axis: np.ndarray) -> np.ndarray:
    """Radians from each direction (triangles 3) to the nearest line of the field's cross."""
    x, y = field.mesh.frames[:, 0], field.mesh.frames[:, 1]
    angle = np.arctan2(np.einsum("fi,fi->f", axis, y), np.einsum("fi,fi->f", axis, x)) - field.angles
    return np.abs(angle - np.round(angle / (np.pi / 2)) * (np.pi / 2))


@pytest.mark.parametrize("make", [icosphere, ellipsoid, torus, barrel, cube])
def test_indices_sum_to_the_euler_characteristic(make):
    """Every sum of angles round a vertex is a whole number of quarters, and all together give V - E + F."""
    mesh = make()
    for field in (cross_field(mesh), CrossField(mesh, np.random.default_rng(0).uniform(0, 6, len(mesh.corners)))):
        assert field.indices.sum() == 4 * igl.euler_characteristic(mesh.corners)


def test_a_sphere_has_eight_corners():
    """The fewest and the mildest: eight points where three quads meet, as of a cube (Bommes et al. 2009)."""
    indices = cross_field(icosphere()).indices
    assert sorted(indices[indices != 0]) == [1] * 8


@pytest.mark.parametrize("make", [torus, barrel])
def test_nothing_irregular_where_nothing_has_to_be(make):
    assert not cross_field(make()).indices.any()


def test_lines_run_along_a_cylinder():
    field = cross_field(barrel())
    assert off_axis(field, np.tile([0.0, 0, 1], (len(field.angles), 1))).max() < 0.02


def test_lines_follow_sharp_folds():
    mesh = cube()
    field = cross_field(mesh, mesh.lines(1.0))
    assert off_axis(field, np.roll(np.round(field.mesh.frames[:, 2]), 1, axis=1)).max() < 1e-6
    assert (field.indices == 1).sum() == 8 and np.abs(field.indices).sum() == 8
    np.testing.assert_allclose(np.abs(field.mesh.vertices[field.indices == 1]), 1.0)


def test_lines_follow_principal_directions():
    """libigl's (a fit of quadrics) on an ellipsoid of three unlike axes, away from its four umbilics."""
    mesh = ellipsoid()
    first, _, most, least, _ = igl.principal_curvature(mesh.vertices, mesh.corners)
    wanted, anisotropy = first[mesh.corners[:, 0]], (most - least)[mesh.corners[:, 0]]
    bent = np.abs(anisotropy) > np.median(np.abs(anisotropy))
    aligned, smooth = (off_axis(cross_field(mesh, alignment=weight), wanted)[bent] for weight in (4.0, 0.0))
    assert np.degrees(np.average(aligned)) < 6
    assert np.average(aligned) < np.average(smooth)


def test_no_scale_and_no_place():
    """The same surface, turned, moved and a thousand times as large: the same crosses."""
    mesh = ellipsoid()
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    other = Triangles(1000 * mesh.vertices @ turn.T + 5, mesh.corners)
    turned = cross_field(mesh).directions @ turn.T
    assert np.percentile(off_axis(cross_field(other), turned), 99) < 1e-3


def test_bad_triangles_are_named():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]])
    with pytest.raises(FlexMapsError) as raised:
        cross_field(Triangles(points, np.array([[0, 1, 2], [0, 1, 3]])))
    assert raised.value.faces
    with pytest.raises(FlexMapsError, match="normals") as raised:
        cross_field(Triangles(points, np.array([[0, 1, 2], [0, 1, 2]])))
    assert raised.value.faces == [0, 1]

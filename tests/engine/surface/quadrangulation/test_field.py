"""The field of crosses: against Poincare and Hopf, against libigl's principal directions, along borders and folds."""

from __future__ import annotations

import sys

import igl
import numpy as np
import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.surface.quadrangulation.field import CrossField, Triangles, cross_field

t = sys.modules["flexmaps_triangles"]


def off_axis(field: CrossField, axis: np.ndarray) -> np.ndarray:
    """Radians from each direction (triangles 3) to the nearest line of the field's cross."""
    x, y = field.mesh.frames[:, 0], field.mesh.frames[:, 1]
    angle = np.arctan2(np.einsum("fi,fi->f", axis, y), np.einsum("fi,fi->f", axis, x)) - field.angles
    return np.abs(angle - np.round(angle / (np.pi / 2)) * (np.pi / 2))


@pytest.mark.parametrize("make", [t.icosphere, t.ellipsoid, t.torus, t.barrel, t.cube])
def test_indices_sum_to_the_euler_characteristic(make):
    """Every sum of angles round a vertex is a whole number of quarters, and all together give V - E + F."""
    mesh = make()
    for field in (cross_field(mesh), CrossField(mesh, np.random.default_rng(0).uniform(0, 6, len(mesh.corners)))):
        assert field.indices.sum() == 4 * igl.euler_characteristic(mesh.corners)


def test_a_sphere_has_eight_corners():
    """The fewest and the mildest: eight points where three quads meet, as of a cube (Bommes et al. 2009)."""
    indices = cross_field(t.icosphere()).indices
    assert sorted(indices[indices != 0]) == [1] * 8


@pytest.mark.parametrize("make", [t.torus, t.barrel])
def test_nothing_irregular_where_nothing_has_to_be(make):
    assert not cross_field(make()).indices.any()


def test_lines_run_along_a_cylinder():
    field = cross_field(t.barrel())
    assert off_axis(field, np.tile([0.0, 0, 1], (len(field.angles), 1))).max() < 0.02


def test_lines_follow_sharp_folds():
    mesh = t.cube()
    field = cross_field(mesh, mesh.feature_sides(1.0))
    assert off_axis(field, np.roll(np.round(field.mesh.frames[:, 2]), 1, axis=1)).max() < 1e-6
    assert (field.indices == 1).sum() == 8 and np.abs(field.indices).sum() == 8
    np.testing.assert_allclose(np.abs(field.mesh.vertices[field.indices == 1]), 1.0)


def test_lines_follow_principal_directions():
    """libigl's (a fit of quadrics) on an ellipsoid of three unlike axes, away from its four umbilics."""
    mesh = t.ellipsoid()
    first, _, most, least, _ = igl.principal_curvature(mesh.vertices, mesh.corners)
    wanted, anisotropy = first[mesh.corners[:, 0]], (most - least)[mesh.corners[:, 0]]
    bent = np.abs(anisotropy) > np.median(np.abs(anisotropy))
    aligned, smooth = (off_axis(cross_field(mesh, alignment=weight), wanted)[bent] for weight in (4.0, 0.0))
    assert np.degrees(np.average(aligned)) < 6
    assert np.average(aligned) < np.average(smooth)


def test_no_scale_and_no_place():
    """The same surface, turned, moved and a thousand times as large: the same crosses."""
    mesh = t.ellipsoid()
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    other = Triangles(1000 * mesh.vertices @ turn.T + 5, mesh.corners)
    field, frames = cross_field(mesh), mesh.frames
    angle = field.angles[:, None]
    turned = (np.cos(angle) * frames[:, 0] + np.sin(angle) * frames[:, 1]) @ turn.T
    assert np.percentile(off_axis(cross_field(other), turned), 99) < 1e-3


def test_bad_triangles_are_named():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]])
    with pytest.raises(FlexMapsError) as raised:
        cross_field(Triangles(points, np.array([[0, 1, 2], [0, 1, 3]])))
    assert raised.value.faces
    with pytest.raises(FlexMapsError, match="normals") as raised:
        cross_field(Triangles(points, np.array([[0, 1, 2], [0, 1, 2]])))
    assert raised.value.faces == [0, 1]

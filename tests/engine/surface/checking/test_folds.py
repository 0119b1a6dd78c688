"""Edges that are sharper than spirals bend: counted, cut along, and rounded."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.extras.choosing import drawn_cuts
from flexmaps.engine.patches.layout import PatchLayout
from flexmaps.engine.surface.checking import check, folds
from flexmaps.engine.surface.checking.topology import sides_of
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh


def roof(degrees: float, columns: int = 8, rows: int = 5) -> PolygonMesh:
    """Two flat halves of 20 mm quads that meet at a ridge, at which the surface turns by so many degrees."""
    slope = np.radians(0.5 * degrees)
    u, v = np.meshgrid(np.arange(columns + 1) - columns / 2, np.arange(rows + 1), indexing="ij")
    points = 0.02 * np.stack([np.cos(slope) * u, 1.0 * v, -np.sin(slope) * np.abs(u)], axis=2).reshape(-1, 3)
    a = (np.arange(columns)[:, None] * (rows + 1) + np.arange(rows)).ravel()
    return PolygonMesh.from_quads(QuadMesh(points, np.stack([a, a + rows + 1, a + rows + 2, a + 1], axis=1)))


@pytest.mark.parametrize(("degrees", "count"), [(30.0, 0), (44.0, 0), (46.0, 5), (120.0, 5)])
def test_edges_that_turn_by_more_than_45_degrees_are_found(degrees: float, count: int) -> None:
    found = [one for one in check.findings(roof(degrees)) if one.code == "sharp-folds"]
    assert sum(len(one.edges) for one in found) == count
    for one in found:
        assert not one.is_error and f"{degrees:.0f}:" in one.message and len(one.faces) == 2 * count
        ridge = roof(degrees).vertices[sides_of(roof(degrees)).edges[list(one.edges)]]
        assert np.allclose(ridge[..., 0], 0.0)


def test_folds_of_about_45_degrees_are_told_in_a_sentence_that_makes_sense() -> None:
    (found,) = (one for one in check.findings(roof(45.2)) if one.code == "sharp-folds")
    assert found.message.startswith("5 edges turn by a little more than 45 degrees: ")


def test_layouts_are_proposed_that_are_cut_along_folds() -> None:
    polygons = roof(90.0)
    mesh = check.as_quad_mesh(polygons)
    ((_, cut),) = drawn_cuts.cuts_along_folds(mesh)
    assert [len(quads) for quads in PatchLayout(mesh, cut).patches] == [20, 20]
    assert not list(drawn_cuts.cuts_along_folds(check.as_quad_mesh(roof(30.0))))


@pytest.mark.parametrize("degrees", [60.0, 90.0, 120.0])
def test_a_rounded_fold_is_an_arc_that_spirals_can_follow(degrees: float) -> None:
    """No edge is left that turns too sharply, all turns together are what they were, and the ends of the ridge stay in the border's plane."""
    polygons = roof(degrees)
    moved = folds.smooth_folds(polygons)
    after = PolygonMesh(moved, polygons.corners, polygons.sizes)
    turned = np.degrees(folds.fold_angles(after, sides_of(after)))
    assert turned.max() <= 45.0
    row = moved.reshape(9, 6, 3)[:, 2]  # across the ridge, in the middle
    way = np.diff(row, axis=0)
    slopes = np.degrees(np.arctan2(way[:, 2], way[:, 0]))
    assert slopes[0] - slopes[-1] == pytest.approx(degrees, abs=1e-6)
    assert (np.diff(slopes) <= 1e-9).all()
    ends = moved.reshape(9, 6, 3)[:, [0, -1], 1]
    assert np.allclose(ends, [0.0, 0.1])
    far = np.abs(polygons.vertices[:, 0]) > 0.99 * np.abs(polygons.vertices[:, 0]).max()
    assert np.allclose(moved[far], polygons.vertices[far])


def test_the_radius_is_that_of_an_arc_whose_edges_turn_as_sharply_as_may_be() -> None:
    angle = np.arange(4) * np.radians(45.0)
    circle = folds.min_bend_radius(0.02) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    assert np.linalg.norm(np.diff(circle, axis=0), axis=1) == pytest.approx(0.02)

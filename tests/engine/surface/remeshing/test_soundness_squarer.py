"""Quads of a remesh that are poor, or have no size, beside good ones."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking import check
from flexmaps.engine.surface.mesh import PolygonMesh
from flexmaps.engine.surface.remeshing.mend import POOR, square_fit_move
from flexmaps.engine.surface.remeshing.soundness import regularise_if_better


@pytest.fixture(name="whole")
def _whole() -> PolygonMesh:
    return PolygonMesh.from_quads(shapes.make("cubesphere"))


def test_quads_without_size_do_not_throw_their_corners_away(whole: PolygonMesh) -> None:
    rows = whole.corners.reshape(-1, 4)
    points = whole.vertices.copy()
    points[rows[10]] = points[rows[10]].mean(axis=0) + 1e-18 * np.arange(12.0).reshape(4, 3)
    wanted = square_fit_move(PolygonMesh(points, whole.corners, whole.sizes), np.zeros((0, 2), int))(points)
    assert np.abs(wanted).max() < 2.0 * np.abs(points).max()


def test_poor_quads_are_made_squarer_where_that_helps(whole: PolygonMesh) -> None:
    assert regularise_if_better(whole) is whole  # none is poor
    points, rows = whole.vertices.copy(), whole.corners.reshape(-1, 4)
    middle = points[rows[14]].mean(axis=0)
    points[rows[14, 0]] = middle + 0.3 * (points[rows[14, 2]] - middle)  # bent in
    bad = PolygonMesh(points, whole.corners, whole.sizes)
    poor = [
        sum(len(f.faces) for f in check.findings(mesh) if f.code in POOR) for mesh in (bad, regularise_if_better(bad))
    ]
    assert poor[1] < poor[0]

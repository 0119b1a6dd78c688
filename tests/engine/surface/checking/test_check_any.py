"""Meshes in any unit and of any faces: they are scaled as asked, and judged whatever they are."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking import check
from flexmaps.engine.surface.mesh import PolygonMesh
from hypothesis import given, settings
from hypothesis import strategies as st


def polygons(vertices, faces) -> PolygonMesh:
    return PolygonMesh(np.asarray(vertices, float), np.concatenate(faces), np.array([len(f) for f in faces]))


def errors(mesh: PolygonMesh) -> set[str]:
    return {f.code for f in check.findings(mesh) if f.is_error}


def test_scaled():
    mesh = PolygonMesh.from_quads(shapes.make("vault", 1.0))
    assert check.scale_to_metres(mesh) is mesh
    assert check.median_edge(check.scale_to_metres(mesh, edge=0.015)) == pytest.approx(0.015)
    assert np.ptp(check.scale_to_metres(mesh, height=0.3).vertices[:, 2]) == pytest.approx(0.3)
    loose = polygons([*mesh.vertices, [0, 0, 1e6]], mesh.corners.reshape(-1, 4).tolist())
    assert np.ptp(check.scale_to_metres(loose, height=0.3).vertices[:-1, 2]) == pytest.approx(0.3)
    for wrong in ({"edge": 0.0}, {"edge": -1.0}, {"height": float("nan")}, {"edge": 1.0, "height": 1.0}):
        with pytest.raises(FlexMapsError):
            check.scale_to_metres(mesh, **wrong)
    with pytest.raises(FlexMapsError, match="flat along z"):
        check.scale_to_metres(PolygonMesh.from_quads(shapes.make("quad")), height=0.3)
    broken = polygons([[0, 0, 0], [1, 0, 0], [1, 1, 0], [np.nan, 1, 0]], [[0, 1, 2, 3]])
    assert errors(check.scale_to_metres(broken, edge=0.02)) == {"not-finite"}
    empty = PolygonMesh(np.zeros((0, 3)), np.zeros(0, int), np.zeros(0, int))
    assert errors(check.scale_to_metres(empty, height=0.02)) == {"no-faces"}


@settings(max_examples=100, deadline=None)
@given(data=st.data())
def test_any_polygons_are_judged(data):
    """Whatever the faces, the check answers; and what passes is a manifold, oriented quad mesh."""
    n = data.draw(st.integers(3, 9))
    vertices = data.draw(st.lists(st.tuples(*[st.integers(-2, 2)] * 3), min_size=n, max_size=n))
    index = st.integers(0, n - 1)
    faces = data.draw(st.lists(st.lists(index, min_size=1, max_size=5), min_size=1, max_size=8))
    mesh = polygons(vertices, faces)
    if errors(mesh):
        with pytest.raises(FlexMapsError):
            check.as_quad_mesh(mesh)
        return
    quads = check.as_quad_mesh(mesh)
    assert (np.bincount(quads.quad_edges.ravel()) <= 2).all()
    sides = np.stack([quads.quads, np.roll(quads.quads, -1, axis=1)], axis=-1).reshape(-1, 2)
    assert len(np.unique(sides, axis=0)) == len(sides)  # every side runs along its edge once in each way
    assert (quads.edge_lengths > 0).all()
    assert (quads.areas > 0).all()


def test_errors_come_before_warnings() -> None:
    # a bent quad of five corners beside three faces at one edge, and a second body through them
    flat = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 0, -1], [1, 0, -1]]
    through = [[0.2, 0.5, -1], [0.8, 0.5, -1], [0.8, 0.5, 1], [0.2, 0.5, 1]]
    mesh = polygons([*flat, *through], [[0, 1, 2, 3], [1, 0, 4, 5], [0, 1, 7, 6], [8, 9, 10, 11]])
    found = [one.is_error for one in check.all_findings(mesh)]
    assert len(set(found)) == 2 and found == sorted(found, reverse=True)

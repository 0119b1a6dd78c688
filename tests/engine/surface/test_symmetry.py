"""Symmetries of meshes, against the group orders of known shapes."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.params import LayoutParams
from flexmaps.engine.patches.merging.board import MergeBoard
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.surface import shapes, symmetry
from flexmaps.engine.surface.symmetry import preserved_by, subgroups, symmetries


@pytest.mark.parametrize(
    ("name", "order"), [("cubesphere", 48), ("vault", 8), ("saddle", 4), ("torus", 120), ("quad", 8)]
)
def test_orders_of_known_groups(name: str, order: int) -> None:
    assert 1 + len(symmetries(shapes.make(name))) == order


def test_they_are_permutations_that_belong_together() -> None:
    mesh = shapes.make("vault")
    for s in symmetries(mesh):
        for permutation in (s.vertices, s.quads, s.edges):
            assert sorted(permutation.tolist()) == list(range(len(permutation)))
        assert (np.sort(s.vertices[mesh.edges], axis=1) == mesh.edges[s.edges]).all()
        assert (np.sort(s.vertices[mesh.quads], axis=1) == np.sort(mesh.quads[s.quads], axis=1)).all()
        centred = mesh.vertices - mesh.vertices.mean(axis=0)
        assert np.abs(centred @ s.matrix.T - centred[s.vertices]).max() < 1e-9


def test_turned_in_space_they_are_the_same() -> None:
    mesh = shapes.make("vault")
    q, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
    turned = mesh.with_vertices(mesh.vertices @ q.T + [1.0, 2.0, 3.0])
    assert len(symmetries(turned)) == len(symmetries(mesh))


def test_a_mesh_is_searched_once(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = shapes.make("dome")
    found = symmetries(mesh)
    monkeypatch.setattr(symmetry, "_search_symmetries", lambda *_: [])
    assert symmetries(mesh) == found != []
    assert symmetries(mesh, tolerance=0.01) == symmetries(shapes.make("dome")) == []


def test_a_dent_breaks_them() -> None:
    mesh = shapes.make("vault")
    vertices = mesh.vertices.copy()
    vertices[41] += [0, 0, 0.4 * mesh.median_edge]
    assert symmetries(mesh.with_vertices(vertices)) == []


def test_names() -> None:
    names = {s.name for s in symmetries(shapes.make("vault"))}
    assert {"mirror across x", "mirror across y", "turn by 90 degrees about z", "turn by 180 degrees about z"} <= names


def test_subgroups_are_closed() -> None:
    found = symmetries(shapes.make("vault"))
    groups = subgroups(found)
    assert len(groups[0]) == 7
    identity = np.arange(len(found[0].vertices)).tobytes()
    for group in groups:
        members = {s.vertices.tobytes() for s in group} | {identity}
        for a in group:
            for b in group:
                assert a.vertices[b.vertices].tobytes() in members


def test_keeping_asks_the_cuts() -> None:
    mesh = shapes.make("vault")
    found = symmetries(mesh)
    cut = np.zeros(len(mesh.edges), dtype=bool)
    assert len(preserved_by(found, cut)) == 7
    line = np.abs(mesh.vertices[mesh.edges][:, :, 0]).max(axis=1) < 1e-9
    cut[line & ~mesh.border] = True
    assert len(preserved_by(found, cut)) == 3


def test_one_of_several_mirrored_runs_leads_the_others() -> None:
    """Of every orbit of edges under the kept symmetries exactly one is tried; without symmetries all are."""
    mesh = shapes.make("cubesphere")
    board = MergeBoard(trace.trace_layout(mesh, LayoutParams()), LayoutParams())
    edges = np.arange(len(mesh.edges))
    assert all(board.is_first_image([e]) for e in edges.tolist())
    board.symmetries = symmetries(mesh)
    orbits = {frozenset([e, *(int(s.edges[e]) for s in board.symmetries)]) for e in edges.tolist()}
    assert sorted(e for e in edges.tolist() if board.is_first_image([e])) == sorted(min(orbit) for orbit in orbits)

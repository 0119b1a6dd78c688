"""The cuts of a layout: patches, flat vertices, seams and measures, against counts made another way."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from flexmaps.engine.patches.layout import PatchLayout, component_numbers, order_run
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import QuadMesh
from hypothesis import given, settings
from hypothesis import strategies as st

DOME = shapes.make("dome")
INNER = np.flatnonzero(~DOME.border)


def grid(columns: int, rows: int) -> QuadMesh:
    x, y = np.meshgrid(np.arange(columns + 1), np.arange(rows + 1), indexing="ij")
    index = np.arange(x.size).reshape(x.shape)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1, 4)
    return QuadMesh(np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1) * 0.02, quads)


def cut_of(mesh: QuadMesh, edges: np.ndarray) -> PatchLayout:
    cut = np.zeros(len(mesh.edges), dtype=bool)
    cut[edges] = True
    return PatchLayout(mesh, cut)


@settings(max_examples=60, deadline=None)
@given(st.sets(st.sampled_from(INNER.tolist()), max_size=len(INNER)))
def test_random_cuts_keep_patches_and_flat_vertices_consistent(edges: set[int]) -> None:
    import trimesh

    layout = cut_of(DOME, np.array(sorted(edges), dtype=np.int64))
    a, b = DOME.edge_quads[layout.uncut_edges].T
    assert (layout.patch_of[a] == layout.patch_of[b]).all()
    assert sorted(np.concatenate(layout.patches).tolist()) == list(range(len(DOME.quads)))
    corners = layout.flat_corners
    # a flat vertex lies on one vertex of the mesh and in one patch; sides match across joined edges only
    for label in (DOME.quads, np.repeat(layout.patch_of, 4).reshape(-1, 4)):
        pairs = np.unique(np.stack([corners.ravel(), label.ravel()], axis=1), axis=0)
        assert len(pairs) == corners.max() + 1
    sides = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2), axis=2)
    qa, qb = DOME.edge_quads[INNER].T
    ka, kb = DOME.edge_sides[INNER].T
    same = (sides[qa, ka] == sides[qb, kb]).all(axis=1)
    assert same[~layout.cut[INNER]].all()
    # the Euler number of every patch, from a mesh of its flat vertices
    for patch, quads in enumerate(layout.patches[:6]):
        c = np.unique(corners[quads], return_inverse=True)[1].reshape(-1, 4)
        faces = np.concatenate([c[:, [0, 1, 2]], c[:, [0, 2, 3]]])
        body = trimesh.Trimesh(np.random.default_rng(0).random((c.max() + 1, 3)), faces, process=False)
        # trimesh takes the two sides of a slit of one edge for one edge: they have the same ends
        outline = np.sort(np.stack([c, np.roll(c, -1, axis=1)], axis=2)[layout.outline_sides[quads]], axis=1)
        slits = len(outline) - len(np.unique(outline, axis=0))
        assert body.euler_number - slits == layout.euler_characteristic[patch]


@settings(max_examples=60, deadline=None)
@given(st.sets(st.sampled_from(INNER.tolist()), max_size=60))
def test_seams_are_runs_that_share_their_edges_out(edges: set[int]) -> None:
    layout = cut_of(DOME, np.array(sorted(edges), dtype=np.int64))
    found = np.concatenate(layout.seams) if layout.seams else np.zeros(0, dtype=np.int64)
    assert sorted(found.tolist()) == sorted(edges)
    for seam in layout.seams:
        for one, two in itertools.pairwise(seam.tolist()):
            shared = set(DOME.edges[one].tolist()) & set(DOME.edges[two].tolist())
            assert shared
            assert all(layout.cut_degree[v] == 2 for v in shared)
        assert len(np.unique(np.sort(layout.patch_of[DOME.edge_quads[seam]], axis=1), axis=0)) == 1


@given(st.integers(1, 60), st.lists(st.tuples(st.integers(0, 59), st.integers(0, 59)), max_size=80), st.booleans())
@settings(max_examples=80, deadline=None)
def test_groups_are_connected_components(count: int, links: list[tuple[int, int]], many: bool) -> None:
    pairs = np.array([(a % count, b % count) for a, b in links], dtype=np.int64).reshape(-1, 2)
    size = count + (5000 if many else 0)
    labels = component_numbers(size, pairs[:, 0], pairs[:, 1])
    parent = list(range(size))

    def root(i: int) -> int:
        while parent[i] != i:
            i = parent[i]
        return i

    for a, b in pairs.tolist():
        parent[root(a)] = root(b)
    expected: dict[int, int] = {}
    assert [expected.setdefault(root(i), len(expected)) for i in range(size)] == labels.tolist()


def row_between(mesh: QuadMesh, columns: int, rows: int, first: int, last: int) -> np.ndarray:
    """Edges along the rows ``first`` and ``last`` of a grid."""
    at = np.arange((columns + 1) * (rows + 1)).reshape(columns + 1, rows + 1)
    pairs = [{int(at[i, j]), int(at[i + 1, j])} for i in range(columns) for j in (first, last)]
    return np.array([e for e, ends in enumerate(mesh.edges.tolist()) if set(ends) in pairs])


def test_measures_of_a_rectangle() -> None:
    mesh = grid(8, 9)
    layout = cut_of(mesh, row_between(mesh, 8, 9, 3, 6))
    assert layout.euler_characteristic.tolist() == [1, 1, 1]
    assert layout.compactness == pytest.approx(np.full(3, 22 / np.sqrt(24)))
    assert layout.isthmus_widths().tolist() == [3, 3, 3]


def test_a_ribbon_is_as_compact_as_a_square_and_a_strip_cut_out_of_a_surface_is_not() -> None:
    assert cut_of(grid(40, 2), np.zeros(0, dtype=np.int64)).compactness == pytest.approx(4.0)
    mesh = grid(40, 10)
    strip = cut_of(mesh, row_between(mesh, 40, 10, 4, 6)).compactness[1]
    assert strip == pytest.approx((80 + 4) / np.sqrt(80))


def test_an_inner_cut_counts_twice_and_narrows_the_neck() -> None:
    mesh = grid(8, 6)
    middle = 4 * 7  # the column of vertices in the middle
    edges = [e for e, (a, b) in enumerate(mesh.edges.tolist()) if middle <= a and b <= middle + 4]
    layout = cut_of(mesh, np.array(edges))
    assert len(layout.patches) == 1
    assert layout.euler_characteristic[0] == 1
    assert layout.compactness[0] == pytest.approx(4 + 8 / np.sqrt(48))  # the border is longer than that of a square
    assert layout.isthmus_widths()[0] == 2  # from the end of the cut to the border
    floating = cut_of(mesh, np.array(edges[1:]))
    assert floating.euler_characteristic[0] == 0


def test_closed_surfaces_are_no_disks() -> None:
    assert cut_of(shapes.make("torus"), np.zeros(0, dtype=np.int64)).euler_characteristic.tolist() == [0]
    assert cut_of(shapes.make("cubesphere"), np.zeros(0, dtype=np.int64)).euler_characteristic.tolist() == [2]


def test_a_closed_run_is_walked_once_round() -> None:
    mesh = grid(5, 5)
    ring = mesh.quad_edges[[6, 7, 8, 13, 18, 17, 16, 11]].ravel()
    outer = np.flatnonzero(np.bincount(ring, minlength=len(mesh.edges)) == 1)
    outer = outer[~np.isin(outer, mesh.quad_edges[12])]
    walk = order_run(mesh, outer)
    assert sorted(walk.tolist()) == sorted(outer.tolist())
    for one, two in zip(walk, np.roll(walk, -1), strict=True):
        assert set(mesh.edges[one].tolist()) & set(mesh.edges[two].tolist())


def test_a_closed_body_is_no_patch_that_lies_flat() -> None:
    from flexmaps.engine.patches.tracing import trace

    mesh = shapes.two_bodies()
    layout = PatchLayout(mesh, np.zeros(len(mesh.edges), bool))
    assert not layout.is_flattenable.any()
    assert trace.make_disks(layout).is_flattenable.all()

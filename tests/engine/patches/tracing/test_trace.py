"""The first layout: lines from irregular vertices, every patch a disk."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.components import components
from flexmaps.engine.params import LayoutParams
from flexmaps.engine.patches.flattening import flatten
from flexmaps.engine.patches.layout import PatchLayout
from flexmaps.engine.patches.tracing.regions import RegionHalver
from flexmaps.engine.patches.tracing.trace import make_disks, middle_line, motorcycles, parametric_lines, trace_layout
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import QuadMesh


def tube(around: int = 12, long: int = 8) -> QuadMesh:
    angle = 2 * np.pi * np.arange(around) / around
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1) * 0.02 * around / (2 * np.pi)
    vertices = np.concatenate([np.column_stack([ring, np.full(around, 0.02 * k)]) for k in range(long + 1)])
    i, k = np.meshgrid(np.arange(around), np.arange(long), indexing="ij")
    j = (i + 1) % around
    quads = np.stack([k * around + i, k * around + j, (k + 1) * around + j, (k + 1) * around + i], axis=-1)
    return QuadMesh(vertices, quads.reshape(-1, 4))


@pytest.mark.parametrize("name", shapes.NAMES)
def test_every_patch_is_a_disk_under_the_limit(name: str) -> None:
    params = LayoutParams()
    layout = trace_layout(shapes.make(name), params)
    assert (layout.euler_characteristic == 1).all()
    flat = flatten.flatten(layout, params)
    assert flat.energy.max() <= params.distortion_limit
    assert not flatten.overlapping_patches(flat)
    assert not (layout.cut & layout.mesh.border).any()


def test_a_cube_falls_into_its_faces() -> None:
    layout = trace_layout(shapes.make("cubesphere"), LayoutParams())
    assert [len(quads) for quads in layout.patches] == [25] * 6


def test_irregular_vertices_end_up_on_outlines() -> None:
    mesh = shapes.make("three_holes")
    layout = PatchLayout(mesh, motorcycles(mesh))
    assert (layout.cut_degree[mesh.irregular & ~mesh.on_border] == mesh.valence[mesh.irregular & ~mesh.on_border]).all()


def test_a_tube_is_cut_along_its_shortest_line() -> None:
    mesh = tube()
    layout = make_disks(PatchLayout(mesh, motorcycles(mesh)))
    assert layout.cut.sum() == 8
    assert layout.euler_characteristic.tolist() == [1]
    heights = mesh.vertices[mesh.edges[layout.cut]][:, :, 2]
    assert np.abs(np.diff(heights, axis=1)).min() > 0.019


def test_a_torus_is_cut_twice() -> None:
    mesh = shapes.make("torus")
    layout = make_disks(PatchLayout(mesh, motorcycles(mesh)))
    assert layout.euler_characteristic.tolist() == [1]
    assert len(layout.seams) <= 4


def test_the_middle_line_halves() -> None:
    mesh = tube(12, 6)
    layout = make_disks(PatchLayout(mesh, np.zeros(len(mesh.edges), dtype=bool)))
    cut = layout.cut.copy()
    cut[middle_line(layout, 0)] = True
    assert [len(q) for q in PatchLayout(mesh, cut).patches] == [36, 36]


@pytest.mark.parametrize("name", ["dome", "saddle", "strip", "vault"])
def test_halves_are_connected_and_take_all_quads(name: str) -> None:
    mesh = shapes.make(name)
    parts = RegionHalver(mesh, LayoutParams()).halves(np.arange(len(mesh.quads)))
    assert len(parts) == 2 and min(len(part) for part in parts) > 0.2 * len(mesh.quads)
    assert np.array_equal(np.sort(np.concatenate(parts)), np.arange(len(mesh.quads)))
    for part in parts:
        within = np.isin(mesh.dual, part).all(axis=1)
        assert len(np.unique(components(len(mesh.quads), *mesh.dual[within].T)[part])) == 1


def test_parametric_lines_share_the_inner_edges_out() -> None:
    mesh = shapes.make("dome")
    layout = PatchLayout(mesh, np.zeros(len(mesh.edges), dtype=bool))
    lines = parametric_lines(layout, 0)
    assert sorted(np.concatenate(lines).tolist()) == np.flatnonzero(~mesh.border).tolist()

"""Layouts that merge under tighter limits where few panels are expected to stay far from the target."""

from __future__ import annotations

from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest
from flexmaps.engine.extras.choosing.drawn_cuts import cuts_along_folds
from flexmaps.engine.extras.choosing.judge import CutPlan, FlatLayout, LayoutProblem, flatten_cuts, judge
from flexmaps.engine.extras.choosing.predict import PredictionStart, predict
from flexmaps.engine.extras.choosing.refine_merged import (
    DISTORTION_SHARES,
    MAX_PANEL_GROWTH,
    PREDICTING_TEXT,
    STRIP_FACTOR,
    _join_small,
    refine_merged,
)
from flexmaps.engine.params import Settings
from flexmaps.engine.patches.flattening.flatten import FlatPatches, flatten
from flexmaps.engine.patches.layout import PatchLayout
from flexmaps.engine.patches.merging.dissolve import join_small_panels
from flexmaps.engine.patches.merging.merge import merge
from flexmaps.engine.patches.tracing.trace import trace_layout
from flexmaps.engine.progress import Progress
from flexmaps.engine.runs import job
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh

SETTINGS = Settings()
ALONG = 15  # quads along the tube with a waist
NEAR = replace(SETTINGS.choose, match=1e-3)  # what no layout holds


@pytest.fixture(name="sphere", scope="module")
def _sphere() -> tuple[LayoutProblem, PatchLayout, FlatPatches]:
    mesh = shapes.make("cubesphere")
    layout = trace_layout(mesh, SETTINGS.layout)
    held = LayoutProblem(mesh, SETTINGS)
    return held, layout, merge(layout, SETTINGS.layout)


def reached(piece: LayoutProblem, flat: FlatPatches) -> float:
    """What a short search leaves of the distance, as a share of the size."""
    found = judge(piece, FlatLayout(flat, "", 1))
    assert found is not None
    return found.rms


def test_few_panels_stay_where_they_hold_the_match(sphere: tuple[LayoutProblem, PatchLayout, FlatPatches]) -> None:
    piece, layout, flat = sphere
    assert refine_merged(piece, layout, flat, replace(SETTINGS.choose, match=100.0)) is flat
    expected = flat.layout.notes["expected_percent"]
    assert isinstance(expected, float) and 0.0 < expected < 100.0
    assert refine_merged(piece, layout, flat, replace(NEAR, goal="panels")) is flat
    assert refine_merged(replace(piece, settings=_rods()), layout, flat, NEAR) is flat


def test_another_layout_comes_nearer_where_few_panels_are_far(
    sphere: tuple[LayoutProblem, PatchLayout, FlatPatches],
) -> None:
    piece, layout, flat = sphere
    other = refine_merged(piece, layout, flat, NEAR)
    assert len(other.layout.patches) <= MAX_PANEL_GROWTH * len(flat.layout.patches)
    assert predict(piece, other) < predict(piece, flat)


def test_a_cut_along_the_folds_replaces_more_panels_that_hold_the_match() -> None:
    """Of a gable roof, which two panels match, four panels."""
    x, y = (k.ravel() for k in np.meshgrid(np.arange(9), np.arange(-3, 4), indexing="ij"))
    corner = np.arange(63).reshape(9, 7)
    quads = np.stack([corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]], axis=-1).reshape(-1, 4)
    mesh = shapes.weld_quads(0.02 * np.c_[x, y, -0.7 * np.abs(y)], quads)
    ends = mesh.vertices[mesh.edges]
    across = (np.abs(ends[:, :, 0] - 0.08) < 1e-9).all(axis=1)
    piece, layout = LayoutProblem(mesh, SETTINGS), trace_layout(mesh, SETTINGS.layout)
    ((_, ridge),) = cuts_along_folds(mesh)
    quartered = flatten_cuts(piece, CutPlan(ridge | across, "quarters"))
    assert quartered is not None and len(quartered.flat.layout.patches) == 4
    found = refine_merged(piece, layout, quartered.flat, replace(SETTINGS.choose, match=100.0))
    np.testing.assert_array_equal(found.layout.cut, ridge)


@pytest.fixture(name="tube", scope="module")
def _tube() -> tuple[LayoutProblem, PatchLayout, FlatPatches, FlatPatches]:
    """A tube with a waist, its traced and its merged layout, and the one that replaces it."""
    piece = LayoutProblem(_waist(), SETTINGS)
    layout, flat = _merged(piece.mesh)
    return piece, layout, flat, refine_merged(piece, layout, flat, SETTINGS.choose)


def test_a_tube_is_divided_into_equal_parts_where_tighter_limits_change_nothing(
    tube: tuple[LayoutProblem, PatchLayout, FlatPatches, FlatPatches],
) -> None:
    piece, layout, flat, found = tube
    few = len(flat.layout.patches)
    for share in DISTORTION_SHARES:
        limits = replace(SETTINGS.layout, distortion_limit=share * SETTINGS.layout.distortion_limit)
        np.testing.assert_array_equal(merge(layout, limits).layout.cut, flat.layout.cut)
    assert few < len(found.layout.patches) <= MAX_PANEL_GROWTH * few
    sizes = [len(quads) for quads in found.layout.patches]
    assert max(sizes) - min(sizes) <= ALONG  # equal but for one row of quads
    assert predict(piece, found) < 0.01 < predict(piece, flat)
    assert found.layout.notes["symmetries_kept"] > 1
    assert "forced" not in found.layout.notes


def test_strips_may_be_a_little_longer_than_other_panels(zoo: ModuleType) -> None:
    """Of a soap film in a square frame, whose four corners are in turn high and low."""
    mesh = job.run(zoo.SURFACES["soap-frame4"].polygons(), SETTINGS, edge=0.02, stop_after="check").mesh
    layout, flat = _merged(mesh)
    piece, limit = LayoutProblem(mesh, SETTINGS), SETTINGS.layout.compactness_limit
    found = refine_merged(piece, layout, flat, SETTINGS.choose)
    assert limit < found.layout.compactness.max() < STRIP_FACTOR * limit
    assert "forced" not in found.layout.notes
    assert predict(piece, found) < 0.01 < predict(piece, flat)


def test_a_panel_of_one_quad_joins_a_more_distorted_one_where_the_match_bears_it() -> None:
    """A dome in one panel is distorted 1.5 times as much as allowed; one of its quads is cut off."""
    mesh = shapes.dome(4)
    mesh = mesh.with_vertices(mesh.vertices * (0.02 / mesh.median_edge))
    whole = flatten(PatchLayout(mesh, np.zeros(len(mesh.edges), dtype=bool)), SETTINGS.layout)
    first = np.flatnonzero(mesh.border[mesh.quad_edges].any(axis=1))[0]
    cut = np.zeros(len(mesh.edges), dtype=bool)
    cut[mesh.quad_edges[first]] = True
    flat = flatten(PatchLayout(mesh, cut & ~mesh.border), SETTINGS.layout)
    assert sorted(map(len, flat.layout.patches)) == [1, len(mesh.quads) - 1]
    limits = replace(SETTINGS.layout, distortion_limit=float(whole.energy.max()) / 1.5)
    piece = LayoutProblem(mesh, replace(SETTINGS, layout=limits))
    assert join_small_panels(flat.layout, limits) is flat.layout  # the limit forbids it
    start, parts = PredictionStart.from_layout(piece, flat), Progress().shares(0.2)
    found, expected = _join_small(piece, flat, start, 1.0, 1.0, parts)
    assert len(found.layout.patches) == 1 and expected < 1.0
    kept, same = _join_small(piece, flat, start, 0.5 * expected, 0.5 * expected, parts)
    assert kept is flat and same == 0.5 * expected


def test_every_body_is_a_piece_of_its_own(
    tube: tuple[LayoutProblem, PatchLayout, FlatPatches, FlatPatches],
) -> None:
    """A tube with a waist, which is divided into more panels, beside a dome that its panels match."""
    waist, dome = tube[0].mesh, shapes.dome(4)
    vertices = np.concatenate([waist.vertices, dome.vertices * waist.median_edge / dome.median_edge + [1.0, 0.0, 0.0]])
    mesh = QuadMesh(vertices, np.concatenate([waist.quads, dome.quads + len(waist.vertices)]))
    layout, flat = _merged(mesh)
    found = refine_merged(LayoutProblem(mesh, SETTINGS), layout, flat, SETTINGS.choose)
    before, after = (np.bincount(mesh.body_of[[p[0] for p in one.layout.patches]]) for one in (flat, found))
    assert before[0] < after[0] <= MAX_PANEL_GROWTH * before[0] and before[1] == after[1]
    of_dome = mesh.body_of[mesh.edge_quads[:, 0]] == 1
    np.testing.assert_array_equal(found.layout.cut[of_dome], flat.layout.cut[of_dome])
    np.testing.assert_array_equal(found.corners[mesh.body_of == 1], flat.corners[mesh.body_of == 1])
    alone = tube[-1].layout.notes["expected_percent"]
    assert 0.0 < found.layout.notes["expected_percent"] < alone  # of a larger whole


def test_merge_says_what_match_to_expect_and_tells_while_it_predicts(predicted_match: None) -> None:
    told: list[tuple[float, str]] = []
    progress = Progress(lambda done, text: told.append((done, text)))
    made = job.run(PolygonMesh.from_quads(shapes.dome(4)), SETTINGS, edge=0.02, stop_after="merge", progress=progress)
    fractions = [done for done, text in told if text == PREDICTING_TEXT]
    assert fractions == sorted(fractions) and len(set(fractions)) > 20
    assert made.outputs["merged"].merged.layout.notes["expected_percent"] > 0.0


@pytest.mark.thorough
def test_what_is_predicted_of_more_panels_comes_true(sphere: tuple[LayoutProblem, PatchLayout, FlatPatches]) -> None:
    piece, layout, flat = sphere
    assert reached(piece, refine_merged(piece, layout, flat, NEAR)) < reached(piece, flat)


def test_an_end_from_outside_ends_it(sphere: tuple[LayoutProblem, PatchLayout, FlatPatches]) -> None:
    from flexmaps.engine.errors import Cancelled

    piece, layout, flat = sphere
    with pytest.raises(Cancelled):
        refine_merged(piece, layout, flat, NEAR, Progress(stopped=lambda: True))


def _waist(around: int = 28, along: int = ALONG) -> QuadMesh:
    """Return a tube with the narrow waist of a catenoid, open at both ends."""
    k, j = (one.ravel() for one in np.meshgrid(np.arange(around), np.arange(along), indexing="ij"))
    quads = np.stack([k + (j + step) * around for step in (0, 1)], axis=-1)
    turned = (k + 1) % around + j * around
    quads = np.stack([quads[:, 0], turned, turned + around, quads[:, 1]], axis=-1)
    row, turn = np.divmod(np.arange(around * (along + 1)), around)
    height, angle = np.linspace(-1.0, 1.0, along + 1)[row], 2.0 * np.pi * turn / around
    radius = np.cosh(height)
    points = np.c_[radius * np.cos(angle), radius * np.sin(angle), height]
    mesh = QuadMesh(points, quads)
    return mesh.with_vertices(points * 0.02 / mesh.median_edge)


def _merged(mesh: QuadMesh) -> tuple[PatchLayout, FlatPatches]:
    layout = trace_layout(mesh, SETTINGS.layout)
    return layout, merge(layout, SETTINGS.layout)


def _rods() -> Settings:
    return replace(SETTINGS, simulate=replace(SETTINGS.simulate, model="rod"))

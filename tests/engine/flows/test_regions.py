"""Surfaces on which lines of quads lead nowhere, surfaces with holes, and single panels that nothing holds."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from flexmaps.engine.params import LayoutParams, RegulariseParams, Settings
from flexmaps.engine.patches.flattening import flatten
from flexmaps.engine.patches.flattening.arap import PatchProblem, solve_local_global
from flexmaps.engine.patches.flattening.flatten import FlatPatches
from flexmaps.engine.patches.flattening.flattening_report import layout_report
from flexmaps.engine.patches.layout import PatchLayout
from flexmaps.engine.patches.merging import merge
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.patches.tracing.regions import RegionHalver
from flexmaps.engine.progress import Progress
from flexmaps.engine.runs import job, manual_changes
from flexmaps.engine.surface import curvature, shapes
from flexmaps.engine.surface.checking import check
from flexmaps.engine.surface.formats import meshio
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh
from flexmaps.engine.surface.remeshing import regularise

PARAMS = LayoutParams()
Height = Callable[[np.ndarray, np.ndarray], np.ndarray]


def grid(n: int, height: Height, keep: Callable[[int, int], bool] = lambda i, j: True) -> QuadMesh:
    """n x n quads of 20 mm over a square, heights in quads; only those that are kept."""
    index = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    kept = [
        [index[i, j], index[i + 1, j], index[i + 1, j + 1], index[i, j + 1]]
        for i in range(n)
        for j in range(n)
        if keep(i, j)
    ]
    x, y = (a.ravel() - n / 2 for a in np.meshgrid(np.arange(n + 1.0), np.arange(n + 1.0), indexing="ij"))
    used, quads = np.unique(np.array(kept), return_inverse=True)
    points = np.column_stack([x, y, height(2 * x / n, 2 * y / n) * np.ones(len(x))])[used]
    mesh = QuadMesh(points, quads.reshape(-1, 4))
    return mesh.with_vertices(points * (0.02 / mesh.median_edge))


def flat(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return 0.0 * u


def bowl(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return 4.0 * np.cos(np.pi * u / 2) * np.cos(np.pi * v / 2)


def thirds(mesh: QuadMesh) -> QuadMesh:
    """Both triangles of every quad split into three quads each: irregular vertices everywhere."""
    triangles = np.concatenate([mesh.quads[:, [0, 1, 2]], mesh.quads[:, [0, 2, 3]]])
    sides = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    pairs, of_side = np.unique(sides, axis=0, return_inverse=True)
    p, count = mesh.vertices, len(mesh.vertices)
    middle = count + of_side.reshape(-1, 3)
    centre = count + len(pairs) + np.arange(len(triangles))
    points = np.concatenate([p, p[pairs].mean(axis=1), p[triangles].mean(axis=1)])
    around = [np.stack([triangles[:, k], middle[:, k], centre, middle[:, k - 1]], axis=1) for k in range(3)]
    made = QuadMesh(points, np.concatenate(around))
    return made.with_vertices(points * (0.02 / made.median_edge))


def merged(mesh: QuadMesh, *, held: bool = False) -> FlatPatches:
    return merge.merge(trace.trace_layout(mesh, PARAMS), PARAMS, has_supports=held)


def sound(made: FlatPatches) -> dict[str, object]:
    report = layout_report(made)
    assert report["overlaps"] == report["flips"] == 0
    assert report["disks"]
    assert made.energy.max() <= PARAMS.distortion_limit
    return report


@pytest.mark.parametrize("name", ["cubesphere", pytest.param("torus", marks=pytest.mark.thorough)])
def test_irregular_vertices_everywhere_do_not_shatter_a_surface(name: str) -> None:
    mesh = thirds(shapes.make(name))
    made = merged(mesh)
    sound(made)
    assert len(made.layout.patches) <= 8
    assert np.median([len(quads) for quads in made.layout.patches]) >= 40


def test_a_ragged_rim_does_not_shatter_a_surface() -> None:
    """Diamonds have a reflex corner at every second vertex of their rim, and a line of quads from each of them."""
    mesh = grid(16, bowl, lambda i, j: abs(i - 7.5) + abs(j - 7.5) < 8)
    made = merged(mesh)
    sound(made)
    assert len(made.layout.patches) <= 2


def test_a_plate_with_holes_is_one_panel() -> None:
    mesh = grid(15, flat, lambda i, j: i % 2 == 0 or j % 2 == 0)
    made = merged(mesh)
    sound(made)
    assert [len(quads) for quads in made.layout.patches] == [len(mesh.quads)]
    shapely = pytest.importorskip("shapely")
    whole = shapely.union_all(shapely.polygons(made.corners), grid_size=1e-9)
    assert len(whole.interiors) == 49
    assert whole.area == pytest.approx(mesh.areas.sum(), rel=1e-6)
    # and it can be cut as such: one outline, 49 holes of the surface among those round the inner vertices
    result = job.check_input(PolygonMesh.from_quads(mesh))
    result = job.run_stages(
        manual_changes.with_manual_layout(result, made, Settings()), Settings(), ("spirals", "sheets")
    )
    assert result.sheets is not None
    inner = int((~mesh.on_border).sum())
    assert len(result.sheets.panels[0].holes) == inner + 49


def test_a_curved_plate_with_holes_is_one_panel_where_it_is_held() -> None:
    mesh = grid(16, lambda u, v: 1.5 * (2 - u * u - v * v), lambda i, j: not (i in (3, 4, 11) and j in (4, 9, 12)))
    made = merged(mesh, held=True)
    sound(made)
    assert len(made.layout.patches) == 1


def comb(i: int, j: int) -> bool:
    return j < 2 or i % 3 == 0


@pytest.mark.parametrize("kept", [comb, lambda i, j: j < 1], ids=["comb", "ribbon"])
def test_a_surface_that_is_narrow_by_itself_is_not_cut_into_short_panels(kept: Callable[[int, int], bool]) -> None:
    mesh = grid(16, lambda u, v: 0.3 * np.cos(6 * v) * np.ones_like(u), kept)
    made = merged(mesh, held=True)
    sound(made)
    assert len(made.layout.patches) == 1


def test_a_wound_ribbon_is_one_panel_unless_it_lies_over_itself() -> None:
    """Ribbons along a circular helix: the flat one is a ring of the geodesic curvature of its middle line."""
    for turns, most in ((0.8, 1), (2.4, 4)):
        t = np.linspace(0.0, 2 * np.pi * turns, int(40 * turns) + 1)[:, None]
        r = np.array([[2.6, 3.0, 3.4]])
        points = np.stack([r * np.cos(t), r * np.sin(t), 0.3 * t * np.ones_like(r)], axis=2)
        index = np.arange(points.shape[0] * 3).reshape(-1, 3)
        quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1, 4)
        mesh = QuadMesh(points.reshape(-1, 3), quads)
        made = merged(mesh.with_vertices(mesh.vertices * (0.02 / mesh.median_edge)), held=True)
        sound(made)
        assert len(made.layout.patches) <= most


def test_a_tube_is_no_plate_with_a_hole() -> None:
    """Both have two rims; the tube's do not turn, those of the plate do, once each."""
    angle = 2 * np.pi * np.arange(12) / 12
    rings = [np.column_stack([np.cos(angle), np.sin(angle), np.full(12, 0.52 * k)]) for k in range(6)]
    i, k = (a.ravel() for a in np.meshgrid(np.arange(12), np.arange(5), indexing="ij"))
    j = (i + 1) % 12
    tube = QuadMesh(np.concatenate(rings), np.stack([k * 12 + i, k * 12 + j, k * 12 + 12 + j, k * 12 + 12 + i], axis=1))
    ring = grid(6, flat, lambda i, j: not (i in (2, 3) and j in (2, 3)))
    for mesh, planar in ((tube, False), (ring, True)):
        layout = PatchLayout(mesh, np.zeros(len(mesh.edges), dtype=bool))
        assert layout.euler_characteristic.tolist() == [0]
        assert layout.is_flattenable.tolist() == [planar]


def test_a_cut_that_floats_is_no_hole() -> None:
    mesh = grid(6, flat)
    inside = np.flatnonzero(~mesh.on_border[mesh.edges].any(axis=1))[:1]
    cut = np.zeros(len(mesh.edges), dtype=bool)
    cut[inside] = True
    assert not PatchLayout(mesh, cut).is_flattenable[0]


def test_regions_are_connected_and_lie_flat() -> None:
    mesh = thirds(shapes.make("torus"))
    layout = RegionHalver(mesh, PARAMS).region_layout(np.arange(len(mesh.quads)))
    assert layout.is_flattenable.all()
    assert flatten.flatten(layout, PARAMS).energy.max() <= PARAMS.distortion_limit


def test_angle_defects_sum_up_to_the_euler_number() -> None:
    """Gauss and Bonnet: 2 pi times the Euler number of a closed surface."""
    for name, euler in (("cubesphere", 2), ("torus", 0), ("three_holes", -4)):
        at_vertices, in_quads = curvature.angle_defects(shapes.make(name))
        assert at_vertices.sum() + in_quads.sum() == pytest.approx(2 * np.pi * euler, abs=1e-9)


@pytest.mark.parametrize(
    "height",
    [
        bowl,
        pytest.param(lambda u, v: 3.0 * (u * u - v * v), marks=pytest.mark.thorough),
        pytest.param(lambda u, v: 5.0 * u * v, marks=pytest.mark.thorough),
    ],
    ids=["dome", "saddle", "hypar"],
)
def test_what_nothing_holds_leaves_the_plane(height: Height) -> None:
    mesh = grid(14, height)
    shape = {}
    for seamless in (True, False):
        params = LayoutParams(seamless=seamless)
        made = merge.merge(trace.trace_layout(mesh, params), params)
        result = manual_changes.with_manual_layout(
            job.check_input(PolygonMesh.from_quads(mesh)), made, Settings(layout=params)
        )
        found = job.run_stages(result, Settings(layout=params), ("spirals", "simulate")).simulation
        assert found is not None
        assert bool(made.layout.cut.any()) is not seamless
        points = found.equilibrium.pose.centres
        out = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[2] / np.sqrt(len(points))
        shape[seamless] = (out, found.distance)
    assert shape[True][0] < 1e-6  # metres: one panel without a cut stays exactly flat
    assert shape[False][0] > 1e-3
    assert np.sqrt((shape[False][1] ** 2).mean()) < 0.8 * np.sqrt((shape[True][1] ** 2).mean())


def test_one_panel_stays_whole_where_it_is_flat_or_held() -> None:
    assert not merged(grid(10, flat)).layout.cut.any()
    assert not merged(grid(10, bowl), held=True).layout.cut.any()
    remarks = layout_report(merged(grid(10, bowl)))["remarks"]
    assert any("supports" in text for text in remarks)  # type: ignore[attr-defined]


@pytest.mark.parametrize("share", [0.5, 2.0])
def test_one_panel_stays_whole_only_where_the_surface_is_nearly_flat(share: float) -> None:
    """The RMS distance of a product of two cosines over half a wave from its mean is known in closed form."""
    spread = np.sqrt(0.25 - (4.0 / np.pi**2) ** 2)  # of a height of 1, continuous
    height = share * curvature.LOW_RELIEF * 10.0 * np.sqrt(2.0) / spread
    mesh = grid(10, lambda u, v: height * np.cos(np.pi * u / 2) * np.cos(np.pi * v / 2))
    assert bool(merged(mesh).layout.cut.any()) is (share > 1.0)


def test_a_piece_too_small_for_two_panels_stays_whole() -> None:
    def shallow(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        return 0.1 * bowl(u, v)

    assert not merged(grid(3, shallow)).layout.cut.any()  # of 9 quads, where a panel has 6
    assert merged(grid(4, shallow)).layout.cut.any()


def test_a_surface_that_bends_one_way_is_cut_along_a_straight_line() -> None:
    mesh = grid(10, lambda u, v: 2.0 * np.cos(np.pi * u / 2) + 0.0 * v)
    ends = mesh.vertices[mesh.edges[merged(mesh).layout.cut]]
    assert len(ends) == 10 and np.ptp(ends[..., [0, 2]].reshape(-1, 2), axis=0).max() < 1e-9


@pytest.mark.parametrize("name", ["dome", pytest.param("three_holes", marks=pytest.mark.thorough)])
def test_merging_what_was_merged_changes_nothing(name: str) -> None:
    mesh = shapes.make(name)
    once = merged(mesh)
    again = merge.merge(PatchLayout(mesh, once.layout.cut), PARAMS)
    assert (again.layout.cut == once.layout.cut).all()


@pytest.mark.filterwarnings("error")
def test_quads_without_area_do_not_break_a_flattening() -> None:
    """The Laplacian has no Cholesky factor there; what comes of it is a candidate that loses."""
    mesh = grid(3, flat)
    points = mesh.vertices.copy()
    points[mesh.quads[4]] = points[mesh.quads[4, 0]]
    bad = QuadMesh(points, mesh.quads)
    made = solve_local_global(PatchProblem(bad, np.arange(9), bad.quads))
    assert not made.max_energy <= PARAMS.distortion_limit or made.flip_count > 0


@pytest.mark.filterwarnings("error")
def test_a_flattening_that_is_no_number_is_the_worst() -> None:
    mesh = grid(2, flat)
    found = PatchProblem(mesh, np.arange(4), mesh.quads).flat_patch(np.full(9, np.nan, dtype=complex))
    assert found.max_energy == np.inf
    assert found.flip_count == 16


def test_progress_between_all_solves() -> None:
    """However large the patches are, a stop is asked for at every one of their solves."""
    mesh = grid(30, bowl)
    said: list[str] = []
    trace.trace_layout(mesh, PARAMS, Progress(report=lambda _, text: said.append(text)))
    assert len(said) > 5


@pytest.mark.parametrize(
    ("name", "most"),
    [
        ("cmc1.obj", 12),
        pytest.param("eight-smoothed-quads.off", 12, marks=pytest.mark.thorough),
        pytest.param("polycastle.off", 25, marks=pytest.mark.thorough),
    ],
)
def test_foreign_meshes(shared_meshes: Path, name: str, most: int) -> None:
    path = shared_meshes / "foreign" / name
    if not path.is_file():
        pytest.skip(f"{path} is not there")
    mesh = check.as_quad_mesh(check.scale_to_metres(meshio.read_mesh(path), edge=0.02))
    mesh = regularise.regularise(mesh, RegulariseParams())
    made = merged(mesh)
    assert layout_report(made)["overlaps"] == 0
    assert len(made.layout.patches) <= most
    assert min(len(quads) for quads in made.layout.patches) > 1

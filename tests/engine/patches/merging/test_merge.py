"""Merged layouts keep every limit; proven again with shapely, and by turning the surface round."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flexmaps.engine.errors import Cancelled
from flexmaps.engine.params import LayoutParams, RegulariseParams
from flexmaps.engine.patches.flattening.flatten import FlatPatches
from flexmaps.engine.patches.flattening.flattening_report import layout_report
from flexmaps.engine.patches.layout import PatchLayout
from flexmaps.engine.patches.merging import board, merge, sketch
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.progress import Progress
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking import check
from flexmaps.engine.surface.formats import meshio
from flexmaps.engine.surface.mesh import QuadMesh
from flexmaps.engine.surface.remeshing import regularise
from flexmaps.engine.surface.symmetry import preserved_by, symmetries

PARAMS = LayoutParams()
NAMES = ("demo", "cubesphere", "dome", "torus", "vault", "strip", "two_bodies", "quad")
QUICK = {"cubesphere", "dome", "torus", "quad"}
PATCHES = {"cubesphere": 1, "vault": 2, "quad": 1, "two_bodies": 2, "torus": 4}


def merged(mesh: QuadMesh, params: LayoutParams = PARAMS) -> FlatPatches:
    return merge.merge(trace.trace_layout(mesh, params), params)


@cache
def layout_of(name: str) -> FlatPatches:
    return merged(shapes.make(name))


@pytest.mark.parametrize(
    "name", ["dome", *(pytest.param(k, marks=pytest.mark.thorough) for k in ("demo", "two_bodies"))]
)
def test_what_is_remembered_changes_no_layout(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """With nothing kept between changes the same seams, flat points and work come of it."""
    spent: list[float] = []
    make = merge.work_budget

    def counted(layout: PatchLayout) -> board.WorkBudget:
        efforts.append(make(layout))
        return efforts[-1]

    monkeypatch.setattr(merge, "work_budget", counted)
    found = []
    for remembers in (True, False):
        efforts: list[board.WorkBudget] = []
        if not remembers:
            monkeypatch.setattr(sketch, "MAX_CACHED_QUADS", -1)
            monkeypatch.setattr(board.BoardCache, "__init__", _without_memory)
        found.append(merged(shapes.make(name)))
        spent.append(sum(effort.remaining for effort in efforts))
    assert (found[0].layout.cut == found[1].layout.cut).all()
    assert (found[0].points == found[1].points).all() and spent[0] == spent[1]


class _Forgetful(dict[Any, Any]):
    """Holds one entry, the last one."""

    def __setitem__(self, key: Any, value: Any) -> None:
        self.clear()
        super().__setitem__(key, value)

    def __contains__(self, key: Any) -> bool:
        return False


def _without_memory(self: Any, mesh: QuadMesh, params: LayoutParams) -> None:
    self.measurer, self.flattenings, self.quad_count = sketch.PatchMeasurer(mesh, params.neck_min), _Forgetful(), 0


def checked(flat: FlatPatches) -> dict[str, Any]:
    """Everything that any layout must fulfil; the report, for what is particular."""
    shapely = pytest.importorskip("shapely")
    report = layout_report(flat)
    assert report["energy_max"] <= PARAMS.distortion_limit
    assert report["compactness_max"] <= PARAMS.compactness_limit * (1 + 1e-9)
    assert report["disks"]
    assert report["flips"] == report["overlaps"] == 0
    assert report["seam_mismatch_median"] <= 0.03
    assert report["seam_mismatch_max"] <= 0.15
    if "forced" not in report:
        assert report["neck_min_quads"] >= 2
        assert report["smallest_patch"] >= min(6, len(flat.layout.mesh.quads))
    for quads, loop in zip(flat.layout.patches, flat.outlines, strict=True):
        outline = shapely.Polygon(flat.points[loop])
        assert outline.is_valid
        assert outline.exterior.is_ccw
        # no quad lies outside or over another one: their areas add up to the outline's
        areas = shapely.area(shapely.polygons(flat.corners[quads]))
        assert areas.sum() == pytest.approx(outline.area, rel=1e-9)
    return report


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in QUICK else pytest.mark.thorough) for name in NAMES]
)
def test_limits_hold(name: str) -> None:
    report = checked(layout_of(name))
    assert report["patches"] <= PATCHES.get(name, 4)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=() if name in QUICK else pytest.mark.thorough)
        for name in ("vault", "torus", "cubesphere", "demo", "dome")
    ],
)
def test_symmetric_or_said_why_not(name: str) -> None:
    notes = layout_of(name).layout.notes
    assert notes["symmetries_kept"] >= 2  # type: ignore[operator]
    if notes["symmetries_kept"] != notes["symmetries"]:
        assert ";" in str(notes["symmetry"])


def test_patches_lie_in_their_own_frames() -> None:
    for flat in map(layout_of, sorted(QUICK)):
        for quads in flat.layout.patches:
            c = flat.corners[quads]
            d1, d2 = c[:, 2] - c[:, 0], c[:, 3] - c[:, 1]
            area = 0.5 * (d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0])
            assert (area > 0).all()
            assert np.abs((area[:, None] * c.mean(axis=1)).sum(axis=0) / area.sum()).max() < 1e-9
            width, height = np.ptp(c.reshape(-1, 2), axis=0)
            assert width >= height * (1 - 1e-6)


def test_the_same_twice() -> None:
    one, two = layout_of("dome"), merged(shapes.make("dome"))
    assert (one.layout.cut == two.layout.cut).all()
    assert (one.points == two.points).all()


def test_a_tighter_limit_gives_less_distortion() -> None:
    params = LayoutParams(distortion_limit=0.008)
    flat = merged(shapes.make("dome"), params)
    assert flat.energy.max() <= 0.008
    assert len(flat.layout.patches) > 1


@pytest.mark.thorough
def test_a_wider_neck_is_kept() -> None:
    flat = merged(shapes.make("three_holes"), LayoutParams(neck_min=4, symmetric=False))
    assert flat.layout.isthmus_widths().min() >= 4 or "forced" in flat.layout.notes


def test_it_can_be_stopped() -> None:
    with pytest.raises(Cancelled):
        merge.merge(trace.trace_layout(shapes.make("dome"), PARAMS), PARAMS, Progress(stopped=lambda: True))


def test_progress_rises() -> None:
    seen: list[float] = []
    merge.merge(trace.trace_layout(shapes.make("torus"), PARAMS), PARAMS, Progress(report=lambda f, _: seen.append(f)))
    assert seen == sorted(seen)
    assert 0 <= seen[0] < 0.1
    assert seen[-1] <= 1


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "patches"), [("bunny.obj", 10), ("three_holes.obj", 11), ("amo_quad.off", 8)])
def test_real_meshes(shared_meshes: Path, name: str, patches: int) -> None:
    polygons = check.scale_to_metres(meshio.read_mesh(shared_meshes / name), edge=0.02)
    mesh = regularise.regularise(check.as_quad_mesh(polygons), RegulariseParams())
    flat = merged(mesh)
    report = layout_report(flat)
    assert report["patches"] <= patches
    if name != "amo_quad.off":
        checked(flat)


def test_first_cuts_that_break_a_mirror_get_its_images() -> None:
    flat = shapes.make("dome")
    x, y, z = flat.vertices.T
    mesh = QuadMesh(np.stack([x, y, z + 3.0 * x**2 * y + 0.4 * y**2], axis=1), flat.quads)  # one mirror, across x
    (mirror,) = symmetries(mesh)
    # lines on one side of the mirror alone
    middles = mesh.vertices[mesh.edges].mean(axis=1)
    along_y = np.ptp(mesh.vertices[mesh.edges][..., 1], axis=1) > np.ptp(mesh.vertices[mesh.edges][..., 0], axis=1)
    sides = np.sort(np.unique(np.round(middles[along_y & (middles[:, 0] > 0.0), 0], 4)))
    near = np.abs(middles[:, 0] - sides[len(sides) // 2]) < 0.4 * mesh.median_edge
    cut = along_y & near & ~mesh.border
    assert cut.any() and not preserved_by([mirror], cut)
    made = merge.merge(PatchLayout(mesh, cut, origin="lines"), PARAMS)
    assert preserved_by([mirror], made.layout.cut) == [mirror]
    checked(made)

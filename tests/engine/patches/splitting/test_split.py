"""Cutting patches to the sheet's size: every piece fits, as judged by shapely, and nothing else changes."""

import numpy as np
import pytest
import shapely
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.params import LayoutParams, Settings, SheetParams
from flexmaps.engine.patches.flattening.flatten import overlapping_patches
from flexmaps.engine.patches.merging import merge
from flexmaps.engine.patches.splitting import split
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.progress import Progress
from flexmaps.engine.runs import job
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh
from flexmaps.engine.surface.symmetry import SEARCH, preserved_by, symmetries

LAYOUT = LayoutParams()


def _fits(points, sheet, degrees=1):
    """Whether a shape lies on the sheet less its margins in some direction."""
    hull = shapely.MultiPoint(points).convex_hull
    free = sheet.sheet_width - 2 * sheet.margin, sheet.sheet_height - 2 * sheet.margin
    for angle in range(0, 180, degrees):
        x0, y0, x1, y1 = shapely.affinity.rotate(hull, angle, origin=(0, 0)).bounds
        if x1 - x0 <= free[0] and y1 - y0 <= free[1]:
            return True
    return False


def _pieces(flat):
    return [flat.points[loop] for loop in flat.outlines]


def test_a_plate_is_cut_straight_into_as_few_pieces_as_fit(flat_grid):
    plate = flat_grid(40, 15)  # 800 x 300 mm
    made = split.split_to_sheet(plate, LAYOUT, SheetParams())
    assert len(made.layout.patches) == 2
    assert made.layout.cut.sum() == 15
    # one straight line of edges
    ends = plate.layout.mesh.vertices[plate.layout.mesh.edges[made.layout.cut]]
    assert np.ptp(ends[..., 0]) < 1e-12
    assert all(_fits(p, SheetParams()) for p in _pieces(made))
    assert "1 more cut," in made.layout.notes["split"]


def test_what_fits_is_left_alone(flat_grid):
    plate = flat_grid(25, 15)
    assert split.split_to_sheet(plate, LAYOUT, SheetParams()) is plate
    large = flat_grid(40, 30)
    assert split.split_to_sheet(large, LAYOUT, SheetParams(oversize="enlarge")) is large


def test_what_does_not_fit_is_not_told_how_to_stay_whole(flat_grid):
    plate = flat_grid(40, 15)
    plate.layout.notes["halved"] = "Keep it whole"
    assert split.split_to_sheet(plate, LAYOUT, SheetParams(sheet_width=1.0)).layout.notes["halved"]
    assert "halved" not in split.split_to_sheet(plate, LAYOUT, SheetParams()).layout.notes


def test_a_large_plate_needs_several_rounds(flat_grid):
    sheet = SheetParams(sheet_width=0.3, sheet_height=0.2)
    made = split.split_to_sheet(flat_grid(25, 20), LAYOUT, sheet)  # 500 x 400 mm: at least 4 sheets
    assert 4 <= len(made.layout.patches) <= 8
    assert all(_fits(p, sheet) for p in _pieces(made))
    assert (made.layout.euler_characteristic == 1).all()
    assert made.layout.isthmus_widths().min() >= LAYOUT.neck_min


@pytest.mark.parametrize("period", [3, 4])
def test_cuts_may_follow_the_borders_of_holes(flat_grid, period):
    bars = flat_grid(31, 31, without=lambda i, j: i % period != 0 and j % period != 0).layout.mesh
    sheet, turns = SheetParams(sheet_width=0.35, sheet_height=0.25), iter(range(10000))
    flat = merge.merge(trace.trace_layout(bars, LAYOUT), LAYOUT)
    # a cancel ends what would go on for ever
    made = split.split_to_sheet(flat, LAYOUT, sheet, Progress(None, lambda: next(turns, None) is None))
    assert all(_fits(p, sheet) for p in _pieces(made))


def test_other_patches_stay_as_they_are(flat_grid):
    flat = flat_grid(60, 12, cut=lambda x, y: x == 50)  # 1000 x 240 and 200 x 240 mm
    made = split.split_to_sheet(flat, LAYOUT, SheetParams())
    small = np.flatnonzero(flat.layout.mesh.centroids[:, 0] > 1.0)
    np.testing.assert_array_equal(made.corners[small], flat.corners[small])
    assert len(made.layout.patches) == 3


@pytest.mark.parametrize("rotation", ["FREE", "QUARTER", "GRAIN"])
def test_rotation_limits_what_fits(flat_grid, rotation):
    # 560 x 300 mm lies lengthwise on the sheet; on one that stands upright only when it may be turned
    plate, sheet = flat_grid(28, 15), SheetParams(sheet_width=0.4, sheet_height=0.6, rotation=rotation)
    made = split.split_to_sheet(plate, LAYOUT, sheet)
    assert (len(made.layout.patches) > 1) == (rotation == "GRAIN")
    assert split.split_to_sheet(plate, LAYOUT, SheetParams(rotation=rotation)) is plate


def test_a_slanted_strip_fits_along_the_diagonal(flat_grid):
    strip = flat_grid(30, 2)  # 600 x 40 mm: only slantwise on a sheet 550 x 400
    sheet = SheetParams(sheet_width=0.55, sheet_height=0.4)
    assert split.split_to_sheet(strip, LAYOUT, sheet) is strip
    assert (
        len(
            split.split_to_sheet(
                strip, LAYOUT, SheetParams(sheet_width=0.55, sheet_height=0.4, rotation="QUARTER")
            ).outlines
        )
        > 1
    )


@pytest.mark.parametrize("sheet", [SheetParams(sheet_width=0.2, sheet_height=0.15), SheetParams(sheet_width=0.3)])
def test_a_curved_surface_keeps_every_limit(sheet):
    mesh = shapes.make("demo", 0.02)
    merged = merge.merge(trace.trace_layout(mesh, LAYOUT), LAYOUT)
    made = split.split_to_sheet(merged, LAYOUT, sheet)
    assert len(made.layout.patches) >= len(merged.layout.patches)
    assert all(_fits(p, sheet) for p in _pieces(made))
    assert made.energy.max() <= LAYOUT.distortion_limit
    assert not overlapping_patches(made)
    # a cut is only ever added
    assert (made.layout.cut | ~merged.layout.cut).all()


def test_mirrored_patches_are_cut_alike(flat_grid):
    flat = flat_grid(80, 12, cut=lambda x, y: x == 40)  # two of 800 x 240 mm, mirror images
    made = split.split_to_sheet(flat, LAYOUT, SheetParams())
    middles = flat.layout.mesh.vertices[flat.layout.mesh.edges[made.layout.cut]].mean(axis=1)
    mirrored = middles * [-1, 1, 1] + [1.6, 0, 0]
    assert {tuple(m) for m in middles.round(6).tolist()} == {tuple(m) for m in mirrored.round(6).tolist()}
    assert len(made.layout.patches) == 4


def test_the_search_for_symmetries_and_every_run_can_be_stopped(flat_grid):
    """Whoever wants to stop is asked in the long steps too, not only between two patches."""
    told: dict[str, int] = {}
    report = Progress(report=lambda _, text: told.update({text: told.get(text, 0) + 1}))
    split.split_to_sheet(flat_grid(40, 15), LAYOUT, SheetParams(), report)
    assert told[SEARCH] >= 10
    assert told["Cutting panels to the sheet's size"] > 40
    assert any("seams" in text for text in told)


def test_a_sheet_without_room_for_a_quad_is_refused(flat_grid):
    plate = flat_grid(4, 4, move=lambda p: p * np.where(p[:, :1] > 0.05, [1.5, 1.0], [1.0, 1.0]))
    with pytest.raises(FlexMapsError, match=r"no room for .* single quads") as caught:
        split.split_to_sheet(plate, LAYOUT, SheetParams(sheet_width=0.045, sheet_height=0.035))
    assert caught.value.faces
    with pytest.raises(FlexMapsError, match="nothing but margin"):
        split.split_to_sheet(plate, LAYOUT, SheetParams(sheet_width=0.01, sheet_height=0.01))


def test_the_main_job_cuts_to_size_before_the_spirals():
    settings = Settings(sheet=SheetParams(sheet_width=0.16, sheet_height=0.12))
    result = job.run(PolygonMesh.from_quads(shapes.make("dome", 0.02)), settings, edge=0.02, stop_after="split")
    assert all(_fits(p, settings.sheet) for p in _pieces(result.flat))
    assert "split" in result.seconds
    assert result.design is None


def test_note_about_symmetry_is_of_the_layout_after_the_cuts():
    """What the note says against the cuts themselves: how many motions of the mesh map them onto themselves."""
    flat = merge.merge(trace.trace_layout(shapes.make("cubesphere"), LayoutParams()), LayoutParams())
    made = split.split_to_sheet(flat, LayoutParams(), SheetParams(sheet_width=0.12, sheet_height=0.1))
    assert len(made.layout.patches) > len(flat.layout.patches)
    found = symmetries(made.layout.mesh)
    kept = 1 + len(preserved_by(found, made.layout.cut))
    assert made.layout.notes["symmetries_kept"] == kept
    assert f"keeps {kept} of {1 + len(found)} symmetries" in str(made.layout.notes["symmetry"])
    assert "instead of" not in str(made.layout.notes["symmetry"])

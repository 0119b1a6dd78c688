"""Packing: shapes stay shapes, never overlap, keep their distance, and use the sheet."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from flexmaps.engine.fabrication.nesting import packing, sheet_raster
from flexmaps.engine.fabrication.nesting.packing import box_fits, min_area_box, pack
from flexmaps.engine.fabrication.nesting.remnants import Remnant
from flexmaps.engine.progress import Progress
from shapely import Polygon, affinity


def _placed(shapes, packing):
    for i, shape in enumerate(shapes):
        turned = affinity.rotate(Polygon(shape), packing.rotation[i], origin=(0, 0), use_radians=True)
        yield int(packing.sheet[i]), affinity.translate(turned, *packing.shift[i])


def _blob(rng, size):
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    radius = size * (1 + 0.5 * np.sin(rng.integers(2, 6) * angle + rng.uniform(0, 6)))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def _check(shapes, packing, margin, spacing):
    sheets: dict[int, list[Polygon]] = {}
    for sheet, shape in _placed(shapes, packing):
        x0, y0, x1, y1 = shape.bounds
        width, height = packing.sizes[sheet]
        assert min(x0, y0, width - x1, height - y1) >= margin - 1e-12
        assert all(shape.distance(other) >= spacing - 1e-12 for other in sheets.get(sheet, []))
        sheets.setdefault(sheet, []).append(shape)
    return sheets


@pytest.mark.parametrize("spacing", [0.0, 0.003, 0.02])
def test_shapes_keep_their_distance_on_several_sheets(spacing):
    rng = np.random.default_rng(7)
    shapes = [_blob(rng, s) for s in rng.uniform(0.01, 0.07, 25)]
    packing = pack(shapes, (0.6, 0.4), 0.005, spacing)
    sheets = _check(shapes, packing, 0.005, spacing)
    assert sorted(sheets) == list(range(len(packing.sizes)))
    assert (packing.sizes == [0.6, 0.4]).all()


def test_equal_squares_fill_the_sheet():
    square = 0.098 * np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    packing = pack([square] * 24, (0.6, 0.4), 0.0, 0.0)
    assert len(packing.sizes) == 1
    _check([square] * 24, packing, 0.0, 0.0)


def test_a_small_shape_goes_into_the_bay_of_a_large_one():
    bay = np.array([[0, 0], [0.38, 0], [0.38, 0.28], [0.3, 0.28], [0.3, 0.08], [0.08, 0.08], [0.08, 0.28], [0, 0.28]])
    inner = np.array([[0, 0], [0.2, 0], [0.2, 0.15], [0, 0.15]])
    packing = pack([bay, inner], (0.4, 0.3), 0.005, 0.003)
    assert len(packing.sizes) == 1
    _check([bay, inner], packing, 0.005, 0.003)


def test_long_shapes_are_turned_to_fit():
    bar = np.array([[0, 0], [0.02, 0], [0.02, 0.55], [0, 0.55]])
    packing = pack([bar] * 3, (0.6, 0.1), 0.005, 0.003)
    assert len(packing.sizes) == 1
    _check([bar] * 3, packing, 0.005, 0.003)


def test_too_large_shapes_get_a_sheet_of_their_own_size():
    large, small = 0.5 * np.array([[0, 0], [1.5, 0], [1.5, 1], [0, 1.0]]), 0.05 * np.array([[0, 0], [1, 0], [0.5, 1.0]])
    packing = pack([small, large], (0.6, 0.4), 0.005, 0.003)
    _check([small, large], packing, 0.005, 0.003)
    width, height = packing.sizes[packing.sheet[1]]
    assert 0.76 <= width <= 0.79
    assert 0.51 <= height <= 0.54


def test_least_box_of_a_turned_rectangle():
    rng = np.random.default_rng(0)
    inside = rng.uniform(-0.5, 0.5, (200, 2)) * [3.0, 1.0]
    corners = np.array([[-1.5, -0.5], [1.5, -0.5], [1.5, 0.5], [-1.5, 0.5]])
    angle = 0.6
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    found, size = min_area_box(np.vstack([inside, corners]) @ turn)
    np.testing.assert_allclose(size, [3.0, 1.0])
    assert np.sin(found + angle) == pytest.approx(0.0, abs=1e-9)


def test_fits_either_way_round():
    assert box_fits(np.array([0.1, 0.5]), (0.52, 0.12), 0.01)
    assert not box_fits(np.array([0.1, 0.51]), (0.52, 0.12), 0.01)


@pytest.mark.parametrize("rotation", ["FREE", "QUARTER", "GRAIN"])
def test_very_many_shapes_are_packed_too(rotation, monkeypatch):
    rng = np.random.default_rng(3)
    shapes = [_blob(rng, s) for s in rng.uniform(0.004, 0.012, 150)]
    bar = np.array([[0, 0], [0.003, 0], [0.003, 0.1], [0, 0.1]])  # too long: only aslant, or on a sheet of its own
    shapes += [bar, 2.0 * bar]
    monkeypatch.setattr(packing, "TRIES", 60)
    seen = []
    progress = Progress(lambda fraction, text: seen.append((fraction, text)))
    found = pack(shapes, (0.1, 0.06), 0.004, 0.003, progress, rotation)
    assert "Packing in rows" in {text for _, text in seen}
    assert [f for f, _ in seen] == sorted(f for f, _ in seen)
    sheets = _check(shapes, found, 0.004, 0.003)
    assert sorted(sheets) == list(range(len(found.sizes)))
    assert (found.sizes.max(axis=1) > 0.1).sum() == 2 - (rotation == "FREE")
    covered = sum(Polygon(s).area for s in shapes)
    assert covered > 0.25 * found.sizes.prod(axis=1).sum()  # not a sheet each


def test_shapes_laid_in_rows_alone(monkeypatch):
    rng = np.random.default_rng(4)
    shapes = [_blob(rng, s) for s in rng.uniform(0.004, 0.03, 60)]
    monkeypatch.setattr(packing, "TRIES", 0)
    found = pack(shapes, (0.2, 0.15), 0.005, 0.002)
    _check(shapes, found, 0.005, 0.002)
    assert (found.sizes == [0.2, 0.15]).all()


@pytest.mark.parametrize("rotation", ["GRAIN", "ANY"])
def test_a_sheet_that_must_grow_keeps_the_grain_of_a_long_shape(rotation):
    """It grows along the shape where that may not be turned, and else where less is needed."""
    tall = np.array([[0, 0], [0.1, 0], [0.1, 0.9], [0, 0.9]])
    found = pack([tall], (0.4, 0.6), 0.005, 0.0, rotation=rotation)
    (size,) = found.sizes
    _check([tall], found, 0.005, 0.0)
    assert (size[1] > 0.9 and size[0] == 0.4) if rotation == "GRAIN" else (size[0] > 0.9 and size[1] == 0.4)


# -- the raster --------------------------------------------------------------------------------------------------------


def test_cells_count_by_their_centres_as_shapely_sees_them():
    rng = np.random.default_rng(5)
    rings = [np.array([9.3, 8.8]) + _blob(rng, 6.0), np.array([9.1, 8.4]) + _blob(rng, 1.5)]
    rows, columns = 18, 20
    x, y = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
    inside = [shapely.contains_xy(Polygon(ring), x, y) for ring in rings]
    assert (sheet_raster._rasterise(rings, columns, rows) == inside[0] ^ inside[1]).all()
    assert not sheet_raster._rasterise(rings, columns, rows)[:, -1].all()


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_masks_cover_all_cells_near_their_shape_and_few_others(turn):
    shape, cell, grow = _blob(np.random.default_rng(2), 0.03), 0.002, 0.003
    stamp = sheet_raster.ShapeMask(shape, turn, cell, grow, (0, 1, 2, 3))
    for quarter, mask in stamp.masks.items():
        corner = np.array([0.5, 0.3])
        angle, shift = stamp.placement_at(quarter, corner)
        assert angle == pytest.approx(turn + 0.5 * np.pi * quarter)
        there = affinity.translate(affinity.rotate(Polygon(shape), angle, (0, 0), use_radians=True), *shift)
        cells = [
            shapely.box(*(corner + cell * np.array([i, j])), *(corner + cell * np.array([i + 1, j + 1])))
            for j, i in np.argwhere(mask)
        ]
        whole = shapely.union_all(cells)
        assert whole.buffer(1e-9).contains(there.buffer(grow))
        assert there.buffer(grow + 2.0 * cell).contains(whole)
        assert stamp.cell_count == mask.sum() == len(cells)


def _square(side):
    return side * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def test_the_first_place_is_at_the_left_and_then_at_the_bottom():
    sheet = sheet_raster.SheetRaster((0.1, 0.07), 0.005, 0.0, 0.0005)
    seen = []
    for _ in range(5):
        stamp = sheet_raster.ShapeMask(_square(0.02), 0.0, 0.0005, 0.0, (0,))
        assert sheet.may_fit(stamp)
        seen.append(sheet.place(stamp)[1])
    # each takes 21 mm of the raster, so that two fit above each other on 60 mm
    wanted = [[0.0054, 0.0054], [0.0054, 0.0264], [0.0264, 0.0054], [0.0264, 0.0264], [0.0474, 0.0054]]
    np.testing.assert_allclose(seen, wanted, atol=1e-4)
    large = sheet_raster.ShapeMask(_square(0.04), 0.0, 0.0005, 0.0, (0,))
    assert sheet.place(large) is None
    assert not sheet.may_fit(sheet_raster.ShapeMask(_square(0.041), 0.0, 0.0005, 0.0, (0,)))
    assert sheet.may_fit(sheet_raster.ShapeMask(_square(0.02), 0.0, 0.0005, 0.0, (0,)))
    # as large as what found no place, but a frame with room in it
    assert sheet.may_fit(sheet_raster.ShapeMask(0.04 * np.array([[0, 0], [1, 0], [0, 1.0]]), 0.0, 0.0005, 0.0, (0,)))


# -- sizes -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rotation", "length", "fits"),
    [("FREE", 0.2, True), ("FREE", 0.25, False), ("QUARTER", 0.179, True), ("QUARTER", 0.2, False)],
)
def test_bars_fit_along_the_sheet_or_also_aslant(rotation, length, fits):
    """Within its margins the sheet has 160 x 180 mm, and a diagonal of 241 mm."""
    bar = np.array([[0.0, 0.0], [length, 0.0], [length, 0.001], [0.0, 0.001]])
    angle = packing.find_fitting_rotation(bar, (0.18, 0.2), 0.01, rotation)
    assert (angle is not None) == fits
    if fits:
        box = affinity.rotate(Polygon(bar), angle, origin=(0, 0), use_radians=True).bounds
        assert box[2] - box[0] <= 0.16 + 1e-8 and box[3] - box[1] <= 0.18 + 1e-8


def test_along_the_grain_nothing_is_turned():
    bar = np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 0.02], [0.0, 0.02]])
    assert packing.find_fitting_rotation(bar, (0.12, 0.04), 0.01, "GRAIN") == 0.0
    assert packing.find_fitting_rotation(bar[:, ::-1], (0.12, 0.04), 0.01, "GRAIN") is None
    assert packing.preferred_box(bar[:, ::-1], "GRAIN")[1] == pytest.approx([0.02, 0.1])
    assert box_fits(np.array([0.1, 0.02]), (0.12, 0.04), 0.01, "GRAIN")
    assert not box_fits(np.array([0.02, 0.1]), (0.12, 0.04), 0.01, "GRAIN")
    assert not box_fits(np.array([0.1, 0.021]), (0.12, 0.04), 0.01, "GRAIN")


def test_the_largest_unused_end_does_not_count():
    """Two sheets of 0.4 x 0.3 m: one is used up to 0.25 m, the other up to 0.15 m, each with a margin of 0.01 m more."""
    shapes = [np.array([[0.0, 0.0], [0.1, 0.0], [0.0, 0.05]])] * 3
    turn, shift = np.array([0.0, 0.5 * np.pi, np.pi]), np.array([[0.15, 0.1], [0.1, 0.01], [0.15, 0.2]])
    found = packing.Packing(np.array([0, 0, 1]), turn, shift, np.array([[0.4, 0.3], [0.4, 0.3]]))
    assert packing.used_length(found, shapes, 0) == pytest.approx(0.25)
    assert packing.used_length(found, shapes, 1) == pytest.approx(0.15)
    assert packing.used_length(replace(found, sheet=np.zeros(3, int)), shapes, 1) == 0.0
    assert packing.fill_ratio(found, shapes, 0.0075, 0.01) == pytest.approx(0.0075 / (0.24 - 0.24 * 0.3))
    remnant = Remnant("L", np.array([[0, 0], [0.4, 0], [0.4, 0.1], [0.2, 0.1], [0.2, 0.3], [0, 0.3]]))
    odd = replace(found, remnants=(remnant,))
    assert odd.sheet_areas == pytest.approx([0.08, 0.12])
    assert packing.fill_ratio(odd, shapes, 0.0075, 0.01) == pytest.approx(0.0075 / (0.2 - 0.24 * 0.3))


def test_rows_are_as_high_as_their_first_box_and_as_long_as_the_sheet(monkeypatch):
    """Boxes of 40 x 20 mm in a sheet of 100 x 70 mm with margins of 5 and a spacing of 10 mm: two in a row, two rows."""
    monkeypatch.setattr(packing, "TRIES", 0)
    box = np.array([[0.0, 0.0], [0.04, 0.0], [0.04, 0.02], [0.0, 0.02]])
    found = pack([box] * 5, (0.1, 0.07), 0.005, 0.01, rotation="QUARTER")
    assert found.sheet.tolist() == [0, 0, 0, 0, 1]
    low = [np.array(p.bounds[:2]) for _, p in _placed([box] * 5, found)]
    np.testing.assert_allclose(
        low, [[5e-3, 5e-3], [0.055, 5e-3], [5e-3, 0.035], [0.055, 0.035], [5e-3, 5e-3]], atol=1e-12
    )
    wider = pack([box * [1.01, 1.0]] * 2, (0.1, 0.07), 0.005, 0.01, rotation="QUARTER")
    assert np.ptp(wider.shift[:, 1]) > 0.02  # a second row

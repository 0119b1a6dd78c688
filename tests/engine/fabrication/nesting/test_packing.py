"""Packing: shapes stay shapes, never overlap, keep their distance, and use the sheet."""

import numpy as np
import pytest
from flexmaps.engine.fabrication.nesting import packing
from flexmaps.engine.fabrication.nesting.packing import box_fits, min_area_box, pack
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

"""Quads without room for a spiral: their neighbours make room, what is left gets a solid hub, and too many are refused."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import shapely
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.fabrication.sheets import make_sheets
from flexmaps.engine.params import SheetParams, SpiralParams
from flexmaps.engine.patches.flattening.flatten import FlatPatches
from flexmaps.engine.spirals import fabricable, painting, quad_enlarging, solid_hubs
from flexmaps.engine.spirals.design_report import design_report

SIZE = 12  # quads along each side: more than a hundred, so that one of them may stay without a spiral


def needled(column: int, row: int, share: float) -> Callable[[np.ndarray], np.ndarray]:
    """Draws two opposite corners of a quad of 20 mm together to a share of their distance."""

    def move(points: np.ndarray) -> np.ndarray:
        points = points.copy()
        ends = [0.02 * np.array([column + 1, row]), 0.02 * np.array([column, row + 1])]
        at = [int(np.linalg.norm(points - end, axis=1).argmin()) for end in ends]
        middle = points[at].mean(axis=0)
        points[at] = middle + share * (points[at] - middle)
        return points

    return move


@pytest.fixture
def needle(flat_grid: Callable[..., FlatPatches]) -> FlatPatches:
    return flat_grid(SIZE, SIZE, move=needled(5, 5, 0.08))


def test_a_needle_gets_a_solid_hub_and_all_others_keep_what_they_can(needle: FlatPatches) -> None:
    made = fabricable.uniform_design(needle, SpiralParams())
    assert np.flatnonzero(made.has_solid_hub).tolist() == [5 * SIZE + 5]
    assert not len(fabricable.unfabricable_quads(made))
    far = np.ones(len(made.twist), dtype=bool)
    far[[5 * SIZE + 5, *(np.array([4, 6]) * SIZE + 5), 5 * SIZE + 4, 5 * SIZE + 6]] = False
    usual = fabricable.uniform_design(needle, SpiralParams()).twist[0]
    assert (made.twist[far] > 0.5 * usual).all()
    (finding,) = made.findings
    assert (finding.code, finding.faces, finding.is_error) == ("no-spiral", (5 * SIZE + 5,), False)
    assert design_report(made)["no_spiral"] == [5 * SIZE + 5]


def test_its_panel_is_one_sound_piece_with_more_material_there(needle: FlatPatches) -> None:
    made = fabricable.uniform_design(needle, SpiralParams())
    outline = made.outlines()[0]
    panel = shapely.Polygon(outline.outer.sample(1e-6), [hole.sample(1e-6) for hole in outline.holes])
    assert panel.is_valid
    quad = shapely.Polygon(needle.corners[5 * SIZE + 5])
    assert panel.contains(shapely.Point(needle.corners[5 * SIZE + 5].mean(axis=0)))
    assert panel.intersection(quad).area > 0.3 * quad.area
    assert any("no room for a spiral" in warning for warning in make_sheets(made, SheetParams()).warnings)


def test_it_is_known_again_by_its_widths_alone(needle: FlatPatches) -> None:
    made = fabricable.uniform_design(needle, SpiralParams())
    stored = made.width.astype(np.float32).astype(float)
    assert (solid_hubs.mark_solid_hubs(stored, made.params) == made.has_solid_hub).all()
    again = fabricable.make_fabricable(needle, made.params, stored, made.twist)
    assert (again.has_solid_hub == made.has_solid_hub).all() and not len(fabricable.unfabricable_quads(again))


def test_a_brush_leaves_it_alone(needle: FlatPatches) -> None:
    made = fabricable.uniform_design(needle, SpiralParams())
    for brush in ("stiffer", "softer", "smooth", "width"):
        assert (painting.paint_spirals(made, brush, np.ones(len(made.twist))).has_solid_hub == made.has_solid_hub).all()


def test_more_than_one_in_a_hundred_are_refused_with_a_count_that_would_do(
    flat_grid: Callable[..., FlatPatches],
) -> None:
    one, two = needled(2, 2, 0.08), needled(8, 8, 0.08)
    flat = flat_grid(SIZE, SIZE, move=lambda points: two(one(points)))
    with pytest.raises(FlexMapsError, match="no room for the arms of 2 quads") as caught:
        fabricable.uniform_design(flat, SpiralParams())
    assert set(caught.value.faces) == {2 * SIZE + 2, 8 * SIZE + 8}
    assert caught.value.quads is not None and caught.value.quads < SIZE**2


@pytest.mark.parametrize("share", [0.08, 0.01])
def test_neighbours_make_room_and_outlines_stay(flat_grid: Callable[..., FlatPatches], share: float) -> None:
    flat = flat_grid(SIZE, SIZE, move=needled(5, 5, share))
    moved = quad_enlarging.enlarge_quads(flat, np.array([5 * SIZE + 5]))
    rim = np.unique(flat.layout.flat_corners[flat.layout.outline_sides])
    assert np.array_equal(moved.points[rim], flat.points[rim])
    corners = moved.corners @ np.array([1.0, 1j])
    along = np.roll(corners, -1, axis=1) - corners
    assert ((np.conj(np.roll(along, 1, axis=1)) * along).imag > 0).all(), "no corner is turned over"
    made = fabricable.design_from_curvature(flat, SpiralParams(), np.ones(SIZE**2))
    assert made.flat is not flat and not made.has_solid_hub.any()


def test_nothing_moves_where_all_have_room(flat_grid: Callable[..., FlatPatches]) -> None:
    flat = flat_grid(4, 4)
    assert fabricable.design_from_curvature(flat, SpiralParams(), np.ones(16)).flat is flat

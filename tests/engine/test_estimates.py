"""Estimates against sums by hand."""

import pytest
from flexmaps.engine.fabrication import estimates, sheets
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.params import MaterialParams, SheetParams, SpiralParams
from flexmaps.engine.spirals import design


def test_figures_of_a_small_design(flat_grid):
    made = design.uniform(flat_grid(4, 3, cut=lambda x, y: x == 2), SpiralParams(thickness=0.003))
    cut = sheets.make_sheets(made, SheetParams(nesting="FAST"))
    found = estimates.estimate(cut, made, MATERIALS["birch"])
    assert found.mass == pytest.approx(680.0 * 0.003 * sum(p.area for p in cut.panels))
    assert found.joints == 3
    assert found.sheet_area == pytest.approx(0.24)
    # 15 mm/s at 3 mm, and a little for every contour
    assert cut.cut_length / 0.015 < found.cut_seconds < 1.3 * cut.cut_length / 0.015 + 30
    block = estimates.estimates_report(found)
    assert block["cut_minutes"] == pytest.approx(found.cut_seconds / 60, abs=0.06)
    assert block["mass_g"] == pytest.approx(found.mass * 1e3, abs=0.01)


def test_thicker_sheets_are_cut_more_slowly():
    speed = estimates.SPEEDS["acrylic"]
    assert speed.at(0.006) == pytest.approx(0.5 * speed.at(0.003))
    assert speed.at(0.0001) == estimates.FASTEST


@pytest.mark.parametrize("material", [MATERIALS["pla"], MaterialParams(material="custom").chosen])
def test_what_is_not_cut_by_laser_has_no_cutting_time(flat_grid, material):
    made = design.uniform(flat_grid(2, 2), SpiralParams())
    found = estimates.estimate(sheets.make_sheets(made, SheetParams(nesting="FAST")), made, material)
    assert found.cut_seconds is None
    assert "cut_minutes" not in estimates.estimates_report(found)
    assert found.mass > 0

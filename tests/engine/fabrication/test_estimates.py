"""Estimates against sums by hand."""

import csv

import pytest
import shapely
from flexmaps.engine import MARK
from flexmaps.engine.fabrication import estimates, sheets
from flexmaps.engine.fabrication.writers import numbered_files, parts
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.params import ConnectorParams, CostParams, MaterialParams, SheetParams, SpiralParams
from flexmaps.engine.spirals import fabricable


def test_figures_of_a_small_design(flat_grid):
    made = fabricable.uniform_design(flat_grid(4, 3, cut=lambda x, y: x == 2), SpiralParams(thickness=0.003))
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
    speed = estimates.CUT_SPEEDS["acrylic"]
    assert speed.at_thickness(0.006) == pytest.approx(0.5 * speed.at_thickness(0.003))
    assert speed.at_thickness(0.0001) == estimates.MAX_CUT_SPEED


@pytest.mark.parametrize("material", [MATERIALS["pla"], MaterialParams(material="custom").chosen])
def test_what_is_not_cut_by_laser_has_no_cutting_time(flat_grid, material):
    made = fabricable.uniform_design(flat_grid(2, 2), SpiralParams())
    found = estimates.estimate(sheets.make_sheets(made, SheetParams(nesting="FAST")), made, material)
    assert found.cut_seconds is None
    assert "cut_minutes" not in estimates.estimates_report(found)
    assert found.mass > 0


def test_costs_are_prices_times_what_is_needed(flat_grid):
    made = fabricable.uniform_design(flat_grid(4, 3, cut=lambda x, y: x == 2), SpiralParams(thickness=0.003))
    cut = sheets.make_sheets(made, SheetParams(nesting="FAST", sheet_width=0.2, sheet_height=0.1))
    found = estimates.estimate(cut, made, MATERIALS["birch"], CostParams(8.0, 60.0, 30.0))
    assert found.costs["sheets"] == 8.0 * cut.count
    assert found.costs["machine"] == pytest.approx(found.cut_seconds / 60)  # one a minute
    assert found.costs["assembly"] == pytest.approx(3 * estimates.SECONDS_PER_JOINT / 120)
    block = estimates.estimates_report(found)
    assert block["cost"]["total"] == pytest.approx(sum(found.costs.values()), abs=0.006)
    material = sum(shapely.Polygon(p.outline.sample(1e-6), [h.sample(1e-6) for h in p.holes]).area for p in cut.panels)
    assert block["waste"] == pytest.approx(1 - material / (cut.count * 0.02), abs=1e-3)
    assert "cost" not in estimates.estimates_report(estimates.estimate(cut, made, MATERIALS["birch"]))
    printed = estimates.estimate(cut, made, MATERIALS["pla"], CostParams(machine_rate=60.0))
    assert not printed.costs  # no laser, no hours of it


def test_the_parts_list_names_every_part_and_sums(flat_grid, tmp_path):
    made = fabricable.uniform_design(flat_grid(4, 3, cut=lambda x, y: x == 2), SpiralParams(thickness=0.003))
    cut = sheets.make_sheets(made, SheetParams(nesting="FAST"), connectors=ConnectorParams(connector="key"))
    path = parts.write_parts_list(cut, [made], MATERIALS["birch"], tmp_path / "parts.csv")
    assert numbered_files.is_own_file(path)
    with open(path, encoding="utf-8", newline="") as stream:
        *rows, total = csv.DictReader(stream)
    panels, keys = ([row for row in rows if row["kind"] == kind] for kind in ("panel", "key"))
    assert [row["part"] for row in panels] == ["1", "2"] and len(keys) == 3
    assert [int(row["spirals"]) for row in panels] == [6, 6]
    assert [int(row["joints"]) for row in panels] == [3, 3]  # both sides of three
    assert all(row["sheet"] == "1" for row in panels)
    for row, panel in zip(rows, cut.panels, strict=True):
        shape = shapely.Polygon(panel.outline.sample(1e-6), [h.sample(1e-6) for h in panel.holes])
        assert float(row["area_cm2"]) == pytest.approx(shape.area * 1e4, abs=0.01)
        assert float(row["mass_g"]) == pytest.approx(680e3 * 0.003 * shape.area, abs=0.01)
    found = estimates.estimate(cut, made, MATERIALS["birch"])
    assert float(total["mass_g"]) == pytest.approx(1e3 * found.mass, abs=0.02)
    assert float(total["cut_length_mm"]) == pytest.approx(1e3 * cut.cut_length, abs=0.05)
    assert int(total["joints"]) == found.joints == 3  # every joint once
    assert total["part"] == "5 parts" and total["note"] == MARK


def test_every_contour_and_engraved_stroke_takes_its_time():
    def seconds(contours, strokes=0.0):
        return estimates.cut_seconds(MATERIALS["birch"], 0.003, 1.5, contours, strokes)

    each = seconds(1) - seconds(0)
    assert each > 0.0 and seconds(4) == pytest.approx(seconds(0) + 4.0 * each)
    assert seconds(4, 0.6) == pytest.approx(seconds(4) + 0.6 / estimates.ENGRAVING_SPEED)

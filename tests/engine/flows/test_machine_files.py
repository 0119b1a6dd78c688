"""What a machine decides about its files: line width, unit, nozzle, and how fine solids are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
import svgelements
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.fabrication import checks, sheets
from flexmaps.engine.fabrication.sheets import CutSheets
from flexmaps.engine.fabrication.writers import panel_solids, svg
from flexmaps.engine.params import CutParams, SheetParams, SpiralParams
from flexmaps.engine.patches.flattening.flatten import FlatPatches
from flexmaps.engine.spirals import fabricable
from flexmaps.engine.spirals.design import SpiralDesign


@pytest.fixture
def drawn(flat_grid: Callable[..., FlatPatches]) -> SpiralDesign:
    return fabricable.uniform_design(flat_grid(3, 2), SpiralParams(), width=0.001, twist=2.0)


@pytest.fixture
def made(drawn: SpiralDesign) -> CutSheets:
    return sheets.make_sheets(drawn, SheetParams(nesting="FAST"))


def boxes(text: str, folder: Path) -> np.ndarray:
    """The boxes of all paths in millimetres."""
    path = folder / "a.svg"
    path.write_text(text, encoding="utf-8")
    read = svgelements.SVG.parse(str(path), ppi=25.4).elements()
    return np.array([e.bbox() for e in read if isinstance(e, svgelements.Path)])


def test_inches_are_as_large_as_millimetres(made: CutSheets, tmp_path: Path) -> None:
    inches = svg.svg_document(replace(made, cut=CutParams(svg_unit="in")), 0)
    assert 'width="23.622in" height="15.748in"' in inches
    np.testing.assert_allclose(boxes(inches, tmp_path), boxes(svg.svg_document(made, 0), tmp_path), atol=1e-3)


@pytest.mark.parametrize(
    ("width", "unit", "wanted"), [(2.54e-5, "mm", "0.0254"), (1e-4, "mm", "0.1"), (1e-4, "in", "0.00393701")]
)
def test_lines_are_as_wide_as_the_machine_wants_them(made: CutSheets, width: float, unit: str, wanted: str) -> None:
    text = svg.svg_document(replace(made, cut=CutParams(line_width=width, svg_unit=unit)), 0)
    assert text.count(f'stroke-width="{wanted}"') == text.count("stroke-width") == 4


def test_arms_are_compared_with_the_nozzle(drawn: SpiralDesign) -> None:
    assert checks.check_nozzle(drawn, CutParams()) == checks.check_nozzle(drawn, CutParams(nozzle=0.0004)) == []
    (said,) = checks.check_nozzle(drawn, CutParams(nozzle=0.0006))
    assert "6 spirals are down to 1 mm wide, less than two lines of the nozzle of 0.6 mm" in said
    with pytest.raises(FlexMapsError, match=r"narrower than the nozzle of 1\.2 mm") as error:
        checks.check_nozzle(drawn, CutParams(nozzle=0.0012))
    assert error.value.faces == [0, 1, 2, 3, 4, 5]


def test_solids_are_as_fine_as_they_are_printed(made: CutSheets) -> None:
    panel = made.panels[0]
    solid = panel_solids.extrude_panel(panel, 0.002)
    fine = shapely.Polygon(panel.outline.sample(1e-7), [h.sample(1e-7) for h in panel.holes])
    flat = solid.vertices[: len(solid.vertices) // 2, :2]
    assert shapely.distance(shapely.points(flat), fine.boundary).max() < 1e-6
    rings = [panel.outline, *panel.holes]
    starts = np.cumsum([0, *(len(r.sample(panel_solids.TOLERANCE)) for r in rings)])
    lines = [shapely.LinearRing(flat[a:b]) for a, b in pairwise(starts.tolist())]
    away = [shapely.distance(shapely.points(r.sample(1e-7)), line).max() for r, line in zip(rings, lines, strict=True)]
    assert 1e-5 < max(away) <= 2.01e-5
    assert len(solid.triangles) < 0.55 * len(panel_solids.extrude_panel(panel, 0.002, 4e-6).triangles)

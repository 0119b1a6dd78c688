"""Pictures of a step: mixed colours, and seams that lie on the outline of the panel."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import shapely
from flexmaps.engine.extras.assembly_sheet.step_pictures import PageBox, PatchColours, draw_flat_panel, mix_colours
from flexmaps.engine.fabrication.writers.pdf import Page
from flexmaps.engine.patches.flattening.flatten import FlatPatches
from flexmaps.engine.patches.joining import assembly_steps
from flexmaps.engine.spirals.curves.arcs import Curve


class Sketch(Page):
    """A page that remembers areas, and lines with their colours."""

    def __init__(self) -> None:
        super().__init__(0.21, 0.297)
        self.areas: list[np.ndarray] = []
        self.lines: list[tuple[np.ndarray, str]] = []

    def fill_polygon(self, points: np.ndarray, *given: Any) -> None:
        self.areas.append(points)

    def draw_curve(self, curve: Curve, colour: str = "#000000", width: float = 2e-4) -> None:
        self.lines.append((curve.points, colour))


def test_the_seams_of_a_step_lie_on_the_outline_of_its_panel(flat_grid: Callable[..., FlatPatches]) -> None:
    flat = flat_grid(6, 3, cut=lambda x, y: x == 2)
    last, seam = assembly_steps(flat.layout)[-1], "#ff0000"
    (join,) = last.joins
    page, box = Sketch(), PageBox(0.02, 0.1, 0.08, 0.06)
    draw_flat_panel(page, box, flat, last, PatchColours(["#c0c0c0"] * 2, [seam]))
    outline = shapely.LinearRing(page.areas[0])
    assert shapely.box(box.x, box.y, box.x + box.width, box.y + box.height).contains(outline)
    drawn = shapely.union_all([shapely.LineString(points) for points, colour in page.lines if colour == seam])
    assert len(flat.layout.seams[join.seam]) == 3
    # the outline of its two by three quads is ten quads long, and the seam three
    assert outline.buffer(1e-9).contains(drawn) and drawn.length == pytest.approx(0.3 * outline.length)


def test_colours_are_mixed_by_their_shares() -> None:
    one, two = "#ff8010", "#01809f"
    assert mix_colours(one, two, 0.0) == one and mix_colours(one, two, 1.0) == two
    assert mix_colours(one, two, 0.5) == "#808058"  # 128, 128 and 87.5, which rounds to 88

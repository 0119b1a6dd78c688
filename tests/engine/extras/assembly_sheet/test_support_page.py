"""The page of eyelets: a picture at one scale, within the margins."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from flexmaps.engine.extras.assembly_sheet import support_page
from flexmaps.engine.extras.assembly_sheet.step_pictures import HEIGHT, MARGIN, WIDTH
from flexmaps.engine.fabrication.standing.base import Base
from flexmaps.engine.fabrication.standing.eyelets import Eyelet
from flexmaps.engine.fabrication.writers.pdf import Page
from flexmaps.engine.params import SpiralParams
from flexmaps.engine.patches.flattening.flatten import FlatPatches
from flexmaps.engine.spirals import fabricable


@pytest.mark.parametrize(("size", "scale"), [(0.02, 1.0), (0.2, None)])
def test_eyelets_are_drawn_where_they_are_held(
    monkeypatch: pytest.MonkeyPatch, flat_grid: Callable[..., FlatPatches], size: float, scale: float | None
) -> None:
    """A small piece at true size; a large one as wide as the page between its margins."""
    names: dict[str, tuple[float, float]] = {}

    def text(page: Page, words: str, at: tuple[float, float], *given: Any, is_centred: bool = False) -> None:
        if is_centred:
            names[words] = at

    areas: list[np.ndarray] = []
    monkeypatch.setattr(Page, "draw_text", text)
    monkeypatch.setattr(Page, "fill_polygon", lambda page, points, *_: areas.append(points))
    design = fabricable.uniform_design(flat_grid(4, 2, size), SpiralParams())
    places = size * np.array([[0.5, 0.5, 3.0], [3.5, 0.5, 3.0], [0.5, 1.5, 3.0]])
    eyelets = tuple(
        Eyelet(number, quad, 0, place[:2], 0.002, 0.001, place)
        for number, (quad, place) in enumerate(zip((0, 6, 1), places, strict=True), start=1)
    )
    support_page.draw_support_page(Base(design, (), (), 0.0, design.params.thickness, eyelets))
    drawn = np.array([names[one.name] for one in eyelets])
    scale = (WIDTH - 2 * MARGIN) / (4 * size) if scale is None else scale
    assert drawn - drawn[0] == pytest.approx(scale * (places - places[0])[:, :2])
    points = np.concatenate([*areas, drawn])
    low, high = points.min(axis=0), points.max(axis=0)
    assert (low > MARGIN - 1e-9).all() and (high < np.array([WIDTH, HEIGHT]) - MARGIN + 1e-9).all()

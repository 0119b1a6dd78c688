"""Sheets far too small for their panels are refused, with a size that would do."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.fabrication.nesting.sheet_count import refuse_many_sheets
from flexmaps.engine.params import SheetParams

TRIANGLE = 0.1 * np.array([[0, 0], [1, 0], [1, 1.0]])


def test_nearly_empty_sheets_are_refused_and_the_named_size_will_do() -> None:
    bars = [TRIANGLE * (1.0, 0.2)] * 40
    many = [*bars, *(2.0 * one for one in bars)]
    sheet = SheetParams(sheet_width=0.24, sheet_height=0.07, margin=0.003)
    with pytest.raises(FlexMapsError, match=r"About 40 sheets of 240 x 70 mm") as caught:
        refuse_many_sheets(many, sheet)
    size = re.search(r"sheets of (\d+) x (\d+) mm would do", str(caught.value))
    assert size is not None
    refuse_many_sheets(many, replace(sheet, sheet_width=int(size[1]) / 1e3, sheet_height=int(size[2]) / 1e3))
    refuse_many_sheets(many, replace(sheet, many_sheets=True))
    refuse_many_sheets(many[:10], sheet)  # few sheets are never too many


def _square(side: float) -> np.ndarray:
    return side * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]) + 0.3


def test_panels_are_counted_with_their_spacing_and_the_margins() -> None:
    """Four squares of 55 mm just fit on 130 x 130 mm less two margins of 5 mm, with 10 mm between them."""
    sheet = SheetParams(sheet_width=0.13, sheet_height=0.13, margin=0.005, spacing=0.01)
    refuse_many_sheets([_square(0.055)] * 44, sheet)
    # the area of 44 squares is that of 7.9 sheets, and one square a sheet is more than three times as many
    with pytest.raises(FlexMapsError, match=r"About 44 sheets of 130 x 130 mm .* area needs 8:"):
        refuse_many_sheets([_square(0.0551)] * 44, sheet)
    refuse_many_sheets([_square(0.0551)] * 10, sheet)
    for one in (replace(sheet, spacing=0.011), replace(sheet, margin=0.0055)):
        with pytest.raises(FlexMapsError, match=r"About 44 sheets"):
            refuse_many_sheets([_square(0.055)] * 44, one)


def test_three_times_the_sheets_that_the_area_needs_are_just_accepted() -> None:
    """Twelve triangles, one on every sheet of 0.01 m2: of 0.0033 m2 they need four sheets by area, of 0.0024 m2 three."""
    sheet = SheetParams(sheet_width=0.1, sheet_height=0.1, margin=0.0, spacing=0.0)
    refuse_many_sheets([TRIANGLE * 0.66**0.5] * 12, sheet)
    with pytest.raises(FlexMapsError, match=r"About 12 sheets of 100 x 100 mm .* area needs 3:"):
        refuse_many_sheets([TRIANGLE * 0.48**0.5] * 12, sheet)


def test_the_named_size_is_hardly_larger_than_it_has_to_be() -> None:
    """Four triangles of 52 mm on a sheet are enough, one is too few."""
    sheet = SheetParams(sheet_width=0.08, sheet_height=0.08, margin=0.005, spacing=0.01)
    with pytest.raises(FlexMapsError) as caught:
        refuse_many_sheets([TRIANGLE * 0.52] * 44, sheet)
    size = re.search(r"sheets of (\d+) x (\d+) mm would do, or a piece of (\d+) %", str(caught.value))
    assert size is not None
    width = int(size[1]) / 1e3
    # two in a row: 2 x 52 + 10 mm and both margins
    assert 0.124 <= width <= 0.124 * 1.05 + 0.01 and size[2] == size[1] and width == pytest.approx(round(width, 2))
    assert 0.9 * 80 / (1e3 * width) <= int(size[3]) / 100 <= 80 / 124

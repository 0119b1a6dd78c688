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

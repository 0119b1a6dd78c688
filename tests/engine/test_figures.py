"""Figures as people see them."""

from __future__ import annotations

import pytest
from flexmaps.engine.figures import format_figure
from hypothesis import given
from hypothesis import strategies as st


@given(st.floats(0.01, 1e4))
def test_a_figure_stays_near_its_value(number: float) -> None:
    text = format_figure(number)
    assert "e" not in text and float(text) == pytest.approx(number, rel=0.051)


def test_what_no_machine_cuts_counts_as_nothing() -> None:
    assert format_figure(0.0099) == format_figure(-0.0099) == "0"

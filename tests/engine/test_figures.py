"""Figures as people see them."""

from __future__ import annotations

import pytest
from flexmaps.engine.figures import format_figure, format_length
from hypothesis import given
from hypothesis import strategies as st


@given(st.floats(0.01, 1e4))
def test_a_figure_stays_near_its_value(number: float) -> None:
    text = format_figure(number)
    assert "e" not in text and float(text) == pytest.approx(number, rel=0.051)


def test_what_no_machine_cuts_counts_as_nothing() -> None:
    assert format_figure(0.0099) == format_figure(-0.0099) == "0"


@given(st.floats(1e-9, 1e9))
def test_a_length_is_never_a_power_of_ten(metres: float) -> None:
    number, unit = format_length(metres).split()
    assert "e" not in number.lower() and float(number) * {"mm": 1e-3, "m": 1.0}[unit] == pytest.approx(
        metres, rel=0.006
    )


def test_lengths_of_pieces() -> None:
    lengths = 0.0, 0.02182, 0.2094, 0.9999, 1.0, 303.0
    assert [format_length(one) for one in lengths] == ["0 mm", "21.8 mm", "209 mm", "1000 mm", "1 m", "303 m"]

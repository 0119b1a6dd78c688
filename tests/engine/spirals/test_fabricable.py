"""Designs that can be cut, and how long they can be waited for."""

from __future__ import annotations

from typing import Any

import pytest
from flexmaps.engine.params import LayoutParams, SpiralParams
from flexmaps.engine.patches.flattening import flatten
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.progress import Progress
from flexmaps.engine.spirals import fabricable
from flexmaps.engine.surface import shapes


def test_a_cancel_is_looked_for_before_and_after_the_clearance_model(monkeypatch: pytest.MonkeyPatch) -> None:
    params, events = SpiralParams(), []
    flat = flatten.flatten(trace.trace(shapes.dome(4), LayoutParams()), LayoutParams())
    design = fabricable.uniform_design(flat, params)
    original = fabricable.ClearanceModel.from_flat

    def from_flat(*args: Any) -> Any:
        events.append("model")
        return original(*args)

    monkeypatch.setattr(fabricable.ClearanceModel, "from_flat", from_flat)
    look = Progress(stopped=lambda: bool(events.append("look")))
    fabricable.make_fabricable(flat, params, design.width, design.twist, prove=False, progress=look)
    assert events[:3] == ["look", "model", "look"]

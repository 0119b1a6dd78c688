"""Designs that can be cut, and how long they can be waited for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from flexmaps.engine.errors import Cancelled
from flexmaps.engine.params import LayoutParams, SpiralParams
from flexmaps.engine.patches.flattening import flatten
from flexmaps.engine.patches.flattening.flatten import FlatPatches
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.progress import Progress
from flexmaps.engine.spirals import fabricable
from flexmaps.engine.surface import shapes


def test_a_cancel_is_looked_for_before_and_after_the_clearance_model(monkeypatch: pytest.MonkeyPatch) -> None:
    params, events = SpiralParams(), []
    flat = flatten.flatten(trace.trace_layout(shapes.dome(4), LayoutParams()), LayoutParams())
    design = fabricable.uniform_design(flat, params)
    original = fabricable.ClearanceModel.from_flat

    def from_flat(*args: Any) -> Any:
        events.append("model")
        return original(*args)

    monkeypatch.setattr(fabricable.ClearanceModel, "from_flat", from_flat)
    look = Progress(stopped=lambda: bool(events.append("look")))
    fabricable.make_fabricable(flat, params, design.width, design.twist, check_outlines=False, progress=look)
    assert events[:3] == ["look", "model", "look"]


def test_a_cancel_is_heard_while_the_spirals_around_a_new_solid_hub_are_restored(
    monkeypatch: pytest.MonkeyPatch, flat_grid: Callable[..., FlatPatches]
) -> None:
    """Straight arms as thin as they may be touch in one quad, so that it gets a solid hub; the cancel comes after that."""
    made = fabricable.uniform_design(flat_grid(10, 10), SpiralParams(), twist=0.0)
    thinnest = np.full_like(made.width, fabricable.slots.MIN_WIDTH_SHARE * made.params.width_min)
    monkeypatch.setattr(fabricable, "_quads_in_contact", lambda *_: (np.array([12]), None))
    restoring = []

    def set_solid(params: SpiralParams, width: np.ndarray, twist: np.ndarray, solid: np.ndarray) -> Any:
        restoring.append(np.flatnonzero(solid).tolist())
        return width, twist

    monkeypatch.setattr(fabricable, "with_solid_hubs", set_solid)
    with pytest.raises(Cancelled):
        fabricable.resolve_contacts(replace(made, width=thinnest), Progress(stopped=lambda: bool(restoring)), rounds=1)
    assert restoring == [[12]]

"""Wishes that spirals can fulfil, and those that they cannot."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.optimisation.optimise import optimise
from flexmaps.engine.optimisation.wishes import UNSTRAINED_MESSAGE, Wishes
from flexmaps.engine.params import LayoutParams, OptimiseParams, SimulateParams, SpiralParams
from flexmaps.engine.patches.flattening import flatten
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.spirals.fabricable import uniform_design
from flexmaps.engine.surface import shapes


@pytest.mark.parametrize(("name", "panels"), [("saddle", 1), pytest.param("dome", 5, marks=pytest.mark.thorough)])
def test_of_a_panel_that_lies_flat_spirals_change_nothing_and_it_is_said(name: str, panels: int) -> None:
    mesh = shapes.make(name, 0.04)
    mesh = mesh.with_vertices(mesh.vertices * (0.02 / mesh.median_edge))
    flat = flatten.flatten(trace.trace_layout(mesh, LayoutParams()), LayoutParams())
    assert len(flat.layout.patches) == panels
    offsets = np.zeros((len(mesh.quads), 3))
    offsets[0, 2] = 0.01
    params = OptimiseParams(iterations=2, codesign=False)
    wanted = Wishes.from_offsets(mesh, offsets)
    found = optimise(
        uniform_design(flat, SpiralParams()),
        mesh,
        MATERIALS["vero"],
        params,
        SimulateParams(),
        wishes=wanted,
        prove=False,
    ).report()
    assert found.get("wish", "") == (UNSTRAINED_MESSAGE if panels == 1 else "")
    assert (found["wished_mm"] < 0.9 * found["wished_mm_before"]) == (panels > 1)

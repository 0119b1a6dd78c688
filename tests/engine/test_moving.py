"""Panels whose points follow a design that is being painted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flexmaps.engine.display import solids
from flexmaps.engine.display.moving import MovingPanels
from flexmaps.engine.params import LayoutParams, SpiralParams
from flexmaps.engine.patches.flattening import flatten
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.spirals.design import uniform
from flexmaps.engine.spirals.painting import Stroke, painted
from flexmaps.engine.spirals.spiral import opposite_sides
from flexmaps.engine.surface import shapes


@pytest.mark.parametrize(
    ("border", "most"), [("stubs", 100_000), ("stubs", 1_000), ("rim", 100_000), ("left_out", 100_000)]
)
def test_moved_points_are_those_of_panels_made_anew(border: str, most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(solids.light, "__defaults__", ((), most, None))
    mesh = shapes.make("saddle", 0.025)
    flat = flatten.flatten(trace.trace(mesh, LayoutParams()), LayoutParams())
    design = uniform(flat, SpiralParams(border=border), twist=2.0)
    panels = MovingPanels(design)
    faces = panels.solid.corners
    inner = ~mesh.border[mesh.quad_edges].any(axis=1)
    inner &= inner[opposite_sides(mesh)[0]].all(axis=1)
    weight = np.where(inner & (np.arange(len(inner)) % 7 == 0), 0.6, 0.0)
    for brush in ("softer", "along"):
        design = painted(design, brush, weight, Stroke(direction=np.eye(3)[0]))
        before = panels.solid.vertices
        panels.follow(design)
        anew = MovingPanels(replace(design)).solid
        assert panels.solid.corners is faces, "its faces stay"
        if border != "left_out":  # Delaunay triangulations of round caps hang on their last digits
            np.testing.assert_array_equal(anew.corners, faces)
        np.testing.assert_allclose(panels.solid.vertices, anew.vertices, atol=1e-8)
        assert 1e-4 < np.abs(panels.solid.vertices - before).max() < 0.02
    everything = painted(design, "stiffer", np.full(len(inner), 0.5))  # border and all
    panels.follow(everything)
    np.testing.assert_allclose(panels.solid.vertices, MovingPanels(everything).solid.vertices, atol=1e-8)

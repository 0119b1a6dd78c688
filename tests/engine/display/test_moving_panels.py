"""Panels whose points follow a design that is being painted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flexmaps.engine.display import solids
from flexmaps.engine.display.moving_panels import MovingPanels
from flexmaps.engine.params import LayoutParams, SpiralParams
from flexmaps.engine.patches.flattening import flatten
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.spirals.curves.spiral import opposite_sides
from flexmaps.engine.spirals.fabricable import uniform_design
from flexmaps.engine.spirals.painting import Stroke, paint_spirals
from flexmaps.engine.surface import shapes


@pytest.mark.parametrize(
    ("border", "most"),
    [
        ("rim", 100_000),
        ("left_out", 1_000),
        *(
            pytest.param(*one, marks=pytest.mark.thorough)
            for one in (("stubs", 100_000), ("stubs", 1_000), ("left_out", 100_000), ("rim", 1_000))
        ),
    ],
)
def test_moved_points_are_those_of_panels_made_anew(border: str, most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(solids.make_light_solids, "__defaults__", ((), most, None))
    mesh = shapes.make("saddle", 0.025)
    flat = flatten.flatten(trace.trace_layout(mesh, LayoutParams()), LayoutParams())
    design = uniform_design(flat, SpiralParams(border=border), twist=2.0)
    panels = MovingPanels(design)
    faces = panels.solid.corners
    inner = ~mesh.border[mesh.quad_edges].any(axis=1)
    inner &= inner[opposite_sides(mesh)[0]].all(axis=1)
    weight = np.where(inner & (np.arange(len(inner)) % 7 == 0), 0.6, 0.0)
    for brush in ("softer", "along"):
        design = paint_spirals(design, brush, weight, Stroke(direction=np.eye(3)[0]))
        before = panels.solid.vertices
        panels.follow(design)
        anew = MovingPanels(replace(design)).solid
        assert panels.solid.corners is faces, "its faces stay"
        if border != "left_out":  # Delaunay triangulations of round caps hang on their last digits
            np.testing.assert_array_equal(anew.corners, faces)
        np.testing.assert_allclose(panels.solid.vertices, anew.vertices, atol=1e-8)
        assert 1e-4 < np.abs(panels.solid.vertices - before).max() < 0.02
    for brush in ("stiffer", "softer", "along"):  # border and all
        design = paint_spirals(design, brush, np.full(len(inner), 0.7), Stroke(direction=np.eye(3)[0]))
        before = areas(panels.solid, len(inner))
        panels.follow(design)
        anew = MovingPanels(replace(design)).solid
        assert panels.solid.corners is faces, "its faces stay there too"
        found, expected = areas(panels.solid, len(inner)), areas(anew, len(inner))
        np.testing.assert_allclose(found, expected, rtol=2e-3)  # half circles have another number of points
        assert np.abs(before / expected - 1.0).max() > 0.02
        if len(anew.vertices) == len(panels.solid.vertices):
            np.testing.assert_allclose(panels.solid.vertices, anew.vertices, atol=1e-8)


def areas(made: solids.PolygonSolid, quads: int) -> np.ndarray:
    """Square metres of all faces of every quad as seen from above, by the trapezes under their sides."""
    first = np.cumsum(made.sizes) - made.sizes
    onward = np.arange(1, len(made.corners) + 1)
    onward[first + made.sizes - 1] = first
    a, b = made.vertices[made.corners], made.vertices[made.corners[onward]]
    each = np.add.reduceat(0.5 * (a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]), first)
    return np.bincount(made.quad_of, np.abs(each), quads)

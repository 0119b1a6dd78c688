"""Strain that even the softest spirals take, known from the layout."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flexmaps.engine.extras.choosing.judge import LayoutProblem
from flexmaps.engine.extras.choosing.strain_forecast import strain_of_softest
from flexmaps.engine.optimisation.remedies import MAX_FACTOR, SOFTEST_LIMIT, size_of_softest
from flexmaps.engine.params import Settings
from flexmaps.engine.runs import job
from flexmaps.engine.simulation.simulate import simulate
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh

SETTINGS = Settings()


def laid(edge: float) -> job.Result:
    return job.run(PolygonMesh.from_quads(shapes.dome(4)), SETTINGS, edge=edge, stop_after="split")


def forecast(result: job.Result) -> float:
    strain = strain_of_softest(LayoutProblem(result.mesh, SETTINGS), result.flat)
    assert strain is not None
    return strain


def test_softest_spirals_are_strained_least() -> None:
    """Spirals of the curvature, at rest in the same panels, are strained more."""
    small = laid(0.006)
    design = job.run_stages(small, SETTINGS, ("spirals",)).design
    params = replace(SETTINGS.simulate, restarts=0)
    usual = simulate(design, small.mesh, SETTINGS.material.chosen, params).strain
    assert usual is not None and forecast(small) < usual.max()


def test_of_several_bodies_the_most_strained_counts() -> None:
    large, small = (one.mesh for one in (laid(0.02), laid(0.006)))
    vertices = np.concatenate([large.vertices, small.vertices + np.array([1.0, 0.0, 0.0])])
    both = PolygonMesh.from_quads(QuadMesh(vertices, np.concatenate([large.quads, small.quads + len(large.vertices)])))
    found = job.run(both, SETTINGS, stop_after="split")
    assert forecast(found) == pytest.approx(forecast(laid(0.006)), rel=0.05)


@pytest.mark.parametrize("edge", [0.0055, 0.006])
def test_as_large_as_advised_they_hold(edge: float) -> None:
    strain = forecast(laid(edge))
    times = size_of_softest(strain)
    assert 1.0 < times < MAX_FACTOR and strain > SOFTEST_LIMIT
    assert forecast(laid(times * edge)) <= SOFTEST_LIMIT
    assert size_of_softest(SOFTEST_LIMIT) == size_of_softest(None) == 1.0
    assert size_of_softest(1e3) == MAX_FACTOR


def test_a_layout_says_which_arms_would_break_or_which_match_to_expect(predicted_match: None) -> None:
    small, large = (laid(edge).flat.layout.notes for edge in (0.006, 0.02))
    assert "strain_softest" in small and "expected_percent" not in small
    assert "strain_softest" not in large and "expected_percent" in large

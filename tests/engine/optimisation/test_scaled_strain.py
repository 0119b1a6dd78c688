"""Strain of a piece in another size or of another sheet, without a search."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flexmaps.engine.optimisation.scaled_strain import forecast_strain
from flexmaps.engine.params import Settings
from flexmaps.engine.runs import job
from flexmaps.engine.simulation.simulate import simulate
from flexmaps.engine.spirals.fabricable import make_fabricable
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh

SETTINGS = Settings()
ALONE = replace(SETTINGS.simulate, restarts=0)


def test_a_larger_piece_is_strained_as_one_made_in_that_size() -> None:
    made = job.run(PolygonMesh.from_quads(shapes.dome(4)), SETTINGS, edge=0.006, stop_after="spirals")
    random = np.random.default_rng(3)
    width = random.uniform(0.001, 0.002, made.design.width.shape)
    twist = random.uniform(0.2, 1.0, made.design.twist.shape) * made.design.twist
    design = make_fabricable(made.flat, SETTINGS.spiral, width, twist, check_outlines=False)
    small = simulate(design, made.mesh, SETTINGS.material.chosen, ALONE)
    forecast = forecast_strain(small)
    assert forecast is not None and small.strain is not None
    assert forecast(1.0, SETTINGS.spiral.thickness) == pytest.approx(small.strain.max())
    for times in (1.1, 1.3):
        piece = job.scale_piece(job.with_design(made, design, "by_hand", SETTINGS), times, np.zeros(3), SETTINGS)
        np.testing.assert_array_equal(piece.design.width, design.width)
        large = simulate(piece.design, piece.mesh, SETTINGS.material.chosen, ALONE)
        assert large.strain is not None and large.strain.max() < small.strain.max()
        assert forecast(times, SETTINGS.spiral.thickness) == pytest.approx(large.strain.max(), rel=1e-6)

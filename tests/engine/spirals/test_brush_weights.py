"""Weights under a brush against their formulas, worked out for rectangles by hand."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.spirals.brush_weights import PaintSurface, combine_weights

SIDES = 0.03, 0.01  # of the rectangles, metres


@pytest.fixture(name="row", scope="module")
def _row() -> PaintSurface:
    """Five rectangles in a row along x, the first around the origin, facing up."""
    x, y = (k.ravel() for k in np.meshgrid(SIDES[0] * (np.arange(6) - 0.5), SIDES[1] * np.array([-0.5, 0.5])))
    first = np.arange(5)
    return PaintSurface.from_mesh(np.c_[x, y, 0.0 * x], np.stack([first, first + 1, first + 7, first + 6], axis=1))


def test_a_quad_begins_half_a_mean_side_from_its_centre(row: PaintSurface) -> None:
    np.testing.assert_allclose(row.centres, [[SIDES[0] * k, 0.0, 0.0] for k in range(5)], atol=1e-15)
    np.testing.assert_allclose(row.normals, [[0.0, 0.0, 1.0]] * 5, atol=1e-15)
    np.testing.assert_allclose(row.side_distance, 0.25 * sum(SIDES))


@pytest.mark.parametrize("radius", [0.005, 0.03, 0.07])
def test_a_dab_falls_off_smoothly_from_the_whole_quad_under_it(row: PaintSurface, radius: float) -> None:
    found = row.dab_weights(np.array([0.002, 0.003, 0.0]), np.array([0.0, 0.0, 1.0]), radius)
    away = np.maximum(np.hypot(SIDES[0] * np.arange(5) - 0.002, 0.003) - 0.01, 0.0)
    share = np.maximum(1.0 - away / radius, 0.0)
    np.testing.assert_allclose(found, 3.0 * share**2 - 2.0 * share**3, atol=1e-12)
    assert found[0] == 1.0 and found[-1] == 0.0


def test_a_dab_leaves_quads_that_face_away(row: PaintSurface) -> None:
    assert not row.dab_weights(np.zeros(3), np.array([0.0, 0.6, -0.8]), 1.0).any()
    assert (row.dab_weights(np.zeros(3), np.array([0.0, 0.99, 0.1]), 1.0) > 0.0).all()


def test_dabs_one_after_the_other_move_a_value_as_their_combined_weight_does() -> None:
    weights, goal = list(np.random.default_rng(1).uniform(size=(4, 6))), 3.0
    value = begin = np.linspace(-1.0, 2.0, 6)
    for weight in weights:
        value = value + weight * (goal - value)
    np.testing.assert_allclose(begin + combine_weights(weights) * (goal - begin), value, rtol=1e-12)

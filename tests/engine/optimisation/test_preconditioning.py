"""Units in which a matrix bends alike along all coordinates, against matrices whose bending is known."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.optimisation.bounded_step import bounded_step
from flexmaps.engine.optimisation.polytope import LinearClearances
from flexmaps.engine.optimisation.preconditioning import CurvatureEstimate

SIZE = 200


def spread(seed: int, decades: float) -> np.ndarray:
    """A matrix whose diagonal runs over so many decades, with couplings that leave it positive definite."""
    rng = np.random.default_rng(seed)
    half = np.eye(SIZE) + 0.3 * rng.normal(size=(SIZE, SIZE)) / np.sqrt(SIZE)
    unit = 10.0 ** rng.uniform(-0.5 * decades, 0.0, SIZE)
    return unit[:, None] * (half @ half.T) * unit


@pytest.mark.parametrize("seed", range(3))
def test_rows_become_alike(seed: int) -> None:
    matrix, bending = spread(seed, 8.0), CurvatureEstimate(SIZE)
    for _ in range(3):
        bending.refine(lambda way: matrix @ way)
    unit = bending.units(0.0, 0.0)
    rows = np.linalg.norm(unit[:, None] * matrix * unit, axis=1)
    assert np.ptp(np.log10(np.linalg.norm(matrix, axis=1))) > 3.0
    assert np.ptp(np.log10(rows)) < 1.5


def test_a_matrix_that_changes_is_followed() -> None:
    matrix, bending = spread(4, 8.0), CurvatureEstimate(SIZE)
    bending.refine(lambda way: matrix @ way)
    before = bending.units(0.0, 0.0)
    bending.refine(lambda way: 100.0 * (matrix @ way))
    ratio = before / bending.units(0.0, 0.0)
    # one refinement takes half of the way to ten times smaller units; random signs blur it
    assert 2.0 < np.median(ratio) < 20.0


def test_what_hardly_bends_moves_no_farther_than_from_end_to_end() -> None:
    bending = CurvatureEstimate(SIZE)
    bending.refine(lambda way: 0.0 * way)
    unit = bending.units(0.4, 0.0)
    # all coordinates, by one box each, change the objective by half of its value
    assert 0.5 * SIZE / unit[0] ** 2 == pytest.approx(0.5 * 0.4)
    np.testing.assert_allclose(bending.units(0.4, 1.0), 1.0, rtol=2e-3)


def test_steps_in_these_units_come_much_nearer() -> None:
    matrix, bending, rng = spread(5, 8.0), CurvatureEstimate(SIZE), np.random.default_rng(5)
    bending.refine(lambda way: matrix @ way)
    # every coordinate has its share in the fall, the more softly it bends the farther it goes
    exact = rng.choice([-1.0, 1.0], SIZE) / np.sqrt(np.diag(matrix))
    exact *= 0.4 / np.abs(exact).max()
    gradient, x = -matrix @ exact, np.full(SIZE, 0.5)
    best = 0.5 * float(gradient @ exact)

    def share(units: np.ndarray | None) -> float:
        step = bounded_step(x, gradient, lambda way: matrix @ way, LinearClearances.empty(SIZE), units)
        return float(gradient @ step + 0.5 * step @ matrix @ step) / best

    assert share(bending.units(0.0, 0.0)) > 0.95
    assert share(None) < 0.8

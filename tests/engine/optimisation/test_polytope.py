"""Projections onto a box and linear clearances, against a solver of quadratic programmes."""

from __future__ import annotations

import numpy as np
import pytest
from cvxopt import matrix, solvers
from flexmaps.engine.optimisation.polytope import MAX_DENSE_ROWS, LinearClearances, Polytope, Projection
from scipy.sparse import block_diag, csr_array, random_array, vstack

solvers.options["show_progress"] = False


def polytope(size: int, rows: int, seed: int) -> Polytope:
    """A polytope with many gaps that are closed or nearly so, each fourth of them twice."""
    rng = np.random.default_rng(seed)
    slope = csr_array(random_array((rows, size), density=6.0 / size, rng=rng, data_sampler=rng.normal))
    room = np.maximum(rng.uniform(-0.05, 0.1, rows), 0.0)
    twice = np.concatenate([np.arange(rows), np.arange(0, rows, 4)])
    linear_clearances = LinearClearances.from_clearances(room[twice], csr_array(vstack([slope, slope[::4]])))
    return Polytope(-rng.uniform(0.0, 0.5, size), rng.uniform(0.0, 0.5, size), linear_clearances)


@pytest.mark.parametrize("far", [0.1, 0.3, 1.0])
@pytest.mark.parametrize("seed", range(8))
def test_the_nearest_step_is_that_of_a_quadratic_programme(seed: int, far: float) -> None:
    bounds = polytope(60, 80, seed)
    step = far * np.random.default_rng(seed + 100).normal(size=60)
    sides = np.vstack([np.eye(60), -np.eye(60), -bounds.slope.toarray()])
    ends = np.concatenate([bounds.high, -bounds.low, bounds.clearances(np.zeros(60))])
    exact = np.array(solvers.qp(matrix(np.eye(60)), matrix(-step), matrix(sides), matrix(ends))["x"]).ravel()
    found = bounds.nearest(step)
    assert found.point == pytest.approx(exact, abs=5e-3)
    assert (found.point >= bounds.low).all() and (found.point <= bounds.high).all()
    assert bounds.clearances(found.point).min() > -2e-3
    assert bounds.clearances(found.point)[found.active] == pytest.approx(0.0, abs=2e-3)
    # it is its own nearest step
    assert bounds.nearest(found.point).point == pytest.approx(found.point, abs=2e-3)


def test_what_lies_inside_stays_where_it_is() -> None:
    bounds = polytope(60, 80, 1)
    inside = 0.5 * bounds.nearest(np.ones(60)).point
    found = bounds.nearest(inside)
    np.testing.assert_allclose(found.point, inside, atol=1e-3)


def test_a_step_that_closed_gaps_block_takes_few_evaluations(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(5)
    slope = csr_array(random_array((60, 300), density=0.02, rng=rng, data_sampler=rng.normal))
    linear_clearances = LinearClearances.from_clearances(np.zeros(60), slope)
    bounds, evaluations, dual = Polytope(np.full(300, -1.0), np.full(300, 1.0), linear_clearances), [], Polytope._dual
    monkeypatch.setattr(Polytope, "_dual", lambda *given: evaluations.append(1) or dual(*given))
    step = -np.asarray(linear_clearances.slope.T @ rng.uniform(0.1, 1.0, linear_clearances.slope.shape[0]))
    np.testing.assert_allclose(bounds.nearest(step).point, 0.0, atol=1e-5)
    assert len(evaluations) < 300


def test_clearances_that_are_violated_already_do_not_force_a_step() -> None:
    linear_clearances = LinearClearances.from_clearances(np.array([-0.1]), csr_array(np.array([[1.0, 0.0]])))
    bounds = Polytope(np.full(2, -1.0), np.full(2, 1.0), linear_clearances)
    np.testing.assert_allclose(bounds.nearest(np.zeros(2)).point, 0.0)
    np.testing.assert_allclose(bounds.nearest(np.array([-0.5, 0.3])).point, [0.0, 0.3], atol=1e-3)


@pytest.mark.parametrize("copies", [1, 2 * MAX_DENSE_ROWS])
def test_projections_leave_rows_as_they_are_also_where_some_are_alike(copies: int) -> None:
    rows = csr_array(np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.6, 0.8, 0.0]]))
    many = Projection(csr_array(block_diag([rows] * copies)))
    assert many.least_norm_solution(np.tile([0.1, 0.1, 0.2], copies)) == pytest.approx(
        np.tile(Projection(rows).least_norm_solution(np.array([0.1, 0.1, 0.2])), copies), abs=1e-9
    )
    onto = Projection(rows)
    along = onto.project(np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(rows @ along, 0.0, atol=1e-5)
    assert along[2] == 3.0
    np.testing.assert_allclose(rows @ onto.least_norm_solution(np.array([0.1, 0.1, 0.2])), [0.1, 0.1, 0.2], atol=1e-5)


def test_other_units_change_the_length_of_slopes_and_not_which_steps_are_possible() -> None:
    linear_clearances = LinearClearances.from_clearances(np.array([0.5]), csr_array(np.array([[3.0, 4.0]])))
    units = np.array([2.0, 0.1])
    scaled = linear_clearances.scaled(units)
    np.testing.assert_allclose(np.linalg.norm(scaled.slope.toarray(), axis=1), 1.0)
    step = np.random.default_rng(0).normal(size=(2, 20))
    there = (scaled.clearance[:, None] + scaled.slope @ step) / (
        linear_clearances.clearance[:, None] + linear_clearances.slope @ (units[:, None] * step)
    )
    np.testing.assert_allclose(there, there[0, 0])
    assert there[0, 0] > 0.0

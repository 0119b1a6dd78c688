"""Steps of a quadratic model within a box and linear clearances, against a solver of quadratic programmes."""

from __future__ import annotations

import numpy as np
import pytest
from cvxopt import matrix, solvers
from flexmaps.engine.optimisation.bounded_step import bounded_step
from flexmaps.engine.optimisation.polytope import LinearClearances
from scipy.sparse import csr_array, random_array


def quadratic(size: int, rows: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, LinearClearances]:
    """x, gradient, matrix and rooms; some of the rooms are closed, some coordinates at an end."""
    rng = np.random.default_rng(seed)
    half = rng.normal(size=(size, size))
    x = np.clip(rng.uniform(-0.2, 1.2, size), 0.0, 1.0)
    slope = csr_array(random_array((rows, size), density=4.0 / size, rng=rng, data_sampler=rng.normal))
    room = np.maximum(rng.uniform(-0.02, 0.1, rows), 0.0)
    return (
        x,
        0.1 * rng.normal(size=size),
        half @ half.T / size + 0.3 * np.eye(size),
        LinearClearances.from_clearances(room, slope),
    )


def solved(x: np.ndarray, gradient: np.ndarray, hessian: np.ndarray, linear_clearances: LinearClearances) -> float:
    """The least value of the model within the bounds, by an interior-point method."""
    size = len(x)
    sides = np.vstack([np.eye(size), -np.eye(size), -linear_clearances.slope.toarray()])
    bounds = np.concatenate([1.0 - x, x, linear_clearances.clearance])
    solvers.options["show_progress"] = False
    return float(solvers.qp(matrix(hessian), matrix(gradient), matrix(sides), matrix(bounds))["primal objective"])


@pytest.mark.parametrize("decades", [0.0, 3.0])
@pytest.mark.parametrize("seed", range(6))
def test_a_step_keeps_the_bounds_and_comes_near_to_the_best_one(seed: int, decades: float) -> None:
    x, gradient, hessian, linear_clearances = quadratic(60, 40, seed)
    # coordinates that bend by so many decades more and less than others, and units that make up for that
    bend = 10.0 ** np.random.default_rng(seed).uniform(-0.5 * decades, 0.5 * decades, len(x))
    gradient, hessian = np.sqrt(bend) * gradient, np.sqrt(bend)[:, None] * hessian * np.sqrt(bend)
    step = bounded_step(x, gradient, lambda v: hessian @ v, linear_clearances, 1.0 / np.sqrt(bend) if decades else None)
    assert (x + step >= 0.0).all() and (x + step <= 1.0).all()
    assert (linear_clearances.clearance + linear_clearances.slope @ step).min() > -2e-3
    value = float(gradient @ step + 0.5 * step @ hessian @ step)
    assert value < 0.9 * solved(x, gradient, hessian, linear_clearances) < 0.0


def test_without_bounds_in_the_way_it_is_newton_s_step() -> None:
    x, gradient, hessian, _ = quadratic(30, 1, 7)
    x = np.full_like(x, 0.5)
    small = 1e-3 * gradient
    step = bounded_step(x, small, lambda v: hessian @ v, LinearClearances.empty(30))
    exact = -np.linalg.solve(hessian, small)
    assert np.linalg.norm(step - exact) < 0.2 * np.linalg.norm(exact)

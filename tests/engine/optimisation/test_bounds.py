"""Steps within a box and linear bounds, against a solver of quadratic programmes; designs that are brought back."""

from __future__ import annotations

import numpy as np
import pytest
from cvxopt import matrix, solvers
from flexmaps.engine.optimisation.bounds import (
    DENSE,
    ClearanceProblem,
    LinearClearances,
    Projection,
    bounded_step,
    narrowest_per_pair,
    restore_clearances,
)
from flexmaps.engine.spirals.clearance.room import Terms
from scipy.sparse import block_diag, csr_array, random_array


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


def solved(x: np.ndarray, gradient: np.ndarray, hessian: np.ndarray, rooms: LinearClearances) -> float:
    """The least value of the model within the bounds, by an interior-point method."""
    size = len(x)
    sides = np.vstack([np.eye(size), -np.eye(size), -rooms.slope.toarray()])
    bounds = np.concatenate([1.0 - x, x, rooms.room])
    solvers.options["show_progress"] = False
    return float(solvers.qp(matrix(hessian), matrix(gradient), matrix(sides), matrix(bounds))["primal objective"])


@pytest.mark.parametrize("decades", [0.0, 3.0])
@pytest.mark.parametrize("seed", range(6))
def test_a_step_keeps_the_bounds_and_comes_near_to_the_best_one(seed: int, decades: float) -> None:
    x, gradient, hessian, rooms = quadratic(60, 40, seed)
    # coordinates that bend by so many decades more and less than others, and units that make up for that
    bend = 10.0 ** np.random.default_rng(seed).uniform(-0.5 * decades, 0.5 * decades, len(x))
    gradient, hessian = np.sqrt(bend) * gradient, np.sqrt(bend)[:, None] * hessian * np.sqrt(bend)
    step = bounded_step(x, gradient, lambda v: hessian @ v, rooms, 100, 1.0 / np.sqrt(bend) if decades else None)
    assert (x + step >= 0.0).all() and (x + step <= 1.0).all()
    # what it runs into in the last round is brought back later
    assert (rooms.room + rooms.slope @ step > -0.02).mean() > 0.9
    value = float(gradient @ step + 0.5 * step @ hessian @ step)
    # a few rounds do not find every bound that counts in the end, the outer iteration does
    assert value < 0.4 * solved(x, gradient, hessian, rooms) < 0.0


def test_without_bounds_in_the_way_it_is_newton_s_step() -> None:
    x, gradient, hessian, _ = quadratic(30, 1, 7)
    x = np.full_like(x, 0.5)
    small = 1e-3 * gradient
    step = bounded_step(x, small, lambda v: hessian @ v, LinearClearances.none(30), 200)
    exact = -np.linalg.solve(hessian, small)
    assert np.linalg.norm(step - exact) < 0.2 * np.linalg.norm(exact)


def test_the_narrowest_gap_of_every_pair_of_arms_is_kept() -> None:
    """Arm 0, whose mate is arm 9, has gaps to arms 1 (at three places) and 2, and its own inner edge and winding."""
    arms = np.array([[0, 9, 1, 8], [0, 9, 2, 7], [0, 9, 1, 8], [0, 9, 0, 9], [0, 9, 1, 8], [0, 0, 0, 0]])
    value = np.array([0.3, 0.5, 0.1, 0.4, 0.2, 0.6])
    found = narrowest_per_pair(Terms(value, csr_array(np.diag(value)), csr_array(np.diag(-value)), arms))
    assert sorted(found.value) == [0.1, 0.4, 0.5, 0.6]
    assert found.by_flat is not None
    for row, by, flat, pair in zip(
        found.value, found.by_design.toarray(), found.by_flat.toarray(), found.arms, strict=True
    ):
        assert by.sum() == row == -flat.sum()
        assert (arms[value == row] == pair).all()


@pytest.mark.parametrize("copies", [1, 2 * DENSE])
def test_projections_leave_rows_as_they_are_also_where_some_are_alike(copies: int) -> None:
    rows = csr_array(np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.6, 0.8, 0.0]]))
    many = Projection(csr_array(block_diag([rows] * copies)))
    assert many.least(np.tile([0.1, 0.1, 0.2], copies)) == pytest.approx(
        np.tile(Projection(rows).least(np.array([0.1, 0.1, 0.2])), copies), abs=1e-9
    )
    onto = Projection(rows)
    along = onto.along(np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(rows @ along, 0.0, atol=1e-5)
    assert along[2] == 3.0
    np.testing.assert_allclose(rows @ onto.least(np.array([0.1, 0.1, 0.2])), [0.1, 0.1, 0.2], atol=1e-5)


def test_what_closes_is_brought_back_and_what_stays_closed_does_not_go() -> None:
    """Three coordinates; the first two may not be more than 1 together, and the third not beyond 0.5, of which the slope is wrong."""

    def rooms(y: np.ndarray, quads: np.ndarray | None) -> LinearClearances:
        slopes = csr_array(np.array([[-1.0, -1.0, 0.0], [0.0, 0.0, 1.0]]))
        return LinearClearances.from_clearances(np.array([1.0 - y[0] - y[1], 0.5 - y[2]]), slopes)

    def shut(y: np.ndarray, quads: np.ndarray | None) -> np.ndarray:
        return np.array([y[0] + y[1] >= 1.0, y[0] + y[1] >= 1.0, y[2] > 0.5])

    inner = np.array([0.2, 0.2, 0.3])
    found = restore_clearances(
        np.array([0.8, 0.6, 0.9]), inner, ClearanceProblem(rooms, shut, lambda share: share, 3, 3)
    )
    assert not shut(found, None).any()
    assert found[0] + found[1] == pytest.approx(1.0, abs=3e-3) and found[0] - found[1] == pytest.approx(0.2, abs=1e-6)
    assert 0.3 <= found[2] <= 0.5

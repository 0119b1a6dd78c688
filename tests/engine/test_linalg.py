"""Both backends of the sparse Cholesky factorisation against scipy's dense solution."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.linalg import NotPositiveDefinite, SparseCholesky, SparsityPattern
from scipy.sparse import random as sparse_random


@pytest.fixture
def system():
    a = sparse_random(120, 120, 0.05, random_state=1)
    return (a @ a.T).toarray() + np.eye(120)


@pytest.fixture(params=["cvxopt", "superlu"])
def backend(request):
    if request.param == "cvxopt":
        pytest.importorskip("cvxopt")
    return request.param


def test_solves_like_dense_and_factors_again(system, backend):
    rows, cols = np.nonzero(system)
    pattern = SparsityPattern(rows, cols, 120)
    solver = SparseCholesky(pattern, backend)
    rhs = np.random.default_rng(0).normal(size=(120, 3))
    for factor in (1.0, 2.5):
        values = pattern.sum(factor * system[rows, cols])
        assert np.allclose(pattern.matrix(values).toarray(), factor * system)
        solver.factor(values)
        assert np.allclose(solver.solve(rhs), np.linalg.solve(factor * system, rhs), rtol=1e-10, atol=1e-12)
        assert solver.solve(rhs[:, 0]).shape == (120,)


def test_repeated_triplets_add_up():
    pattern = SparsityPattern(np.array([0, 1, 1, 0, 1]), np.array([0, 0, 0, 1, 1]), 2)
    found = pattern.matrix(pattern.sum(np.array([4.0, 0.5, 0.25, 9.0, 3.0]))).toarray()
    assert np.allclose(found, [[4.0, 0.75], [0.75, 3.0]])


def test_refuses_indefinite_and_recovers(system, backend):
    rows, cols = np.nonzero(system)
    pattern = SparsityPattern(rows, cols, 120)
    solver = SparseCholesky(pattern, backend)
    good = pattern.sum(system[rows, cols])
    with pytest.raises(NotPositiveDefinite):
        solver.factor(pattern.sum((system - 3.0 * np.eye(120))[rows, cols]))
    with pytest.raises(NotPositiveDefinite):
        solver.factor(np.full_like(good, np.nan))
    solver.factor(good)
    assert np.allclose(solver.solve(system[:, 0]), np.eye(120)[0], atol=1e-9)

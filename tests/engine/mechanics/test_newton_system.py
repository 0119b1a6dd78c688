"""Linear systems of joints against dense matrices built by hand, with numpy's solver and scipy's eigenvalues."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from flexmaps.engine.mechanics import newton_system
from flexmaps.engine.mechanics.newton_system import NewtonSystem
from scipy.linalg import eigh

HUBS = 7
PAIRS = np.array([[k, k + 1] for k in range(HUBS - 1)] + [[6, 0], [5, 2]])


def blocks(seed: int) -> np.ndarray:
    """Symmetric positive definite blocks (m, 12, 12), one for every joint."""
    root = np.random.default_rng(seed).normal(size=(len(PAIRS), 12, 12))
    return root @ root.transpose(0, 2, 1) + 2.0 * np.eye(12)


def dense(parts: np.ndarray, hubs: int = HUBS) -> np.ndarray:
    """The sum of all blocks at the rows and columns of their two hubs."""
    whole = np.zeros((6 * hubs, 6 * hubs))
    for pair, part in zip(PAIRS, parts, strict=True):
        rows = np.concatenate([6 * one + np.arange(6) for one in pair])
        whole[np.ix_(rows, rows)] += part
    return whole


@pytest.fixture
def held() -> np.ndarray:
    mask = np.zeros((HUBS, 6), dtype=bool)
    mask[0] = True
    mask[4, 1:3] = True
    return mask


def test_a_solution_is_that_of_the_free_increments_and_zero_elsewhere(held: np.ndarray) -> None:
    system, parts, free = NewtonSystem(PAIRS, held), blocks(1), ~held.ravel()
    right = np.random.default_rng(2).normal(size=(HUBS, 6))
    assert system.factor(system.values(parts))
    wanted = np.zeros(6 * HUBS)
    wanted[free] = np.linalg.solve(dense(parts)[np.ix_(free, free)], right.ravel()[free])
    np.testing.assert_allclose(system.solve(right), wanted.reshape(HUBS, 6), rtol=1e-9, atol=1e-12)
    assert not system.factor(system.values(-parts))
    assert system.count_negative(system.values(-parts)) == free.sum() == HUBS * 6 - 8


def test_nodes_beyond_the_hubs_are_free_and_their_rows_may_be_missing(held: np.ndarray) -> None:
    short, parts = NewtonSystem(PAIRS, held[:5]), blocks(1)
    assert short.held.shape == (HUBS, 6) and not short.held[5:].any()
    force = np.random.default_rng(2).normal(size=(5, 6))
    entries = short.free_entries(force)
    np.testing.assert_array_equal(entries[-12:], 0.0)
    assert short.factor(short.values(parts))
    np.testing.assert_allclose(
        short.solve(force), NewtonSystem(PAIRS, short.held).expand(np.linalg.solve(
            dense(parts)[np.ix_(short.free, short.free)], entries)), rtol=1e-9, atol=1e-12,
    )  # fmt: skip


def test_a_semidefinite_matrix_becomes_definite_by_a_share_of_its_diagonal(held: np.ndarray) -> None:
    system = NewtonSystem(PAIRS, held)
    parts = blocks(3)
    parts[:, :, 3:6] = parts[:, 3:6] = 0.0  # no stiffness in the turns of the first hub of every joint
    values = system.values(parts)
    made = system.make_definite(values, 1e-6)
    before, after = (system.pattern.matrix(v).toarray() for v in (values, made))
    change = after - before
    diagonal = np.diag(before)
    np.testing.assert_allclose(change, np.diag(1e-6 * diagonal + 1e-9 * diagonal.max()), rtol=1e-6, atol=1e-15)
    assert system.factor(made) and values is not made


@pytest.mark.parametrize("fewest", [0, 1000])
@pytest.mark.parametrize("find", ["softest_modes", "softest_at_minimum"])
def test_softest_modes_are_scipys_and_of_unit_length_in_the_metric(
    held: np.ndarray, find: str, fewest: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By Lanczos and with dense matrices."""
    monkeypatch.setattr(newton_system, "MAX_DENSE_SIZE", fewest)
    system = NewtonSystem(PAIRS, held)
    values, metric = (system.values(blocks(seed)) for seed in (4, 5))
    more: Any = {"tolerance": 1e-9} if find == "softest_modes" else {}
    assert system.factor(values)
    modes, rise = getattr(system, find)(values, metric, 3, **more)
    full = [dense(blocks(seed))[np.ix_(system.free, system.free)] for seed in (4, 5)]
    wanted, vectors = eigh(*full)
    np.testing.assert_allclose(rise, wanted[:3], rtol=1e-6)
    assert modes.shape == (3, HUBS, 6) and not modes[:, held].any()
    for mode, vector in zip(modes, vectors.T, strict=False):
        entries = system.free_entries(mode)
        assert entries @ full[1] @ entries == pytest.approx(1.0, rel=1e-6)
        assert abs(entries @ full[1] @ vector) == pytest.approx(1.0, rel=1e-5)


def test_without_free_increments_there_is_one_mode_of_zeros() -> None:
    system = NewtonSystem(PAIRS, np.ones((HUBS, 6), dtype=bool))
    modes, rise = system.softest_modes(np.zeros(0), np.zeros(0))
    assert modes.shape == (1, HUBS, 6) and not modes.any() and rise.tolist() == [1.0]

"""The excess of strains as a term of the objective: its derivatives, and what steps expect of it."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.optimisation.terms import MAX_MULTIPLIER, Jacobian, StrainLimit, StrainTerm
from scipy.sparse import csr_array, eye_array

JOINTS = 3


@pytest.fixture
def strains() -> np.ndarray:
    """(m, 2) as shares of the limit, some of them beyond it."""
    return np.random.default_rng(4).uniform(0.2, 1.8, size=(JOINTS, 2))


def excess(strains: np.ndarray, pushes: float) -> StrainTerm:
    """Of strains that are themselves the coordinates."""
    strain_limit = StrainLimit(MATERIALS["vero"], 1.0, multipliers=np.full((JOINTS, 2), pushes))
    sizes = csr_array(strain_limit.limit * eye_array(strains.size))
    return StrainTerm(
        strain_limit, strain_limit.limit * strains, lambda arms: Jacobian(csr_array((len(arms), 6)), sizes[arms])
    )


def test_its_gradient_against_differences(strains: np.ndarray) -> None:
    here, step = excess(strains, 0.5), 1e-6
    assert here.value > 0.0
    for k in range(strains.size):
        moved = [
            excess(strains + sign * step * np.eye(strains.size)[k].reshape(strains.shape), 0.5) for sign in (1, -1)
        ]
        slope = (moved[0].value - moved[1].value) / (2.0 * step)
        assert np.asarray(here.gradient.by_coordinates)[k] == pytest.approx(slope, rel=1e-6, abs=1e-10)


@pytest.mark.parametrize("pushes", [0.3, MAX_MULTIPLIER])
def test_no_step_is_promised_more_than_it_brings(strains: np.ndarray, pushes: float) -> None:
    """The model of a step lies above the objective where all arms are felt."""
    strains = strains + 1.0
    here, hubs = excess(strains, pushes), np.zeros((1, 6))
    rng = np.random.default_rng(5)
    for step in (-strains, *rng.normal(size=(50, *strains.shape))):
        change = step.ravel()
        pulled = np.asarray(here.gauss_newton_product(hubs, change).by_coordinates)
        model = here.value + np.asarray(here.gradient.by_coordinates) @ change + 0.5 * change @ pulled
        assert excess(strains + step, pushes).value <= model * (1.0 + 1e-9)


@pytest.mark.parametrize("pushes", [0.3, MAX_MULTIPLIER])
def test_what_it_foretells_of_strains_that_follow_a_step_is_exact(strains: np.ndarray, pushes: float) -> None:
    here, hubs = excess(strains + 0.5, pushes), np.zeros((1, 6))
    for step in np.random.default_rng(6).normal(size=(20, *strains.shape)) * 0.3:
        ahead, there = here.after_step(hubs, step.ravel()), excess(strains + 0.5 + step, pushes)
        assert ahead.value == pytest.approx(there.value, rel=1e-9)
        np.testing.assert_allclose(
            np.asarray(ahead.gradient.by_coordinates), np.asarray(there.gradient.by_coordinates), rtol=1e-9
        )


def test_a_larger_weight_leaves_the_force_of_the_multipliers() -> None:
    pushes = np.array([[0.3, 0.0], [1.0, 0.2]])
    given = StrainLimit(MATERIALS["vero"], 1.0, weight=2.0, multipliers=pushes)
    larger, same = given.with_weight_at_least(5.0), given.with_weight_at_least(1.0)
    assert (larger.weight, same.weight) == (5.0, 2.0)
    assert larger.multipliers is not None
    assert larger.weight * larger.multipliers == pytest.approx(2.0 * pushes)


def test_products_need_only_rows_with_a_second_derivative() -> None:
    rng = np.random.default_rng(1)
    rows = Jacobian(csr_array(rng.normal(size=(5, 12))), csr_array(rng.normal(size=(5, 3))))
    increments, change, curvature = rng.normal(size=(2, 6)), rng.normal(size=3), np.array([0.0, 2.0, 0.0, 0.5, 0.0])
    some, kept = rows.drop_zero_curvature(curvature)
    confined = kept.vjp(some * kept.jvp(increments, change))
    whole = rows.vjp(curvature * rows.jvp(increments, change))
    assert kept.by_hubs.shape[0] == 2
    assert confined.by_hubs == pytest.approx(whole.by_hubs)
    assert confined.by_coordinates == pytest.approx(whole.by_coordinates)

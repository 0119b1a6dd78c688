"""The excess of strains as a term of the objective: its derivatives, and what steps expect where components change their signs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.optimisation.terms import HOPELESS, Bearing, Excess, Rows
from scipy.sparse import csr_array, diags_array, eye_array

JOINTS = 3


@pytest.fixture
def wrench() -> Any:
    """(m, 2, 6) components of wrenches of either sign, as shares of the limit that they add."""
    return np.random.default_rng(4).uniform(-0.5, 0.5, size=(JOINTS, 2, 6))


def excess(wrench: np.ndarray, pushes: float) -> Excess:
    """Of strains whose coordinates are the components themselves."""
    bearing = Bearing(MATERIALS["vero"], 1.0, pushes=np.full((JOINTS, 2), pushes))
    parts = bearing.limit * np.abs(wrench)
    sizes = csr_array(diags_array(bearing.limit * np.sign(wrench).ravel()) @ eye_array(wrench.size))

    def changes(arms: np.ndarray) -> Rows:
        rows = (6 * arms[:, None] + np.arange(6)).ravel()
        return Rows(csr_array((len(rows), 6)), sizes[rows])

    return Excess(bearing, parts, changes)


def test_its_gradient_against_differences(wrench: np.ndarray) -> None:
    here, step = excess(wrench, 0.5), 1e-6
    assert here.value > 0.0
    for k in range(wrench.size):
        moved = [excess(wrench + sign * step * np.eye(wrench.size)[k].reshape(wrench.shape), 0.5) for sign in (1, -1)]
        slope = (moved[0].value - moved[1].value) / (2.0 * step)
        assert np.asarray(here.gradient.own)[k] == pytest.approx(slope, rel=1e-6, abs=1e-10)


@pytest.mark.parametrize("pushes", [0.3, HOPELESS])
def test_no_step_is_promised_more_than_it_brings(wrench: np.ndarray, pushes: float) -> None:
    """The model of a step lies above the objective, also where all components change their signs."""
    here, hubs = excess(wrench, pushes), np.zeros((1, 6))
    rng = np.random.default_rng(5)
    for step in (-wrench, -2.0 * wrench, *rng.normal(size=(50, *wrench.shape))):
        change = step.ravel()
        pulled = np.asarray(here.product(hubs, change).own)
        model = here.value + np.asarray(here.gradient.own) @ change + 0.5 * change @ pulled
        assert excess(wrench + step, pushes).value <= model * (1.0 + 1e-9)

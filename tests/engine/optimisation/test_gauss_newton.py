"""Steps of a search: damping of rotations after a step to a lost equilibrium, and shortened steps."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from flexmaps.engine.optimisation import gauss_newton
from flexmaps.engine.optimisation.preconditioning import CurvatureEstimate
from flexmaps.engine.optimisation.terms import rotation_damping_gradient
from flexmaps.engine.params import OptimiseParams
from flexmaps.engine.progress import SILENT


@pytest.mark.parametrize("still", [0, 90])
def test_rotations_of_a_lost_step_cost_more_than_it_promised(still: int) -> None:
    """Hubs that do not turn make no difference."""
    start: Any = SimpleNamespace()
    problem = gauss_newton._GaussNewtonProblem(
        OptimiseParams(), gauss_newton.SearchRecord(), lambda _: None, SILENT, start, CurvatureEstimate(1)
    )
    increments = np.concatenate([np.random.default_rng(3).normal(size=(10, 6)), np.zeros((still, 6))])
    damping = problem.min_following(gauss_newton._Proposal(np.zeros(1), increments, 0.3))
    cost = 0.5 * float((rotation_damping_gradient(damping, increments).by_hubs * increments).sum())
    assert cost == pytest.approx(0.3 * gauss_newton.GENTLE_COST) and cost > 0.3


def test_a_shortened_step_keeps_its_direction_and_predicts_its_own_decrease(monkeypatch: pytest.MonkeyPatch) -> None:
    """The model is a quadratic, the hubs move with the coordinates, and no gap would close."""
    slope, step = np.array([-3.0, 1.0]), np.array([0.2, -0.1])

    def model(step: np.ndarray) -> float:
        return 5.0 + float(slope @ step) + 2.0 * float(step @ step)

    monkeypatch.setattr(
        gauss_newton,
        "CompositeModel",
        lambda point, *_: SimpleNamespace(point=point, after=lambda step, _: SimpleNamespace(value=model(step))),
    )
    point: Any = SimpleNamespace(
        x=np.array([0.5, 0.5]),
        value=model(np.zeros(2)),
        problem=SimpleNamespace(restore_clearances=lambda x, _: x),
        hub_increments=lambda step: np.full((3, 6), step[0]),
    )
    problem = gauss_newton._GaussNewtonProblem(
        OptimiseParams(), gauss_newton.SearchRecord(), lambda _: None, SILENT, point, CurvatureEstimate(2)
    )
    here: Any = SimpleNamespace(own=point)
    found = problem.shorten(here, gauss_newton._Proposal(step, np.zeros((3, 6)), 1.0), 0.25)
    assert found.step == pytest.approx(0.25 * step) and found.increments == pytest.approx(np.full((3, 6), 0.05))
    assert found.gain == pytest.approx(model(np.zeros(2)) - model(0.25 * step))

"""Damping of rotations after a step to a lost equilibrium."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from flexmaps.engine.optimisation import optimisers
from flexmaps.engine.optimisation.scaling import CurvatureEstimate
from flexmaps.engine.optimisation.terms import turning
from flexmaps.engine.params import OptimiseParams
from flexmaps.engine.progress import SILENT


@pytest.mark.parametrize("still", [0, 90])
def test_rotations_of_a_lost_step_cost_more_than_it_promised(still: int) -> None:
    """Hubs that do not turn make no difference."""
    start: Any = SimpleNamespace()
    problem = optimisers._GaussNewtonProblem(
        OptimiseParams(), optimisers.SearchRecord(), lambda _: None, SILENT, start, CurvatureEstimate(1)
    )
    moves = np.concatenate([np.random.default_rng(3).normal(size=(10, 6)), np.zeros((still, 6))])
    damping = problem.gentle(optimisers._Proposal(np.zeros(1), moves, 0.3))
    cost = 0.5 * float((turning(damping, moves).hubs * moves).sum())
    assert cost == pytest.approx(0.3 * optimisers.GENTLE_COST) and cost > 0.3

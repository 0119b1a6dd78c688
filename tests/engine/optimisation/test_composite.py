"""The composite model of a step: its derivatives, and that it foretells what slots and strains cost where a step leads."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.mechanics.assembly import target_pose
from flexmaps.engine.optimisation.composite import CompositeModel
from flexmaps.engine.optimisation.inverse import DesignPoint
from flexmaps.engine.optimisation.task import Task
from flexmaps.engine.optimisation.work import Work
from flexmaps.engine.params import OptimiseParams, Settings, SimulateParams
from flexmaps.engine.runs import job
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh

MATERIAL = MATERIALS["vero"]
pytestmark = pytest.mark.usefixtures("predicted_match")  # with more panels, slots of the dome close


@lru_cache(maxsize=1)
def start() -> DesignPoint:
    """A dome of uniform spirals whose arms are strained beyond a low limit and whose slots are partly narrow."""
    found = job.run(PolygonMesh.from_quads(shapes.dome(8)), Settings(), edge=0.02, stop_after="spirals")
    assert found.design is not None
    params = OptimiseParams(strain_share=0.5)
    task = Task(found.mesh, MATERIAL, params, SimulateParams(tolerance=1e-10), None, None, Work())
    problem = task.build_problem(found.design)
    point = problem.point_at(problem.space.uniform(0.5, 0.6), target_pose(found.mesh, found.design.flat.corners))
    return point.with_strain_weight(point.mismatch.value)


def model(point: DesignPoint, damping: float = 1e-5) -> CompositeModel:
    return CompositeModel(point, damping, 0.0, np.ones_like(point.x), lambda: None)


def ways() -> list[np.ndarray]:
    rng = np.random.default_rng(3)
    return [rng.normal(size=start().x.shape) * size for size in (0.01, 0.05)]


@pytest.mark.parametrize("k", [0, 1])
def test_its_gradient_after_a_step_against_differences(k: int) -> None:
    point, step, h = start(), ways()[k], 1e-5
    direction = np.random.default_rng(4).normal(size=step.shape)
    assert {type(term).__name__ for term in point.terms} >= {"MismatchTerm", "StrainTerm", "SlotPenalty"}
    here = model(point).after(step, point.hub_increments(step))
    gradient = sum((cost.gradient for cost in here.costs), point.total_gradient([term.gradient for term in here.terms]))

    def value(t: float) -> float:
        there = step + t * direction
        return model(point).after(there, point.hub_increments(there)).value

    slope = (8 * (value(h) - value(-h)) - value(2 * h) + value(-2 * h)) / (12 * h)
    assert slope == pytest.approx(float(gradient @ direction), rel=1e-5)


def test_without_a_step_it_is_the_objective() -> None:
    point, still = start(), np.zeros_like(start().x)
    here = model(point).after(still, point.hub_increments(still))
    assert here.value == pytest.approx(point.value, rel=1e-12)
    gradient = sum((cost.gradient for cost in here.costs), point.total_gradient([term.gradient for term in here.terms]))
    np.testing.assert_allclose(gradient, point.gradient, rtol=1e-9, atol=1e-12 * np.abs(point.gradient).max())


def test_it_foretells_what_a_step_costs_that_closes_slots() -> None:
    """A quadratic model at the start of the same step knows nothing of slots that are still wide there."""
    point = start()
    found = model(point, damping=3e-4).minimise()
    there = point.problem.point_at(point.x + found.step, point.equilibrium.pose, step=found.increments)
    assert there.equilibrium.converged
    fall = point.value - there.value
    assert fall > 0.2 * point.value
    assert point.value - found.value == pytest.approx(fall, rel=0.2)


def test_a_step_keeps_within_the_box_and_lowers_the_model() -> None:
    point = start()
    found = model(point).minimise()
    assert found.damped < point.value
    assert ((point.x + found.step >= -1e-12) & (point.x + found.step <= 1.0 + 1e-12)).all()

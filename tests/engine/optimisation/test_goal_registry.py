"""The goals of the folder ``goals``, and that of docs/extend.md: their derivatives, and that the search finds them by itself."""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.mechanics.arms import curving_changes
from flexmaps.engine.mechanics.assembly import target_pose
from flexmaps.engine.optimisation import goal_registry, goals
from flexmaps.engine.optimisation.inverse import DesignPoint, InverseProblem
from flexmaps.engine.optimisation.task import Task
from flexmaps.engine.optimisation.terms import Gradient, LeastSquares, MismatchTerm
from flexmaps.engine.optimisation.work import Work
from flexmaps.engine.params import OptimiseParams, Settings, SimulateParams
from flexmaps.engine.progress import SILENT
from flexmaps.engine.runs import job
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh

WHOLE = re.compile(r"```python3\n(.*?)```", re.DOTALL)


@pytest.fixture(autouse=True)
def example(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The file of docs/extend.md, saved where the page says, or as good as there."""
    found = WHOLE.search((root / "docs" / "extend.md").read_text(encoding="utf-8"))
    assert found is not None
    (tmp_path / "span.py").write_text(found.group(1), encoding="utf-8")
    monkeypatch.setattr(goals, "__path__", [*goals.__path__, str(tmp_path)])
    importlib.invalidate_caches()
    goal_registry.makers.cache_clear()
    yield
    goal_registry.makers.cache_clear()
    sys.modules.pop(f"{goals.__name__}.span", None)


@lru_cache(maxsize=1)
def problem() -> tuple[InverseProblem, DesignPoint]:
    """A small dome and a point away from its target."""
    made = job.run(PolygonMesh.from_quads(shapes.dome(4)), Settings(), edge=0.02, stop_after="spirals")
    assert made.design is not None
    task = Task(made.mesh, MATERIALS["vero"], OptimiseParams(), SimulateParams(tolerance=1e-11), None, None, Work())
    found = replace(
        task.build_problem(made.design),
        strain_limit=None,
        slot_requirement=None,
        physics=SimulateParams(tolerance=1e-11),
    )
    return found, found.point_at(found.space.uniform(0.5, 0.6), target_pose(made.mesh, made.design.flat.corners))


def fresh() -> DesignPoint:
    """The point without what other tests made it compute."""
    return replace(problem()[1])


def residuals(point: DesignPoint) -> list[LeastSquares]:
    """The goals that have a residual."""
    return [goal for goal in point.goals if isinstance(goal, LeastSquares)]


def changed(point: DesignPoint, increments: np.ndarray, change: np.ndarray) -> DesignPoint:
    """The point with moved hubs and changed spirals, not at rest."""
    pose, x = point.equilibrium.pose.moved(increments), point.x + change
    model = point.problem.build_model(
        point.problem.assembly.with_spirals(*point.problem.space.width_and_twist(x)), SILENT
    )
    equilibrium = replace(point.equilibrium, pose=pose)
    return replace(
        point, x=x, model=model, equilibrium=equilibrium, mismatch=point.problem.target.compare(pose.centres)
    )


def direction(point: DesignPoint) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(7)
    size = len(point.equilibrium.pose.centres)
    return rng.normal(size=(size, 6)) * [*3 * [0.01], *3 * [0.3]], rng.normal(size=point.x.shape) * 0.1


def along(slope: Gradient, increments: np.ndarray, change: np.ndarray) -> float:
    """The derivative of a scalar along a direction."""
    return float((slope.by_hubs * increments).sum() + np.sum(slope.by_coordinates * change))


def test_the_search_finds_the_file_of_the_page() -> None:
    assert "Span" in [type(term).__name__ for term in fresh().terms]


def test_residuals_follow_taylors_theorem() -> None:
    here = fresh()
    increments, change = direction(here)

    def errors(h: float) -> Iterator[float]:
        for start, there in zip(residuals(here), residuals(changed(here, h * increments, h * change)), strict=True):
            yield float(np.linalg.norm(there.residual - start.residual - h * start.jvp(increments, change)))

    for one, half in zip(errors(1e-2), errors(5e-3), strict=True):
        assert one > 0.0 and one / half == pytest.approx(4.0, rel=0.1)


def test_products_are_transposed() -> None:
    here = fresh()
    increments, change = direction(here)
    for term in (MismatchTerm(here.mismatch), *residuals(here)):
        weight = np.random.default_rng(8).normal(size=np.shape(term.residual))
        forward = float((weight * term.jvp(increments, change)).sum())
        assert along(term.vjp(weight), increments, change) == pytest.approx(forward, rel=1e-9)


def test_the_model_of_a_step_is_that_of_the_linearised_residual() -> None:
    here = fresh()
    increments, change = direction(here)
    for term in (MismatchTerm(here.mismatch), *residuals(here)):
        ahead, far = term.after_step(increments, change), term.residual + term.jvp(increments, change)
        assert ahead.value == pytest.approx(0.5 * float((far**2).sum()), rel=1e-12)
        assert along(ahead.gradient, increments, change) == pytest.approx(
            float((far * term.jvp(increments, change)).sum()), rel=1e-9
        )
        expected = (
            term.value
            + along(term.gradient, increments, change)
            + 0.5 * along(term.gauss_newton_product(increments, change), increments, change)
        )
        assert ahead.value == pytest.approx(expected, rel=1e-9)


def test_the_whole_gradient_against_equilibria(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(curving_changes, "MIN_SHARE", 0.0)  # a search leaves small second-order parts out
    given, here = problem()[0], fresh()
    way, h = np.random.default_rng(9).normal(size=here.x.shape), 1e-4
    span = next(term for term in here.terms if type(term).__name__ == "Span")
    assert float(np.abs(here.total_gradient([span.gradient])).max()) > 1e-3 * float(
        np.abs(here.gradient).max()
    )  # it counts
    ahead, behind = (given.point_at(here.x + sign * h * way, here.equilibrium.pose).value for sign in (1.0, -1.0))
    assert (ahead - behind) / (2.0 * h) == pytest.approx(float(here.gradient @ way), rel=1e-4)

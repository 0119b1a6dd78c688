"""Searches that are stopped, and what they tell and hear meanwhile."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from flexmaps.engine import newton
from flexmaps.engine.errors import Cancelled
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.mechanics.assembly import target_pose
from flexmaps.engine.mechanics.newton_system import NewtonSystem
from flexmaps.engine.optimisation import optimise, search
from flexmaps.engine.optimisation.near_target import NEAR_PERCENT, is_near
from flexmaps.engine.optimisation.wishes import Wishes
from flexmaps.engine.optimisation.work import Work
from flexmaps.engine.params import OptimiseParams, Settings, SimulateParams
from flexmaps.engine.progress import SILENT, Progress
from flexmaps.engine.runs import job
from flexmaps.engine.simulation.simulate import simulate
from flexmaps.engine.spirals.design import SpiralDesign
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh

VERO = MATERIALS["vero"]


@lru_cache(maxsize=1)
def made() -> tuple[SpiralDesign, QuadMesh]:
    found = job.run(PolygonMesh.from_quads(shapes.dome(6)), Settings(), edge=0.02, stop_after="spirals")
    assert found.design is not None
    return found.design, found.mesh


def test_stopping_keeps_the_best_so_far() -> None:
    design, mesh = made()
    looks = []
    progress = Progress(shown=looks.append, stopped=lambda: len(looks) >= 4)  # given design, best start, two steps
    found = optimise.optimise(design, mesh, VERO, OptimiseParams(), SimulateParams(), progress=progress)
    assert not found.is_finished and len(found.trace.rows) == 2
    assert found.report()["laplacian_rmse_mm"] < found.report()["laplacian_rmse_mm_before"]
    with pytest.raises(Cancelled):
        optimise.optimise(
            design, mesh, VERO, OptimiseParams(), SimulateParams(), progress=Progress(stopped=lambda: True)
        )


def test_a_search_ends_near_its_target_and_does_not_begin_there() -> None:
    design, mesh = made()
    given = mesh, Settings().material.chosen, OptimiseParams(), SimulateParams()
    found = optimise.optimise(design, *given)
    assert found.ended == newton.REACHED and is_near(found.point, OptimiseParams())
    # it does not go on to the exact shape
    assert 0.1 * NEAR_PERCENT < found.report()["rms_percent"] < 1.2 * NEAR_PERCENT
    again = optimise.optimise(found.design, *given)
    assert again.ended == newton.REACHED and not again.trace.evaluations and again.design is found.design


def test_only_an_unstrained_piece_on_its_target_is_near_enough() -> None:
    design, mesh = made()
    material, params = Settings().material.chosen, OptimiseParams(open_slots=False)
    task = optimise.Task(mesh, material, params, SimulateParams(), None, None, Work())
    x = task.build_space(design).coordinates(design.width, design.twist)
    point = task.build_problem(design).point_at(x, target_pose(mesh, design.flat.corners))
    target = replace(point.problem.target, points=point.equilibrium.pose.centres)

    def near(params: OptimiseParams = params, **changes: Any) -> bool:
        problem = replace(point.problem, **{"target": target, **changes})
        return is_near(replace(point, problem=problem), params)

    assert near() and not near(target=point.problem.target)
    assert not near(target=replace(target, wishes=Wishes(np.arange(1), target.points[:1])))
    assert not near(strain_limit=replace(point.problem.strain_limit, share=1e-6))
    assert not near(OptimiseParams(stop=0.0)) and not near(OptimiseParams(patience=0.0))
    far = replace(target, points=target.points * (1.0 + 1e-3 * NEAR_PERCENT))
    assert near(target=far) and not near(OptimiseParams(patience=100.0), target=far)


@pytest.mark.parametrize(
    ("percent", "strained", "held"),
    [(0.9, False, False), (0.9, True, False), (1.1, False, False), (20.0, True, False), (0.9, False, True)],
)
def test_a_search_is_given_up_later_while_the_piece_is_far_overstrained_or_held(
    percent: float, strained: bool, held: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(search, "is_near", lambda *_: False)
    work = Work(limit=100.0, rate=1.0)
    work.begin_stage(1.0)
    searching: Any = SimpleNamespace(task=SimpleNamespace(work=work, params=OptimiseParams()))
    loads = SimpleNamespace(springs=object() if held else None)
    point = SimpleNamespace(problem=SimpleNamespace(loads=loads))
    here: Any = SimpleNamespace(distance_percent=percent, value=1.0, is_overstrained=strained, point=point)
    here.rate_factor = search.StageResult.rate_factor.fget(here)  # type: ignore[attr-defined]
    here.with_updated_multipliers = here.with_stability_weight = lambda: here
    slow = []

    def stage(*_: Any) -> Any:
        for _ in range(10):  # two thirds of the rate
            work.add(0.1, 1)
            work.add_step(0.067)
        slow.append(work.is_slow)
        return here

    search.Search._repeat(searching, stage, here, 1, 0.05, SILENT)
    assert slow == [percent < search.WANTED_PERCENT and not strained and not held]


def test_given_design_is_shown_before_limits_and_other_starts_are_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    design, mesh = made()
    looks, events = [], []
    space = optimise.Task.build_space
    monkeypatch.setattr(optimise.Task, "build_space", lambda *given: events.append("limits") or space(*given))

    def show(look: optimise.OptimisationStep) -> None:
        looks.append(look)
        events.append("shown")

    progress = Progress(lambda _, text: events.append(text), lambda: len(looks) >= 2, shown=show)
    optimise.optimise(design, mesh, VERO, OptimiseParams(), SimulateParams(), progress=progress)
    assert looks[0].width == pytest.approx(design.width, rel=1e-6)
    at_rest = simulate(design, mesh, VERO, SimulateParams())
    assert looks[0].vertices == pytest.approx(at_rest.vertices, abs=1e-6 * mesh.diagonal)
    assert looks[0].distance == pytest.approx(
        0.01 * at_rest.target_distances["rms_percent"] * at_rest.target.diagonal, rel=1e-3
    )
    assert events.index("shown") < events.index("limits")
    assert "Finding starting shapes" in events[events.index("shown") :]


@pytest.mark.parametrize(
    "steps", [2, pytest.param(14, marks=pytest.mark.thorough)], ids=["before any stage has ended", "later"]
)
def test_what_a_stop_leaves_is_what_a_simulation_finds(steps: int) -> None:
    design, mesh = made()
    looks: list[optimise.OptimisationStep] = []
    progress = Progress(shown=looks.append, stopped=lambda: len(looks) > steps)
    found = optimise.optimise(design, mesh, VERO, OptimiseParams(stop=1e-6), SimulateParams(), progress=progress)
    assert not found.is_finished
    again = simulate(found.design, mesh, VERO, SimulateParams(), start=found.after.equilibrium.pose).report()
    left = found.after.report()
    for name in ("rms_mm", "laplacian_rmse_mm"):
        assert left[name] == pytest.approx(again[name], rel=1e-3)


def test_it_tells_and_listens_between_any_two_factorisations(monkeypatch: pytest.MonkeyPatch) -> None:
    """What takes long on thousands of spirals goes on in parts, each of which is told and hears a stop."""
    design, mesh = made()
    since = {"told": 0, "heard": 0}
    most = dict(since)
    factor = NewtonSystem.factor

    def counted(system: NewtonSystem, values: np.ndarray) -> bool:
        for word in since:
            since[word] += 1
            most[word] = max(most[word], since[word])
        return factor(system, values)

    def told(fraction: float, text: str) -> None:
        assert text
        since["told"] = 0

    def stopped() -> bool:
        since["heard"] = 0
        return False

    monkeypatch.setattr(NewtonSystem, "factor", counted)
    params = OptimiseParams(iterations=2)
    optimise.optimise(design, mesh, VERO, params, SimulateParams(), progress=Progress(told, stopped))
    # a step of an equilibrium tries up to four: as it is, and its convex part with more and more of its diagonal
    assert 1 <= most["told"] <= 6 and 1 <= most["heard"] <= 6


@pytest.mark.parametrize("stop", [1e-3, 0.4, 0.0])
def test_steps_that_relieve_arms_must_bring_more_than_others(stop: float, monkeypatch: pytest.MonkeyPatch) -> None:
    taken: list[OptimiseParams] = []
    monkeypatch.setattr(search.Search, "optimise_spirals", lambda _, here, params, progress: taken.append(params))
    task = SimpleNamespace(params=OptimiseParams(stop=stop))
    alone = search.Search(task, optimise.SearchRecord(), print, np.inf, None)
    alone.polish(None, SILENT)
    alone.relieve_step(None, SILENT)
    assert [one.iterations for one in taken] == [search.POLISH_STEPS, search.RELIEF_STEPS]
    assert taken[0].stop == stop
    assert taken[1].stop > max(stop, 0.1) or taken[1].stop == stop in (0.4, 0.0)

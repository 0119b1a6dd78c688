"""Which start a search takes, and that a result too far from the target counts for nothing."""

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.mechanics.assembly import target_pose
from flexmaps.engine.optimisation import optimise
from flexmaps.engine.optimisation.gauss_newton import SearchRecord
from flexmaps.engine.optimisation.search import Search
from flexmaps.engine.optimisation.task import Task
from flexmaps.engine.optimisation.work import Work
from flexmaps.engine.params import OptimiseParams, Settings, SimulateParams
from flexmaps.engine.runs import job
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh


def point(mismatch: float, value: float, distance: float = 0.5) -> Any:
    """A start with this mismatch, objective and distance from the target."""
    return SimpleNamespace(mismatch=SimpleNamespace(value=mismatch), value=value, relative_distance=distance)


def test_slots_and_strain_do_not_outvote_the_mismatch() -> None:
    points = {"given": point(0.0035, 0.0158), "uniform": point(0.0096, 0.0096)}
    assert optimise._rank_starts(points, np.inf)[0] == "given"


def test_among_near_equals_the_objective_decides() -> None:
    points = {"given": point(0.0188, 0.05), "uniform": point(0.0190, 0.02), "curvature": point(0.0170, 0.03)}
    assert optimise._rank_starts(points, np.inf)[0] == "uniform"


def test_a_start_too_far_away_is_not_taken() -> None:
    points = {"given": point(0.004, 0.03, distance=0.4), "uniform": point(0.003, 0.003, distance=1.75)}
    assert optimise._rank_starts(points, 0.42)[0] == "given"
    assert optimise._rank_starts(points, np.inf)[0] == "uniform"


def made_dome() -> Any:
    """A dome with spirals, as the stage *Spirals* makes them."""
    return job.run(PolygonMesh.from_quads(shapes.make("dome", 0.04)), Settings(), edge=0.02, stop_after="spirals")


@pytest.mark.parametrize(("scale", "names"), [(1.0, {"given", "uniform"}), (0.5, {"given", "curvature", "uniform"})])
def test_starts_that_are_nearly_the_given_design_are_left_out(scale: float, names: set[str]) -> None:
    made = made_dome()
    design = dataclasses.replace(made.design, twist=scale * made.design.twist)
    task = Task(made.mesh, MATERIALS["vero"], OptimiseParams(), SimulateParams(restarts=0), None, None, Work())
    found = optimise.find_starts(task.build_problem(design), design, made.mesh, OptimiseParams(), optimise.SILENT)
    assert set(found) == names


def test_a_result_too_far_away_is_worth_nothing() -> None:
    made = made_dome()
    physics = SimulateParams(restarts=0)
    task = Task(made.mesh, MATERIALS["vero"], OptimiseParams(), physics, None, None, Work())
    problem = task.build_problem(made.design)
    start = optimise.find_starts(problem, made.design, made.mesh, OptimiseParams(restart=False), optimise.SILENT)[
        "given"
    ]
    near = optimise.SimulatedResult(task.simulate_point(made.design, start), start, start.relative_distance * 1.01)
    assert np.isfinite(near.merit(1.0))
    assert dataclasses.replace(near, max_distance=start.relative_distance * 0.99).merit(1.0) == np.inf


def test_every_body_is_taken_from_the_result_where_it_matches_best() -> None:
    """Of two equal domes, the first has the better spirals in one result, and the second in the other."""
    polygons = PolygonMesh.from_quads(shapes.make("dome", 0.04))
    apart = polygons.vertices + np.array([2.0 * np.ptp(polygons.vertices[:, 0]), 0.0, 0.0])
    corners = np.concatenate([polygons.corners, polygons.corners + len(polygons.vertices)])
    two = PolygonMesh(np.concatenate([polygons.vertices, apart]), corners, np.tile(polygons.sizes, 2))
    made = job.run(two, Settings(), edge=0.02, stop_after="spirals")
    assert made.design is not None
    task = Task(made.mesh, MATERIALS["vero"], OptimiseParams(), SimulateParams(restarts=0), None, None, Work())
    problem, start = task.build_problem(made.design), target_pose(made.mesh, made.design.flat.corners)
    body = problem.target.body_of_spiral
    shares = np.where(body[None] == [[0], [1]], 0.1, 0.6)
    every = [np.repeat(share, problem.space.coordinates_per_spiral) for share in shares]
    points = [problem.point_at(x, start).with_strain_weight(1.0) for x in every]
    search = Search(task, SearchRecord(), lambda _: None, np.inf, made.design.flat)
    tried = [search.add_result(made.design, one) for one in points]
    best = search._with_best_bodies(tried, tried[0], optimise.SILENT)
    values = np.array([one.point.mismatch.value_by_body for one in tried])
    assert np.argmin(values, axis=0).tolist() in ([0, 1], [1, 0])
    assert best.point.mismatch.value_by_body == pytest.approx(values.min(axis=0), rel=1e-4)
    assert search._with_best_bodies([best, *tried], best, optimise.SILENT) is best

"""Spirals are wound less where their slots close in space, at the end of a search."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from flexmaps.engine.materials import OVERSTRAIN_SHARE, find_material
from flexmaps.engine.optimisation import slot_opening
from flexmaps.engine.optimisation.gauss_newton import CANCELLED, SearchRecord
from flexmaps.engine.optimisation.remedies import WANTED_PERCENT
from flexmaps.engine.optimisation.search import RELIEF_TIME_SHARE, TIME_WITH_FLATS, Search
from flexmaps.engine.optimisation.slot_opening import (
    OPEN_GROWTH,
    UNSEEN_PERCENT,
    SimulatedResult,
    open_closed_slots,
    reduce_twist,
    separate_arms,
)
from flexmaps.engine.optimisation.task import Task
from flexmaps.engine.optimisation.work import Work
from flexmaps.engine.params import LayoutParams, OptimiseParams, SimulateParams, SpiralParams
from flexmaps.engine.patches.flattening import flatten
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.progress import SILENT, Progress
from flexmaps.engine.simulation.simulate import Simulation, simulate
from flexmaps.engine.spirals import fabricable
from flexmaps.engine.surface import shapes


@pytest.fixture(scope="module")
def wound() -> tuple[Task, SimulatedResult]:
    """A dome of spirals wound so far that slots close, as a search would have left it."""
    mesh, pom = shapes.make("dome"), find_material("pom")
    flat, count = flatten.flatten(trace.trace_layout(mesh, LayoutParams()), LayoutParams()), len(mesh.quads)
    params = SpiralParams(width_min=0.0006)
    made = fabricable.make_fabricable(flat, params, np.full((count, 4), 0.0009), np.full(count, 5.5))
    task = Task(mesh, pom, OptimiseParams(), SimulateParams(), None, None, Work())
    at_rest = simulate(made, mesh, pom, SimulateParams())
    problem = task.build_problem(made)
    point = problem.point_at(problem.space.coordinates(made.width, made.twist), at_rest.equilibrium.pose)
    return task, SimulatedResult(at_rest, point, np.inf)


def test_slots_open_and_the_shape_hardly_changes(wound):
    task, found = wound
    before = found.simulation
    after = open_closed_slots(
        Search(task, SearchRecord(), lambda _: None, np.inf, before.design.flat), found, SILENT
    ).simulation
    assert len(before.slots().closed) > 20  # or this shows nothing
    assert len(after.slots().closed) < 0.25 * len(before.slots().closed)
    assert (after.design.twist <= before.design.twist).all()
    assert after.target_distances["laplacian_rmse_mm"] <= 1.05 * before.target_distances["laplacian_rmse_mm"]
    again = simulate(after.design, after.target, after.material, SimulateParams())
    assert again.target_distances["rms_percent"] == pytest.approx(after.target_distances["rms_percent"], rel=1e-2)


def test_slots_are_measured_only_where_they_may_have_closed(wound, monkeypatch):
    """Less slots are measured than there are, and those counted as closed are those of a measurement of all."""
    task, found = wound
    measured, counts = [], []
    slots_near = Simulation.slots_near

    def watched(simulation, quads, others):
        measured.append(quads.mean())
        near = slots_near(simulation, quads, others)
        counts.append((len(near.closed), len(simulation.slots().closed)))
        return near

    monkeypatch.setattr(Simulation, "slots_near", watched)
    open_closed_slots(Search(task, SearchRecord(), lambda _: None, np.inf, found.simulation.design.flat), found, SILENT)
    assert min(measured) > 0.0 and max(measured) < 0.8
    assert all(near == every for near, every in counts)


def test_slots_open_by_more_steps_where_less_twist_alone_strains_arms_too_much(wound, monkeypatch):
    task, found = wound
    before, limit = found.simulation, 1.02 * float(found.simulation.strain.max())
    strain_limit = replace(found.point.problem.strain_limit, share=limit)
    found = replace(found, point=replace(found.point, problem=replace(found.point.problem, strain_limit=strain_limit)))
    monkeypatch.setattr(slot_opening, "OVERSTRAIN_SHARE", limit)
    closed = []
    for searches in (0, slot_opening.MAX_SHORT_SEARCHES):
        monkeypatch.setattr(slot_opening, "MAX_SHORT_SEARCHES", searches)
        after = open_closed_slots(
            Search(task, SearchRecord(), lambda _: None, np.inf, before.design.flat), found, SILENT
        ).simulation
        assert after.strain.max() <= limit
        closed.append(len(after.slots().closed))
    assert closed[0] > 10 and closed[1] < 0.2 * closed[0]
    assert after.target_distances["laplacian_rmse_mm"] <= 1.1 * before.target_distances["laplacian_rmse_mm"]


def test_further_searches_end_where_they_ease_no_strains(wound, monkeypatch):
    task, found = wound
    calls, polished = [], Search.polish
    monkeypatch.setattr(Search, "polish", lambda *given: calls.append(given) or polished(*given))
    every = np.ones(len(found.simulation.design.twist), dtype=bool)
    monkeypatch.setattr(SimulatedResult, "overstrained_spirals", lambda *given: every)
    search = Search(task, SearchRecord(), lambda _: None, np.inf, found.simulation.design.flat)
    assert open_closed_slots(search, found, SILENT) is found
    assert len(calls) == 1


@pytest.mark.parametrize("asks", [0, 3, 40])
def test_a_result_stays_as_it_is_where_opening_its_slots_is_cancelled(wound, asks, monkeypatch):
    task, found = wound
    monkeypatch.setattr(slot_opening, "OVERSTRAIN_SHARE", 1.02 * float(found.simulation.strain.max()))
    search = Search(task, SearchRecord(), lambda _: None, np.inf, found.simulation.design.flat)
    left = iter(range(asks))
    assert open_closed_slots(search, found, Progress(None, lambda: next(left, None) is None)) is found
    assert search.trace.ended == CANCELLED


def test_arms_beside_a_spiral_with_less_twist_have_room_in_the_flat_sheet(wound):
    flat = wound[1].simulation.design.flat
    width = 0.0016 * np.random.default_rng(0).uniform(0.7, 1.5, (len(flat.corners), 4))
    tight = fabricable.make_fabricable(flat, SpiralParams(width_min=0.0006), width, np.full(len(width), 7.0))
    every = np.ones(len(width), dtype=bool)
    assert separate_arms(tight, every, SILENT) is tight
    lacking = 0
    for quad in range(0, len(width), 45):
        twist = tight.twist.copy()
        twist[quad] *= 0.8
        made = separate_arms(replace(tight, twist=twist), every, SILENT)
        fitted = fabricable.make_fabricable(flat, made.params, made.width, made.twist, check_outlines=False)
        assert not fitted.changed_spirals(made).any()
        lacking += bool((made.twist != twist).any())
    assert lacking  # or this shows nothing


def test_only_free_spirals_beside_closed_slots_are_unwound(wound):
    found = wound[1]
    made, slots = found.simulation.design, found.simulation.slots()
    free = np.arange(len(made.twist)) % 2 == 0
    beside = np.isin(np.arange(len(free)), slots.arms[slots.width < 0.0] // 4)
    twist = reduce_twist(made, slots, free)
    assert (twist[beside & free] < made.twist[beside & free]).all()
    assert (twist[~(beside & free)] == made.twist[~(beside & free)]).all()
    nearly = replace(made, twist=np.full(len(free), 0.05))
    assert (reduce_twist(nearly, slots, free)[beside & free] == 0.0).all()
    assert reduce_twist(nearly, slots, np.zeros(len(free), bool)) is nearly.twist


@pytest.mark.parametrize("worst, beyond", [(0.85, 1.01 * OVERSTRAIN_SHARE), (1.2, 1.36)])
def test_strains_that_hold_go_on_to_hold(wound, worst, beyond):
    """Where none is beyond what the material bears, none may be; where one is, others may hardly be more."""
    found = wound[1]
    simulation, count = found.simulation, len(found.simulation.design.twist)

    def strained(strain: np.ndarray) -> SimulatedResult:
        other = replace(simulation)
        other.__dict__["strain"] = strain
        return replace(found, simulation=other)

    before = np.full(count, 0.5)
    before[3] = worst
    after = before.copy()
    after[7] = beyond
    assert np.flatnonzero(strained(after).overstrained_spirals(strained(before))).tolist() == [7]
    after[7] = 0.99 * OVERSTRAIN_SHARE
    assert not strained(after).overstrained_spirals(strained(before)).any()


def test_a_piece_on_its_target_may_give_up_of_its_match_what_nobody_sees(wound):
    """Another one may give up a tenth of its mismatch only, and more the more slots open, while it is as near as wanted."""
    found = wound[1]
    target, simulation = found.point.problem.target, found.simulation
    centres = simulation.equilibrium.pose.centres
    away = 1e-3 * found.simulation.target.diagonal * np.random.default_rng(0).normal(size=centres.shape)

    def placed(share: float) -> SimulatedResult:
        pose = replace(simulation.equilibrium.pose, centres=target.points + share * away)
        other = replace(simulation, equilibrium=replace(simulation.equilibrium, pose=pose))
        other.__dict__["strain"] = np.full(len(centres), 0.5)
        return replace(found, simulation=other)

    near, twice, far, farther, hardly = (placed(share) for share in (0.2, 0.4, 2.0, 4.0, 2.08))
    assert all(one.simulation.target_distances["rms_percent"] < UNSEEN_PERCENT for one in (near, twice))
    assert twice.can_replace(near)
    assert hardly.can_replace(far) and not farther.can_replace(far)
    slots = simulation.slots()
    without = replace(slots, width=np.abs(slots.width))
    for share, of in ((2.6, 2.0), (OPEN_GROWTH * 2.0, 2.0), (26.0, 20.0)):
        closed, before = placed(share), placed(of)
        opened = replace(closed, known_slots=without)
        wanted = opened.simulation.target_distances["rms_percent"] <= WANTED_PERCENT and share / of < OPEN_GROWTH**0.5
        assert opened.can_replace(before) == wanted
        assert not closed.can_replace(before)
    half = slots.width.copy()
    half[slots.closed[::2]] *= -1.0
    grown = [replace(placed(2.0 * factor**0.5), known_slots=replace(slots, width=half)) for factor in (1.5, 1.6)]
    before = replace(placed(2.0), known_slots=slots)
    assert [one.can_replace(before) for one in grown] == [True, False]  # half of the way from 1.1 to 2


@pytest.mark.parametrize("share, until", [(0.01, 0.9 * (1.0 + RELIEF_TIME_SHARE)), (100.0, TIME_WITH_FLATS)])
def test_a_search_whose_time_for_flat_shapes_is_over_goes_on_where_arms_are_strained_too_much(wound, share, until):
    task, found = wound
    task = replace(task, work=Work(limit=1.0, seconds_done=0.9))
    strain_limit = found.point.problem.strain_limit
    problem = replace(found.point.problem, work=task.work, strain_limit=replace(strain_limit, share=share))
    search = Search(task, SearchRecord(), lambda _: None, np.inf, found.simulation.design.flat)
    search.run([replace(found.point, problem=problem)], found.simulation.design, SILENT)
    assert until <= task.work.share < 1.05 * until  # a little work is done before


@pytest.mark.parametrize(("counts", "searches"), [((3, 3, 3, 3, 3), 2), ((4, 4, 3, 3, 3), 4), ((4, 2, 1, 0), 3)])
def test_searches_for_open_slots_end_when_two_in_a_row_open_none(
    monkeypatch: pytest.MonkeyPatch, counts: tuple[int, ...], searches: int
) -> None:
    """Counts of closed slots: of the result, and after each search."""
    point = SimpleNamespace(problem=SimpleNamespace(space=SimpleNamespace(free_spirals=None)))
    rest = {"simulation": SimpleNamespace(design=None), "point": point, "can_replace": lambda _: True}
    results = [SimpleNamespace(closed=count, **rest) for count in counts]
    waiting = iter(results[1:])
    monkeypatch.setattr(slot_opening, "_reduce_twists", lambda search, one, *rest, **options: one)
    monkeypatch.setattr(slot_opening, "_relieve_strains", lambda *given: next(waiting))
    monkeypatch.setattr(slot_opening, "separate_arms", lambda design, *rest: design)
    best = slot_opening._open_slots(SimpleNamespace(), results[0], SILENT)  # type: ignore[arg-type]
    assert best.closed == min(counts[: searches + 1]) and len(list(waiting)) == len(counts) - 1 - searches

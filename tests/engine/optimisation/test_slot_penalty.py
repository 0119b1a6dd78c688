"""Slots that stay open: the tips' motions and the estimated widths against differences and against what is measured."""

from __future__ import annotations

import dataclasses
from functools import lru_cache

import numpy as np
import pytest
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.mechanics.arms.bent import bend_arms
from flexmaps.engine.mechanics.arms.model import ArmModel
from flexmaps.engine.mechanics.arms.tip_beams import hub_ends
from flexmaps.engine.mechanics.arms.tip_motion import TipMotions, tip_motions
from flexmaps.engine.mechanics.assembly import Pose, assembly_from_design, target_pose
from flexmaps.engine.mechanics.clearance.slot_estimate import PLACES
from flexmaps.engine.mechanics.clearance.slots_in_space import slots_in_space
from flexmaps.engine.optimisation.optimise import optimise
from flexmaps.engine.optimisation.slot_penalty import SlotRequirement
from flexmaps.engine.optimisation.task import Task
from flexmaps.engine.optimisation.work import Work
from flexmaps.engine.params import OptimiseParams, Settings, SimulateParams
from flexmaps.engine.runs import job
from flexmaps.engine.simulation.simulate import Simulation, build_model, simulate
from flexmaps.engine.spirals.design import SpiralDesign
from flexmaps.engine.spirals.fabricable import uniform_design
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh

VERO = MATERIALS["vero"]
NARROW = 0.0006  # metres


@lru_cache(maxsize=2)
def simulated(name: str, twist: float) -> Simulation:
    """Alike spirals on a surface, in their equilibrium."""
    found = job.run(PolygonMesh.from_quads(shapes.make(name, 0.03)), Settings(), edge=0.02, stop_after="spirals")
    made = uniform_design(found.flat, found.design.params, width=0.0016, twist=twist)
    return simulate(made, found.mesh, VERO, SimulateParams(), quick=True)


def model_of(design: SpiralDesign, width: np.ndarray, twist: np.ndarray) -> ArmModel:
    model = build_model(assembly_from_design(design).with_spirals(width, twist), VERO, "arm", quick=True)
    assert isinstance(model, ArmModel)
    return model


@pytest.fixture(scope="module")
def dome() -> tuple[SpiralDesign, Pose, np.ndarray, np.ndarray]:
    """Spirals of four widths in a pose that is no equilibrium."""
    found, rng = simulated("dome", 4.5), np.random.default_rng(2)
    pose = target_pose(found.target, found.design.flat.corners)
    pose = pose.moved(rng.normal(size=(len(found.design.twist), 6)) * np.repeat([1e-4, 0.03], 3))
    width = rng.uniform(0.001, 0.002, found.design.width.shape)
    return found.design, pose, width, rng.uniform(3.0, 4.0, len(width))


def test_tips_move_as_their_hubs_and_spirals_say(dome) -> None:
    design, pose, width, twist = dome
    rng, h = np.random.default_rng(3), 1e-4
    model = model_of(design, width, twist)
    known = TipMotions.from_assembly(model.assembly, model.compliance.values, model.compliance_by, model.at_joint, pose)
    pairs = model.assembly.pairs

    def tips(model: ArmModel, pose: Pose) -> np.ndarray:
        return tip_motions(model.assembly, model.compliance.values, model.at_joint, pose)

    assert known.values == pytest.approx(tips(model, pose), rel=1e-12, abs=1e-15)
    step = rng.normal(size=(len(width), 6)) * np.repeat([1e-3, 0.05], 3)
    found = (tips(model, pose.moved(h * step)) - tips(model, pose.moved(-h * step))) / (2 * h)
    told = (known.by_pose @ step[pairs].reshape(-1, 1, 12, 1))[..., 0]
    wide, wound = rng.normal(size=width.shape) * 1e-3, rng.normal(size=len(width))
    ahead, behind = (model_of(design, width + t * wide, twist + t * wound) for t in (h, -h))
    changed = (tips(ahead, pose) - tips(behind, pose)) / (2 * h)
    meant = np.einsum("esikp,ekp->esi", known.by_design, np.column_stack([wide, wound])[pairs])
    for one, two in ((found, told), (changed, meant)):
        for part in (slice(0, 3), slice(3, 6)):
            assert one[..., part] == pytest.approx(two[..., part], abs=1e-6 * np.abs(two[..., part]).max())


def test_tips_of_a_joint_meet(dome) -> None:
    """What both arms have yielded is what parts the hubs: the tips come to one place."""
    design, pose, width, twist = dome
    model = model_of(design, width, twist)
    known, moved = model.assembly, tip_motions(model.assembly, model.compliance.values, model.at_joint, pose)
    place = pose.centres[known.pairs] + np.einsum(
        "esij,esj->esi", pose.rotations[known.pairs], known.lever + moved[..., :3]
    )
    assert place[:, 0] == pytest.approx(place[:, 1], abs=1e-12)


@pytest.mark.parametrize("clockwise", [False, True])
def test_narrow_slots_are_estimated_to_a_tenth_of_a_millimetre(clockwise) -> None:
    found = simulated("dome", 4.5)
    if clockwise:
        made = uniform_design(
            found.design.flat, dataclasses.replace(found.design.params, clockwise=True), width=0.0016, twist=4.5
        )
        found = simulate(made, found.target, VERO, SimulateParams(), quick=True)
    design, pose = found.design, found.equilibrium.pose
    measured = slots_in_space(design, bend_arms(design, pose)).width[: 4 * len(design.twist)]
    opening = dataclasses.replace(SlotRequirement.from_design(design), width=NARROW)
    told = opening.narrow_slots(model_of(design, design.width, design.twist), pose).found
    # the outer arm of slot k is arm k + 1, or arm k
    slot = told.arms[:, 0] if clockwise else told.arms[:, 1]
    least = np.full(len(measured), np.inf)
    np.minimum.at(least, slot, told.values)
    mouths = (measured < 0.7 * NARROW) & (least < NARROW)
    assert mouths.sum() > 10 and (measured < 0.0003).any()
    missed = np.abs(least - measured)[mouths]
    assert (np.percentile(missed, [50, 90]) < [5e-5, 1e-4]).all() and missed.max() < 2e-4


@pytest.mark.parametrize("clockwise", [pytest.param(False, marks=pytest.mark.thorough), True])
def test_estimates_that_were_too_wide_are_as_measured_and_stay_nearer_to_it(clockwise) -> None:
    found = simulated("dome", 4.5)
    params = dataclasses.replace(found.design.params, clockwise=clockwise)
    count, excess = len(found.design.twist), []
    opening = measured = None
    for twist in (4.5, 4.45):
        made = uniform_design(found.design.flat, params, width=0.0016, twist=twist)
        at_rest = simulate(made, found.target, VERO, SimulateParams(), quick=True)
        pose, slots = at_rest.equilibrium.pose, slots_in_space(made, bend_arms(made, at_rest.equilibrium.pose))
        model = model_of(made, made.width, made.twist)
        if opening is None:
            opening = dataclasses.replace(SlotRequirement.from_design(made), width=NARROW)
            measured = opening.with_measured_slots(model, pose, slots)
        for one in (opening, measured):
            told, least = one.narrow_slots(model, pose).found, np.full(4 * count, np.inf)
            np.minimum.at(least, told.arms[:, 0], told.values)
            excess.append(least[slots.arms[: 4 * count, 0]] - slots.width[: 4 * count])
    narrow = np.isfinite(excess).all(axis=0)
    wide = narrow & (excess[0] > 2e-5)
    assert wide.sum() > 10
    assert np.abs(excess[1][wide]).max() < 1e-12
    small = narrow & (excess[0] < 0.0)
    assert excess[1][small] == pytest.approx(excess[0][small], abs=1e-12)
    uncut = dataclasses.replace(slots, width=np.where(np.arange(len(slots.width)) < 8, np.inf, slots.width))
    with np.errstate(all="raise"):
        assert np.isfinite(opening.with_measured_slots(model, pose, uncut).estimate_error).all()
    assert np.median(np.abs(excess[3][wide])) < 0.3 * np.median(np.abs(excess[2][wide]))


def test_estimated_widths_follow_hubs_and_spirals(dome) -> None:
    design, pose, width, twist = dome
    opening = dataclasses.replace(SlotRequirement.from_design(design), width=0.0008)
    rng, h = np.random.default_rng(5), 1e-5
    here = opening.narrow_slots(model_of(design, width, twist), pose)
    assert len(here.found.values) > 50 and len(set(here.found.t)) > len(PLACES) // 2
    step = rng.normal(size=(len(width), 6)) * np.repeat([1e-3, 0.05], 3)
    wide, wound = rng.normal(size=width.shape) * 1e-3, rng.normal(size=len(width))

    def widths(t: float, increments: bool) -> np.ndarray:
        share = 0.0 if increments else t
        model = model_of(design, width + share * wide, twist + share * wound)
        known = (
            dataclasses.replace(opening, width=1.0)
            .narrow_slots(model, pose.moved(t * step) if increments else pose)
            .found
        )
        every = {(*arms, t): value for arms, t, value in zip(known.arms.tolist(), known.t, known.values)}
        return np.array([every[(*arms, t)] for arms, t in zip(here.found.arms.tolist(), here.found.t)])

    for increments, told in (
        (True, here.widths_by_pose @ step.ravel()),
        (False, here.widths_by_design @ np.r_[wide.ravel(), wound]),
    ):
        found = (widths(h, increments) - widths(-h, increments)) / (2 * h)
        missed = np.abs(found - told) / np.abs(told).max()
        # where a place passes from one piece of an arm to the next its curvature jumps
        assert np.percentile(missed, 95) < 1e-6 and missed.max() < 1e-2


@pytest.mark.parametrize("arms", ["alike", "each"])
def test_gradient_of_a_search_that_keeps_slots_open(arms) -> None:
    found = simulated("dome", 4.5)
    task = Task(
        found.target,
        VERO,
        OptimiseParams(strain_share=0.3, arms=arms, lies=0.0),  # compares curvature only, so that slots count beside it
        SimulateParams(tolerance=1e-11),
        None,
        None,
        Work(),
    )
    whole = dataclasses.replace(
        task.build_problem(found.design), build_model=lambda a, _: build_model(a, VERO, "arm", quick=True)
    )
    wide = dataclasses.replace(SlotRequirement.from_design(found.design), width=0.0015)
    whole = dataclasses.replace(whole, slot_requirement=wide, physics=SimulateParams(tolerance=1e-11))
    x = np.random.default_rng(4).uniform(0.2, 0.8, len(found.design.twist) * whole.space.coordinates_per_spiral)
    here = whole.point_at(x, target_pose(found.target, found.design.flat.corners))
    assert here._narrow_slots is not None and here._narrow_slots.value > 0.02 * here.mismatch.value
    direction, h = np.random.default_rng(5).normal(size=x.shape), 2e-5

    def value(t: float) -> float:
        return whole.point_at(x + t * direction, here.equilibrium.pose).value

    slope = (8 * (value(h) - value(-h)) - value(2 * h) + value(-2 * h)) / (12 * h)
    assert slope == pytest.approx(float(here.gradient @ direction), rel=1e-6)


def test_the_cost_begins_smoothly_and_goes_on_straight(dome) -> None:
    design, pose, width, twist = dome
    here = SlotRequirement.from_design(design).narrow_slots(model_of(design, width, twist), pose)

    def penalty(missing_share: float) -> tuple[float, float, float]:
        found = dataclasses.replace(
            here.found, values=np.full(len(here.found.values), (1 - missing_share) * here.slot_requirement.width)
        )
        one = dataclasses.replace(here, found=found)
        count = len(found.values)
        slope, curvature = one.penalty_slope(one.missing_share), one.penalty_curvature(one.missing_share)
        return one.value / count, float(slope[0]) * -here.slot_requirement.width, float(curvature[0])

    h = 1e-5
    for missing_share in (0.1, 0.5, 0.9, 1.5, 4.0):
        (ahead, up, _), (behind, down, _) = penalty(missing_share + h), penalty(missing_share - h)
        _, slope, curvature = penalty(missing_share)
        assert (ahead - behind) / (2 * h) == pytest.approx(slope, rel=1e-6)
        bend = (up - down) / (2 * h) if missing_share < 1.0 else slope / missing_share
        assert curvature * here.slot_requirement.width**2 == pytest.approx(bend, rel=1e-6)
    assert penalty(1e-3)[0] < 2e-8 * penalty(1.0)[0] and penalty(1.0)[1] == pytest.approx(penalty(9.0)[1])


def test_hubs_end_where_the_slots_of_regular_spirals_do() -> None:
    away = np.array([0.001])
    for wind in (0.0, 3.0, -3.0):
        t = hub_ends(np.array([0.01]), np.array([wind]), away)[0][0] / 0.985
        # the slots' width of regular spirals at that radius, from both middles
        radius = 0.01 * (1.0 - t)
        assert 0.25 * np.pi * 0.02 / np.hypot(wind, 0.01 / radius) == pytest.approx(2.0 * away[0], rel=1e-9)


@pytest.mark.thorough
def test_optimised_spirals_keep_their_slots_open() -> None:
    found = job.run(PolygonMesh.from_quads(shapes.make("dome", 0.05)), Settings(), edge=0.02, stop_after="spirals")
    physics, closed = SimulateParams(), {}
    for keep in (False, True):
        params = OptimiseParams(codesign=False, strain_share=0.0, open_slots=keep, iterations=30)
        closed[keep] = optimise(found.design, found.mesh, VERO, params, physics).after.slots().width.min()
    assert closed[True] > 0.0 and closed[True] > closed[False]

"""The stability barrier: its derivatives against finite differences of whole equilibria, and what it does to a search."""

import dataclasses
from functools import lru_cache

import numpy as np
import pytest
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.mechanics.arms import curving_changes
from flexmaps.engine.mechanics.assembly import assembly_from_design, target_pose
from flexmaps.engine.mechanics.loads import Loads, Springs
from flexmaps.engine.mechanics.support_poses import SupportPoses
from flexmaps.engine.optimisation import stability
from flexmaps.engine.optimisation.codesign_problem import FlatProblem, FlatRange
from flexmaps.engine.optimisation.design_space import DesignSpace
from flexmaps.engine.optimisation.inverse import DesignPoint, InverseProblem
from flexmaps.engine.optimisation.objective import Target
from flexmaps.engine.optimisation.point_copy import with_problem
from flexmaps.engine.optimisation.slot_penalty import SlotRequirement
from flexmaps.engine.optimisation.stability import (
    BARRIER_POLE,
    LEAST_MISMATCH,
    STABLE_EIGENVALUE,
    TANGENT_BELOW,
    RequirementWithoutSprings,
    StabilityBarrier,
    StabilityRequirement,
)
from flexmaps.engine.optimisation.terms import StrainLimit
from flexmaps.engine.params import Settings, SimulateParams
from flexmaps.engine.runs import job
from flexmaps.engine.simulation.simulate import build_model
from flexmaps.engine.spirals.clearance.clearance_model import ClearanceModel
from flexmaps.engine.spirals.design import SpiralDesign
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh

VERO = MATERIALS["vero"]
EXACT = SimulateParams(tolerance=1e-12)
MODES = 3


@lru_cache(maxsize=1)
def made() -> tuple[SpiralDesign, QuadMesh]:
    found = job.run(PolygonMesh.from_quads(shapes.make("dome", 0.04)), Settings(), edge=0.02, stop_after="spirals")
    assert found.design is not None
    return found.design, found.mesh


def start(
    *, flats: bool = False, held: bool = False, groups: int = 1, curving: bool = False, springs: bool = False
) -> DesignPoint:
    """A point with soft modes, of spirals at random; every eigenvalue of the dome's counts as low."""
    design, mesh = made()
    assembly = assembly_from_design(design)
    supports = np.flatnonzero(mesh.centroids[:, 2] < mesh.centroids[:, 2].min() + 0.005) if held else None
    space = DesignSpace.from_design(design, assembly, groups)
    stability = StabilityRequirement(weight=0.7, enough=0.999, modes=MODES)
    loads = Loads.for_spirals(assembly.size, supports=supports)
    if springs:
        loads = dataclasses.replace(loads, springs=Springs(20.0, mesh.centroids))
        stability = RequirementWithoutSprings(weight=0.7, enough=0.999, modes=MODES)
    given = {
        "assembly": assembly,
        "space": space,
        "target": Target(assembly.pairs, mesh.centroids, supports=supports),
        "loads": loads,
        "support_poses": SupportPoses(loads, mesh, design.flat.corners),
        "build_model": lambda a, _: build_model(a, VERO, "arm", quick=not curving),
        "physics": EXACT,
        "stability": stability,
    }
    x = np.random.default_rng(4).uniform(0.2, 0.8, assembly.size * space.coordinates_per_spiral)
    if flats:
        opening = dataclasses.replace(SlotRequirement.from_design(design), width=0.0006)
        flat = FlatRange.from_patches(design.flat, 0.5, 0.035, 0.06, 1e-3, design.flat, space.free_spirals)
        more = {
            "clearance_model": ClearanceModel.from_flat(design.flat, design.params),
            "strain_limit": StrainLimit(VERO, 0.3),
            "slot_requirement": opening,
        }
        x = np.concatenate([x, 0.5 + np.random.default_rng(5).uniform(-0.01, 0.01, 2 * len(flat.span))])
        return FlatProblem(**given, **more, flat=flat).point_at(x, target_pose(mesh, design.flat.corners))
    return InverseProblem(**given).point_at(x, target_pose(mesh, design.flat.corners))


def test_a_point_of_which_more_stability_is_asked_is_the_one_that_is_evaluated_anew() -> None:
    here = start()
    less = dataclasses.replace(here.problem, stability=StabilityRequirement(weight=0.7, enough=BARRIER_POLE))
    stable = with_problem(here, less)
    assert stable.stability_barrier is None and stable.value < here.value
    found = with_problem(stable, here.problem)
    assert found.stability_barrier is not None and found.value == here.value


@pytest.mark.parametrize(
    "options",
    [
        {"curving": True, "flats": True},
        {"flats": True, "held": True},
        {"flats": True, "springs": True},
        *(
            pytest.param(one, marks=pytest.mark.thorough)
            for one in ({}, {"curving": True}, {"held": True}, {"groups": 4}, {"flats": True})
        ),
    ],
    ids=str,
)
def test_gradient_of_the_barrier(options: dict, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(curving_changes, "MIN_SHARE", 0.0)
    monkeypatch.setattr(stability, "DIFFERENCE_TURN", 1e-4)
    monkeypatch.setattr(stability, "MODE_TOLERANCE", 1e-10)
    here = start(**options)
    assert (
        here.equilibrium.converged and here.stability_barrier is not None and len(here.stability_barrier.rises) == MODES
    )
    change = here.stability_barrier.gradient
    gradient = here.adjoint(np.asarray(change.by_hubs)) + change.by_coordinates
    each, n = here.problem.space.coordinates_per_spiral, here.problem.n_spiral_x
    parts = {"widths": slice(0, n, each), "twists": slice(each - 1, n, each)}
    if "flats" in options:
        parts |= {"flat x": slice(n, None, 2), "flat y": slice(n + 1, None, 2)}
    for name, part in parts.items():
        way = np.zeros_like(here.x)
        way[part] = np.random.default_rng(6).normal(size=way[part].shape)

        def value(t: float, way: np.ndarray = way) -> float:
            found = here.problem.point_at(here.x + t * way, here.equilibrium.pose).stability_barrier
            assert found is not None and len(found.rises) == MODES
            return found.value

        h = 1e-4 if not name.startswith("flat") else 1e-5
        slope = (8 * (value(h) - value(-h)) - value(2 * h) + value(-2 * h)) / (12 * h)
        parts_sum = float(np.abs(gradient * way).sum())  # positive and negative parts nearly cancel
        assert float(gradient @ way) == pytest.approx(slope, abs=1e-4 * parts_sum), name


def test_the_logarithm_goes_on_in_a_straight_line() -> None:
    asked, kink, step = StabilityRequirement(1.0), BARRIER_POLE + TANGENT_BELOW, 1e-7
    rises = np.array([kink - step, kink + step])
    values, slopes = asked.rows(rises, STABLE_EIGENVALUE)
    assert values[0] - values[1] == pytest.approx(2.0 * step / TANGENT_BELOW, rel=1e-3)
    assert slopes == pytest.approx([-1.0 / TANGENT_BELOW] * 2, rel=1e-3)
    assert asked.rows(np.array([STABLE_EIGENVALUE]), STABLE_EIGENVALUE)[0] == pytest.approx([0.0], abs=1e-12)


def test_results_are_compared_alike_whatever_the_barrier_weighs() -> None:
    rises = np.array([0.02, 0.2])
    first, last = StabilityRequirement(0.0), StabilityRequirement.from_mismatch(1e-6)
    assert first.merit(1.0, rises) == last.merit(1.0, rises) == last.merit(1.0, rises[:1]) > 1.0
    assert last.merit(1.0, rises[1:]) == 1.0 < last.merit(1.0, np.array([0.05])) < last.merit(1.0, rises)


def test_a_piece_on_its_target_that_is_about_to_snap_is_worse_than_one_a_little_farther() -> None:
    asked, snapping, stable = StabilityRequirement(0.0), np.array([0.02]), np.array([0.5])
    unseen = 0.1 * LEAST_MISMATCH
    assert asked.merit(0.0, stable) < asked.merit(unseen, stable) < asked.merit(0.0, snapping)
    values = np.array([0.5, 1.0, 2.0]) * LEAST_MISMATCH
    penalties = [asked.merit(value, snapping) - value for value in values]
    assert penalties[0] == pytest.approx(penalties[1]) and penalties[2] == pytest.approx(2.0 * penalties[1])


def test_the_barrier_weighs_a_share_of_the_mismatch_of_each_stage() -> None:
    least, few, many = (StabilityRequirement.from_mismatch(share * LEAST_MISMATCH) for share in (0.0, 1.0, 1e2))
    assert least.weight == few.weight == pytest.approx(1e-2 * many.weight)
    here = start()
    stability = here.with_stability_weight().problem.stability
    assert stability is not None
    assert stability.weight == StabilityRequirement.from_mismatch(here.mismatch.value).weight > 0.0


def test_a_lack_of_stability_weighs_nothing_at_the_start() -> None:
    here = start().with_strain_weight(1.0)
    rises = here.stability_barrier.rises if here.stability_barrier is not None else np.ones(1)
    assert not any(isinstance(term, StabilityBarrier) for term in here.terms)
    stability = dataclasses.replace(StabilityRequirement.from_mismatch(1.0), enough=0.999)
    later = dataclasses.replace(here, problem=dataclasses.replace(here.problem, stability=stability))
    assert any(isinstance(term, StabilityBarrier) for term in later.terms) and later.value > here.value
    # results are compared by their stability from the start on
    assert here.merit(0.0) == pytest.approx(StabilityRequirement(0.0).merit(here.mismatch.value, rises))

"""Inverse design: gradients against finite differences, bounds, recovery of a known design, stopping."""

import dataclasses
from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest
from flexmaps.engine.errors import Cancelled, FlexMapsError
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.mechanics.arms import curving_changes
from flexmaps.engine.mechanics.assembly import assembly_from_design, target_pose
from flexmaps.engine.mechanics.loads import Loads
from flexmaps.engine.optimisation import gauss_newton, inverse, optimise
from flexmaps.engine.optimisation.design_space import DesignSpace
from flexmaps.engine.optimisation.gauss_newton import SearchRecord, run_gauss_newton
from flexmaps.engine.optimisation.inverse import DesignPoint, InverseProblem
from flexmaps.engine.optimisation.match_limits import REASON_NAMES, find_limits
from flexmaps.engine.optimisation.objective import Target
from flexmaps.engine.optimisation.task import Task
from flexmaps.engine.optimisation.terms import MILD_STRAIN_PENALTY, StrainLimit
from flexmaps.engine.optimisation.wishes import Wishes
from flexmaps.engine.optimisation.work import Work
from flexmaps.engine.params import OptimiseParams, Settings, SimulateParams
from flexmaps.engine.progress import SILENT, Progress
from flexmaps.engine.runs import job
from flexmaps.engine.simulation.simulate import build_model
from flexmaps.engine.spirals.clearance.slots import twist_bound
from flexmaps.engine.spirals.constraints import NO_CONSTRAINTS, Constraints
from flexmaps.engine.spirals.curves.spiral import same_width
from flexmaps.engine.spirals.design import SpiralDesign
from flexmaps.engine.spirals.fabricable import make_fabricable, uniform_design
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh

VERO = MATERIALS["vero"]
EXACT = SimulateParams(tolerance=1e-11)


@lru_cache(maxsize=2)
def made(name: str = "dome") -> tuple[SpiralDesign, QuadMesh]:
    found = job.run(PolygonMesh.from_quads(shapes.make(name, 0.03)), Settings(), edge=0.02, stop_after="spirals")
    assert found.design is not None
    return found.design, found.mesh


def problem(
    *,
    lies: float = 0.0,
    smoothness: float = 0.0,
    model: str = "arm",
    supports: bool = False,
    strain: float | None = None,
    groups: int = 1,
    kept: bool = False,
    wishes: bool = False,
) -> tuple[InverseProblem, DesignPoint]:
    design, mesh = made()
    assembly = assembly_from_design(design)
    held = np.flatnonzero(mesh.centroids[:, 2] < mesh.centroids[:, 2].min() + 0.005) if supports else None
    loads = Loads.for_spirals(assembly.size, supports=held)
    wanted = Wishes(np.array([2, 7]), mesh.centroids[[2, 7]] + [0.0, 0.004, 0.01]) if wishes else None
    aim = Target(assembly.pairs, mesh.centroids, lies, supports=held, wishes=wanted)
    asked = Constraints(fixed=np.arange(0, assembly.size, 3)) if kept else NO_CONSTRAINTS
    space = DesignSpace.from_design(design, assembly, groups, constraints=asked)
    strain_limit = None if strain is None else StrainLimit(VERO, strain)
    whole = InverseProblem(
        assembly,
        space,
        aim,
        loads,
        lambda a, _: build_model(a, VERO, model, quick=True),
        EXACT,
        smoothness,
        strain_limit,
    )
    x = np.random.default_rng(4).uniform(0.2, 0.8, assembly.size * space.coordinates_per_spiral)
    return whole, whole.point_at(x, target_pose(mesh, design.flat.corners))


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"supports": True, "lies": 1.0},
        {"wishes": True, "supports": True},
        {"strain": 0.3, "pressed": True},
        {"groups": 4, "model": "rod"},
        {"groups": 4, "strain": 0.3, "smoothness": 0.05, "kept": True},
        *(
            pytest.param(one, marks=pytest.mark.thorough)
            for one in (
                {"wishes": True, "lies": 0.3},
                {"groups": 2},
                {"lies": 1.0},
                {"lies": 0.3},
                {"smoothness": 0.05},
                {"supports": True},
                {"model": "rod"},
                {"strain": 0.3},
                {"groups": 4, "strain": 0.3, "smoothness": 0.05},
            )
        ),
    ],
    ids=str,
)
def test_adjoint_gradient_is_that_of_the_objective(options: dict) -> None:
    whole, here = problem(**{name: value for name, value in options.items() if name != "pressed"})
    if "pressed" in options:  # by more than at the beginning
        whole, before = here.with_updated_multipliers().problem, here.value
        here = here.with_updated_multipliers()
        assert here.value > 1.5 * before
    free = np.repeat(whole.space.free_spirals, whole.space.coordinates_per_spiral)
    direction = np.where(free, np.random.default_rng(5).normal(size=here.x.shape), 0.0)
    assert not here.gradient[~free].any() and free.all() is not options.get("kept", False)

    def value(t: float) -> float:
        return whole.point_at(here.x + t * direction, here.equilibrium.pose).value

    if "strain" in options:  # what is tested is there at all
        assert here.value > 1.1 * here.mismatch.value
    h = 2e-5
    slope = (8 * (value(h) - value(-h)) - value(2 * h) + value(-2 * h)) / (12 * h)
    assert here.equilibrium.converged
    parts = here.gradient * direction  # which nearly cancel in some directions
    assert slope == pytest.approx(float(parts.sum()), rel=1e-6, abs=5e-8 * float(np.abs(parts).sum()))


def test_gradient_with_the_second_order_of_the_strains(monkeypatch: pytest.MonkeyPatch) -> None:
    design, mesh = made()
    task = Task(mesh, VERO, OptimiseParams(strain_share=0.3), EXACT, None, None, Work())
    whole = dataclasses.replace(task.build_problem(design), physics=EXACT)
    x = np.clip(whole.space.coordinates(design.width, design.twist), 0.05, 0.95)
    pose = whole.point_at(x, target_pose(mesh, design.flat.corners)).equilibrium.pose
    direction, h = np.random.default_rng(5).normal(size=x.shape), 1e-5
    ahead, behind = (whole.point_at(x + s * direction, pose).value for s in (h, -h))
    gradients = []
    for share in (0.0, curving_changes.MIN_SHARE, np.inf):  # of all joints, of those that matter, of none
        monkeypatch.setattr(curving_changes, "MIN_SHARE", share)
        gradients.append(whole.point_at(x, pose).gradient)
    every, some, none = gradients
    assert (ahead - behind) / (2 * h) == pytest.approx(float(every @ direction), rel=1e-6)
    assert np.linalg.norm(some - every) < np.linalg.norm(none - every)


def test_points_keep_their_derivatives_whatever_came_after_them() -> None:
    """Each against differences right after others were made: more of them than there are factors, some that find no rest."""
    whole, first = problem(strain=0.3)
    rng, start, h = np.random.default_rng(8), first.equilibrium.pose, 2e-5
    points = [first, *(whole.point_at(rng.uniform(0.2, 0.8, len(first.x)), start) for _ in range(3))]
    assert not whole.point_at(1.0 - first.x, start, iterations=1).equilibrium.converged

    def value(point: DesignPoint, t: float) -> float:
        return whole.point_at(point.x + t * direction, point.equilibrium.pose).value

    for point in points:
        direction = rng.normal(size=point.x.shape)
        move = point.hub_increments(direction)  # its own factor, whatever the others did
        slope = (8 * (value(point, h) - value(point, -h)) - value(point, 2 * h) + value(point, -2 * h)) / (12 * h)
        assert float(point.gradient @ direction) == pytest.approx(slope, rel=1e-6)
        assert point.hub_increments(direction) == pytest.approx(move, rel=1e-9, abs=1e-12 * np.abs(move).max())


def test_steps_to_where_a_piece_nearly_snaps_are_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    _, here = problem()
    step = np.full_like(here.x, 1e-3)
    assert here.equilibrium.spare == inverse.MIN_STABILITY
    trace = SearchRecord()
    assert (
        gauss_newton._take_step(here, step, here.hub_increments(step), trace, SILENT) is not None
        and trace.unstable == 0
    )
    # no equilibrium under load is stiffer than its convex part in every way
    monkeypatch.setattr(inverse, "MIN_STABILITY", 1.1)
    assert gauss_newton._take_step(here, step, here.hub_increments(step), trace, SILENT) is None and trace.unstable == 1
    # but where the present one has no more to spare either, as at a start, there is no other way
    edge = dataclasses.replace(here, equilibrium=dataclasses.replace(here.equilibrium, spare=0.0))
    assert gauss_newton._take_step(edge, step, here.hub_increments(step), trace, SILENT) is not None


def test_a_factor_that_was_being_made_when_it_was_stopped_is_nobodys() -> None:
    whole, here = problem()
    alone, seen = here.gradient.copy(), []

    def stopped() -> bool:
        seen.append(0)
        return len(seen) > 4

    other = whole.point_at(np.full_like(here.x, 0.4), here.equilibrium.pose)
    for _ in range(2):
        seen.clear()
        with pytest.raises(Cancelled):
            whole.point_at(np.full_like(here.x, 0.7), here.equilibrium.pose, Progress(stopped=stopped))
    assert other.equilibrium.converged
    again = dataclasses.replace(here)  # nothing of it is known yet
    assert again.gradient == pytest.approx(alone, rel=1e-9, abs=1e-14)


def test_tangent_and_adjoint_are_transposed_and_foretell_the_shape() -> None:
    whole, here = problem()
    rng = np.random.default_rng(6)
    change, pull = rng.normal(size=here.x.shape), rng.normal(size=(whole.assembly.size, 6))
    increments = here.hub_increments(change)
    assert (increments * pull).sum() == pytest.approx((here.adjoint(pull) * change).sum(), rel=1e-8)
    assert (change * here.gauss_newton_product(change)).sum() > 0.0
    h = 1e-4
    ahead = whole.point_at(here.x + h * change, here.equilibrium.pose).equilibrium.pose
    behind = whole.point_at(here.x - h * change, here.equilibrium.pose).equilibrium.pose
    found = (ahead.centres - behind.centres) / (2 * h)
    assert found == pytest.approx(increments[:, :3], abs=1e-5 * np.abs(increments[:, :3]).max())


@pytest.mark.parametrize("groups", [1, 2, 4])
def test_every_point_of_the_box_can_be_cut(groups: int) -> None:
    design, _ = made()
    space = DesignSpace.from_design(design, assembly_from_design(design), groups)
    rng = np.random.default_rng(7)
    for _ in range(3):
        x = rng.uniform(0.0, 1.0, len(design.width) * space.coordinates_per_spiral)
        x.reshape(-1, space.coordinates_per_spiral)[::3, -1] = 1.0
        width, twist = space.width_and_twist(x)
        assert (space.min_width - 1e-12 <= width.T).all() and (space.max_width + 1e-12 >= width.T).all()
        if groups == 1:
            # between two knots the interpolated bound is off by a few degrees, which fitting takes back
            assert (twist <= twist_bound(design.flat, design.params, width) + 0.1).all()
        assert space.coordinates(width, twist) == pytest.approx(x, abs=1e-9)
        h, cells = 1e-6, space.by_spiral(x)
        for k in range(space.coordinates_per_spiral):
            step = np.tile(h * np.eye(space.coordinates_per_spiral)[k], len(cells))
            ahead, behind = (np.column_stack(space.width_and_twist(x + sign * step)) for sign in (1.0, -1.0))
            inner = (cells[:, k] > 2 * h) & (cells[:, k] < 1.0 - 2 * h)
            slopes = space.spiral_jacobians(x)[inner, :, k]
            assert (ahead - behind)[inner] / (2 * h) == pytest.approx(slopes, rel=1e-4, abs=1e-7)


def test_a_shape_made_by_known_spirals_is_found_again() -> None:
    """The target is the equilibrium of a random smooth design: the optimiser must come near to it from a uniform start."""
    design, mesh = made()
    slope = np.clip((mesh.centroids[:, 0] - mesh.centroids[:, 0].min()) / np.ptp(mesh.centroids[:, 0]), 0.0, 1.0)
    secret = make_fabricable(design.flat, design.params, same_width(0.0012 + 0.0006 * slope), 4.0 - 3.0 * slope)
    whole, here = problem()
    wanted = whole.point_at(whole.space.coordinates(secret.width, secret.twist), here.equilibrium.pose).equilibrium.pose
    whole = dataclasses.replace(whole, target=Target(whole.assembly.pairs, wanted.centres))
    start = whole.point_at(whole.space.uniform(0.5, 0.5), wanted)
    trace = SearchRecord()
    best = run_gauss_newton(whole, start, OptimiseParams(iterations=25, stop=0.0), trace, lambda point: None)
    assert best.value < 0.02 * start.value
    values = [value for _, value, _ in trace.rows]
    assert all(b < a for a, b in pairwise(values))
    assert (best.x >= 0.0).all() and (best.x <= 1.0).all()


@pytest.mark.thorough
def test_the_whole_job_improves_the_match_and_can_be_cut() -> None:
    design, mesh = made()
    seen = []
    found = optimise.optimise(
        design,
        mesh,
        VERO,
        OptimiseParams(iterations=4, codesign=False),
        SimulateParams(),
        progress=Progress(shown=seen.append),
    )
    block = found.report()
    assert block["laplacian_rmse_mm"] < 0.9 * block["laplacian_rmse_mm_before"]
    assert found.is_finished and found.after.equilibrium.converged
    assert seen and seen[-1].vertices.shape == mesh.vertices.shape
    # the result is as it was asked for: cutting it again changes nothing
    again = make_fabricable(found.design.flat, design.params, found.design.width, found.design.twist)
    assert again.twist == pytest.approx(found.design.twist, abs=1e-6)
    limits = find_limits(found)
    assert len(limits.kind) == len(mesh.quads) and limits.kind.max() < len(REASON_NAMES)
    assert limits.share.sum() == pytest.approx(1.0) and limits.advice.endswith(".")
    assert sum(limits.report()["spirals"].values()) == len(mesh.quads)


@pytest.mark.thorough
def test_a_further_run_never_ends_worse() -> None:
    design, mesh = made("saddle")
    params = OptimiseParams(restart=False, codesign=False, stop=1e-4)
    for _ in range(3):
        found = optimise.optimise(design, mesh, VERO, params, SimulateParams())
        design = found.design
        before, after = (
            optimise.SimulatedResult(one, found.point, np.inf).merit(MILD_STRAIN_PENALTY)
            for one in (found.before, found.after)
        )
        # equilibria are found to a tolerance
        assert after <= before * (1.0 + 1e-6)


def thin_ring() -> tuple[SpiralDesign, QuadMesh]:
    """A closed tube that nothing but its second order of the strains keeps from folding."""
    around, across = 8, 3
    u, v = (2.0 * np.pi * np.arange(k) / k for k in (around, across))
    radius = 1.0 + 0.25 * np.cos(v)
    points = np.stack(np.broadcast_arrays(
        radius * np.cos(u)[:, None], radius * np.sin(u)[:, None], 0.25 * np.sin(v)), axis=-1)  # fmt: skip
    index = np.arange(around * across).reshape(around, across)
    ahead = np.roll(index, -1, axis=0)
    quads = np.stack([index, ahead, np.roll(ahead, -1, axis=1), np.roll(index, -1, axis=1)], axis=-1)
    mesh = shapes.subdivide(QuadMesh(points.reshape(-1, 3), quads.reshape(-1, 4)))
    found = job.run(PolygonMesh.from_quads(mesh), Settings(), edge=0.02, stop_after="spirals")
    assert found.design is not None
    return found.design, found.mesh


@pytest.mark.thorough
def test_what_is_simulated_in_the_end_is_what_was_found() -> None:
    design, mesh = thin_ring()
    found = optimise.optimise(
        design, mesh, VERO, OptimiseParams(strain_share=0.0, iterations=8, codesign=False), SimulateParams()
    )
    block = found.report()
    assert block["laplacian_rmse_mm"] < block["laplacian_rmse_mm_before"]
    assert block["rms_percent"] < max(1.1 * block["rms_percent_before"], 1.0)
    # nothing that was seen on the way is lost when arms give way and the whole model takes over
    assert block["laplacian_rmse_mm"] < 1.5 * min(row["rmse_mm"] for row in block["history"])


@pytest.mark.thorough
def test_the_end_is_told() -> None:
    design, mesh = made()
    patient = optimise.optimise(
        design,
        mesh,
        VERO,
        OptimiseParams(iterations=2, codesign=False, strain_share=0.0, patience=0.0),
        SimulateParams(),
    )
    assert patient.ended == "iterations"
    hasty = optimise.optimise(design, mesh, VERO, OptimiseParams(patience=0.02, codesign=False), SimulateParams())
    assert hasty.ended in ("time", "nothing") and hasty.is_finished
    assert hasty.report()["laplacian_rmse_mm"] <= hasty.report()["laplacian_rmse_mm_before"]
    assert hasty.report()["end"] == optimise.ENDS[hasty.ended]


def test_loads_that_are_too_much_at_once_are_put_on_in_parts() -> None:
    """Where no start finds rest within a few iterations under the whole load, it does in parts."""
    whole, here = problem(supports=True)
    pull = np.zeros((whole.assembly.size, 3))
    pull[:, 2] = -0.02
    loaded = dataclasses.replace(
        whole,
        loads=dataclasses.replace(whole.loads, force=pull),
        physics=SimulateParams(iterations=200, tolerance=1e-6),
    )
    direct = loaded.point_at(here.x, here.equilibrium.pose)
    parts = optimise._load_in_parts(loaded, here.x, here.equilibrium.pose, SILENT)
    assert parts.equilibrium.converged and parts.problem is loaded
    if direct.equilibrium.converged:
        assert parts.value == pytest.approx(direct.value, rel=1e-3)


def test_a_target_with_other_quads_is_refused() -> None:
    design, _ = made()
    with pytest.raises(FlexMapsError, match="lay out the panels again"):
        optimise.optimise(design, made("saddle")[1], VERO, OptimiseParams(), SimulateParams())


def test_no_equilibrium_to_start_from_is_said() -> None:
    design, mesh = made()
    with pytest.raises(FlexMapsError, match="No equilibrium"):
        optimise.optimise(design, mesh, VERO, OptimiseParams(), SimulateParams(iterations=1))


def test_uniform_start_is_uniform() -> None:
    design, _ = made()
    assert np.ptp(uniform_design(design.flat, design.params).width) < 1e-4


def test_poses_of_other_rests_are_not_shown_as_designs(monkeypatch: pytest.MonkeyPatch) -> None:
    @dataclasses.dataclass(frozen=True)
    class Found:
        others: tuple[object, ...] = ()

    def rests(found: Found, physics: object, progress: Progress) -> Found:
        progress.show("a pose")
        return Found(("another",))

    shown: list[object] = []
    monkeypatch.setattr(optimise, "find_other_rests", rests)
    made = optimise._with_other_rests(Found(), SimulateParams(), Progress(shown=shown.append))  # type: ignore[arg-type]
    assert made == Found(("another",)) and shown == []  # type: ignore[comparison-overlap]

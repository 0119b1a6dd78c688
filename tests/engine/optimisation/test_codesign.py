"""Co-design: derivatives by the flat vertices against finite differences, limits that hold, a better match that can be cut."""

import dataclasses
from functools import lru_cache

import numpy as np
import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.mechanics.arms import curving_changes
from flexmaps.engine.mechanics.arms.model import ArmModel
from flexmaps.engine.mechanics.assembly import Pose, assembly_from_design, target_pose
from flexmaps.engine.mechanics.loads import Loads, parse_supports
from flexmaps.engine.mechanics.support_poses import SupportPoses
from flexmaps.engine.optimisation import codesign, optimise
from flexmaps.engine.optimisation.codesign_cost import FlatCost, FlatLimits
from flexmaps.engine.optimisation.codesign_geometry import geometry_jacobian, joint_derivatives
from flexmaps.engine.optimisation.codesign_problem import FlatPoint, FlatProblem, FlatRange
from flexmaps.engine.optimisation.design_space import DesignSpace
from flexmaps.engine.optimisation.gauss_newton import SearchRecord, run_gauss_newton
from flexmaps.engine.optimisation.inverse import InverseProblem
from flexmaps.engine.optimisation.objective import Target
from flexmaps.engine.optimisation.point_copy import with_position_share
from flexmaps.engine.optimisation.slot_penalty import SlotRequirement
from flexmaps.engine.optimisation.terms import StrainLimit, StrainTerm
from flexmaps.engine.params import ChooseParams, LayoutParams, OptimiseParams, Settings, SimulateParams
from flexmaps.engine.patches.flattening.flatten import (
    count_flipped,
    flatten,
    overlapping_patches,
    seam_mismatch,
    with_energies,
)
from flexmaps.engine.patches.layout import PatchLayout
from flexmaps.engine.progress import SILENT, Progress
from flexmaps.engine.runs import job
from flexmaps.engine.simulation.simulate import build_model, simulate
from flexmaps.engine.spirals.clearance.clearance_model import ClearanceModel
from flexmaps.engine.spirals.constraints import NO_CONSTRAINTS, Constraints
from flexmaps.engine.spirals.design import SpiralDesign
from flexmaps.engine.spirals.fabricable import make_fabricable
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh

VERO = MATERIALS["vero"]
EXACT = SimulateParams(tolerance=1e-11)
LIMIT, SEAM = 0.035, 0.06


@lru_cache(maxsize=2)
def made(name: str = "dome") -> tuple[SpiralDesign, QuadMesh]:
    found = job.run(
        PolygonMesh.from_quads(shapes.make(name, 0.03)),
        Settings(choose=ChooseParams(goal="panels")),
        edge=0.02,
        stop_after="spirals",
    )
    assert found.design is not None
    return found.design, found.mesh


def problem(
    model: str = "arm",
    share: float = 0.0,
    groups: int = 1,
    opening: float | None = None,
    kept: bool = False,
    feet: str = "",
    curving: bool = False,
) -> tuple[FlatProblem, Pose]:
    """A problem of the dome.

    share : of the material's strain, 0 where it does not count; feet : "clamped" or "hinged" at four corners, "" for none
    curving : with the second order of the strains
    """
    design, mesh = made()
    assembly = assembly_from_design(design)
    space = DesignSpace.from_design(
        design, assembly, groups, constraints=Constraints(fixed=np.arange(4)) if kept else NO_CONSTRAINTS
    )
    supports = parse_supports(mesh, "lowest")[::2] if feet else None
    loads = Loads.for_spirals(assembly.size, supports=supports, clamped=feet == "clamped")
    whole = FlatProblem(
        assembly=assembly,
        space=space,
        target=Target(assembly.pairs, mesh.centroids, supports=supports),
        loads=loads,
        build_model=lambda a, _: build_model(a, VERO, model, quick=not curving),
        physics=EXACT,
        strain_limit=StrainLimit(VERO, share) if share else None,
        clearance_model=ClearanceModel.from_flat(design.flat, design.params),
        slot_requirement=None
        if opening is None
        else dataclasses.replace(SlotRequirement.from_design(design), width=opening),
        flat=FlatRange.from_patches(design.flat, 0.5, LIMIT, SEAM, 1e-3, design.flat, space.free_spirals),
        support_poses=SupportPoses(loads, mesh, design.flat.corners),
    )
    return whole, target_pose(mesh, design.flat.corners)


def anywhere(whole: FlatProblem, spread: float = 0.01) -> np.ndarray:
    rng = np.random.default_rng(4)
    spirals = rng.uniform(0.2, 0.8, whole.space.coordinates_per_spiral * whole.assembly.size)
    return np.concatenate([spirals, 0.5 + rng.uniform(-spread, spread, 2 * len(whole.flat.span))])


def slope(value: object, h: float) -> float:
    """Of a function of one number at 0, by differences of the fourth order."""
    return float((8 * (value(h) - value(-h)) - value(2 * h) + value(-2 * h)) / (12 * h))  # type: ignore[operator]


@pytest.mark.parametrize(
    "options",
    [
        {"groups": 4, "share": 0.3, "kept": True},
        {"share": 0.3, "opening": 0.0006, "curving": True},
        {"feet": "clamped", "share": 0.3, "opening": 0.0006},
        *(
            pytest.param(one, marks=pytest.mark.thorough)
            for one in (
                {},
                {"share": 0.3},
                {"groups": 4},
                {"opening": 0.0015},
                {"share": 0.3, "opening": 0.0006},
                {"feet": "clamped"},
                {"feet": "hinged"},
            )
        ),
    ],
    ids=str,
)
def test_gradient_by_spirals_and_flat_vertices(options: dict, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(curving_changes, "MIN_SHARE", 0.0)
    whole, pose = problem(**options)
    here = whole.point_at(anywhere(whole), pose)
    assert (whole.flat.span == 0.0).any() == ("kept" in options)
    n, each = here.n_spiral_x, whole.space.coordinates_per_spiral
    assert here.equilibrium.converged and here.costs[-1].cost.inside
    assert any(isinstance(term, StrainTerm) and term.value > 0.0 for term in here.terms) == ("share" in options)
    assert (here._narrow_slots is not None) == ("opening" in options)
    if "share" in options:
        assert here._strain_jacobian(np.zeros(0, dtype=int)).by_coordinates.shape == (
            0,
            len(here.x),
        )  # where no arm is pressed
    parts = {"widths": slice(0, n, each), "twists": slice(each - 1, n, each)}
    parts |= {"flat x": slice(n, None, 2), "flat y": slice(n + 1, None, 2)}
    for name, part in parts.items():
        direction = np.zeros_like(here.x)
        direction[part] = np.random.default_rng(5).normal(size=direction[part].shape)
        found = slope(lambda t, d=direction: whole.point_at(here.x + t * d, here.equilibrium.pose).value, 3e-6)
        parts_of_it = here.gradient * direction  # which nearly cancel in some directions
        assert found == pytest.approx(float(parts_of_it.sum()), abs=1e-7 * float(np.abs(parts_of_it).sum())), name


def test_a_point_with_other_weights_is_the_one_that_is_evaluated_anew() -> None:
    whole, pose = problem(share=0.3, opening=0.0006)
    here = whole.point_at(anywhere(whole), pose)
    here.precompute(SILENT)
    found = here.with_updated_weights()
    again = found.problem.point_at(here.x, here.equilibrium.pose)
    assert found.problem.flat.weight != whole.flat.weight and found.value != here.value
    assert found.value == pytest.approx(again.value, rel=1e-6)
    np.testing.assert_allclose(found.gradient, again.gradient, atol=1e-5 * np.abs(again.gradient).max())


def test_a_point_compared_otherwise_is_the_one_that_is_evaluated_anew() -> None:
    whole, pose = problem(share=0.3, opening=0.0006)
    here = whole.point_at(anywhere(whole), pose)
    here.precompute(SILENT)
    found = with_position_share(here, 0.9 * here.problem.target.position_share)
    again = found.problem.point_at(here.x, here.equilibrium.pose)
    assert found.value != here.value and found.relative_distance == here.relative_distance
    assert found.value == pytest.approx(again.value, rel=1e-6)
    np.testing.assert_allclose(found.gradient, again.gradient, atol=1e-5 * np.abs(again.gradient).max())
    assert with_position_share(here, here.problem.target.position_share) is here


@pytest.mark.parametrize("feet", ["", "clamped"])
def test_tangent_and_adjoint_are_transposed_and_foretell_the_shape(feet: str) -> None:
    whole, pose = problem(share=0.3, opening=0.0006, feet=feet)
    here = whole.point_at(anywhere(whole), pose)
    rng = np.random.default_rng(6)
    change, other = rng.normal(size=(2, len(here.x)))
    pull = rng.normal(size=(whole.assembly.size, 6))
    increments = here.hub_increments(change)
    assert (increments * pull).sum() == pytest.approx((here.adjoint(pull) * change).sum(), rel=1e-8)
    assert (other * here.gauss_newton_product(change)).sum() == pytest.approx(
        (change * here.gauss_newton_product(other)).sum(), rel=1e-8
    )
    assert (change * here.gauss_newton_product(change)).sum() > 0.0
    h = 1e-5
    ahead, behind = (whole.point_at(here.x + s * change, here.equilibrium.pose).equilibrium.pose for s in (h, -h))
    assert (ahead.centres - behind.centres) / (2 * h) == pytest.approx(
        increments[:, :3], abs=1e-5 * np.abs(increments[:, :3]).max()
    )


def test_geometry_of_the_joints_follows_the_vertices() -> None:
    design, _ = made()
    layout, points = design.flat.layout, design.flat.points
    step = np.random.default_rng(7).normal(size=points.shape)
    h = 1e-7

    def numbers(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        made_of = assembly_from_design(dataclasses.replace(design, flat=with_energies(layout, p)))
        along = made_of.axes[..., 1]
        return made_of.lever[..., :2], np.arctan2(along[..., 1], along[..., 0])

    ahead, behind = numbers(points + h * step), numbers(points - h * step)
    found = (geometry_jacobian(layout, points) @ step.ravel()).reshape(*ahead[1].shape, 3)
    assert found[..., :2] == pytest.approx((ahead[0] - behind[0]) / (2 * h), abs=1e-7)
    turned = (ahead[1] - behind[1] + np.pi) % (2 * np.pi) - np.pi
    assert found[..., 2] == pytest.approx(turned / (2 * h), rel=1e-5, abs=1e-4)


def test_derivatives_by_geometry_of_a_known_function() -> None:
    design, mesh = made()
    model = ArmModel.from_assembly(assembly_from_design(design), VERO, curving=False)
    assembly = model.assembly

    def measure(alone: ArmModel, pose: Pose) -> np.ndarray:
        lever, along = alone.assembly.lever, alone.assembly.axes[..., 1]
        angle = np.arctan2(along[..., 1], along[..., 0])
        return np.stack([lever[:, 0, 0] * lever[:, 1, 1], np.sin(angle[:, 1]) + 0.0 * pose.centres[::2, 0]], axis=1)

    found = joint_derivatives(model, target_pose(mesh, design.flat.corners), measure)
    wanted = np.zeros((len(assembly.pairs), 2, 2, 3))
    wanted[:, 0, 0, 0], wanted[:, 0, 1, 1] = assembly.lever[:, 1, 1], assembly.lever[:, 0, 0]
    wanted[:, 1, 1, 2] = assembly.axes[:, 1, 1, 1] * 0.0 + assembly.axes[:, 1, 0, 1]
    assert found == pytest.approx(wanted, abs=1e-8)


def test_barriers() -> None:
    design, _ = made()
    flat = design.flat
    limits = FlatLimits.relaxed_to(flat, LIMIT, SEAM)
    rng = np.random.default_rng(8)
    points = flat.points + 1e-4 * rng.normal(size=flat.points.shape)
    cost, step = FlatCost.from_points(limits, points), 1e-3 * rng.normal(size=points.shape)
    # the same measures as those of the layout
    known = with_energies(flat.layout, points)
    assert cost.energy == pytest.approx(known.energy, rel=1e-12)
    assert np.abs(cost.apart) == pytest.approx(seam_mismatch(known), abs=1e-12)
    found = slope(lambda t: FlatCost.from_points(limits, points + t * step).value, 1e-3)
    assert found == pytest.approx(float((cost.gradient * step).sum()), rel=1e-8)
    # symmetric, and positive everywhere
    other = rng.normal(size=points.shape)
    assert other.ravel() @ cost.hessian @ step.ravel() == pytest.approx(
        step.ravel() @ cost.hessian @ other.ravel(), rel=1e-9
    )
    assert step.ravel() @ cost.hessian @ step.ravel() > 0.0
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    assert FlatCost.from_points(limits, points @ turn.T + 0.3).value == pytest.approx(cost.value, rel=1e-9)
    assert not FlatCost.from_points(limits, 1.2 * points).inside


def test_barriers_bend_as_told_where_nothing_is_strained() -> None:
    """Of a plane in two panels, laid out as it is, the Hessian leaves out nothing."""
    rng = np.random.default_rng(4)
    x, y = (0.02 * part for part in np.meshgrid(np.arange(5.0), np.arange(4.0), indexing="ij"))
    vertices = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    vertices[:, :2] += 0.002 * rng.normal(size=(len(vertices), 2))
    first = (4 * np.arange(4)[:, None] + np.arange(3)).ravel()
    mesh = QuadMesh(vertices, first[:, None] + np.array([0, 4, 5, 1]))
    across = np.flatnonzero((np.sort(mesh.edges, axis=1) // 4 == 2).all(axis=1))
    layout = PatchLayout(mesh, np.isin(np.arange(len(mesh.edges)), across))
    flat = flatten(layout, LayoutParams())
    points = np.zeros_like(flat.points)
    points[layout.flat_corners] = mesh.vertices[mesh.quads][..., :2]
    limits = FlatLimits.relaxed_to(flat, LIMIT, SEAM)
    assert len(limits.surface) == 3
    one, other = 1e-3 * rng.normal(size=(2, *points.shape))
    bent = slope(lambda t: float((FlatCost.from_points(limits, points + t * one).gradient * other).sum()), 1e-4)
    assert float(other.ravel() @ FlatCost.from_points(limits, points).hessian @ one.ravel()) == pytest.approx(
        bent, rel=1e-6
    )


@pytest.mark.parametrize("feet", ["", "clamped"])
def test_a_point_with_flat_shapes_that_have_not_moved_is_that_of_the_spirals(feet: str) -> None:
    whole, pose = problem(share=0.3, opening=0.0006, curving=True, feet=feet)
    alone = InverseProblem(**{one.name: getattr(whole, one.name) for one in dataclasses.fields(InverseProblem)})
    start = alone.point_at(np.random.default_rng(4).uniform(0.2, 0.8, whole.n_spiral_x), pose)
    assert start.value > 0.0  # computes what the other point takes over
    known = whole.convert_point(start)
    anew = whole.point_at(known.x, start.equilibrium.pose)
    assert known.value == pytest.approx(anew.value, rel=1e-6)
    np.testing.assert_allclose(known.gradient, anew.gradient, atol=1e-5 * np.abs(anew.gradient).max())


def test_a_step_is_shortened_only_where_it_would_break_a_limit() -> None:
    flat = problem()[0].flat
    inner = np.full((len(flat.span), 2), 0.5)
    x, corner = inner + np.random.default_rng(2).uniform(-1e-3, 1e-3, inner.shape), flat.flat.layout.flat_corners[7]
    assert (flat.clip_to_limits(x, inner) == x).all()
    x[corner[0]] += 0.4
    assert not flat.cost(x).inside
    found = flat.clip_to_limits(x, inner)
    assert flat.cost(found).inside
    moved_back = (found != x).any(axis=1)
    assert moved_back[corner[0]]
    beside = (flat.flat.layout.flat_corners == corner[0]).any(axis=1)
    assert not moved_back[np.setdiff1d(np.arange(len(x)), flat.flat.layout.flat_corners[beside])].any()


def test_the_match_improves_within_the_limits_and_can_be_cut() -> None:
    design, mesh = made()
    whole, pose = problem()
    alone = InverseProblem(**{f.name: getattr(whole, f.name) for f in dataclasses.fields(InverseProblem)})
    params, trace = OptimiseParams(iterations=6), SearchRecord()
    alone, x = optimise._make_fabricable(alone, design, alone.space.coordinates(design.width, design.twist), SILENT)
    start = alone.point_at(x, pose)
    few = dataclasses.replace(params, iterations=3)  # leaves the flat shapes something to gain
    spirals = run_gauss_newton(alone, start, few, SearchRecord(), lambda point: None)
    points: list[FlatPoint] = []
    found = codesign.refine_flat_shapes(alone, spirals, design, params, trace, points.append)
    assert np.array_equal(points[-1].x, found.x) and len(points) == len(trace.rows)
    assert found.mismatch.value < 0.9 * spirals.mismatch.value and found.mismatch.rmse < spirals.mismatch.rmse
    better = codesign.to_design(found, design)
    flat = better.flat
    assert flat.energy.max() < LIMIT and seam_mismatch(flat).max() < max(SEAM, 1.02 * seam_mismatch(design.flat).max())
    assert overlapping_patches(flat) == [] and not count_flipped(flat.corners @ np.array([1.0, 1.0j])).any()
    # it is the simulated object that is nearer, and fitting it again changes nothing
    before = simulate(
        make_fabricable(design.flat, design.params, *alone.space.width_and_twist(spirals.x)),
        mesh,
        VERO,
        SimulateParams(),
    )
    after = simulate(better, mesh, VERO, SimulateParams(), start=found.equilibrium.pose)
    assert after.report()["laplacian_rmse_mm"] < 0.95 * before.report()["laplacian_rmse_mm"]
    assert make_fabricable(flat, better.params, better.width, better.twist).twist == pytest.approx(
        better.twist, abs=1e-6
    )
    report = codesign.flat_report(design.flat, flat)
    assert 0.0 < report["flat_strain_median"] < 0.1


@pytest.mark.thorough
def test_optimise_moves_the_flat_shapes_where_asked() -> None:
    design, mesh = made()
    params = OptimiseParams(iterations=5, strain_share=0.0, codesign=False)
    alone = optimise.optimise(design, mesh, VERO, params, SimulateParams()).report()
    looks: list[object] = []
    params = dataclasses.replace(params, codesign=True)
    found = optimise.optimise(design, mesh, VERO, params, SimulateParams(), progress=Progress(shown=looks.append))
    report = found.report()
    assert found.is_finished and found.after.equilibrium.converged and found.design.flat is not design.flat
    assert report["laplacian_rmse_mm"] < 0.97 * alone["laplacian_rmse_mm"]
    assert found.at_bound.shape == found.gradient.shape == (len(mesh.quads), 5)
    assert report["flat"]["energy_max"] < LIMIT and "flat" not in alone
    # stopped while the flat shapes move: what has moved so far is kept
    count, seen = len(looks), []
    stopping = Progress(shown=seen.append, stopped=lambda: len(seen) >= 8)
    assert count > 10
    stopped = optimise.optimise(design, mesh, VERO, params, SimulateParams(), progress=stopping)
    assert not stopped.is_finished and stopped.design.flat is not design.flat
    assert stopped.report()["laplacian_rmse_mm"] < stopped.report()["laplacian_rmse_mm_before"]


def test_a_point_outside_the_limits_of_flat_shapes_costs_without_end() -> None:
    outside = FlatCost.from_points(problem()[0].flat.limits, 1.5 * made()[0].flat.points)
    assert not outside.inside and outside.value == np.inf


def test_rods_are_refused() -> None:
    design, mesh = made()
    whole, pose = problem(model="rod")
    alone = InverseProblem(**{f.name: getattr(whole, f.name) for f in dataclasses.fields(InverseProblem)})
    start = alone.point_at(np.full((len(mesh.quads), 2), 0.5), pose)
    with pytest.raises(FlexMapsError, match="Arms"):
        codesign.refine_flat_shapes(alone, start, design, OptimiseParams(), SearchRecord(), lambda point: None)


def test_patches_that_overlap_are_no_design() -> None:
    design, _ = made()
    whole, pose = problem()
    x = np.concatenate([whole.space.coordinates(design.width, design.twist), np.full(2 * len(whole.flat.span), 0.5)])
    here = whole.point_at(x, pose)
    # one vertex pulled far across its patch
    folded = dataclasses.replace(whole.flat, span=40.0 * whole.flat.span)
    x = x.copy()
    first = here.n_spiral_x + 2 * design.flat.layout.flat_corners[0, 0]
    x[first : first + 2] = 1.0
    broken = dataclasses.replace(here, problem=dataclasses.replace(whole, flat=folded), x=x)
    assert overlapping_patches(with_energies(design.flat.layout, folded.points(broken.flat_x)))
    assert codesign.to_design(broken, design) is None
    assert codesign.to_design(here, design) is not None

"""The rim along open borders: outlines judged by shapely, beams by closed forms, derivatives by finite differences."""

import dataclasses
import sys
from functools import lru_cache
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import shapely
import trimesh
from flexmaps.engine.display import arrange, solids
from flexmaps.engine.display.panel_mesh import DETAILS, make_panel_mesh
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.mechanics.arms import bent_rim
from flexmaps.engine.mechanics.arms.bent import bend_arms
from flexmaps.engine.mechanics.arms.model import ArmModel
from flexmaps.engine.mechanics.assembly import Pose, assembly_from_design, target_pose
from flexmaps.engine.mechanics.loads import Loads
from flexmaps.engine.mechanics.rim_bodies import NECK, RimJoints
from flexmaps.engine.optimisation.codesign_problem import FlatProblem, FlatRange
from flexmaps.engine.optimisation.design_space import DesignSpace
from flexmaps.engine.optimisation.objective import Target
from flexmaps.engine.optimisation.slot_penalty import SlotRequirement
from flexmaps.engine.optimisation.stability import StabilityRequirement
from flexmaps.engine.optimisation.terms import StrainLimit
from flexmaps.engine.params import ChooseParams, Settings, SimulateParams, SpiralParams
from flexmaps.engine.progress import SILENT
from flexmaps.engine.runs import job
from flexmaps.engine.simulation.simulate import build_model, simulate
from flexmaps.engine.spirals import fabricable
from flexmaps.engine.spirals.clearance.clearance_model import ClearanceModel
from flexmaps.engine.spirals.design import SpiralDesign
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh

VERO = MATERIALS["vero"]
RIM = SpiralParams(border="rim")


def polygon(outline):
    return shapely.Polygon(outline.outer.sample(1e-7), [h.sample(1e-7) for h in outline.holes])


@lru_cache(maxsize=4)
def made(name: str = "dome", edge: float = 0.03) -> tuple[SpiralDesign, QuadMesh]:
    settings = Settings(spiral=RIM, choose=ChooseParams(goal="panels"))
    found = job.run(PolygonMesh.from_quads(shapes.make(name, edge)), settings, edge=0.02, stop_after="spirals")
    assert found.design is not None
    return found.design, found.mesh


@pytest.mark.parametrize("material", [pytest.param("vero", marks=pytest.mark.thorough), "birch"])
def test_derivatives_that_are_found_later_are_those_found_at_once(material):
    whole = assembly_from_design(made()[0])
    at_once, later = (
        ArmModel.from_assembly(whole, MATERIALS[material], curving=False, slopes=slopes) for slopes in (True, False)
    )
    assert later.compliance.by is None
    np.testing.assert_array_equal(later.compliance.values, at_once.compliance.values)
    for part in (lambda model: model, lambda model: model.without_strips, lambda model: model.rim_only):
        np.testing.assert_allclose(
            part(later).compliance_by, part(at_once).compliance.by, rtol=1e-12, atol=1e-15
        )  # sums in another order


@pytest.mark.parametrize("degrees", [0, 200])
def test_a_panel_is_a_strip_beside_the_same_spirals(flat_grid, degrees):
    flat = flat_grid(4, 3, cut=lambda x, y: x == 2.0)
    whole = fabricable.uniform_design(flat, RIM, width=0.0015, twist=np.radians(degrees))
    rim = whole.rim
    assert rim is not None
    following = np.flatnonzero(rim.next_node >= 0)
    strips = RimJoints.from_rim(rim, whole.arms.centre).pairs
    assert np.array_equal(strips, np.column_stack([following, rim.next_node[following]]))
    for outline, own in zip(whole.outlines(1e-7), range(2), strict=True):
        shape = polygon(outline)
        assert shape.is_valid
        # the area of the drawn panel is known before it is drawn, but for the fillets
        assert whole.area[flat.layout.patch_of == own].sum() == pytest.approx(shape.area, rel=2e-3)
        holes = [h.sample(1e-7) for h in outline.holes]
        round_ = [h for h in holes if abs(shapely.Polygon(h).area - np.pi * 0.001**2) < 1e-9]
        patches, places = rim.hole_centres
        assert len(round_) == (patches == own).sum() >= 10
        # as much material as the strip that its middle line is buffered to, its holes and the necks
        node, way = np.flatnonzero(rim.next_node >= 0), np.linspace(0.0, 1.0, 200)
        node = node[rim.patch[node] == own]
        lines = [rim.points_at(np.full(200, n), way * rim.length[n])[0] for n in node]
        ends = [
            rim.centre[n] + s * o * rim.along[n]
            for n in np.flatnonzero(rim.patch == own)
            for s, o in ((1.0, rim.overhang[n, 0]), (-1.0, rim.overhang[n, 1]))
            if o
        ]
        lines += [np.array([rim.centre[np.abs(rim.centre - e).argmin()], e]) for e in ends]
        strip = shapely.union_all(
            [shapely.LineString(np.c_[z.real, z.imag]).buffer(0.0025, cap_style="flat") for z in lines]
        )
        strip = strip.difference(shapely.union_all([shapely.Point(z.real, z.imag).buffer(0.001) for z in places]))
        assert strip.difference(shape.buffer(1e-6)).area < 0.02 * strip.area  # the ends are round
        edge = shapely.union_all([shapely.LinearRing(shapely.Polygon(s).exterior) for s in [shape.exterior]])
        for hole in round_:
            assert shapely.distance(shapely.LinearRing(hole), edge) >= 0.001 - 1e-6


def test_area_of_round_ends_and_holes_is_that_of_the_outline(flat_grid):
    """Straight arms with almost no fillets, which the area leaves out; to 0.01 square millimetres."""
    flat = flat_grid(4, 3, cut=lambda x, y: x == 2.0)
    whole = fabricable.uniform_design(flat, dataclasses.replace(RIM, fillet=1e-5), width=0.0015, twist=0.0)
    rim = whole.rim
    assert rim is not None and (rim.end_hole_distances > 0.0).any() and rim.hole_count.any()
    drawn = sum(polygon(outline).area for outline in whole.outlines(1e-7))
    assert whole.area.sum() == pytest.approx(drawn, abs=1e-8)


@pytest.mark.parametrize("wrong", [{"rim_width": 0.003}, {"rim_spacing": 0.003}])
def test_holes_that_have_no_room_are_refused(wrong):
    with pytest.raises(FlexMapsError, match="at least twice"):
        dataclasses.replace(RIM, **wrong)


def test_a_border_that_turns_inwards_too_sharply_is_refused(flat_grid):
    flat = flat_grid(3, 3, without=lambda i, j: i + j == 4)
    assert fabricable.uniform_design(flat, RIM, width=0.0015, twist=1.0).rim is not None
    with pytest.raises(FlexMapsError, match="no room there; make it narrower") as error:
        fabricable.uniform_design(flat, dataclasses.replace(RIM, rim_width=0.02), width=0.0015, twist=1.0)
    assert set(error.value.faces) <= {5, 7}


def test_the_strip_goes_round_corners_outside_the_border(flat_grid):
    """From node to node without a jump; straight parts at one distance from the border, its inner edge nowhere within."""
    flat = flat_grid(4, 4, move=lambda p: p + 0.15 * p[:, ::-1] * [1.0, 0.0], without=lambda i, j: i > 1 and j > 1)
    rim = fabricable.uniform_design(flat, RIM, width=0.0015, twist=0.0).rim
    assert rim is not None and (rim.next_node >= 0).all() and (rim.turn > 0.1).any() and (rim.turn < -0.1).any()
    node = np.repeat(np.arange(len(rim.quad)), 60)
    share = np.tile(np.linspace(0.0, 1.0, 60), len(rim.quad))
    place, _ = rim.points_at(node, share * rim.length[node])
    np.testing.assert_allclose(place[share == 1.0], rim.centre[rim.next_node], atol=1e-12)
    border = shapely.union_all([shapely.Polygon(quad) for quad in flat.corners]).exterior
    apart = shapely.distance(shapely.points(place.real, place.imag), border)
    assert apart[share == 0.0] == pytest.approx(rim.depth + 0.5 * rim.width, abs=1e-12)
    assert apart.min() >= 0.5 * rim.width - 1e-9


def test_strips_of_uneven_quads_join_where_both_nodes_end(flat_grid):
    """A strip's joint lies as far along the rim from one node as from the other, and necks end on the strip's centre line."""
    flat = flat_grid(4, 3, move=lambda p: p * (1.0 + 6.0 * p), cut=lambda x, y: x == 2.0)
    whole = fabricable.uniform_design(flat, RIM, width=0.0015, twist=0.0)
    rim = whole.rim
    assert rim is not None
    joints = RimJoints.from_rim(rim, whole.arms.centre)
    then = joints.pairs[:, 1]
    assert np.ptp(rim.reach[rim.reach > 0.0]) > 1e-3  # quads of several sizes
    back, _ = rim.vectors_along_strip(then, True, rim.reach[then, 1])
    np.testing.assert_allclose(joints.strip_lever[:, 1, :2] @ [1.0, 1j], back, atol=1e-9)
    neck = bent_rim._line(rim, NECK, np.array([0.0, 1.0]))[0]
    np.testing.assert_allclose(neck[:, 1], rim.middle - rim.centre, atol=1e-12)


def test_strips_and_necks_are_beams(flat_grid):
    flat = flat_grid(3, 1)
    plain = dataclasses.replace(RIM, rim_hole=0.0)
    model = ArmModel.from_assembly(
        assembly_from_design(fabricable.uniform_design(flat, plain, width=0.0015, twist=1.0)), VERO
    )
    whole = model.assembly
    straight = np.flatnonzero(np.abs(np.linalg.norm(whole.lever, axis=2).sum(axis=1) - 0.02) < 1e-9)
    straight = straight[straight >= whole.tie_joints.stop]
    assert len(straight) >= 2
    youngs, shear = VERO.youngs, VERO.youngs / (2.0 * (1.0 + VERO.poisson))
    for e in straight:
        length, wide, high = 0.02, plain.rim_width, plain.thickness
        inside, outside = high * wide**3 / 12.0, wide * high**3 / 12.0
        found = np.linalg.inv(model.at_joint[e])
        # of both halves about their middle: a beam that is pulled, bent and sheared at its middle
        assert found[0, 0] == pytest.approx(length / (youngs * wide * high), rel=1e-3)
        assert found[5, 5] == pytest.approx(length / (youngs * inside), rel=1e-3)
        assert found[4, 4] == pytest.approx(length / (youngs * outside), rel=1e-3)
        lateral = length**3 / (12.0 * youngs * inside) + 1.2 * length / (shear * wide * high)
        assert found[1, 1] == pytest.approx(lateral, rel=1e-3)
        assert found[2, 2] == pytest.approx(
            length**3 / (12.0 * youngs * outside) + 1.2 * length / (shear * wide * high), rel=1e-3
        )


def rim_strips() -> ModuleType:
    """The module beside this one that computes compliances of strips; it imports scikit-fem where solids are made."""
    sys.path.append(str(Path(__file__).parent))
    return __import__("rim_solids")


@pytest.mark.parametrize(
    ("width", "hole", "height"),
    [(0.004, 0.002, 0.001), pytest.param(0.005, 0.002, 0.002, marks=pytest.mark.thorough)],
)
def test_a_hole_softens_a_strip_as_much_as_it_does_a_solid(width: float, hole: float, height: float):
    """Against quadratic hexahedra of scikit-fem; the material that is taken away alone would be half of it."""
    strips, apart = rim_strips(), []
    for compliance in (strips.solid_compliance, strips.beam_compliance):
        whole, bored = (np.diag(compliance(0.01, width, size, height, VERO)) for size in (0.0, hole))
        apart.append(bored / whole)
    solid, beam = apart
    # shifts along, across and out of the sheet, twist, turns out of the sheet and in it
    assert beam == pytest.approx(solid, rel=0.05)
    assert (solid[[0, 1, 4]] > 1.08).all()


def test_a_strip_with_a_hole_is_as_soft_as_its_image_of_another_size() -> None:
    """Shifts per force go with 1 / length, turns per force with 1 / length^2, turns per moment with 1 / length^3."""
    powers, sides = np.repeat([0.5, 1.5], 3), np.array([20.0, 6.0, 2.5, 2.0])  # length, width, hole, height
    large, small = (rim_strips().beam_compliance(*(scale * sides), VERO) for scale in (1e-2, 1e-3))
    expected = large * 10.0 ** np.add.outer(powers, powers)
    np.testing.assert_allclose(small, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_forces_and_stiffness_are_differences_of_the_energy():
    whole, mesh = made()
    model = build_model(assembly_from_design(whole), VERO, "arm")
    rng = np.random.default_rng(1)
    state = model.start(target_pose(mesh, whole.flat.corners))
    state = model.start(state.pose.moved(rng.normal(size=(model.assembly.size, 6)) * np.repeat([1e-4, 0.05], 3)))
    here, direction = model.expand(state), rng.normal(size=(model.assembly.size, 6)) * np.repeat([0.01, 1.0], 3)

    def energy(t: float) -> float:
        return model.energy(model.moved(state, t * direction))

    h = 1e-3
    slope = (8 * (energy(h) - energy(-h)) - energy(2 * h) + energy(-2 * h)) / (12 * h)
    bend = (16 * (energy(h) + energy(-h)) - 30 * energy(0.0) - energy(2 * h) - energy(-2 * h)) / (12 * h * h)
    both = direction[model.pairs].reshape(-1, 12)
    assert slope == pytest.approx(float((here.gradient * direction).sum()), rel=1e-6)
    assert bend == pytest.approx(float(np.einsum("mi,mij,mj->", both, here.hessian, both)), rel=1e-6)


def problem(share: float, groups: int, opening: float | None, soft: float = 0.0) -> tuple[FlatProblem, Pose]:
    whole, mesh = made()
    assembly = assembly_from_design(whole)
    space = DesignSpace.from_design(whole, assembly, groups)
    found = FlatProblem(
        assembly=assembly,
        space=space,
        target=Target(assembly.pairs, mesh.centroids),
        loads=Loads.for_spirals(assembly.size),
        build_model=lambda a, _: build_model(a, VERO, "arm", quick=True),
        physics=SimulateParams(tolerance=1e-11),
        strain_limit=StrainLimit(VERO, share) if share else None,
        clearance_model=ClearanceModel.from_flat(whole.flat, whole.params),
        slot_requirement=None
        if opening is None
        else dataclasses.replace(SlotRequirement.from_design(whole), width=opening),
        flat=FlatRange.from_patches(whole.flat, 0.5, 0.035, 0.06, 1e-3, whole.flat, space.free_spirals, border=False),
        stability=StabilityRequirement(soft, enough=0.999, modes=3) if soft else None,
    )
    return found, target_pose(mesh, whole.flat.corners)


@pytest.mark.parametrize(
    "options",
    [
        (0.3, 4, 0.0015),
        pytest.param((0.0, 1, None), marks=pytest.mark.thorough),
        pytest.param((0.0, 1, None, 0.1), marks=pytest.mark.thorough),
    ],
    ids=str,
)
def test_the_optimisers_gradient_is_a_difference(options):
    whole, pose = problem(*options)
    rng = np.random.default_rng(4)
    spirals = rng.uniform(0.2, 0.8, whole.space.coordinates_per_spiral * whole.assembly.size)
    x = np.concatenate([spirals, 0.5 + rng.uniform(-0.01, 0.01, 2 * len(whole.flat.span))])
    here = whole.point_at(x, pose)
    n, each = here.n_spiral_x, whole.space.coordinates_per_spiral
    assert here.equilibrium.converged and (here.stability_barrier is None) == (len(options) < 4)
    beside = np.unique(whole.flat.flat.layout.flat_corners[here.assembly.rim.hub])
    assert whole.flat.span[beside].any()  # flat shapes of spirals at the rim move too
    for name, part in {"widths": slice(0, n, each), "twists": slice(each - 1, n, each), "flat": slice(n, None)}.items():
        direction = np.zeros_like(x)
        direction[part] = rng.normal(size=direction[part].shape)

        def value(t: float, d: np.ndarray = direction) -> float:
            return whole.point_at(x + t * d, here.equilibrium.pose).value

        # eigenvalues change with third derivatives, which are differences themselves
        h, within = (3e-6, 2e-6) if here.stability_barrier is None else (1e-5, 4e-3)
        found = float((8 * (value(h) - value(-h)) - value(2 * h) + value(-2 * h)) / (12 * h))
        assert found == pytest.approx(float((here.gradient * direction).sum()), rel=within), name


def test_rooms_beside_arms_at_the_rim_follow_the_design():
    whole, _ = made()
    room, rng, size = ClearanceModel.from_flat(whole.flat, RIM), np.random.default_rng(2), whole.width.size
    way = rng.normal(size=size + len(whole.twist)) * np.repeat([1e-3, 0.1], [size, len(whole.twist)])

    def value(t: float) -> float:
        moved = whole.width + t * way[:size].reshape(-1, 4), whole.twist + t * way[size:]
        return float(room.clearances(*moved, below=np.inf).value.sum())

    here, h = room.clearances(whole.width, whole.twist, below=np.inf), 1e-6
    slope = (8 * (value(h) - value(-h)) - value(2 * h) + value(-2 * h)) / (12 * h)
    assert slope == pytest.approx(float((here.by_design @ way).sum()), rel=1e-5)


def test_a_pose_without_nodes_finds_them_again():
    whole, mesh = made()
    found = simulate(whole, mesh, VERO, SimulateParams())
    assert found.equilibrium.converged
    pose = found.equilibrium.pose
    again = found.model.start(Pose(pose.centres, pose.rotations))
    assert again.pose.whole.centres == pytest.approx(pose.whole.centres, abs=1e-7)
    assert found.model.energy(again) == pytest.approx(found.equilibrium.energy, rel=1e-6)


def test_the_rod_model_is_refused():
    with pytest.raises(FlexMapsError, match="arm model"):
        build_model(assembly_from_design(made()[0]), VERO, "rod", progress=SILENT)


def test_drawn_bodies_are_closed_and_hold_what_is_cut():
    whole, mesh = made()
    pose = simulate(whole, mesh, VERO, SimulateParams()).equilibrium.pose
    drawn, centres = make_panel_mesh(whole, DETAILS["FINE"]), arrange.arrange_patches(whole.flat)
    shown = solids.make_solids(whole, centres)
    cut = sum(polygon(outline).area for outline in whole.outlines()) * whole.params.thickness
    # the same where only the hubs' poses are known, as they are stored
    arms = bend_arms(whole, Pose(pose.centres, pose.rotations))
    for points, corners, sizes in (
        (drawn.vertices_at_pose(arms, pose), drawn.corners, drawn.sizes),
        (drawn.flat_vertices(centres), drawn.corners, drawn.sizes),
        (shown.vertices, shown.corners, shown.sizes),
    ):
        starts = np.cumsum(sizes) - sizes
        faces = [
            [corners[s], corners[s + k], corners[s + k + 1]]
            for s, n in zip(starts, sizes, strict=True)
            for k in range(1, n - 1)
        ]
        body = trimesh.Trimesh(points, faces, process=False)
        assert body.is_watertight
        assert body.volume == pytest.approx(cut, rel=0.02)
    # necks and the halves of the strip meet where the elastic model has them
    tips = arms.tips[0].reshape(-1, 4, 3)
    hub, n = whole.rim.quad, len(whole.width)
    assert tips[hub, whole.rim.side] == pytest.approx(tips[n:, 1], abs=1e-9)

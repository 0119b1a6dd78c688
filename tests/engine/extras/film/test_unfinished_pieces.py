"""Half-finished pieces: they rest, nothing pulls at open joints, and closing costs the energy that bending costs."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from flexmaps.engine.errors import Cancelled
from flexmaps.engine.extras.film import unfinished_pieces
from flexmaps.engine.fabrication.panels.labels import panel_name, seam_name
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.mechanics.arms.compliances import arm_compliances
from flexmaps.engine.mechanics.assembly import Assembly, Pose, assembly_from_design, target_pose
from flexmaps.engine.mechanics.equilibrium import solve
from flexmaps.engine.mechanics.loads import Loads
from flexmaps.engine.params import LayoutParams, SimulateParams, SpiralParams
from flexmaps.engine.patches.flattening import flatten
from flexmaps.engine.patches.flattening.flatten import FlatPatches
from flexmaps.engine.patches.joining import assembly_steps
from flexmaps.engine.patches.layout import PatchLayout
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.progress import Progress
from flexmaps.engine.simulation.simulate import build_model, simulate
from flexmaps.engine.spirals import design, fabricable
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import QuadMesh

POM = MATERIALS["pom"]
MODELS = ("arm", "rod")


def piece(name: str, model: str):
    """A design, its simulation and its stages."""
    mesh = shapes.make(name)
    flat = flatten.flatten(trace.trace_layout(mesh, LayoutParams()), LayoutParams())
    made = fabricable.uniform_design(flat, SpiralParams(), twist=3.0)
    params = SimulateParams(model=model)
    simulation = simulate(made, mesh, POM, params)
    assert simulation.equilibrium.converged
    return made, simulation, unfinished_pieces.find_stages(made, simulation.equilibrium.pose, POM, params)


@pytest.fixture(scope="module", params=MODELS)
def dome(request):
    return *piece("dome", request.param), request.param


def test_they_go_on_from_flat_to_the_simulation(dome):
    made, simulation, found, _ = dome
    first, last = found.all[0], found.all[-1]
    assert not found.skipped and all(stage.solved for stage in found.all)
    turned = first.pose.rotations[0].T @ first.pose.rotations
    assert turned == pytest.approx(np.broadcast_to(np.eye(3), turned.shape), abs=1e-9)
    flat = (first.pose.centres - first.pose.centres.mean(axis=0)) @ first.pose.rotations[0]
    centres = made.arms.centre[first.hubs]
    assert flat[:, :2] == pytest.approx(centres - centres.mean(axis=0), abs=1e-9)
    assert flat[:, 2] == pytest.approx(0.0, abs=1e-9)
    assert last.whole and last.closed.all()
    assert last.pose.centres == pytest.approx(simulation.equilibrium.pose.centres)
    assert last.energy == pytest.approx(simulation.equilibrium.energy)


def test_all_joints_are_closed_one_after_the_other(dome):
    made, _, found, _ = dome
    order = assembly_steps(made.flat.layout)
    before = np.zeros_like(found.all[0].closed)
    for stage in found.all:
        assert stage.closed[before].all()  # what is joined stays joined
        there = np.isin(made.flat.layout.patch_of, order[stage.step].joined_panels)
        assert (np.flatnonzero(there) == stage.hubs).all()
        before = stage.closed
    assert np.unique([stage.step for stage in found.all]).tolist() == list(range(len(order)))


def test_every_one_rests(dome):
    """Differences of the energy of a model that is built of the closed joints alone, along random ways."""
    made, _, found, model = dome
    rng, whole = np.random.default_rng(1), assembly_from_design(made)
    assert len(found.all) > 4
    for stage in found.all:
        number = np.full(whole.size, -1)
        number[stage.hubs] = np.arange(len(stage.hubs))
        joints = stage.closed
        part = Assembly(
            number[whole.pairs[joints]], whole.sides[joints], whole.lever[joints], whole.axes[joints], whole.width[stage.hubs],
            whole.twist[stage.hubs], whole.thickness, whole.clockwise, whole.cut,
        )  # fmt: skip
        if model == "rod":  # a spiral's springs are those of all its arms, also where some are open
            elastic = build_model(whole, POM, model).part(stage.hubs, np.flatnonzero(joints))
        else:
            elastic = build_model(part, POM, model)
        energy = lambda pose, elastic=elastic: elastic.energy(elastic.start(pose))  # noqa: E731
        for _ in range(3):
            way = rng.normal(size=(len(stage.hubs), 6)) * np.repeat([0.01, 1.0], 3)
            step = 1e-5
            here, ahead, back = (energy(stage.pose.moved(share * way)) for share in (0.0, step, -step))
            rise, bend = (ahead - back) / (2 * step), (ahead - 2 * here + back) / step**2
            # where the parabola through all three has its bottom
            assert bend > 0 and abs(rise / bend) < 1e-5


def test_open_joints_are_not_forced(dome):
    """While a seam is being closed, its open end gapes; what is free bends less than it will."""
    made, _, found, _ = dome
    whole, edge = assembly_from_design(made), made.flat.layout.mesh.median_edge
    stage = found.all[-2]
    assert not stage.closed.all()
    pose = Pose(np.empty((whole.size, 3)), np.empty((whole.size, 3, 3)))
    pose.centres[stage.hubs], pose.rotations[stage.hubs] = stage.pose.centres, stage.pose.rotations
    ends = pose.centres[whole.pairs] + (pose.rotations[whole.pairs] @ whole.lever[..., None])[..., 0]
    gap = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    assert gap[~stage.closed].max() > 3.0 * gap[stage.closed].max()
    assert gap[~stage.closed].max() > 0.05 * edge


def test_closing_costs_energy(dome):
    energies = [stage.energy for stage in dome[2].all]
    assert energies[0] == pytest.approx(0.0, abs=1e-12 * energies[-1]) and (np.diff(energies) > 0).all()


def test_they_lie_where_they_will_be(dome):
    _, simulation, found, _ = dome
    for stage in found.all:
        own, there = stage.pose.centres, simulation.equilibrium.pose.centres[stage.hubs]
        size = np.linalg.norm(np.ptp(there, axis=0))
        assert np.linalg.norm(own - there, axis=1).mean() < 0.2 * size


# -- two strips that become a ring -----------------------------------------------------------------------------------------

COUNT, EDGE = 40, 0.02


@pytest.fixture(scope="module")
def ring():
    """A ring of spirals, cut into two strips; its equilibrium."""
    angle = 2.0 * np.pi * np.arange(COUNT) / COUNT
    radius = 0.5 * EDGE / np.sin(np.pi / COUNT)
    circle = radius * np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=1)
    vertices = np.concatenate([circle, circle + np.array([0.0, EDGE, 0.0])])
    here, after = np.arange(COUNT), (np.arange(COUNT) + 1) % COUNT
    mesh = QuadMesh(vertices, np.stack([here, after, after + COUNT, here + COUNT], axis=1))
    ends = [{0, COUNT}, {COUNT // 2 - 3, COUNT // 2 - 3 + COUNT}]
    layout = PatchLayout(mesh, np.array([set(edge) in ends for edge in mesh.edges.tolist()]))
    points = np.zeros((int(layout.flat_corners.max()) + 1, 2))
    along = np.stack([here, here + 1, here + 1, here], axis=1)
    points[layout.flat_corners] = EDGE * np.stack([along, np.broadcast_to([0, 0, 1, 1], along.shape)], axis=2)
    flat = FlatPatches(layout, points, np.zeros(COUNT), np.zeros(COUNT))
    # arms that are wider than thick: they bend out of the sheet, and the ring does not roll over
    made = design.SpiralDesign(flat, SpiralParams(thickness=0.001), np.full((COUNT, 4), 0.002), np.full(COUNT, 2.0))
    assembly = assembly_from_design(made)
    model = build_model(assembly, POM, "arm")
    rest = solve(model, target_pose(mesh, flat.corners), Loads.for_spirals(COUNT), SimulateParams())
    assert rest.converged
    return made, assembly, rest


def test_a_ring_costs_what_bending_it_costs(ring):
    """Straight while one of its two seams is open; closed, a beam that is bent all round: M^2 c / 2 a joint, M = turn / c."""
    made, assembly, rest = ring
    found = unfinished_pieces.find_stages(made, rest.pose, POM, SimulateParams())
    flat, straight, closed = found.all
    axes = assembly.arm_axes
    compliance = (axes @ arm_compliances(assembly, POM).values @ np.swapaxes(axes, 2, 3)).sum(axis=1)[:, 4, 4]
    turn = 2.0 * np.pi / COUNT
    assert closed.energy == pytest.approx((0.5 * turn**2 / compliance).sum(), rel=0.02)
    assert max(flat.energy, straight.energy) < 1e-9 * closed.energy
    assert len(straight.hubs) == COUNT and straight.closed.sum() == COUNT - 1
    way = straight.pose.centres - straight.pose.centres.mean(axis=0)
    assert np.linalg.svd(way, compute_uv=False)[1] < 1e-6 * EDGE  # all hubs on one line
    lengths = np.linalg.norm(np.diff(np.sort(way @ np.linalg.svd(way)[2][0])[:, None], axis=0), axis=1)
    assert lengths == pytest.approx(EDGE, rel=1e-6)


def test_what_does_not_come_to_rest_is_left_out_and_named(ring):
    made, _, rest = ring
    found = unfinished_pieces.find_stages(made, rest.pose, POM, SimulateParams(iterations=1))
    second = assembly_steps(made.flat.layout)[1]
    assert found.skipped == ((panel_name(2), seam_name(second.joins[0].seam)),)
    assert [stage.whole for stage in found.all] == [False, True]
    assert found.all[-1].pose.centres == pytest.approx(rest.pose.centres)


def test_it_can_be_stopped(ring):
    made, _, rest = ring
    told = []
    stop = Progress(lambda fraction, text: told.append(fraction), lambda: len(told) >= 2)
    with pytest.raises(Cancelled):
        unfinished_pieces.find_stages(made, rest.pose, POM, SimulateParams(), stop)
    assert min(told) >= 0.0 and max(told) < 1.0


def test_bodies_do_not_know_of_each_other():
    """Two bodies: the second one begins flat, and the first one is whole by then."""
    made, simulation, found = piece("two_bodies", "arm")
    ends = [stage for stage in found.all if stage.whole]
    assert len(ends) == 2 and sorted(np.concatenate([stage.hubs for stage in ends]).tolist()) == list(
        range(len(made.width))
    )
    assert sum(stage.energy for stage in ends) == pytest.approx(simulation.equilibrium.energy)
    pose = simulation.equilibrium.pose
    for stage in ends:
        assert stage.pose.centres == pytest.approx(pose.centres[stage.hubs])
    for stage in found.all:
        assert sum(set(stage.hubs.tolist()) <= set(end.hubs.tolist()) for end in ends) == 1


def test_a_seam_is_closed_from_where_the_panel_hangs(dome):
    """All joints of a step, seam by seam, along every seam; the second one goes on from a corner that is joined."""
    layout = dome[0].flat.layout
    mesh = layout.mesh
    inner = np.flatnonzero(~mesh.border)
    for step in assembly_steps(layout):
        held: set[int] = set()
        closed = []
        for join in sorted(step.joins, key=lambda join: join.other == join.panel):
            edges = inner[
                np.concatenate(
                    [j for name, j in unfinished_pieces.joint_batches(layout, step) if name == seam_name(join.seam)]
                )
            ]
            assert sorted(edges.tolist()) == sorted(layout.seams[join.seam].tolist())
            ends = [set(mesh.edges[edge].tolist()) for edge in edges]
            assert all(one & two for one, two in pairwise(ends))
            if held & (ends[0] | ends[-1]):
                assert ends[0] & held
            held |= set.union(*ends)
            closed += edges.tolist()
        made = [edge for _, joints in unfinished_pieces.joint_batches(layout, step) for edge in inner[joints].tolist()]
        assert made == closed


@pytest.mark.parametrize("name", MODELS)
def test_parts_of_a_model_are_its_joints(name):
    """The energy of a part is that of its joints in the whole; weaker joints have their share of it."""
    mesh = shapes.make("dome")
    flat = flatten.flatten(trace.trace_layout(mesh, LayoutParams()), LayoutParams())
    made = fabricable.uniform_design(flat, SpiralParams(), twist=3.0)
    model, pose = build_model(assembly_from_design(made), POM, name), target_pose(mesh, flat.corners)
    each = model.expand(model.start(pose)).per_joint
    hubs = np.random.default_rng(0).permutation(len(mesh.quads))[:120]
    joints = np.flatnonzero(np.isin(model.pairs, hubs).all(axis=1))[::2]
    part = model.part(hubs, joints)
    state = part.start(pose.part(hubs))
    assert part.energy(state) == pytest.approx(each[joints].sum()) and len(joints) > 20
    share = np.linspace(0.1, 1.0, len(joints))
    weaker = part.scale_stiffness(share)
    assert weaker.expand(weaker.start(pose.part(hubs))).per_joint == pytest.approx(share * each[joints])


def test_a_cancel_is_looked_for_before_the_elastic_model_is_built(monkeypatch):
    def build(*_, **__):
        raise AssertionError("built in vain")

    monkeypatch.setattr(unfinished_pieces, "build_model", build)
    mesh = shapes.make("strip")
    flat = flatten.flatten(trace.trace_layout(mesh, LayoutParams()), LayoutParams())
    made = fabricable.uniform_design(flat, SpiralParams(), twist=3.0)
    with pytest.raises(Cancelled):
        unfinished_pieces.find_stages(
            made, target_pose(mesh, flat.corners), POM, SimulateParams(), Progress(stopped=lambda: True)
        )

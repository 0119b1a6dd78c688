"""Arms bent between hubs: closed forms, what stays as long and as thick as it was, joints that meet, closed bodies."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from flexmaps.engine.display.panel_mesh import DETAILS, Detail, make_panel_mesh
from flexmaps.engine.fabrication.connectors.connect import connect
from flexmaps.engine.materials import find_material
from flexmaps.engine.mechanics.arms import bent as bent_arms
from flexmaps.engine.mechanics.arms import bent_rim
from flexmaps.engine.mechanics.arms.bent import bend_arms, hub_edge_of_design
from flexmaps.engine.mechanics.arms.model import ArmModel
from flexmaps.engine.mechanics.assembly import Pose, assembly_from_design, target_pose
from flexmaps.engine.mechanics.rim_bodies import BACKWARDS, FORWARDS, NECK
from flexmaps.engine.mechanics.vectors import rotation_matrix
from flexmaps.engine.params import ConnectorParams, LayoutParams, SimulateParams, SpiralParams
from flexmaps.engine.patches.flattening import flatten
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.simulation.simulate import simulate
from flexmaps.engine.spirals import design, fabricable
from flexmaps.engine.spirals.curves.spiral import LEFT, RIGHT, edge_points, opposite_sides
from flexmaps.engine.surface import shapes
from scipy.spatial.transform import Rotation

STRAIGHT = SpiralParams(thickness=0.001, width_min=0.001, width_max=0.002)


def flat_pose(made: design.SpiralDesign) -> Pose:
    count = len(made.width)
    return Pose(np.c_[made.arms.centre, np.zeros(count)], np.broadcast_to(np.eye(3), (count, 3, 3)).copy())


@pytest.fixture(
    scope="module", params=[False, pytest.param(True, marks=pytest.mark.thorough)], ids=["left", "clockwise"]
)
def dome(request):
    """A dome of wound spirals in several patches, in its equilibrium."""
    mesh = shapes.make("dome")
    flat = flatten.flatten(trace.trace_layout(mesh, LayoutParams()), LayoutParams())
    made = fabricable.uniform_design(flat, SpiralParams(clockwise=request.param), twist=3.5)
    found = simulate(made, mesh, find_material("pom"), SimulateParams())
    assert found.equilibrium.converged
    return made, found.equilibrium.pose


def test_two_straight_arms_become_a_circular_arc(flat_grid):
    """A pure bending moment M = E I angle / length, the same everywhere (Euler and Bernoulli)."""
    made = design.SpiralDesign(flat_grid(2, 1), STRAIGHT, np.full((2, 4), 0.002), np.zeros(2))
    angle, size = 0.8, 0.02
    clamp = 0.5 * size * (1 - hub_edge_of_design(made)[0, 1])  # from a hub's centre to where its arm begins
    length = size - 2 * clamp
    radius = length / angle
    # both hubs touch a circle of this radius about the y axis, at half the angle before and behind its top
    turns = np.stack([Rotation.from_euler("y", a).as_matrix() for a in (-0.5 * angle, 0.5 * angle)])
    ends = np.array([[-np.sin(angle / 2), 0, np.cos(angle / 2)], [np.sin(angle / 2), 0, np.cos(angle / 2)]]) * radius
    centres = ends + np.array([-1, 1])[:, None] * clamp * turns[:, :, 0]
    arms = bend_arms(made, Pose(centres, turns))
    t = np.linspace(0, hub_edge_of_design(made)[0, 1], 30)
    middle = np.c_[0.5 * size * (1 - t), 0 * t, 0 * t]
    place, turn = arms.at(np.full(30, 1), t, middle)
    assert np.hypot(place[:, 0], place[:, 2]) == pytest.approx(radius, rel=2e-4)
    assert place[0] == pytest.approx([0, 0, radius], abs=1e-8)
    assert turn[0] == pytest.approx(np.eye(3), abs=1e-9)
    inertia = 0.002 * STRAIGHT.thickness**3 / 12
    force, moment = arms.wrench[1, :3], arms.wrench[1, 3:]
    assert np.abs(moment) == pytest.approx([0, inertia * angle / length, 0], rel=1e-6, abs=1e-20)
    # what little is left of the force makes up for the moment's lever along the flat arm
    assert np.abs(force[1:]) * length == pytest.approx(0, abs=1e-6 * inertia)
    # arms that are not at this joint stay as they were
    assert arms.bend[[0, 2, 3, 4, 5, 6]] == pytest.approx(0, abs=1e-12)


def test_a_twisted_bar_turns_evenly(flat_grid):
    made = design.SpiralDesign(flat_grid(2, 1), STRAIGHT, np.full((2, 4), 0.002), np.zeros(2))
    pose = flat_pose(made)
    turns = np.stack([Rotation.from_euler("x", a).as_matrix() for a in (0.0, 0.6)])
    arms = bend_arms(made, Pose(pose.centres, turns))
    along = Rotation.from_matrix(arms.turn[1]).as_rotvec()
    assert along == pytest.approx(np.linspace(0, 0.3, 17)[:, None] * [1, 0, 0], abs=1e-9)


def test_wrenches_agree_with_the_elastic_model(dome):
    """Moments of beams against those of the table that was made with finite elements."""
    made, pose = dome
    model = ArmModel.from_assembly(assembly_from_design(made), find_material("pom"), curving=False)
    theirs = model.wrenches(model.start(pose))[:, 3:]
    mesh = made.flat.layout.mesh
    inner = ~mesh.border
    first = 4 * mesh.edge_quads[inner, 0] + mesh.edge_sides[inner, 0]
    ours = find_material("pom").youngs * bend_arms(made, pose, material=find_material("pom")).wrench[first, 3:]
    away = np.linalg.norm(ours - theirs, axis=1) / np.linalg.norm(theirs, axis=1)
    assert np.median(away) < 0.1
    assert (ours * theirs).sum() / (theirs**2).sum() == pytest.approx(1.0, abs=0.1)


def test_tips_of_neighbours_coincide(dome):
    made, pose = dome
    arms = bend_arms(made, pose)
    zero = np.zeros((*made.arms.radius.shape, 1))
    centre = np.concatenate([edge_points(made.arms, zero, way)[0] for way in (RIGHT, LEFT)], axis=2)  # (F, 4, 2, 2)
    offset = np.zeros((*centre.shape[:3], 3))
    offset[..., :2] = 0.5 * (centre - centre[:, :, ::-1])
    place, turn = arms.tips
    corners = place.reshape(-1, 4, 1, 3) + np.einsum("fkij,fkej->fkei", turn.reshape(-1, 4, 3, 3), offset)
    quad, side = opposite_sides(made.flat.layout.mesh)
    inner = ~made.flat.layout.mesh.border[made.flat.layout.mesh.quad_edges]
    size = np.linalg.norm(np.ptp(pose.centres, axis=0))
    # what is right of one arm is left of the other
    apart = (corners - corners[quad, side][:, :, ::-1])[inner]
    assert np.abs(apart).max() < 1e-9 * size
    normals = turn[:, :, 2].reshape(-1, 4, 3)
    assert (normals * normals[quad, side]).sum(axis=-1)[inner] == pytest.approx(1.0, abs=1e-12)


def test_arms_keep_their_length(dome):
    made, pose = dome
    arms = bend_arms(made, pose)
    now = np.linalg.norm(np.diff(arms.place, axis=1), axis=2).sum(axis=1)
    before = np.linalg.norm(np.diff(arms.flat, axis=1), axis=2).sum(axis=1)
    assert now == pytest.approx(before, rel=0.01)
    assert np.abs(arms.bend).sum(axis=1).max() > 0.05  # they are bent indeed


def test_sections_keep_width_and_thickness(dome):
    made, pose = dome
    panels = make_panel_mesh(made, DETAILS["MEDIUM"])
    whole = np.full((panels.section.max() + 1, 4, 3), np.nan)
    order = np.concatenate([np.tile(np.arange(4), len(panels.arm)), np.tile(np.arange(2), len(panels.fillet_quad))])
    whole[panels.section, order[panels.kept_vertices]] = panels.vertices_at_pose(bend_arms(made, pose), pose)
    whole = whole[: len(panels.arm)]
    width = np.linalg.norm(whole[:, 0] - whole[:, 1], axis=1)
    flat = np.linalg.norm(panels.sides[:, 0] - panels.sides[:, 1], axis=1)
    there = np.isfinite(width)
    assert there.mean() > 0.9
    assert width[there] == pytest.approx(flat[there], rel=1e-9)
    thick = np.linalg.norm(whole[:, :2] - whole[:, 2:], axis=2)[there]
    assert thick == pytest.approx(made.params.thickness, rel=1e-9)
    # square: the edge and the normal are at right angles
    lean = ((whole[:, 0] - whole[:, 1]) * (whole[:, 0] - whole[:, 2])).sum(axis=1)[there]
    assert np.abs(lean).max() < 1e-9 * made.params.thickness * flat.max()


def test_at_rest_every_panel_is_its_own_outline(dome):
    """The upper faces lie within the true outlines of arcs and cover them."""
    made, _ = dome
    pose = flat_pose(made)
    layout = made.flat.layout
    panels = make_panel_mesh(made, Detail(20, 4.0, 4))
    inside = ~layout.cut[~layout.mesh.border]
    points = panels.vertices_at_pose(bend_arms(made, pose, closed=inside), pose)
    assert points == pytest.approx(panels.flat_vertices(np.zeros((len(layout.patches), 2))), abs=1e-12)
    starts = np.cumsum(panels.sizes) - panels.sizes
    faces = [panels.corners[s : s + n] for s, n in zip(starts, panels.sizes)]
    above = [k for k, f in enumerate(faces) if (points[f, 2] > 0).all()]
    patch = layout.patch_of[panels.quad_of]
    for number, outline in enumerate(made.outlines()[:1]):
        drawn = shapely.polygons([shapely.linearrings(points[faces[k], :2]) for k in above if patch[k] == number])
        true = shapely.Polygon(outline.outer.sample(1e-5), [hole.sample(1e-5) for hole in outline.holes])
        shapely.prepare(true)
        assert shapely.area(drawn).sum() == pytest.approx(true.area, rel=0.002)
        corners = shapely.points(shapely.get_coordinates(drawn))
        assert shapely.dwithin(true, corners[::9], 2e-5).all()  # the outline's tolerance


def closed_body(panels, points):
    """The faces as triangles, for trimesh to judge."""
    import trimesh

    starts = np.cumsum(panels.sizes) - panels.sizes
    fans = [
        np.stack([panels.corners[s], panels.corners[s + k], panels.corners[s + k + 1]], axis=1)
        for k in range(1, panels.sizes.max() - 1)
        for s in [starts[panels.sizes > k + 1]]
    ]
    solid = trimesh.Trimesh(points, np.concatenate(fans), process=False)
    assert len(solid.faces) == panels.triangle_count
    assert solid.is_watertight and solid.is_winding_consistent
    return solid


def test_every_part_is_a_closed_body(dome):
    made, pose = dome
    for name, much in (("COARSE", 0.04), ("MEDIUM", 0.01), ("FINE", 0.005)):
        panels = make_panel_mesh(made, DETAILS[name])
        solid = closed_body(panels, panels.vertices_at_pose(bend_arms(made, pose), pose))
        assert solid.body_count == len(made.flat.layout.patches)
        assert solid.volume == pytest.approx(made.area.sum() * made.params.thickness, rel=much)


def test_connectors_have_their_true_outlines(dome):
    made, pose = dome
    found = connect(made, ConnectorParams(), 2e-5)
    assert len(found.tips) > 20
    panels = make_panel_mesh(made, DETAILS["FINE"], found.tips)
    solid = closed_body(panels, panels.vertices_at_pose(bend_arms(made, pose), pose))
    assert solid.body_count == len(made.flat.layout.patches)
    flat = closed_body(panels, panels.flat_vertices(np.zeros((len(made.flat.layout.patches), 2))))
    area = sum(o.outer.area + sum(hole.area for hole in o.holes) for o in found.outlines)
    assert flat.volume == pytest.approx(area * made.params.thickness, rel=0.005)
    assert solid.volume == pytest.approx(flat.volume, rel=0.005)


def test_open_joints_carry_what_they_are_given(dome):
    made, pose = dome
    whole = bend_arms(made, pose)
    layout = made.flat.layout
    inside = ~layout.cut[~layout.mesh.border]
    apart = bend_arms(made, pose, closed=inside)
    again = bend_arms(made, pose, closed=inside, wrench=whole.wrench)
    quad, side = np.nonzero(layout.cut[layout.mesh.quad_edges])
    free = 4 * quad + side
    assert apart.bend[free] == pytest.approx(0, abs=1e-15)
    assert again.place == pytest.approx(whole.place, abs=1e-6 * np.ptp(pose.centres))
    assert np.abs(apart.place[free] - whole.place[free]).max() > 1e-5


def test_torn_poses_are_closed_all_the_same(dome):
    made, pose = dome
    rng = np.random.default_rng(1)
    torn = pose.moved(np.c_[rng.normal(0, 0.01, (len(made.width), 3)), rng.normal(0, 1.0, (len(made.width), 3))])
    arms = bend_arms(made, torn)
    place, _ = arms.tips
    quad, side = opposite_sides(made.flat.layout.mesh)
    inner = ~made.flat.layout.mesh.border[made.flat.layout.mesh.quad_edges]
    place = place.reshape(-1, 4, 3)
    assert np.isfinite(arms.place).all()
    assert np.abs(place - place[quad, side])[inner].max() < 1e-12


def test_spirals_wound_too_far_for_their_settings_can_be_drawn(flat_grid):
    """As they are after a setting was changed: arms that are hub to the tip keep to it."""
    made = design.SpiralDesign(flat_grid(2, 1), SpiralParams(fillet=0.002), np.full((2, 4), 0.0015), np.full(2, 6.2))
    assert hub_edge_of_design(made).min() == 0.0
    panels, pose = make_panel_mesh(made, DETAILS["MEDIUM"]), flat_pose(made)
    points = panels.vertices_at_pose(bend_arms(made, pose), pose)
    apart = points[:, :2] - made.arms.centre[panels.vertex_quad]
    assert np.abs(apart).max() < 0.02 and np.abs(points[:, 2]).max() < 0.002


def test_rotation_matrices_agree_with_scipy():
    rng = np.random.default_rng(2)
    turns = rng.normal(0, 1.0, (200, 3)) * np.logspace(-12, 0.5, 200)[:, None]
    assert rotation_matrix(turns) == pytest.approx(Rotation.from_rotvec(turns).as_matrix(), abs=1e-14)
    assert bent_arms.STATIONS % 2 == 0


def test_on_the_target_without_a_simulation(dome):
    made, _ = dome
    pose = target_pose(shapes.make("dome"), made.flat.corners)
    arms = bend_arms(made, pose)
    stretched = np.linalg.norm(np.diff(arms.place, axis=1), axis=2).sum(axis=1)
    assert stretched == pytest.approx(np.linalg.norm(np.diff(arms.flat, axis=1), axis=2).sum(axis=1), rel=0.02)


def test_necks_and_strips_of_a_rim_reach_from_its_nodes_to_their_joints():
    flat = flatten.flatten(trace.trace_layout(shapes.make("dome"), LayoutParams()), LayoutParams())
    rim = fabricable.uniform_design(flat, SpiralParams(border="rim")).rim
    assert rim is not None
    ends = np.array([0.0, 1.0])
    for arm in (NECK, FORWARDS, BACKWARDS):
        place, way, length = bent_rim._line(rim, arm, ends)
        assert place[:, 0] == pytest.approx(0.0, abs=1e-12) and np.abs(way) == pytest.approx(1.0)
        assert (length > 0.0).all()
        if arm == NECK:
            assert place[:, 1] == pytest.approx(rim.middle - rim.centre, abs=1e-12)
    # both halves of a strip end in its middle
    node = np.flatnonzero(rim.next_node >= 0)
    halves = [bent_rim._line(rim, arm, ends)[0][:, 1] + rim.centre for arm in (FORWARDS, BACKWARDS)]
    assert halves[0][node] == pytest.approx(halves[1][rim.next_node[node]], abs=1e-9)

"""The film of an assembly: from the table to the simulated piece, through its stages, with joints that stay closed."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from flexmaps.engine.display.panel_mesh import DETAILS, make_panel_mesh
from flexmaps.engine.extras.film import assembly_film, hub_film
from flexmaps.engine.extras.film.pose_blend import PoseBlend
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.mechanics.arms.bent import bend_arms
from flexmaps.engine.mechanics.assembly import Pose, rest_joints
from flexmaps.engine.params import LayoutParams, SimulateParams, SpiralParams
from flexmaps.engine.patches.flattening import flatten
from flexmaps.engine.patches.joining import assembly_steps
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.progress import Progress
from flexmaps.engine.simulation.simulate import simulate
from flexmaps.engine.spirals import design, fabricable
from flexmaps.engine.surface import shapes
from scipy.spatial.transform import Rotation, Slerp

POM = MATERIALS["pom"]


@pytest.fixture(scope="module")
def dome():
    """Two panels with four seams, and where they rest."""
    mesh = shapes.make("dome")
    flat = flatten.flatten(trace.trace_layout(mesh, LayoutParams()), LayoutParams())
    made = fabricable.uniform_design(flat, SpiralParams(), twist=3.0)
    return made, simulate(made, mesh, POM, SimulateParams()).equilibrium.pose


@pytest.fixture(scope="module")
def film(dome):
    made, pose = dome
    count = len(made.flat.layout.patches)
    low = make_panel_mesh(made, DETAILS["COARSE"]).vertices_at_pose(bend_arms(made, pose), pose)[:, 2].min()
    table = np.c_[0.4 * np.arange(count), np.zeros(count), np.full(count, low + 0.5 * made.params.thickness)]
    return assembly_film.make_film(made, pose, table, DETAILS["COARSE"], POM, SimulateParams()), table


def shown(found, time):
    """(V, 3) the film's vertices at a time, as Blender shows them: straight ways between shapes and between places."""
    out = np.empty((len(found.panels.vertex_quad), 3))
    for track in found.tracks:
        at = np.clip(np.searchsorted(track.shape_times, time) - 1, 0, len(track.shape_times) - 2)
        begin, end = track.shape_times[at : at + 2]
        share = np.clip((time - begin) / (end - begin), 0.0, 1.0)
        shape = (1.0 - share) * track.shapes[track.which[at]] + share * track.shapes[track.which[at + 1]]
        now = np.clip(time, track.times[0], track.times[-1])
        turn = Slerp(track.times, Rotation.from_matrix(track.turns))(now).as_matrix()
        place = np.array([np.interp(now, track.times, x) for x in track.places.T])
        out[track.vertices] = shape @ turn.T + place
    return out


def tips(found):
    """For every joint at a seam (m,) its number among the inner edges and (m, 2, 2) two vertices on either side that meet."""
    panels, layout = found.panels, found.panels.design.flat.layout
    mesh = layout.mesh
    seam = np.flatnonzero(layout.cut & ~mesh.border)
    arms = 4 * mesh.edge_quads[seam] + mesh.edge_sides[seam]
    first = np.flatnonzero(np.r_[True, np.diff(panels.arm) > 0])  # sections at the tips
    index = np.full(4 * len(panels.arm), -1)
    index[panels.kept_vertices[panels.kept_vertices < len(index)]] = np.flatnonzero(panels.kept_vertices < len(index))
    left, right = index[4 * first[arms]], index[4 * first[arms] + 1]
    assert (left >= 0).all() and (right >= 0).all()
    # what is left of one arm is right of the other
    meet = np.stack([[left[:, 0], right[:, 1]], [right[:, 0], left[:, 1]]], axis=0).transpose(2, 0, 1)
    return (np.cumsum(~mesh.border) - 1)[seam], meet


def test_it_begins_on_the_table(film):
    found, table = film
    flat = found.panels.flat_vertices(table[:, :2])
    flat[:, 2] += table[0, 2]
    for track in found.tracks:
        points = track.shapes[0] @ track.turns[0].T + track.places[0]
        assert points == pytest.approx(flat[track.vertices], abs=1e-9)


def test_nothing_dips_under_the_table(film):
    """At all times: loose panels, and what is joined, which is held as high as it needs to be."""
    found, table = film
    ground = table[0, 2] - 0.5 * found.panels.design.params.thickness
    edge = found.panels.design.flat.layout.mesh.median_edge
    for time in np.linspace(0.0, found.length, 60):
        assert shown(found, time)[:, 2].min() > ground - 0.02 * edge


def test_it_ends_in_the_pose(dome, film):
    made, pose = dome
    found, _ = film
    ends = make_panel_mesh(made, DETAILS["COARSE"]).vertices_at_pose(bend_arms(made, pose), pose)
    seen = np.concatenate([track.vertices for track in found.tracks])
    assert (np.sort(seen) == np.arange(len(ends))).all()
    for track in found.tracks:
        points = track.shapes[-1] @ track.turns[-1].T + track.places[-1]
        assert points == pytest.approx(ends[track.vertices], abs=1e-7)
        assert track.times[-1] <= found.length and (np.diff(track.times) > 0).all()
        assert (np.diff(track.shape_times) > 0).all() and track.shape_times[-1] <= found.length + 1e-9
        assert set(np.diff(track.which).tolist()) <= {0, 1} and track.which[-1] == len(track.shapes) - 1


def test_panels_come_in_the_order_of_the_assembly_sheet(dome, film):
    made, _ = dome
    order = [step.panel for step in assembly_steps(made.flat.layout)]
    assert [track.patch for track in film[0].tracks] == order
    assert (np.diff([track.times[0] for track in film[0].tracks]) > 0).all()


def test_at_its_stages_it_shows_them(dome, film):
    """The arms of every stage, bent by themselves; shapes that differ by too little to be seen are not made anew."""
    made, pose = dome
    found, _ = film
    owner, edge = made.flat.layout.patch_of[found.panels.vertex_quad], made.flat.layout.mesh.median_edge
    assert len(found.stage_times) == len(found.stages.all)
    for stage, time in zip(found.stages.all, found.stage_times, strict=True):
        stand = Pose(pose.centres.copy(), pose.rotations.copy())
        stand.centres[stage.hubs], stand.rotations[stage.hubs] = stage.pose.centres, stage.pose.rotations
        there = np.isin(owner, np.unique(made.flat.layout.patch_of[stage.hubs]))
        wanted = found.panels.vertices_at_pose(bend_arms(made, stand, closed=stage.closed), stand)[there]
        away = shown(found, time)[there] - wanted
        lift = away[:, 2].mean()
        assert lift > -0.01 * edge
        assert np.linalg.norm(away - [0.0, 0.0, lift], axis=1).max() < 2.0 * assembly_film.SHAPE_TOLERANCE * edge


def test_what_is_joined_stays_joined(film):
    """Tips at closed joints of a seam meet from their stage on, at all times in between as well; before, they are apart."""
    found, _ = film
    joint, meet = tips(found)
    edge = found.panels.design.flat.layout.mesh.median_edge
    open_before = 0.0
    for time in np.linspace(0.0, found.length, 90):
        points = shown(found, time)
        gap = np.linalg.norm(points[meet[:, :, 0]] - points[meet[:, :, 1]], axis=2).max(axis=1)
        done = np.flatnonzero(found.stage_times <= time + 1e-9)
        closed = found.stages.all[done[-1]].closed[joint] if len(done) else np.zeros(len(joint), bool)
        assert gap[closed].max(initial=0.0) < 0.1 * edge
        open_before = max(open_before, gap[~closed].max(initial=0.0))
    assert closed.all() and gap.max() < 1e-6 * edge and open_before > edge


def test_nothing_jumps(film):
    """In no moment a point is much faster than one that flies straight from the table."""
    found, _ = film
    step = 0.02
    frames = [shown(found, time) for time in np.arange(0.0, found.length, step)]
    fastest = max(np.linalg.norm(b - a, axis=1).max() for a, b in pairwise(frames)) / step
    assert fastest < 4.0 * np.linalg.norm(frames[-1] - frames[0], axis=1).max() / assembly_film.FLIGHT_TIME


def test_progress_rises_with_every_piece_of_a_stage(dome, film):
    made, pose = dome
    found, table = film
    seen = []
    progress = Progress(lambda fraction, text: seen.append(fraction))
    assembly_film.record_tracks(made, pose, table, found.stages, hub_film.HubActors(made), progress)
    assert len(seen) > len(found.stages.all) and seen[0] == 0.0 and seen[-1] < 1.0
    assert (np.diff(seen) > 0.0).all()


def test_a_rolled_strip_unrolls_on_circles(flat_grid):
    """A strip that is rolled round more than once: half way it has half its curvature, and its joints are closed."""
    count, size, turn = 12, 0.02, 0.7
    made = design.SpiralDesign(flat_grid(count, 1), SpiralParams(), np.full((count, 4), 0.001), np.full(count, 2.0))
    angle = turn * np.arange(count)
    radius = 0.5 * size / np.tan(0.5 * turn)
    rotations = Rotation.from_euler("y", angle).as_matrix()
    pose = Pose(np.c_[radius * np.sin(angle), 0 * angle, radius * np.cos(angle)], rotations)
    mesh = made.flat.layout.mesh
    pairs, lever = mesh.edge_quads[~mesh.border], rest_joints(mesh, made.flat.corners)[0]
    centres = np.c_[made.arms.centre, np.zeros(count)]
    lying = Pose(centres, np.broadcast_to(np.eye(3), (count, 3, 3)))
    # the middle of the strip stays as it is turned
    pose = pose.transform(rotations[count // 2].T, np.zeros(3))
    blend = PoseBlend.between(lying, pose, pairs, lever)
    flat, middle, whole = (blend.at(share) for share in (0.0, 0.5, 1.0))
    assert whole.centres == pytest.approx(pose.centres, abs=1e-6 * size)
    assert whole.rotations == pytest.approx(pose.rotations, abs=1e-9)
    assert flat.rotations == pytest.approx(np.broadcast_to(np.eye(3), (count, 3, 3)))
    assert flat.centres == pytest.approx(centres, abs=1e-6 * size)
    between = np.swapaxes(middle.rotations[:-1], 1, 2) @ middle.rotations[1:]
    assert Rotation.from_matrix(between).magnitude() == pytest.approx(0.5 * turn)
    ends = middle.centres[pairs] + (middle.rotations[pairs] @ lever[..., None])[..., 0]
    assert np.abs(ends[:, 1] - ends[:, 0]).max() < 1e-6 * size

"""The film of an assembly: from flat to the pose that was given, with joints that stay closed and seams that close."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.assembling import assembly_film
from flexmaps.engine.assembling.assembly_order import steps
from flexmaps.engine.fabrication.panel_mesh import DETAILS, panel_mesh
from flexmaps.engine.mechanics.assembly import Pose, rest_joints, target_pose
from flexmaps.engine.mechanics.bent_arms import bent
from flexmaps.engine.params import LayoutParams, SpiralParams
from flexmaps.engine.patches import flatten, trace
from flexmaps.engine.spirals import design
from flexmaps.engine.surface import shapes
from scipy.spatial.transform import Rotation


@pytest.fixture(scope="module")
def dome():
    mesh = shapes.make("dome")
    flat = flatten.flatten(trace.trace(mesh, LayoutParams()), LayoutParams())
    made = design.uniform(flat, SpiralParams(), twist=3.0)
    return made, target_pose(mesh, flat.corners)


@pytest.fixture(scope="module")
def film(dome):
    made, pose = dome
    table = np.c_[np.arange(len(made.flat.layout.patches)), np.zeros((len(made.flat.layout.patches), 2))]
    return assembly_film.film(made, pose, table, DETAILS["COARSE"]), table


def test_it_begins_on_the_table(film):
    found, table = film
    flat = found.panels.flat(table[:, :2])
    for track in found.tracks:
        points = track.shapes[0] @ track.turns[0].T + track.places[0]
        assert points == pytest.approx(flat[track.vertices], abs=1e-9)


def test_nothing_dips_under_the_table(film):
    """Until it has arrived every panel stays on or above the ground that it lay on."""
    found, _ = film
    half = 0.5 * found.panels.design.params.thickness
    for track in found.tracks:
        for time, turn, place in zip(track.times[:-1], track.turns[:-1], track.places[:-1], strict=True):
            shape = track.shapes[max(int(np.searchsorted(track.shape_times, time - 1e-9)), 0)]
            assert (shape @ turn.T + place)[:, 2].min() > -half - 1e-9


def test_it_ends_in_the_pose(dome, film):
    made, pose = dome
    found, _ = film
    ends = panel_mesh(made, DETAILS["COARSE"]).placed(bent(made, pose), pose)
    seen = np.concatenate([track.vertices for track in found.tracks])
    assert (np.sort(seen) == np.arange(len(ends))).all()
    for track in found.tracks:
        points = track.shapes[-1] @ track.turns[-1].T + track.places[-1]
        assert points == pytest.approx(ends[track.vertices], abs=1e-7)
        assert track.times[-1] <= found.length and (np.diff(track.times) > 0).all()
        assert (np.diff(track.shape_times) >= 0).all() and track.shape_times[-1] <= found.length + 1e-9


def test_panels_come_in_the_order_of_the_assembly_sheet(dome, film):
    made, _ = dome
    order = [step.panel for step in steps(made.flat.layout)]
    assert [track.patch for track in film[0].tracks] == order
    assert (np.diff([track.times[0] for track in film[0].tracks]) > 0).all()


def test_a_rolled_strip_unrolls_on_circles(flat_grid):
    """A strip that is rolled round more than once: half way it has half its curvature, and its joints are closed."""
    count, size, turn = 12, 0.02, 0.7
    made = design.SpiralDesign(flat_grid(count, 1), SpiralParams(), np.full(count, 0.001), np.full(count, 2.0))
    angle = turn * np.arange(count)
    radius = 0.5 * size / np.tan(0.5 * turn)
    rotations = Rotation.from_euler("y", angle).as_matrix()
    pose = Pose(np.c_[radius * np.sin(angle), 0 * angle, radius * np.cos(angle)], rotations)
    home = assembly_film._frames(made, pose)
    local = assembly_film._local(pose, home, made.flat.layout.patch_of)
    blend = assembly_film.Blend.of(made, local)
    flat, middle, whole = (blend.at(share) for share in (0.0, 0.5, 1.0))
    assert whole.centres == pytest.approx(local.centres, abs=1e-6 * size)
    assert whole.rotations == pytest.approx(local.rotations, abs=1e-9)
    assert flat.rotations == pytest.approx(np.broadcast_to(np.eye(3), (count, 3, 3)))
    between = np.swapaxes(middle.rotations[:-1], 1, 2) @ middle.rotations[1:]
    assert Rotation.from_matrix(between).magnitude() == pytest.approx(0.5 * turn)
    lever = rest_joints(made.flat.layout.mesh, made.flat.corners)[0]
    pairs = made.flat.layout.mesh.edge_quads[~made.flat.layout.mesh.border]
    ends = middle.centres[pairs] + (middle.rotations[pairs] @ lever[..., None])[..., 0]
    assert np.abs(ends[:, 1] - ends[:, 0]).max() < 1e-6 * size


def test_seams_close_as_the_second_panel_arrives(dome, film):
    """Plain ends on both sides of a seam: apart in the middle of the closing, together at its end."""
    made, pose = dome
    found, _ = film
    layout, panels = made.flat.layout, found.panels
    mesh = layout.mesh
    seam = np.flatnonzero(layout.cut & ~mesh.border)
    arms = 4 * mesh.edge_quads[seam] + mesh.edge_sides[seam]
    first = np.flatnonzero(np.r_[True, np.diff(panels.arm) > 0])  # sections at the tips
    index = np.full(4 * len(panels.arm), -1)
    index[panels.used[panels.used < len(index)]] = np.flatnonzero(panels.used < len(index))
    patch = layout.patch_of[mesh.edge_quads[seam]]
    different = patch[:, 0] != patch[:, 1]
    size = np.linalg.norm(np.ptp(pose.centres, axis=0))
    ends = np.empty((len(panels.vertex_quad), 3))
    for track in found.tracks:
        ends[track.vertices] = track.shapes[-1] @ track.turns[-1].T + track.places[-1]
    left, right = index[4 * first[arms[different]]], index[4 * first[arms[different]] + 1]
    assert (left >= 0).all() and (right >= 0).all()
    # what is left of one arm is right of the other
    assert ends[left[:, 0]] == pytest.approx(ends[right[:, 1]], abs=1e-6 * size)

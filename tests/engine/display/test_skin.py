"""Spirals that follow their hubs: the page's bodies against the elastic ones that the preview and the film draw."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flexmaps.engine.display import arrange
from flexmaps.engine.display.panel_mesh import PanelMesh, make_panel_mesh
from flexmaps.engine.display.rim_mesh import RimMesh
from flexmaps.engine.display.skin import Skin, choose_detail
from flexmaps.engine.extras.film import assembly_film, hub_film, unfinished_pieces
from flexmaps.engine.extras.film.pose_blend import PoseBlend
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.mechanics.arms.bent import bend_arms
from flexmaps.engine.mechanics.assembly import Pose, rest_joints
from flexmaps.engine.params import LayoutParams, SimulateParams, SpiralParams
from flexmaps.engine.patches.flattening import flatten
from flexmaps.engine.patches.joining import assembly_steps
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.simulation.simulate import simulate
from flexmaps.engine.spirals import fabricable
from flexmaps.engine.surface import shapes

POM = MATERIALS["pom"]


@pytest.fixture(scope="module", params=["dome", "strip"])
def piece(request):
    """Panels with seams, and where they rest."""
    mesh = shapes.make(request.param)
    flat = flatten.flatten(trace.trace_layout(mesh, LayoutParams()), LayoutParams())
    made = fabricable.uniform_design(flat, SpiralParams(), twist=3.0)
    return made, simulate(made, mesh, POM, SimulateParams()).equilibrium.pose


@pytest.fixture(scope="module")
def rimmed():
    """A dome of panels with a rim, and where it rests."""
    mesh = shapes.make("dome")
    flat = flatten.flatten(trace.trace_layout(mesh, LayoutParams()), LayoutParams())
    made = fabricable.uniform_design(flat, SpiralParams(border="rim"), twist=3.0)
    return made, simulate(made, mesh, POM, SimulateParams()).equilibrium.pose


def sections(panels: PanelMesh, points: np.ndarray) -> np.ndarray:
    """(n, 4, 3): of the drawn vertices those of the sections, as the skin has them; NaN where two arms share a section."""
    out = np.full((4 * len(panels.arm) + 2 * len(panels.fillet_quad), 3), np.nan)
    out[panels.kept_vertices] = points
    return out[: 4 * len(panels.arm)].reshape(-1, 4, 3)


def joined(skin: Skin) -> np.ndarray:
    return (skin.partner >= 0).astype(float)


def test_it_ends_as_the_elastic_arms_do(piece):
    made, pose = piece
    panels, skin = make_panel_mesh(made, choose_detail(made)), Skin.from_design(made, pose)
    wanted = sections(panels, panels.vertices_at_pose(bend_arms(made, pose), pose))
    found = skin.corners_at_pose(pose, joined(skin), made.params.thickness)
    there = np.isfinite(wanted)
    assert there.mean() > 0.8
    assert found[there] == pytest.approx(wanted[there], abs=1e-9)


def test_it_begins_flat(piece):
    made, pose = piece
    panels, skin = make_panel_mesh(made, choose_detail(made)), Skin.from_design(made, pose)
    places = arrange.arrange_patches(made.flat)
    wanted = sections(panels, panels.flat_vertices(places))
    centres = np.c_[made.arms.centre + places[made.flat.layout.patch_of], np.zeros(len(made.width))]
    flat = Pose(centres, np.broadcast_to(np.eye(3), (len(centres), 3, 3)))
    found = skin.corners_at_pose(flat, np.zeros(len(skin.tip)), made.params.thickness)
    there = np.isfinite(wanted)
    assert found[there] == pytest.approx(wanted[there], abs=1e-9)


def placed_strip(skin, pose, closed, thickness):
    """Positions (points, 2, 3) above and below every point of the rim, metres, as the page computes them."""
    assert skin.rim_strip is not None
    quad, up = skin.rim_strip.quad, np.array([0.0, 0.0, 1.0])
    bend = skin._mean_over_joints(skin.joint_bend_shares(skin.tip_motions(pose, closed)))[quad, None]
    middle = np.c_[skin.rim_strip.flat, np.zeros(len(quad))] + bend * skin.rim_strip.way
    lift = (1.0 - bend) * up + bend * skin.rim_strip.up
    lift *= 0.5 * thickness / np.linalg.norm(lift, axis=1, keepdims=True)
    ends = np.stack([middle + lift, middle - lift], axis=1)
    return pose.centres[quad, None] + ends @ np.swapaxes(pose.rotations, 1, 2)[quad]


def test_a_rim_begins_flat_and_ends_as_the_elastic_one_does(rimmed):
    made, pose = rimmed
    rim, skin = RimMesh.from_design(made), Skin.from_design(made, pose)
    assert rim is not None and skin.rim_strip is not None
    order, half = np.argsort(rim.quad, kind="stable"), 0.5 * made.params.thickness
    place, up = rim.points_at_pose(bend_arms(made, pose))
    wanted = np.stack([place + half * up, place - half * up], axis=1)[order]
    assert placed_strip(skin, pose, joined(skin), made.params.thickness) == pytest.approx(wanted, abs=1e-9)
    centres = np.c_[made.arms.centre, np.zeros(len(made.width))]
    flat = Pose(centres, np.broadcast_to(np.eye(3), (len(centres), 3, 3)))
    lying = placed_strip(skin, flat, np.zeros(len(skin.tip)), made.params.thickness)
    assert lying.mean(axis=1) == pytest.approx(rim.flat_points[order], abs=1e-9)
    # the same bodies, though their points are in another order
    same = place[order][skin.rim_strip.triangles].mean(axis=1)
    assert np.sort(same, axis=0) == pytest.approx(np.sort(place[rim.triangles].mean(axis=1), axis=0), abs=1e-9)


def test_necks_of_another_design_on_the_same_rim_leave_its_outer_edge(rimmed):
    made, _ = rimmed
    rim, wider = RimMesh.from_design(made), replace(made, width=1.3 * made.width)
    assert rim is not None
    there = rim.with_necks_of(wider)
    outer = rim.strip_points[:, 1] > 0.49 * rim.rim.width
    assert outer.any() and np.array_equal(there.strip_points[outer], rim.strip_points[outer])
    at_neck = np.isclose(np.abs(rim.strip_points[:, 0]), rim.half_necks[rim.node]) & (
        rim.strip_points[:, 1] < -0.49 * rim.rim.width
    )
    assert np.abs(there.strip_points[at_neck, 0]) == pytest.approx(1.3 * np.abs(rim.strip_points[at_neck, 0]), rel=1e-6)


def test_half_way_it_is_near_the_elastic_arms(piece):
    """Poses that no simulation has seen: arms are where a beam would be, as nearly as can be seen."""
    made, pose = piece
    layout, count = made.flat.layout, len(made.width)
    mesh, panels, skin = layout.mesh, make_panel_mesh(made, choose_detail(made)), Skin.from_design(made, pose)
    flat = Pose(np.c_[made.arms.centre, np.zeros(count)], np.broadcast_to(np.eye(3), (count, 3, 3)).copy())
    inner = ~mesh.border
    inside = ~layout.cut[inner]
    pairs, lever = mesh.edge_quads[inner], rest_joints(mesh, made.flat.corners)[0]
    here = PoseBlend.between(flat, pose, pairs[inside], lever[inside]).at(0.5)
    closed = np.zeros(len(skin.tip))
    closed[(4 * mesh.edge_quads[inner] + mesh.edge_sides[inner])[inside]] = 1.0
    wanted = sections(panels, panels.vertices_at_pose(bend_arms(made, here, closed=inside), here))
    off = np.linalg.norm(skin.corners_at_pose(here, closed, made.params.thickness) - wanted, axis=2) / mesh.median_edge
    # a pixel, where the piece of ten quads fills a screen of 500
    assert np.nanmean(off) < 0.02
    assert np.nanmax(off) < 0.15


@pytest.mark.parametrize("resting", [True, False])
def test_hubs_come_together_as_in_the_film(piece, resting):
    made, pose = piece
    layout = made.flat.layout
    table = arrange.places_before_assembly(made, pose)
    found = (
        unfinished_pieces.find_stages(made, pose, POM, SimulateParams())
        if resting
        else unfinished_pieces.stages_without_equilibria(made, pose)
    )
    actors = hub_film.HubActors(made)
    shots = assembly_film.record_tracks(made, pose, table, found, actors)
    assert [track.patch for track in shots.tracks] == [step.panel for step in assembly_steps(layout)]
    for track in shots.tracks:
        hubs = layout.patches[track.patch]
        centres, rotations = actors.poses(track.shapes)
        last = centres[-1] @ track.turns[-1].T + track.places[-1]
        assert last == pytest.approx(pose.centres[hubs], abs=1e-9)
        assert track.turns[-1] @ rotations[-1] == pytest.approx(pose.rotations[hubs], abs=1e-9)
        first = centres[0] @ track.turns[0].T + track.places[0]
        assert first[:, :2] == pytest.approx(made.arms.centre[hubs] + table[track.patch, :2], abs=1e-9)
        assert np.ptp(first[:, 2]) == pytest.approx(0.0, abs=1e-12)


def test_every_seam_is_closed_once_and_in_the_order_of_the_assembly_sheet(piece):
    made, pose = piece
    layout = made.flat.layout
    found = unfinished_pieces.stages_without_equilibria(made, pose)
    shots = assembly_film.record_tracks(
        made, pose, arrange.places_before_assembly(made, pose), found, hub_film.HubActors(made)
    )
    times = hub_film.closing_times(made, shots)
    assert np.isfinite(times).all() and (times[:, 0] < times[:, 1]).all()
    joint = np.cumsum(~layout.mesh.border) - 1
    assert (times[joint[~layout.cut & ~layout.mesh.border], 1] < 0.0).all()
    for number, step in enumerate(assembly_steps(layout)):
        for join in step.joins:
            own = times[joint[layout.seams[join.seam]]]
            assert (own >= number).all() and (own <= min(number + 1.5, shots.length) + 1e-9).all()

"""Arms left out at open borders, judged by shapely and trimesh: the same panel but for those arms, closed by round ends."""

import numpy as np
import pytest
import shapely
import trimesh
from flexmaps.engine.display import arrange, solids
from flexmaps.engine.display.panel_mesh import DETAILS, make_panel_mesh
from flexmaps.engine.fabrication import sheets
from flexmaps.engine.fabrication.panels.kerf import cut_paths
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.mechanics.arms.bent import bend_arms
from flexmaps.engine.mechanics.assembly import Pose
from flexmaps.engine.params import SheetParams, SimulateParams, SpiralParams
from flexmaps.engine.simulation.simulate import simulate
from flexmaps.engine.spirals import design, fabricable
from flexmaps.engine.spirals.curves import spiral

STUBS, OUT = SpiralParams(border="stubs"), SpiralParams(border="left_out")


def _polygon(outline):
    return shapely.Polygon(outline.outer.sample(1e-7), [h.sample(1e-7) for h in outline.holes])


def _designs(flat, twist):
    made = fabricable.uniform_design(flat, STUBS, width=0.0015, twist=twist)
    return made, design.SpiralDesign(flat, OUT, made.width, made.twist)


@pytest.mark.parametrize("degrees", [0, 60, 180, 300])
def test_a_panel_is_the_same_but_for_the_arms_that_are_left_out(flat_grid, degrees):
    stubs, out = _designs(flat_grid(4, 3), np.radians(degrees))
    (whole,), (less,) = (map(_polygon, made.outlines(1e-7)) for made in (stubs, out))
    assert less.is_valid
    assert less.difference(whole).area < 5e-7 * less.length
    # what is gone lies along the arms at the border, from their round ends outwards, and nowhere else
    border = out.flat.layout.mesh.border[out.flat.layout.mesh.quad_edges]
    assert (out.is_absent == border).all()
    line = spiral.centre_line(out.arms, out.arm_starts[..., None] * np.linspace(0.0, 1.0, 400))[0][border]
    width = np.repeat(out.width[:, :1], 4, axis=1)[border]
    gone = shapely.union_all([shapely.LineString(p).buffer(0.5 * w) for p, w in zip(line, width, strict=True)])
    assert whole.difference(less).difference(gone.buffer(1e-6)).area < 5e-7 * less.length
    kept = 0.125 * np.pi * width**2  # a round end each, and slots that end beside it
    removed = sum(np.linalg.norm(np.diff(p, axis=0), axis=1).sum() * w for p, w in zip(line, width)) - kept.sum()
    assert whole.area - less.area == pytest.approx(removed, rel=2e-3)
    # both are made of chords, which lose most where arms are wound most
    assert stubs.area.sum() - out.area.sum() == pytest.approx(removed, rel=1e-2)
    assert out.min_slot_and_bridge[0] >= stubs.min_slot_and_bridge[0] - 1e-9


@pytest.mark.parametrize("border", [STUBS, OUT], ids=["stubs", "left out"])
def test_weight_is_that_of_what_is_cut(flat_grid, border):
    flat = flat_grid(3, 3)
    made = fabricable.uniform_design(flat, border, width=0.0015, twist=2.0)
    (panel,) = map(_polygon, made.outlines())
    params, pom = SimulateParams(gravity=True), MATERIALS["pom"]
    found = simulate(made, flat.layout.mesh, pom, params, supports=np.array([0]))
    weight = panel.area * border.thickness * pom.density * 9.81
    assert -found.loads.force[:, 2].sum() == pytest.approx(weight, rel=4e-3)


def test_without_weight_the_shape_is_the_same_and_no_slot_closes_beside_what_is_not_there(flat_grid):
    flat = flat_grid(3, 3, move=lambda p: p + 0.002 * np.sin(300.0 * p[:, ::-1]))
    found = [
        simulate(made, flat.layout.mesh, MATERIALS["pom"], SimulateParams(), supports=np.array([4]))
        for made in _designs(flat, 4.0)
    ]
    assert np.allclose(*(f.equilibrium.pose.centres for f in found), atol=1e-12)
    widths = [f.slots().width for f in found]
    beside = found[1].design.is_absent.ravel()[found[1].slots().arms].any(axis=1)
    assert np.isinf(widths[1][beside]).all()
    assert widths[1].min() >= widths[0].min() - 1e-12


def test_sheets_kerf_and_labels_go_with_it(flat_grid):
    _, out = _designs(flat_grid(5, 3, cut=lambda x, y: x == 2.0), 2.5)
    made = sheets.make_sheets(out, SheetParams())
    assert len(made.connections.connectors) == 3
    for panel in made.panels:
        shape = shapely.Polygon(panel.outline.sample(1e-6), [h.sample(1e-6) for h in panel.holes])
        assert shape.is_valid
        assert panel.area == pytest.approx(shape.area, rel=3e-4)
        assert all(shape.contains(shapely.LineString(stroke.points)) for stroke in panel.labels)
        path = cut_paths(type(out.outlines()[0])(panel.outline, panel.holes), 0.00015, 0.00015)
        wider = shapely.Polygon(path.outer.sample(1e-6), [h.sample(1e-6) for h in path.holes])
        assert wider.symmetric_difference(shape.buffer(0.000075, quad_segs=64)).area < 2e-4 * shape.area
        places = shapely.points(panel.tab_places[:, :2])
        assert shapely.distance(places, shape.boundary).max() < 0.0016  # as far as an end is wide


@pytest.mark.parametrize("degrees", [0, 200])
def test_drawn_bodies_are_closed_and_hold_what_is_cut(flat_grid, degrees):
    _, out = _designs(flat_grid(3, 3), np.radians(degrees))
    (panel,) = map(_polygon, out.outlines())
    centres = arrange.arrange_patches(out.flat)
    flat_pose = Pose(np.c_[out.arms.centre, np.zeros(9)], np.broadcast_to(np.eye(3), (9, 3, 3)).copy())
    drawn = make_panel_mesh(out, DETAILS["FINE"])
    shown = solids.make_solids(out, centres)
    for points, corners, sizes in (
        (drawn.vertices_at_pose(bend_arms(out, flat_pose), flat_pose), drawn.corners, drawn.sizes),
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
        assert body.volume == pytest.approx(panel.area * OUT.thickness, rel=0.02)

"""Outlines of panels against shapely: one valid piece, the same area as arms buffered one by one, cuttable everywhere."""

import numpy as np
import pytest
import shapely
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.params import SpiralParams
from flexmaps.engine.spirals import contours, fabricable
from flexmaps.engine.spirals.clearance import slots
from flexmaps.engine.spirals.contacts import find_contacts, nearest_quads
from flexmaps.engine.spirals.curves import spiral
from flexmaps.engine.spirals.design import SpiralDesign

SHEAR = np.array([[1.0, 0.03], [0.12, 1.05]])
TAPER = lambda p: p * [[1.0, 1.0]] + np.column_stack([0.25 * p[:, 0] * p[:, 1] / 0.06, 0 * p[:, 1]])  # noqa: E731


def _polygons(made, tolerance=1e-5):
    return [shapely.Polygon(o.outer.sample(1e-7), [h.sample(1e-7) for h in o.holes]) for o in made.outlines(tolerance)]


def _buffered(made, fillet):
    """The same panel made another way: every arm's centre line buffered, all united, inside corners rounded."""
    arms = made.arms
    t = np.broadcast_to(np.linspace(0, 1, 500), (*arms.radius.shape, 500))
    lines = spiral.centre_line(arms, t)[0].reshape(-1, 500, 2)
    width = np.repeat(made.width, 4)
    united = shapely.union_all(
        [shapely.LineString(a).buffer(w / 2, cap_style="flat", quad_segs=4) for a, w in zip(lines, width)]
    )
    # joints meet at a line only: bring them together before the corners are rounded
    united = united.buffer(1e-8)
    return united.buffer(fillet, quad_segs=16).buffer(-fillet, quad_segs=16)


@pytest.mark.parametrize("clockwise", [False, True], ids=["left", "right"])
@pytest.mark.parametrize("move", [None, lambda p: p @ SHEAR, TAPER], ids=["square", "sheared", "tapered"])
@pytest.mark.parametrize("degrees", [0, 90, 180, 360])
def test_panel_equals_the_union_of_its_arms(flat_grid, degrees, move, clockwise):
    params = SpiralParams(clockwise=clockwise, slot_min=0.0002, fillet=0.0001)
    flat = flat_grid(2, 2, move=move)
    bound = slots.twist_bound(flat, params, np.full((4, 4), 0.0012)).min()
    made = SpiralDesign(flat, params, np.full((4, 4), 0.0012), np.full(4, min(np.radians(degrees), 0.95 * bound)))
    (panel,) = _polygons(made, 1e-6)
    assert panel.is_valid
    assert len(panel.interiors) == 1  # one hole per inner vertex
    other = _buffered(made, params.fillet)
    assert panel.area == pytest.approx(other.area, rel=5e-4)
    # nowhere more than some thousandths of a millimetre along all edges
    assert panel.symmetric_difference(other).area < 1e-6 * panel.length


def test_area_of_the_curves_is_that_of_the_polygon(flat_grid):
    made = fabricable.uniform_design(flat_grid(4, 4), SpiralParams())
    (outline,), (panel,) = made.outlines(), _polygons(made)
    assert outline.outer.area > 0
    assert all(h.area < 0 for h in outline.holes)
    assert outline.outer.area + sum(h.area for h in outline.holes) == pytest.approx(panel.area, rel=2e-5)


@pytest.mark.parametrize("ratio", [40, 20, 10, 5])
def test_thin_and_thick_arms(flat_grid, ratio):
    size = 0.02
    params = SpiralParams(width_min=0.0003, width_max=0.004, twist_max=2 * np.pi)
    made = fabricable.uniform_design(flat_grid(2, 2, size), params, width=size / ratio, twist=2 * np.pi)
    (panel,) = _polygons(made)
    assert panel.is_valid
    assert made.width[0, 0] == pytest.approx(size / ratio)
    assert panel.area == pytest.approx(_buffered(made, params.fillet).area, rel=1e-3)


@pytest.mark.parametrize("seed", range(6))
def test_wild_designs_come_out_as_one_valid_piece_that_can_be_cut(flat_grid, seed):
    rng = np.random.default_rng(seed)
    flat = flat_grid(8, 8, move=lambda p: p + rng.uniform(-0.003, 0.003, p.shape))
    params = SpiralParams(clockwise=bool(seed % 2))
    made = fabricable.design_from_curvature(flat, params, rng.uniform(0, 1, 64))
    (panel,) = _polygons(made)
    assert panel.is_valid
    assert panel.geom_type == "Polygon"
    # a cutter as wide as the smallest slot reaches every hole as a whole ...
    for ring in panel.interiors:
        assert shapely.Polygon(ring).buffer(-0.49 * params.slot_min).geom_type == "Polygon"
    # ... and no bridge is thinner than the thinnest arm
    assert panel.buffer(-0.49 * params.width_min).geom_type == "Polygon"
    slot, bridge = slots.min_slot_and_bridge(made.arms, made.roots.left, made.roots.right, params.fillet)
    assert slot >= params.slot_min - 1e-6
    assert bridge == pytest.approx(made.width.min(), abs=2e-5)


def test_roots_touch_both_edges(flat_grid):
    made = fabricable.uniform_design(flat_grid(2, 2), SpiralParams(fillet=0.0002))
    (panel,) = _polygons(made)
    edges = panel.boundary
    for centre in made.roots.centre.reshape(-1, 2):
        assert edges.distance(shapely.Point(centre)) == pytest.approx(0.0002, abs=2e-6)
        assert not panel.contains(shapely.Point(centre))


def test_sharp_corners_without_fillet(flat_grid):
    params = SpiralParams(fillet=0.0)
    (panel,) = _polygons(fabricable.uniform_design(flat_grid(2, 2), params, twist=0.0))
    assert panel.is_valid
    w = 0.0015
    assert panel.area == pytest.approx(4 * (2 * 0.02 * w - w * w), rel=1e-9)  # four crosses


def test_l_shape_and_grid_with_a_hole(flat_grid):
    l_shape = flat_grid(4, 4, without=lambda i, j: i > 1 and j > 1)
    ring = flat_grid(3, 3, without=lambda i, j: i == 1 and j == 1)
    for flat, holes in ((l_shape, 5), (ring, 1)):
        (panel,) = _polygons(fabricable.uniform_design(flat, SpiralParams()))
        assert panel.is_valid
        assert len(panel.interiors) == holes


def test_panels_side_by_side_along_a_seam_touch_and_do_not_overlap(flat_grid):
    rng = np.random.default_rng(3)
    points = rng.uniform(-0.002, 0.002, (30, 2))
    whole, parted = (flat_grid(5, 4, move=lambda p: p + points, cut=cut) for cut in (None, lambda x, y: x == 2))
    curvature = rng.uniform(0, 1, 20)
    one, two = (fabricable.design_from_curvature(flat, SpiralParams(), curvature) for flat in (whole, parted))
    np.testing.assert_allclose(one.twist, two.twist)
    (both,), (left, right) = _polygons(one), _polygons(two)
    assert left.intersection(right).area < 1e-12
    assert left.distance(right) < 1e-9
    assert left.area + right.area == pytest.approx(both.area, rel=1e-4)
    assert left.buffer(2e-6).union(right.buffer(2e-6)).geom_type == "Polygon"


def test_cut_inside_a_patch_leaves_a_slot(flat_grid):
    params = SpiralParams()
    flat = flat_grid(6, 6, cut=lambda x, y: x == 3 and 1 < y < 5)
    assert len(flat.layout.patches) == 1
    (panel,) = _polygons(fabricable.uniform_design(flat, params, twist=3.0))
    assert panel.is_valid
    slit = max(panel.interiors, key=lambda r: shapely.Polygon(r).area)
    assert shapely.Polygon(slit).buffer(-0.49 * params.slot_min).geom_type == "Polygon"
    assert len(panel.interiors) == 25 - 5 + 1  # the five vertices along the cut share one hole


def test_every_quad_a_patch(flat_grid):
    made = fabricable.uniform_design(flat_grid(2, 2, cut=lambda x, y: True), SpiralParams())
    panels = _polygons(made)
    assert len(panels) == 4
    assert all(p.is_valid and not p.interiors for p in panels)


def test_few_nodes(flat_grid):
    made = fabricable.uniform_design(flat_grid(6, 6), SpiralParams(), width=0.001, twist=2 * np.pi)
    (outline,) = made.outlines()
    nodes = sum(len(c.points) for c in (outline.outer, *outline.holes))
    assert nodes <= 40 * 4 * 36


def test_outlines_stay_within_the_tolerance(flat_grid):
    made = fabricable.uniform_design(flat_grid(1, 1), SpiralParams(), width=0.0012, twist=5.0)
    fine, coarse = (made.outlines(t)[0].outer for t in (1e-7, 2e-5))
    line = shapely.LinearRing(fine.sample(1e-7))
    shapely.prepare(line)
    assert shapely.distance(line, shapely.points(coarse.sample(1e-6))).max() < 2.1e-5
    assert len(coarse.points) < 0.5 * len(fine.points)


def test_spirals_without_room_are_named(flat_grid):
    made = SpiralDesign(
        flat_grid(2, 1, 0.01), SpiralParams(), spiral.same_width(np.array([0.0015, 0.0025])), np.array([1.0, 9.0])
    )
    with pytest.raises(FlexMapsError, match=r"^1 spiral does not fit its quad;") as caught:
        made.outlines()
    assert caught.value.faces == [1]


def test_touching_places_are_found(flat_grid):
    # two arms of quads that share but a vertex, driven into each other by a quad squeezed to a sliver
    flat = flat_grid(2, 2)
    made = fabricable.uniform_design(flat, SpiralParams())
    outline = made.outlines()[0]
    assert not len(find_contacts([outline]))
    shifted = contours.Outline(outline.outer, (*outline.holes, outline.holes[0].transform(0.0, np.array([0.001, 0.0]))))
    places = find_contacts([shifted])
    assert len(places) > 0
    assert (np.abs(places[:, 1:] - 0.02) < 0.02).all()


def test_places_lie_in_the_quads_nearest_to_them(flat_grid):
    flat = flat_grid(4, 3, cut=lambda x, y: x == 2.0)
    centre = flat.corners.mean(axis=1)
    for quad, (x, y) in enumerate(centre):
        place = np.array([[flat.layout.patch_of[quad], x + 1e-3, y - 1e-3]])
        assert nearest_quads(flat, place, 1).tolist() == [quad]
        assert quad in nearest_quads(flat, place) and len(nearest_quads(flat, place)) == 4


def test_distances_of_points_from_segments_are_those_of_shapely() -> None:
    import shapely
    from flexmaps.engine.spirals.contours import _distance_from_segment

    points, segments = np.random.default_rng(3).normal(size=(2, 200, 2, 2))
    lines = shapely.linestrings(segments)
    wanted = np.minimum(*(shapely.distance(shapely.points(points[:, k]), lines) for k in range(2)))
    np.testing.assert_allclose(_distance_from_segment(points, segments), wanted, atol=1e-12)

"""Offsets of arcs against shapely's buffers and closed forms; paths of panels against the material that they leave."""

import math

import numpy as np
import pytest
import shapely
import shapely.affinity
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.fabrication import sheets
from flexmaps.engine.fabrication.connectors.shape import round_polyline
from flexmaps.engine.fabrication.panels import kerf
from flexmaps.engine.params import CutParams, SheetParams, SpiralParams
from flexmaps.engine.spirals import fabricable
from flexmaps.engine.spirals.contacts import find_contacts
from flexmaps.engine.spirals.curves.arcs import Curve

SQUARE = [(0.0, 0.0), (0.02, 0.0), (0.02, 0.01), (0.0, 0.01)]
NOTCHED = [(0.0, 0.0), (0.03, 0.0), (0.03, 0.02), (0.02, 0.02), (0.016, 0.01), (0.014, 0.01), (0.01, 0.02), (0.0, 0.02)]


def _polygon(curve):
    return shapely.Polygon(curve.sample(1e-8))


def _corners(points):
    return Curve(np.array(points), np.zeros(len(points)))


def test_circle_stays_a_circle():
    circle = Curve(np.array([[0.01, 0.0], [-0.01, 0.0]]), np.ones(2))
    for distance in (0.001, -0.001, -0.009):
        made = kerf.offset_curve(circle, distance)
        assert len(made.points) == 2
        assert made.area == pytest.approx(math.pi * (0.01 + distance) ** 2, rel=1e-12)
    with pytest.raises(FlexMapsError, match="too small"):
        kerf.offset_curve(circle, -0.0101)


@pytest.mark.parametrize("radius", [0.0, 0.0005])
@pytest.mark.parametrize("points", [SQUARE, NOTCHED], ids=["square", "notched"])
@pytest.mark.parametrize("distance", [2e-4, -2e-4, 4e-4])
def test_offset_is_the_buffer(points, radius, distance):
    curve = round_polyline(points, radius, closed=True) if radius else _corners(points)
    made = kerf.offset_curve(curve, distance)
    wanted = _polygon(curve).buffer(distance, quad_segs=400)
    assert shapely.hausdorff_distance(_polygon(made).boundary, wanted.boundary) < 1e-7
    # corners that are filled get an arc each, nothing else does
    assert len(made.points) <= 2 * len(curve.points)


def test_arcs_smaller_than_the_offset_vanish():
    made = kerf.offset_curve(round_polyline(NOTCHED, 0.0005, closed=True), 0.0007)
    wanted = shapely.Polygon(NOTCHED).buffer(0.0007, quad_segs=400)
    assert _polygon(made).is_valid
    # outside corners were rounded before, so only the notch is compared
    notch = shapely.box(0.012, 0.005, 0.018, 0.015)
    assert (_polygon(made) & notch).symmetric_difference(wanted & notch).area < 1e-12


def test_segments_without_length_go():
    doubled = _corners([p for p in SQUARE for _ in range(2)])
    assert len(kerf.without_empty_segments(doubled).points) == 4
    assert kerf.offset_curve(doubled, 1e-4).area == pytest.approx(
        kerf.offset_curve(_corners(SQUARE), 1e-4).area, rel=1e-12
    )


def test_open_curve_keeps_its_ends():
    made = kerf.offset_curve(Curve(np.array([[0.0, 0.0], [0.01, 0.0], [0.01, 0.01]]), np.zeros(3), closed=False), 0.001)
    assert made.points[0] == pytest.approx([0.0, -0.001])
    assert made.points[-1] == pytest.approx([0.011, 0.01])


def _lens(one, two, *, union):
    """Outline of two overlapping discs, given as (x of the centre, radius), or of what they have in common."""
    (a, r), (b, q) = one, two
    x = 0.5 * (a + b) + 0.5 * (r**2 - q**2) / (b - a)
    y = math.sqrt(r**2 - (x - a) ** 2)
    left, right = (math.pi - math.atan2(y, x - a)) * 2.0, (math.pi - math.atan2(y, b - x)) * 2.0
    turns = [right, left] if union else [2.0 * math.pi - left, 2.0 * math.pi - right]
    return Curve(np.array([[x, -y], [x, y]]), np.tan(0.25 * np.array(turns)))


def _discs(one, two, grow=0.0):
    return [shapely.Point(x, 0.0).buffer(r + grow, quad_segs=200) for x, r in (one, two)]


@pytest.mark.parametrize("distance", [0.0015, 0.0004, -0.0005, -0.002])
@pytest.mark.parametrize("q", [0.007, 0.01])
def test_arcs_that_meet_in_a_corner_are_trimmed_or_joined(distance, q):
    """Two overlapping discs grow to larger discs, and their common part shrinks to that of smaller discs."""
    pair = (-0.006, 0.01), (0.006, q)
    one, two = _discs(*pair)
    for union, drawn in ((True, one | two), (False, one & two)):
        curve = _lens(*pair, union=union)
        assert curve.area == pytest.approx(drawn.area, rel=1e-4)
        for path, by in (
            (curve, distance),
            (curve.reversed(), -distance),
        ):  # to its right, seen the other way to its left
            found = _polygon(kerf.offset_curve(path, by))
            wanted = drawn.buffer(distance, quad_segs=200)
            if union == (distance > 0.0):
                exact = _discs(*pair, distance)
                wanted = exact[0] | exact[1] if union else exact[0] & exact[1]
            assert shapely.hausdorff_distance(found.boundary, wanted.boundary) < 1e-6


def test_arcs_that_no_longer_meet_are_refused_at_their_corner():
    """The common part of the discs is 4 mm thick, and 2.6 mm of kerf on both sides leave nothing of it."""
    curve = _lens((-0.006, 0.01), (0.006, 0.006), union=False)
    assert kerf.offset_curve(curve, -0.0019).area > 0.0
    with pytest.raises(FlexMapsError, match=r"no room near x 2\.\d mm, y -?\d\.\d mm"):
        kerf.offset_curve(curve, -0.0026)


@pytest.mark.parametrize("shrunk", [False, True])
@pytest.mark.parametrize("aslant", [0.0, 0.8])
def test_lines_and_arcs_that_meet_in_a_corner(aslant, shrunk):
    """A disc with a bar through its edge, and a half disc: their corners lie where circle and line do, offset."""
    half, r = 0.002, 0.01
    x = math.sqrt(r**2 - half**2)
    turn = 2.0 * math.pi - 2.0 * math.asin(half / r)
    keyhole = Curve(
        np.array([[x, half], [x, -half], [0.02, -half], [0.02, half]]), np.array([math.tan(0.25 * turn), 0.0, 0.0, 0.0])
    )
    dee = Curve(np.array([[0.0, -r], [0.0, r]]), np.array([math.tan(0.25 * math.pi), 0.0]))
    for curve, drawn in (
        (keyhole, shapely.Point(0, 0).buffer(r, quad_segs=200) | shapely.box(0.0, -half, 0.02, half)),
        (dee, shapely.Point(0, 0).buffer(r, quad_segs=200) & shapely.box(0.0, -r, r, r)),
    ):
        by = -0.0015 if shrunk else 0.0015
        wanted = shapely.affinity.rotate(drawn.buffer(by, quad_segs=200), aslant, (0, 0), use_radians=True)
        found = _polygon(kerf.offset_curve(curve.transform(aslant, np.zeros(2)), by))
        assert shapely.hausdorff_distance(found.boundary, wanted.boundary) < 2e-6


# -- short segments ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("first", range(5))
def test_a_short_side_goes_wherever_it_is(first, closed):
    """A square with a corner cut off by 13 micrometres: the sides are longer by that, unless an open curve ends there."""
    blunt = np.array([[0.0, 0.0], [0.02, 0.0], [0.02, 0.019991], [0.019991, 0.02], [0.0, 0.02]])
    points = np.roll(blunt, -first, axis=0)
    made = kerf.without_short_segments(Curve(points, np.zeros(5), closed))
    corners = np.array([[0.0, 0.0], [0.02, 0.0], [0.02, 0.02], [0.0, 0.02]])
    if closed or first in (0, 1):  # the short side has a neighbour on both sides
        nearest = np.linalg.norm(made.points[:, None] - corners, axis=2)
        assert made.points.shape == (4, 2) and nearest.min(axis=1).max() < 1e-12 and nearest.min(axis=0).max() < 1e-12
    else:
        assert (made.points[[0, -1]] == points[[0, -1]]).all() and len(made.points) == (5 if first == 3 else 4)


def test_where_neighbours_do_not_meet_nearby_a_short_side_shrinks_to_its_middle():
    hair = Curve(np.array([[0.0, 0.0], [0.02, 0.0], [0.02, 1e-5], [0.0, 1e-5], [0.0, 0.01]]), np.zeros(5), closed=False)
    made = kerf.without_short_segments(hair)
    np.testing.assert_allclose(made.points, [[0.0, 0.0], [0.02, 5e-6], [0.0, 1e-5], [0.0, 0.01]], atol=1e-12)


def test_three_nodes_are_left_however_near_they_are():
    tiny = Curve(1e-6 * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]), np.zeros(4))
    assert len(kerf.without_short_segments(tiny).points) == 3


# -- dogbones ----------------------------------------------------------------------------------------------------------


def _slit(angle, radius, reach=0.03):
    """Waste between two lines at an angle whose corner is rounded, the material on the left of the curve."""
    half = 0.5 * angle
    ways = reach * np.array([[math.cos(half), math.sin(half)], [math.cos(half), -math.sin(half)]])
    return round_polyline([tuple(ways[1]), (0.0, 0.0), tuple(ways[0])], radius)


@pytest.mark.parametrize("degrees", [25.0, 50.0, 75.0, 90.0, 120.0, 150.0])
@pytest.mark.parametrize("turn", [0.0, 2.0])
def test_a_mill_reaches_a_sharp_corner_and_takes_no_more_than_its_circle(degrees, turn):
    mill, rounding = 0.0015, 0.0002
    corner = _slit(math.radians(degrees), rounding)
    reach, half = 0.03, math.radians(0.5 * degrees)
    made = kerf.cut_dogbones(corner.transform(turn, np.zeros(2)), mill).transform(-turn, np.zeros(2))
    np.testing.assert_allclose(made.points[[0, -1]], corner.points[[0, -1]], atol=1e-12)
    before, after = (shapely.Polygon(c.sample(1e-8)) for c in (corner, made))
    assert after.is_valid and before.difference(after).area < 1e-11
    # the mill's circle passes through the middle of the rounded corner, on the line between both sides
    middle = rounding / math.sin(half) - rounding
    circle = shapely.Point(middle + mill, 0.0).buffer(mill, quad_segs=100)
    assert shapely.Point(middle, 0.0).distance(after.boundary) < 1e-8
    corridor = shapely.LineString([(middle + mill, 0.0), (reach, 0.0)]).buffer(mill, quad_segs=100)
    assert after.difference(before | circle | corridor).area < 1e-9
    reached = after.buffer(-mill * (1.0 - 1e-4), quad_segs=100).buffer(mill, quad_segs=100)
    assert (after & shapely.box(0.0, -0.004, 0.01, 0.004)).difference(reached.buffer(2e-6)).area < 1e-9


def test_corners_that_are_round_enough_stay():
    """Also those that turn the other way: the material's own corners."""
    wide = _slit(math.radians(80.0), 0.0016)
    assert kerf.cut_dogbones(wide, 0.0015) is not wide
    np.testing.assert_array_equal(kerf.cut_dogbones(wide, 0.0015).points, wide.points)
    np.testing.assert_array_equal(kerf.cut_dogbones(wide, 0.0015).bulge, wide.bulge)
    own = _slit(math.radians(80.0), 0.0002).reversed()
    np.testing.assert_array_equal(kerf.cut_dogbones(own, 0.0015).points, own.points)


def test_lines_shorter_than_a_dogbone_are_refused():
    with pytest.raises(FlexMapsError, match=r"no room for a mill of 3 mm"):
        kerf.cut_dogbones(_slit(math.radians(90.0), 0.0002, reach=0.0012), 0.0015)


# -- panels ------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def made(flat_grid):
    return fabricable.uniform_design(flat_grid(4, 3, cut=lambda x, _: x == 2), SpiralParams(), twist=4.0)


@pytest.mark.parametrize(
    "outline, holes",
    [(0.0002, 0.0001), *(pytest.param(*one, marks=pytest.mark.thorough) for one in ((0.0001, 0.0001), (0.0, 0.0002)))],
)
def test_material_is_left_as_drawn(made, outline, holes):
    cut = CutParams(kerf_outline=outline, kerf_holes=holes)
    result = sheets.make_sheets(made, SheetParams(nesting="FAST", labels=False), cut=cut)
    drawn, paths = result.panels_on_sheet(0)[0], result.paths_on_sheet(0)[0]
    # the beam takes away half of the kerf on the inner side of the outline and around every hole
    left = _polygon(paths.outline).buffer(-outline / 2, quad_segs=32)
    for hole in paths.holes:
        left -= _polygon(hole).buffer(holes / 2, quad_segs=32)
    wanted = shapely.Polygon(drawn.outline.sample(1e-8), [h.sample(1e-8) for h in drawn.holes])
    assert left.symmetric_difference(wanted).area < 1e-4 * wanted.area
    assert left.area == pytest.approx(drawn.area, rel=1e-5)
    nodes = sum(len(c.points) for c in (paths.outline, *paths.holes))
    assert nodes < 1.1 * sum(len(c.points) for c in (drawn.outline, *drawn.holes))


def test_kerf_wider_than_the_slots_names_the_faces(made):
    with pytest.raises(FlexMapsError, match="kerf") as error:
        sheets.make_sheets(made, SheetParams(nesting="FAST"), cut=CutParams(kerf_outline=0.002, kerf_holes=0.002))
    assert len(error.value.faces)


def test_kerf_wider_than_the_spacing_is_refused(made):
    params = SheetParams(nesting="FAST", spacing=0.0001)
    with pytest.raises(FlexMapsError, match="spacing"):
        sheets.make_sheets(made, params, cut=CutParams(kerf_outline=0.0002))


def test_paths_of_panels_do_not_touch_themselves(made):
    paths = [kerf.cut_paths(o, 0.0002, 0.0002) for o in made.outlines()]
    assert not len(find_contacts(paths))


@pytest.mark.parametrize("height", [1.0, 2.9, 3.1, 5.0])
@pytest.mark.parametrize("width", [1.0, 2.9, 3.1, 5.0])
def test_a_hole_smaller_than_the_kerf_has_no_path(width, height):
    corners = 1e-3 * np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])
    hole, left = Curve(corners, np.zeros(4), closed=True), shapely.Polygon(corners).buffer(-1.5e-3)
    if left.is_empty:
        with pytest.raises(FlexMapsError, match="too small"):
            kerf.offset_curve(hole, -1.5e-3)
    else:
        assert kerf.offset_curve(hole, -1.5e-3).area == pytest.approx(left.area, rel=1e-9)

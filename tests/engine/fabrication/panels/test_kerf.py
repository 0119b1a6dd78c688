"""Offsets of arcs against shapely's buffers and closed forms; paths of panels against the material that they leave."""

import math

import numpy as np
import pytest
import shapely
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

"""Lead-ins, holding tabs and mills: what the runs leave of the sheet, judged by shapely from the runs alone."""

import sys

import numpy as np
import pytest
import shapely
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.fabrication import sheets, sheets_report
from flexmaps.engine.fabrication.connectors.shape import connector_size, head_curve, socket_curve
from flexmaps.engine.fabrication.panels import toolpath
from flexmaps.engine.fabrication.panels.kerf import cut_dogbones, without_short_segments
from flexmaps.engine.fabrication.writers import export
from flexmaps.engine.params import ConnectorParams, CutParams, SheetParams, SpiralParams
from flexmaps.engine.spirals import fabricable
from flexmaps.engine.spirals.curves.arcs import Curve

fit = sys.modules["flexmaps_connector_gaps"].fit

FAST = SheetParams(nesting="FAST", labels=False)
RING = Curve(np.array([[0.01, 0.0], [-0.01, 0.0]]), np.ones(2))


@pytest.fixture(scope="module")
def made(flat_grid):
    return fabricable.uniform_design(flat_grid(4, 3, cut=lambda x, _: x == 2), SpiralParams(), twist=2.0)


@pytest.fixture(scope="module")
def milled(flat_grid):
    flat = flat_grid(4, 3, 0.05, cut=lambda x, _: x == 2)
    return fabricable.uniform_design(
        flat, SpiralParams(width_max=0.003, slot_min=0.0031, fillet=0.00155), width=0.003, twist=0.5
    )


def _line(curve):
    return shapely.LineString(curve.sample(1e-7))


# -- pieces ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("begin, end", [(0.001, 0.002), (0.0, 0.05), (0.05, 0.07), (0.06, 0.0648)])
def test_piece_of_a_circle(begin, end):
    part = toolpath.curve_between(RING, begin, end)
    assert not part.closed
    assert part.length == pytest.approx(end - begin, rel=1e-9)
    for at, point in ((begin, part.points[0]), (end, part.points[-1])):
        assert point == pytest.approx([0.01 * np.cos(at / 0.01), 0.01 * np.sin(at / 0.01)], abs=1e-12)
    assert np.linalg.norm(part.sample(1e-7), axis=1) == pytest.approx(0.01, abs=1e-9)


# -- lead-ins ----------------------------------------------------------------------------------------------------------


def test_lead_ins_lie_in_the_waste(made):
    cut = CutParams(kerf_outline=0.0001, kerf_holes=0.0001, lead_in=0.001)
    result = sheets.make_sheets(made, FAST, cut=cut)
    runs, plain = result.cuts_on_sheet(0), result.paths_on_sheet(0)
    material = [
        shapely.Polygon(p.outline.sample(1e-7), [h.sample(1e-7) for h in p.holes]) for p in result.panels_on_sheet(0)
    ]
    beam = 0.499 * cut.kerf_outline
    led = 0
    paths = [c for p in plain for c in (p.outline, *p.holes)]
    for run in (*runs.inner_cuts, *runs.outer_cuts):
        if run.closed:
            continue
        led += 1
        lead = shapely.LineString(run.points[:2])
        assert lead.length == pytest.approx(0.001) or lead.length == pytest.approx(0.0005)
        # the beam does not touch any part on the way in; after that it goes once round the path
        assert all(lead.buffer(beam).intersection(m).area == 0.0 for m in material)
        # whichever was cut
        whole = min(paths, key=lambda c: np.linalg.norm(c.points - run.points[1], axis=1).min())
        assert run.length - lead.length == pytest.approx(whole.length, rel=1e-9)
        assert run.points[-1] == pytest.approx(run.points[1], abs=1e-12)
    assert led + runs.lead_ins_left_out == len(runs.inner_cuts) + len(runs.outer_cuts)
    assert led > 0.9 * len(runs.inner_cuts)
    assert sheets_report.sheets_report(result)["lead_ins_left_out"] == runs.lead_ins_left_out


def test_slots_without_room_have_no_lead_in(flat_grid):
    wound = fabricable.uniform_design(flat_grid(3, 3, 0.006), SpiralParams(), width=0.001, twist=1.0)
    result = sheets.make_sheets(wound, FAST, cut=CutParams(lead_in=0.02))
    runs = result.cuts_on_sheet(0)
    assert runs.lead_ins_left_out == len(runs.inner_cuts)
    assert [c.closed for c in (*runs.inner_cuts, *runs.outer_cuts)] == [True] * 4 + [False]


# -- holding tabs ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("lead", [0.0, 0.001])
def test_tabs_hold_every_panel(made, lead):
    cut = CutParams(kerf_outline=0.0002, kerf_holes=0.0002, tabs=3, tab_width=0.0008, lead_in=lead)
    result = sheets.make_sheets(made, FAST, cut=cut)
    runs, panels = result.cuts_on_sheet(0), result.paths_on_sheet(0)
    assert runs.tab_count == 3 * len(panels)
    assert len(runs.outer_cuts) == 3 * len(panels)
    whole = sum(p.outline.length for p in panels)
    leads = sum(np.linalg.norm(c.points[1] - c.points[0]) for c in runs.outer_cuts) if lead else 0.0
    assert whole - sum(c.length for c in runs.outer_cuts) + leads == pytest.approx(runs.tab_count * 0.001, rel=1e-3)
    cutter = shapely.union_all([_line(c).buffer(0.0001) for c in (*runs.inner_cuts, *runs.outer_cuts)])
    sheet = shapely.box(0, 0, *result.packing.sizes[0]) - cutter
    held = max(shapely.get_parts(sheet), key=lambda g: g.area)
    for panel in result.panels_on_sheet(0):
        inside = shapely.Polygon(panel.outline.sample(1e-6), [h.sample(1e-6) for h in panel.holes]).buffer(-0.0003)
        assert held.contains(inside)  # the panel hangs on the sheet


def test_tabs_keep_away_from_connectors(made):
    cut = CutParams(tabs=6, tab_width=0.0008)
    result = sheets.make_sheets(made, FAST, cut=cut)
    border = made.flat.layout.mesh.border[made.flat.layout.mesh.quad_edges]
    for panel in result.panels:
        assert (panel.tab_places[:, 2] == 1.0).sum() == border[made.flat.layout.patches[panel.patch]].sum()
    # arms at the cut lie on the line x = 0.04 of the grid, which keeps its coordinates
    assert all(np.abs(p.tab_places[p.tab_places[:, 2] == 1.0][:, 0] - 0.04).min() > 0.005 for p in result.panels)


@pytest.mark.parametrize("tabs", [0, 2])
@pytest.mark.parametrize("lead", [0.0, 0.0005])
def test_files_hold_the_runs(made, tabs, lead, tmp_path):
    import ezdxf
    import svgelements

    result = sheets.make_sheets(made, FAST, cut=CutParams(tabs=tabs, lead_in=lead))
    runs = result.cuts_on_sheet(0)
    document = ezdxf.readfile(export.write_sheets(result, tmp_path / "a", ("dxf",))[0])
    outer = document.modelspace().query('LWPOLYLINE[layer=="CUT_OUTER"]')
    assert [e.closed for e in outer] == [c.closed for c in runs.outer_cuts]
    read = svgelements.SVG.parse(str(export.write_sheets(result, tmp_path / "a", ("svg",))[0]), ppi=25.4)
    red = [e for e in read.elements() if isinstance(e, svgelements.Path) and e.stroke.hex == "#ff0000"]
    assert [any(isinstance(s, svgelements.Close) for s in e) for e in red] == [c.closed for c in runs.outer_cuts]


@pytest.mark.parametrize("middle", [0.0, 0.003, 0.01, 0.0205, 0.03])
def test_a_tab_is_as_wide_as_asked_round_a_bend(middle):
    drop = Curve(np.array([[0.0, 0.0], [0.02, 0.0], [0.02, 0.002], [0.0, 0.002]]), np.array([0.0, 1.0, 0.0, 1.0]))
    cut = CutParams(tabs=1, tab_width=0.0013, kerf_outline=0.0002)
    place = toolpath.curve_between(drop, middle, middle + 0.001).points[:1]
    (part,) = toolpath._with_tabs(drop, np.array([[*place[0], 1.0]]), cut)
    assert np.linalg.norm(part.points[-1] - part.points[0]) == pytest.approx(0.0015, rel=1e-5)


def test_no_segment_is_too_short_to_run():
    turns = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)
    angle = np.sort(np.concatenate([turns, turns[::10] + 4e-4, turns[::20] + 8e-4]))
    ring = Curve(
        0.02 * np.column_stack([np.cos(angle), np.sin(angle)]), np.tan(0.25 * np.diff(angle, append=2.0 * np.pi))
    )
    for curve in (ring, Curve(ring.points, ring.bulge, closed=False)):
        made = without_short_segments(curve)
        step = np.linalg.norm(np.diff(made.points, axis=0), axis=1)
        assert step.min() >= 2e-5 and len(made.points) <= 201 and made.closed == curve.closed
        assert np.abs(np.linalg.norm(made.sample(1e-7), axis=1) - 0.02).max() < 1.2e-5
        if not curve.closed:
            np.testing.assert_array_equal(made.points[[0, -1]], curve.points[[0, -1]])


def test_neighbours_of_a_short_segment_stay_on_their_lines():
    blunt = [[0.0, 0.0], [0.02, 0.0], [0.02, 0.019991], [0.019991, 0.02], [0.0, 0.02]]
    made = without_short_segments(Curve(np.array(blunt), np.zeros(5)))
    np.testing.assert_allclose(made.points, [[0.0, 0.0], [0.02, 0.0], [0.02, 0.02], [0.0, 0.02]], atol=1e-12)
    half = Curve(np.array([[0.0, 0.0], [0.02, 0.0], [0.02, 0.00001], [0.0, 0.00001]]), np.array([0.0, 0.0, 1.0, 0.0]))
    centre = np.array([0.01, 0.00001])
    for point in without_short_segments(half).sample(1e-8)[2:-2]:
        assert abs(np.linalg.norm(point - centre) - 0.01) < 1e-7 or abs(point[1]) < 1e-9


# -- where and how a path begins ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("degrees", [25.0, 45.0, 65.0, 90.0])
@pytest.mark.parametrize("longest", [0.0021, 0.0011])
def test_a_lead_in_takes_the_smallest_angle_that_is_free(degrees, longest):
    """On a circle: it comes from outside, on the right of the path, and leaves the circle at that angle."""

    def free(lines):
        begin, end = np.moveaxis(np.array([line.coords for line in lines]), 1, 0)
        outwards = ((begin - end) * end).sum(axis=1) / np.linalg.norm(begin - end, axis=1) / np.linalg.norm(end, axis=1)
        return (np.linalg.norm(begin - end, axis=1) < longest) & (outwards > np.sin(np.radians(degrees - 6.0)))

    share = 1.0 if longest > 0.002 else 0.5
    made = toolpath.with_lead_in(RING, 0.002, free)
    begin, start = made.points[:2]
    lead, radial = start - begin, start / np.linalg.norm(start)
    assert np.linalg.norm(lead) == pytest.approx(0.002 * share)
    forward = np.array([-radial[1], radial[0]])
    assert lead @ radial < 0.0 < lead @ forward + 1e-15
    assert np.degrees(np.arccos(lead @ forward / np.linalg.norm(lead))) == pytest.approx(degrees)
    np.testing.assert_allclose(made.points[-1], start, atol=1e-15)
    whole = Curve(made.points[1:], made.bulge[1:], closed=False)
    assert not made.closed and made.bulge[0] == 0.0 and whole.length == pytest.approx(RING.length)


def test_without_room_there_is_no_lead_in_and_after_a_tab_it_is_square():
    none, every = (lambda lines, value=value: np.full(len(lines), value) for value in (False, True))
    assert toolpath.with_lead_in(RING, 0.002, none) is None
    part = toolpath.curve_between(RING, 0.003, 0.05)
    made = toolpath.with_lead_in(part, 0.002, every)
    np.testing.assert_allclose(made.points[0], 1.2 * part.points[0], rtol=1e-12)
    np.testing.assert_array_equal(made.points[1:], part.points)


def test_places_along_a_curve_are_those_that_shapely_finds():
    drop = Curve(np.array([[0.0, 0.0], [0.02, 0.0], [0.02, 0.002], [0.0, 0.002]]), np.array([0.0, 1.0, 0.0, 1.0]))
    line = drop.sample(1e-8)
    ring = shapely.LinearRing(line)
    rng = np.random.default_rng(1)
    points = np.column_stack([rng.uniform(-0.002, 0.022, 40), rng.choice([-0.003, 0.006], 40)])
    found = toolpath._nearest_along(drop, points)
    wanted = shapely.line_locate_point(ring, shapely.points(points)) * drop.length / ring.length
    assert np.abs(found - wanted).max() < 6e-5


def test_engraved_strokes_may_begin_at_either_end():
    there = Curve(np.array([[0.01, 0.0], [0.1, 0.0]]), np.zeros(2), closed=False)
    back = Curve(np.array([[0.2, 0.01], [0.1, 0.01]]), np.zeros(2), closed=False)
    made = toolpath.plan_cuts(
        [there, back], [()], [RING.transform(0.0, np.array([0.1, 0.1]))], [np.empty((0, 3))], (0.3, 0.2), CutParams()
    )
    np.testing.assert_array_equal(made.engraving[1].points, back.points[::-1])
    assert (made.lead_ins_left_out, made.tab_count) == (0, 0)


def test_tabs_keep_apart_and_off_the_places_that_are_disliked():
    """On a circle of 63 mm: the first tab comes where the penalty is least, the next as far away as there is a place."""
    cut = CutParams(tabs=3, tab_width=0.001)
    angle = np.radians([0.0, 20.0, 100.0, 170.0, 178.0, 260.0])
    places = np.column_stack([0.01 * np.cos(angle), 0.01 * np.sin(angle), [3.0, 1.0, 1.0, 1.0, 5.0, 1.0]])
    parts = toolpath._with_tabs(RING, places, cut)
    ends = np.array([[part.points[-1], nxt.points[0]] for part, nxt in zip(parts, [*parts[1:], parts[0]], strict=True)])
    assert np.linalg.norm(np.diff(ends, axis=1)[:, 0], axis=1) == pytest.approx(0.001, rel=1e-5)
    middle = ends.mean(axis=1)
    assert sorted(np.round(np.degrees(np.arctan2(middle[:, 1], middle[:, 0])) % 360.0)) == [20.0, 170.0, 260.0]
    # two places within five widths of a tab hold one tab alone
    close = np.array([[0.01, 0.0, 1.0], [0.01 * np.cos(0.4), 0.01 * np.sin(0.4), 1.0]])
    assert len(toolpath._with_tabs(RING, close, cut)) == 1
    apart = np.array([[0.01, 0.0, 1.0], [0.01 * np.cos(0.52), 0.01 * np.sin(0.52), 1.0]])
    assert len(toolpath._with_tabs(RING, apart, cut)) == 2


# -- mills -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mill", [0.001, 0.002, 0.003])
def test_mill_reaches_all_of_a_socket_and_its_head_fits(mill):
    s = connector_size(0.003, ConnectorParams(clearance=0.0001), 1.0, mill)
    pocket, part = -socket_curve(s).sample(1e-7), head_curve(s).sample(1e-7)
    half, deep = 0.5 * s.pad_width, -0.01
    # what is free in front of either part; a mill reaches what stays when it is shrunk and grown by its radius
    male = shapely.Polygon([(deep, -half), *part, (deep, half)])
    waste = {
        "socket": shapely.Polygon([(deep, -half), *pocket[::-1], (deep, half)]).buffer(0),
        "head": shapely.box(-0.0005, -half, s.length + 0.02, half) - male,
    }
    for free in waste.values():
        reached = free.buffer(-0.5 * mill, quad_segs=64).buffer(0.5 * mill, quad_segs=64)
        high = 0.5 * s.head + 0.7 * s.inside_radius
        near = shapely.box(-0.0004, -high, s.length + 0.003, high)
        missed = (free - reached.buffer(2e-6)) & near
        assert max((g.area for g in shapely.get_parts(missed)), default=0.0) < 2e-3 * mill**2
    assert shapely.LineString(part).distance(shapely.LineString(pocket)) == pytest.approx(0.0001, abs=2e-7)


def test_dogbone_holds_the_corner():
    corner = Curve(np.array([[0.0, 0.0], [0.0098, 0.0], [0.01, -0.0002], [0.01, -0.01]])[:, ::1], np.array([0, -np.tan(np.pi / 8), 0, 0]), closed=False)  # fmt: skip
    made = cut_dogbones(corner, 0.001)
    assert len(made.points) == 4
    ring = made.sample(1e-8)
    # the free side is on the right: below and to the left; the mill's circle passes through the middle of the old arc
    opened, before = (shapely.Polygon([*r, (0.0, -0.01)]) for r in (ring, corner.sample(1e-8)))
    assert before.difference(opened).area < 1e-12
    assert opened.difference(before).area > 0.0
    with pytest.raises(FlexMapsError, match="mill"):
        cut_dogbones(corner, 0.02)


def test_panels_for_a_mill(milled):
    cut = CutParams(kerf_outline=0.003, kerf_holes=0.003, mill=0.003)
    params = SheetParams(nesting="FAST", labels=False, spacing=0.004)
    result = sheets.make_sheets(milled, params, connectors=ConnectorParams(clearance=0.0001), cut=cut)
    assert [c.kind for c in result.connections.connectors] == ["dovetail"] * 3
    found = fit(milled, result.connections, 0.003)
    assert np.abs(found.least - 0.0001).max() < 1e-5
    assert found.overlap.max() == 0.0


def test_mill_too_thick_for_the_slots_names_the_faces(made, milled):
    with pytest.raises(FlexMapsError, match="mill") as error:
        sheets.make_sheets(made, FAST, cut=CutParams(mill=0.001))
    assert len(error.value.faces) == len(made.width)
    assert not len(milled.quads_with_narrow_slots(0.003))
    with pytest.raises(FlexMapsError, match="spacing"):
        sheets.make_sheets(milled, SheetParams(nesting="FAST", spacing=0.002), cut=CutParams(mill=0.003))


def test_slots_as_wide_as_the_mill_will_do(flat_grid):
    spirals = fabricable.uniform_design(flat_grid(4, 3, 0.05), SpiralParams(fillet=0.0015), width=0.002, twist=3.0)
    assert not len(spirals.quads_with_narrow_slots(0.003))
    assert spirals.quads_with_narrow_slots(0.0031).tolist() == list(range(12))

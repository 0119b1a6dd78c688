"""Connectors: every joint has one that fits, panels stay whole and free, and what has no room is told."""

import sys

import numpy as np
import pytest
import shapely
from flexmaps.engine.errors import Cancelled, FlexMapsError
from flexmaps.engine.fabrication import sheets, sheets_report
from flexmaps.engine.fabrication.connectors import connect as connectors
from flexmaps.engine.fabrication.connectors.shape import connector_size, head_curve, key_outline, socket_curve
from flexmaps.engine.params import ConnectorParams, CutParams, SheetParams, SpiralParams
from flexmaps.engine.progress import Progress
from flexmaps.engine.spirals import design, fabricable
from flexmaps.engine.spirals.contacts import find_contacts

fit = sys.modules["flexmaps_connector_gaps"].fit

KINDS = ["dovetail", "key", "tab"]


def _halves(flat_grid, twist, *, clockwise=False, size=0.02, rows=3):
    flat = flat_grid(4, rows, size, cut=lambda x, _: x == 2)
    return fabricable.uniform_design(flat, SpiralParams(clockwise=clockwise), width=0.0012, twist=twist)


def _polygons(made):
    return [shapely.Polygon(o.outer.sample(1e-7), [h.sample(1e-7) for h in o.holes]) for o in made.outlines]


# -- shapes ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("clearance", [0.0, 0.00005, 0.0002])
@pytest.mark.parametrize("width", [0.0006, 0.001, 0.002])
def test_head_and_socket_leave_the_clearance_everywhere(width, clearance):
    s = connector_size(width, ConnectorParams(connector="dovetail", clearance=clearance))
    one, two = head_curve(s).sample(1e-8), -socket_curve(s).sample(1e-8)
    assert shapely.hausdorff_distance(shapely.LineString(one), shapely.LineString(two)) == pytest.approx(
        clearance, abs=2e-7
    )
    assert shapely.distance(shapely.LineString(one), shapely.LineString(two)) == pytest.approx(clearance, abs=2e-7)


@pytest.mark.parametrize("width", [0.0006, 0.001, 0.002])
def test_nothing_is_thinner_than_asked(width):
    params = ConnectorParams(connector="dovetail", thinnest=0.0008)
    for scale in (1.0, 0.5):
        s = connector_size(width, params, scale)
        half = 0.5 * s.pad_width
        # closing the ends makes polygons of them
        male = shapely.Polygon([*head_curve(s).points, (-0.003, half), (-0.003, -half)])
        female = shapely.Polygon([*socket_curve(s).points, (-0.004, half), (-0.004, -half)])
        for part in (male, female):
            left = part.buffer(-0.5 * 0.999 * params.thinnest)
            assert left.geom_type == "Polygon"  # still one piece: no neck or wall is thinner
        assert s.head > s.neck + 2.0 * params.clearance  # it holds


def test_key_fits_both_sockets():
    s = connector_size(0.001, ConnectorParams(connector="key"))
    for back in (0.0, 0.0005):
        loose = shapely.Polygon(key_outline(s, back).sample(1e-8))
        for way in (1.0, -1.0):
            assert shapely.distance(
                loose, shapely.LineString(way * socket_curve(s, back).sample(1e-8))
            ) == pytest.approx(s.clearance, abs=2e-7)


def _convex_radii(curve):
    """Radii of the arcs that turn left by more than 25 degrees."""
    chord = np.linalg.norm(np.roll(curve.points, -1, axis=0) - curve.points, axis=1)
    sharp = 4.0 * np.arctan(curve.bulge) > np.radians(25.0)
    bulge = curve.bulge[sharp]
    return chord[sharp] * (1.0 + bulge**2) / (4.0 * bulge)


@pytest.mark.parametrize("rounding", [0.0001, pytest.param(0.0002, marks=pytest.mark.thorough), 0.0003])
@pytest.mark.parametrize("kind", KINDS)
def test_corners_are_as_round_as_asked(flat_grid, kind, rounding):
    for twist in (0.0, 2.0, 6.0):
        made = _halves(flat_grid, twist)
        found = connectors.connect(made, ConnectorParams(connector=kind, rounding=rounding))
        least = min(_convex_radii(o.outer).min(initial=1.0) for o in (*found.outlines, *found.key_outlines))
        assert least >= 0.995 * (min(rounding, 0.2 * 0.0012) if kind == "tab" else rounding)  # ends for glue are short
        assert found.report["connector_rounding_min_mm"] == pytest.approx(1e3 * least, rel=0.01)


# -- panels ------------------------------------------------------------------------------------------------------------


# straight arms wind to neither side
@pytest.mark.parametrize(("twist", "clockwise"), [(0.0, False), (2.0, False), (2.0, True), (6.0, False), (6.0, True)])
@pytest.mark.parametrize("kind", KINDS)
def test_every_joint_has_one_that_fits(flat_grid, kind, twist, clockwise):
    made = _halves(flat_grid, twist, clockwise=clockwise)
    found = connectors.connect(made, ConnectorParams(connector=kind))
    assert [c.name for c in found.connectors] == ["A1", "A2", "A3"]
    assert not found.plain_joints
    assert not len(find_contacts(list(found.outlines)))
    for polygon, plain in zip(_polygons(found), made.outlines(), strict=True):
        assert polygon.is_valid
        assert len(polygon.interiors) == len(plain.holes)
        # as wide as the smallest slot: whatever lies closer together would close up and leave a hole more
        assert len(polygon.buffer(0.49 * made.params.slot_min).interiors) == len(plain.holes)
    for kerf in (0.0, 0.0001, 0.0002):
        gaps = fit(made, found, kerf)
        assert len(gaps.joint) == (6 if kind == "key" else 3)
        assert np.abs(gaps.least - found.clearance).max() < 1e-6
        assert np.abs(gaps.most - found.clearance).max() < 1e-6
        assert gaps.overlap.max() == 0.0


@pytest.mark.parametrize("share", [0.5, 0.55])
def test_the_slot_at_seams_leaves_room_for_dovetails_beside_strongly_wound_arms(flat_grid, share):
    """In oblong quads, whose long arms lie beside the short ones that meet across the cut."""
    flat = flat_grid(4, 4, 0.022, move=lambda p: p * [share, 1.0], cut=lambda x, _: x == 2)
    kinds = []
    for slot in (0.0, SpiralParams.slot_seam):
        made = fabricable.uniform_design(flat, SpiralParams(slot_seam=slot), width=0.001, twist=6.0)
        found = connectors.connect(made, ConnectorParams(connector="dovetail"))
        kinds.append(found.report["connector_kinds"])
    assert kinds == [{"tab": 4}, {"dovetail": 4}]
    assert np.abs(fit(made, found, 0.0001).least - found.clearance).max() < 1e-6
    # no more is unwound than has to be, and nothing elsewhere
    plain = fabricable.uniform_design(flat, SpiralParams(slot_seam=0.0), width=0.001, twist=6.0)
    assert (made.twist > 0.75 * plain.twist).all()
    assert ((made.twist < plain.twist) == (np.arange(16) // 4 % 3 > 0)).all()
    # what was wound before, or by hand, can still be cut
    assert not len(fabricable.unfabricable_quads(design.SpiralDesign(flat, SpiralParams(), plain.width, plain.twist)))


def test_small_quads_keep_their_spirals_beside_seams(flat_grid):
    flat = flat_grid(4, 3, 0.008, cut=lambda x, _: x == 2)
    made = fabricable.uniform_design(flat, SpiralParams(), width=0.001, twist=6.0)
    plain = fabricable.uniform_design(flat, SpiralParams(slot_seam=0.0), width=0.001, twist=6.0)
    assert (made.twist > 0.5 * plain.twist).all() and (plain.twist > 1.0).all()


def test_fit_sees_a_wrong_gap(flat_grid):
    made = _halves(flat_grid, 0.0)
    # as round between the parts: finished corners are sharper by half of the clearance
    tight = connectors.connect(made, ConnectorParams(connector="dovetail", clearance=0.0, rounding=0.000275))
    wide = connectors.connect(made, ConnectorParams(connector="dovetail", clearance=0.00015, rounding=0.0002))
    # the panels of one with the panels of the other: half of either clearance
    mixed = connectors.Connections(
        (tight.outlines[0], wide.outlines[1]), wide.connectors, (), wide.clearance, wide.occupied_lengths
    )
    assert fit(made, mixed, 0.0001).least == pytest.approx(0.000075, abs=5e-6)


def test_heads_and_sockets_take_turns(flat_grid):
    made = connectors.connect(_halves(flat_grid, 1.0, rows=6), ConnectorParams(connector="dovetail"))
    assert [c.candidate.roles()[0] for c in made.connectors] == ["head", "socket"] * 3
    assert all(set(c.candidate.roles()) == {"head", "socket"} for c in made.connectors)
    assert all(c.faces[0] < c.faces[1] for c in made.connectors)


def test_panels_side_by_side_hold_together(flat_grid):
    """The grid's patches keep its coordinates, so joined panels lie in each other as drawn."""
    made = _halves(flat_grid, 3.0)
    one, two = _polygons(connectors.connect(made, ConnectorParams(connector="dovetail")))
    assert one.intersection(two).area == 0.0
    assert one.distance(two) == pytest.approx(0.00005, abs=1e-6)
    # pulled apart by more than the play in the dovetails, they catch
    assert shapely.affinity.translate(two, 0.0005, 0.0).intersection(one).area > 0.0


def test_arms_elsewhere_are_as_before(flat_grid):
    made = _halves(flat_grid, 2.0)
    plain, drawn = made.outlines(), connectors.connect(made, ConnectorParams(connector="dovetail")).outlines
    for before, after in zip(plain, drawn, strict=True):
        changed = shapely.Polygon(before.outer.sample(1e-7)).symmetric_difference(
            shapely.Polygon(after.outer.sample(1e-7))
        )
        far = shapely.box(0.0, 0.0, 0.027, 0.06).union(shapely.box(0.053, 0.0, 0.08, 0.06))
        assert changed.intersection(far).area < 1e-10


def test_cut_inside_a_panel_gets_keys_where_its_sides_touch(flat_grid):
    flat = flat_grid(6, 4, cut=lambda x, y: x == 3 and y < 2)
    made = fabricable.uniform_design(flat, SpiralParams(), width=0.0012, twist=1.0)
    found = connectors.connect(made, ConnectorParams(connector="dovetail"))
    assert len(found.outlines) == 1
    assert len(found.connectors) == 2
    assert {c.kind for c in found.connectors} == {"key"}  # both sides lie on each other here: no room for a head
    assert len(found.key_outlines) == 2
    (polygon,) = _polygons(found)
    assert polygon.is_valid
    assert np.abs(fit(made, found, 0.0001).least - found.clearance).max() < 1e-6


def test_joints_without_room_for_a_dovetail_get_ends_for_glue(flat_grid):
    flat = flat_grid(4, 3, 0.004, cut=lambda x, _: x == 2)
    made = fabricable.uniform_design(flat, SpiralParams(width_min=0.0006, width_max=0.001, fillet=0.0001), twist=0.5)
    found = connectors.connect(made, ConnectorParams(connector="dovetail", thinnest=0.0015))
    assert [c.kind for c in found.connectors] == ["tab"] * 3
    for polygon, plain in zip(_polygons(found), made.outlines(), strict=True):
        assert polygon.is_valid
        assert polygon.area > plain.outer.area + sum(h.area for h in plain.holes)
    gaps = fit(made, found, 0.0001)
    assert gaps.overlap.max() == 0.0
    assert np.abs(gaps.least - found.clearance).max() < 1e-6


def test_joints_without_any_room_keep_plain_ends_and_are_told(flat_grid, monkeypatch):
    made = _halves(flat_grid, 0.5)
    monkeypatch.setattr(connectors.FreeSpace, "fit_tips", lambda self, which, *_: [None] * len(which))
    found = connectors.connect(made, ConnectorParams(connector="dovetail"))
    assert not found.connectors
    assert [name for name, *_ in found.plain_joints] == ["A1", "A2", "A3"]
    assert found.report["unsolved"][0]["faces"] == list(found.plain_joints[0][1:])
    for a, b in zip(found.outlines, made.outlines(), strict=True):
        assert a.outer.area == pytest.approx(b.outer.area, rel=1e-9)


def test_clearance_that_lets_everything_slip_is_refused(flat_grid):
    with pytest.raises(FlexMapsError, match="slip out"):
        connectors.connect(_halves(flat_grid, 0.0), ConnectorParams(connector="dovetail", clearance=0.0005))


def test_mill_too_thick_for_the_corners_is_refused(flat_grid):
    made = fabricable.uniform_design(
        flat_grid(4, 2, 0.03, cut=lambda x, _: x == 2), SpiralParams(slot_min=0.0012, fillet=0.0006), twist=1.0
    )
    mill = CutParams(kerf_outline=0.001, kerf_holes=0.001)
    params = SheetParams(nesting="FAST")
    with pytest.raises(FlexMapsError, match=r"rounding at least 0\.5 mm"):
        sheets.make_sheets(made, params, connectors=ConnectorParams(rounding=0.0003), cut=mill)
    connect = ConnectorParams(rounding=0.0005)
    result = sheets.make_sheets(made, params, connectors=connect, cut=mill)
    assert len(result.connections.connectors) == 2
    gaps = fit(made, result.connections, 0.001)
    assert np.abs(gaps.least - connect.clearance).max() < 1e-5
    assert np.abs(gaps.most - connect.clearance).max() < 1e-5


def test_none_is_the_plain_outline(flat_grid):
    made = _halves(flat_grid, 2.0)
    found = connectors.connect(made, ConnectorParams(connector="none"))
    assert list(found.outlines) == made.outlines()
    assert found.report == {"connectors": 0}


def test_can_be_stopped(flat_grid):
    with pytest.raises(Cancelled):
        connectors.connect(
            _halves(flat_grid, 0.0), ConnectorParams(connector="dovetail"), progress=Progress(stopped=lambda: True)
        )


# -- sheets ------------------------------------------------------------------------------------------------------------


def test_sheets_with_keys_labels_and_kerf(flat_grid):
    made = _halves(flat_grid, 2.0)
    result = sheets.make_sheets(
        made,
        SheetParams(nesting="FAST"),
        connectors=ConnectorParams(connector="key"),
        cut=CutParams(kerf_outline=0.0002, kerf_holes=0.0001),
    )
    block = sheets_report.sheets_report(result)
    assert (block["panels"], block["sheets"], block["connectors"]) == (2, 2, 3)
    assert block["kerf_mm"] == [0.2, 0.1]
    loose = result.paths_on_sheet(1)
    assert len(loose) == 3
    width, height = result.packing.sizes[1]
    frame = shapely.box(0.0, 0.0, width, height).buffer(-0.9 * result.params.margin)
    shapes = [shapely.Polygon(p.outline.sample(1e-6)) for p in loose]
    assert all(frame.contains(s) for s in shapes)
    assert min(a.distance(b) for a in shapes for b in shapes if a is not b) > 0.002
    # every label's strokes lie inside the material, clear of its sockets
    for panel in result.panels[:2]:
        material = shapely.Polygon(panel.outline.sample(1e-6), [h.sample(1e-6) for h in panel.holes])
        assert panel.labels
        assert all(material.contains(shapely.LineString(c.points)) for c in panel.labels)


def test_sphere_as_one_panel_with_cuts_that_end_inside_it():
    from flexmaps.engine.params import Settings
    from flexmaps.engine.runs import job
    from flexmaps.engine.surface import shapes
    from flexmaps.engine.surface.mesh import PolygonMesh

    polygons = PolygonMesh.from_quads(shapes.make("cubesphere"))
    made = job.run(polygons, Settings(), stop_after="spirals").design
    found = connectors.connect(made, ConnectorParams(connector="dovetail"))
    assert not found.plain_joints
    assert len(found.connectors) == int(made.flat.layout.cut.sum())
    assert not len(find_contacts(list(found.outlines)))
    gaps = fit(made, found, 0.00015)
    assert np.abs(gaps.least - found.clearance).max() < 1e-5
    assert np.abs(gaps.most - found.clearance).max() < 1e-5
    # every arm has one part of one connector
    tips = {(f, s) for c in found.connectors for f, s in zip(c.faces, c.sides, strict=True)}
    assert len(tips) == 2 * len(found.connectors)


def test_edges_that_were_drawn_before_are_those_that_are_drawn_with_the_connectors(flat_grid):
    fresh, drawn = (_halves(flat_grid, 2.0) for _ in range(2))
    fresh.cache.by_tolerance.clear()  # what the proof has drawn
    assert drawn.cache.by_tolerance
    one, two = (connectors.connect(made, ConnectorParams()).outlines for made in (fresh, drawn))
    for a, b in zip(one, two, strict=True):
        for curve, other in zip((a.outer, *a.holes), (b.outer, *b.holes), strict=True):
            assert curve.points == pytest.approx(other.points, abs=1e-12)
            assert curve.bulge == pytest.approx(other.bulge, abs=1e-9)


def test_a_smaller_connector_is_tried_only_after_all_places_for_a_larger_one(flat_grid):
    space = connectors.FreeSpace(_halves(flat_grid, 2.6), ConnectorParams())
    sizes = [[c.size.neck for c in space.candidates(joint) if c.kind == "dovetail"] for joint in range(3)]
    assert all(len(set(necks)) > 2 and necks == sorted(necks, reverse=True) for necks in sizes)


# -- looking round -----------------------------------------------------------------------------------------------------


def test_lines_of_sight_end_where_shapely_sees_the_first_piece(flat_grid):
    space = connectors.FreeSpace(_halves(flat_grid, 0.5), ConnectorParams())
    rng = np.random.default_rng(3)
    rings = space.obstacles.rings
    view = 0.004
    near = rings[rng.integers(0, len(rings), 40), 0]
    origin = near[:, None] + rng.uniform(-0.002, 0.002, (40, 8)) + 1j * rng.uniform(-0.002, 0.002, (40, 8))
    way = np.exp(2j * np.pi * rng.random(origin.shape))
    arm = rng.integers(0, space.obstacles.arm.max() + 1, (40, 2))
    seen = space.obstacles.cast_rays(origin, way, np.full(40, view), arm)
    expected = np.full(seen.shape, view)
    for row in range(len(origin)):
        other = ~np.isin(space.obstacles.arm, arm[row])
        pieces = shapely.union_all(shapely.polygons(np.stack([rings[other].real, rings[other].imag], axis=-1)))
        for k, (start, end) in enumerate(zip(origin[row], origin[row] + view * way[row], strict=True)):
            ray = shapely.LineString([(start.real, start.imag), (end.real, end.imag)])
            hit = ray.intersection(pieces)
            if not hit.is_empty:
                expected[row, k] = hit.distance(shapely.Point(start.real, start.imag))
    assert (expected < view).sum() > 50
    assert np.abs(seen - expected).max() < 1e-9

"""Sheets, labels and the files: read back by other programs, and measured."""

import math
import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import ezdxf
import ezdxf.bbox
import ezdxf.path
import numpy as np
import pytest
import shapely
import svgelements
from flexmaps.engine.errors import Cancelled, FlexMapsError
from flexmaps.engine.fabrication import sheets, sheets_report
from flexmaps.engine.fabrication.nesting import packing
from flexmaps.engine.fabrication.panels import lettering
from flexmaps.engine.fabrication.panels.labels import free_hub_radii, panel_name, seam_name
from flexmaps.engine.fabrication.writers import export, operations, svg
from flexmaps.engine.params import ConnectorParams, ExportParams, LayoutParams, Settings, SheetParams, SpiralParams
from flexmaps.engine.patches.splitting import split
from flexmaps.engine.progress import Progress
from flexmaps.engine.runs import job
from flexmaps.engine.spirals import fabricable
from flexmaps.engine.spirals.contours import Outline
from flexmaps.engine.spirals.curves.arcs import Curve
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh

FLIPPED = {"#000000": "engrave", "#0000ff": "cut inner", "#ff0000": "cut outer", "#f36926": "sheet"}


@pytest.fixture(scope="module")
def made(flat_grid):
    """Sheets of two panels, one of them with a cut inside, of many different spirals."""
    flat = flat_grid(
        8, 6, move=lambda p: p @ np.array([[1.0, 0.05], [0.1, 1.0]]), cut=lambda x, y: x == 3 or (y == 3 and x > 6)
    )
    curvature = np.sin(40 * flat.corners.mean(axis=1)).sum(axis=1) + 2
    return sheets.make_sheets(
        fabricable.design_from_curvature(flat, SpiralParams(), curvature),
        SheetParams(nesting="FAST"),
        connectors=ConnectorParams(connector="none"),
    )


def _polygon(panel):
    return shapely.Polygon(panel.outline.sample(1e-6), [h.sample(1e-6) for h in panel.holes])


def test_panels_lie_apart_on_the_sheet(made):
    assert made.count == 1
    one, two = (_polygon(p) for p in made.panels_on_sheet(0))
    assert one.is_valid
    assert two.is_valid
    assert one.distance(two) >= made.params.spacing
    frame = shapely.box(0, 0, 0.6, 0.4).buffer(-made.params.margin + 1e-9, join_style="mitre")
    assert frame.contains(one)
    assert frame.contains(two)


@pytest.mark.parametrize("nesting", ["TRUE", "FAST"])
def test_panels_are_nested_as_the_settings_say(nesting, flat_grid, monkeypatch):
    asked = []
    real = sheets.nest
    monkeypatch.setattr(
        sheets, "nest", lambda shapes, params, *more: asked.append(params) or real(shapes, params, *more)
    )
    params = SheetParams(nesting=nesting, labels=False)
    sheets.make_sheets(fabricable.uniform_design(flat_grid(2, 1, cut=lambda x, y: x == 1), SpiralParams()), params)
    assert asked == [params]


def test_labels_lie_inside_the_material(made):
    assert made.labels_left_out == 0
    # both panels' numbers, 6 joints of one seam and 2 of the cut inside, each on both sides
    assert made.labels_placed == 2 + 2 * (6 + 2)
    for panel in made.panels_on_sheet(0):
        material = _polygon(panel).buffer(-0.00005)
        assert len(panel.labels) > 20
        assert all(material.contains(shapely.LineString(s.points)) for s in panel.labels)


def test_names_of_joints_stand_on_hubs_where_arms_are_narrow(flat_grid):
    narrow = fabricable.uniform_design(
        flat_grid(3, 2, 0.03, cut=lambda x, y: x == 1), SpiralParams(), width=0.001, twist=1.0
    )
    circles = free_hub_radii(narrow.arms, narrow.roots)
    made = sheets.make_sheets(narrow, SheetParams(nesting="FAST"))
    assert made.labels_left_out == 0
    heights = []
    for panel in made.panels:
        strokes = [s.points for s in panel.labels]
        away = np.array([np.linalg.norm(s.mean(axis=0) - narrow.arms.centre, axis=1) for s in strokes])
        near = away.min(axis=1) < circles[away.argmin(axis=1)]
        heights.append(max(np.ptp(s[:, 1]) for s, close in zip(strokes, near, strict=True) if close))
        # a tick along an arm: more points than any letter has
        assert sum(len(s) == 8 and np.ptp(s, axis=0).max() > 1e-4 and not close for s, close in zip(strokes, near)) >= 1
        material = _polygon(panel).buffer(-0.00005)
        assert all(material.contains(shapely.LineString(s)) for s in strokes)
    assert min(heights) > 0.62e-3  # what an arm of 1 mm has room for


def test_labels_that_would_be_too_small_are_counted(flat_grid):
    made = fabricable.uniform_design(flat_grid(2, 2, cut=lambda x, y: x == 1), SpiralParams(), width=0.001)
    assert sheets.make_sheets(made, SheetParams(nesting="FAST", label_min=0.001)).labels_left_out == 0  # beside it
    result = sheets.make_sheets(made, SheetParams(nesting="FAST", label_min=0.001, spacing=0.03))
    assert result.labels_left_out == 4
    assert any("labels have no room" in w for w in result.warnings)
    assert sheets.make_sheets(made, SheetParams(nesting="FAST", labels=False)).labels_placed == 0


def test_names():
    assert [seam_name(i) for i in (0, 23, 24, 25, 599, 600)] == ["A", "Z", "AA", "AB", "ZZ", "AAA"]
    assert not set("IO") & set("".join(seam_name(i) for i in range(100)))
    assert [panel_name(i) for i in (1, 5, 6, 8, 9, 12, 66, 68, 69, 91)] == [
        "1",
        "5",
        "6.",
        "8",
        "9.",
        "12",
        "66.",
        "68.",
        "69",
        "91.",
    ]


def test_numbers_of_the_report(made):
    report = sheets_report.sheets_report(made)
    polygons = [_polygon(p) for p in made.panels]
    assert report["panels"] == 2
    assert report["sheets"] == 1
    assert report["area_m2"] == pytest.approx(sum(p.area for p in polygons), rel=3e-4)
    assert report["cut_length_m"] == pytest.approx(sum(p.length for p in polygons), rel=1e-3)
    # of the only sheet what lies beyond the panels and their margin is left over
    used = (max(_polygon(p).bounds[2] for p in made.panels_on_sheet(0)) + 0.005) * 0.4
    assert report["fill"] == pytest.approx(sum(shapely.Polygon(p.exterior).area for p in polygons) / used, rel=1e-3)
    assert report["slot_min_mm"] >= 0.3 - 1e-6
    assert 0.99 <= report["bridge_min_mm"] <= 1.1
    assert report["nodes"] <= 40 * 4 * 48


def _svg_polygons(path):
    """Signed areas and polygons by layer, as svgelements reads them; in mm."""
    found = {}
    for element in svgelements.SVG.parse(path, ppi=25.4).elements():
        if isinstance(element, svgelements.Path):
            points = []
            for segment in element:
                if isinstance(segment, svgelements.Arc):
                    points += [segment.point(t) for t in np.linspace(0, 1, 2 + int(abs(segment.sweep) / 0.04))]
                elif isinstance(segment, svgelements.Line):
                    points += [segment.start, segment.end]
            found.setdefault(FLIPPED[element.stroke.hex], []).append(np.array([(p.x, p.y) for p in points]))
    return found


def test_svg_reads_back_in_true_millimetres(made, tmp_path):
    (path,) = export.write_sheets(made, tmp_path / "sheet", ("svg",))
    assert path.name == "sheet-01.svg"
    root = ET.parse(path).getroot()
    assert (root.get("width"), root.get("height"), root.get("viewBox")) == ("600mm", "400mm", "0 0 600 400")
    layers = [g.get("{http://www.inkscape.org/namespaces/inkscape}label") for g in root.findall("{*}g")]
    assert layers == ["engrave", "cut inner", "cut outer", "sheet"]
    found = _svg_polygons(path)
    edge, mark = found["sheet"]
    assert shapely.Polygon(edge).symmetric_difference(shapely.box(0, 0, 600, 400)).area < 1.0
    np.testing.assert_allclose(sorted(map(tuple, mark)), [(0, 400), (5, 395)], atol=1e-3)  # from the lower left corner
    panels, runs = made.panels_on_sheet(0), made.cuts_on_sheet(0)
    assert sorted(c.length for c in runs.outer_cuts) == pytest.approx(sorted(p.outline.length for p in panels))
    assert sorted(c.length for c in runs.inner_cuts) == pytest.approx(sorted(h.length for p in panels for h in p.holes))
    for outline, points in zip(runs.outer_cuts, found["cut outer"], strict=True):
        # y points down in the file: the same place, seen from the other side
        expected = shapely.Polygon(outline.sample(1e-6) * [1e3, -1e3] + [0, 400])
        assert shapely.Polygon(points).symmetric_difference(expected).area < 1e-3 * expected.area
    for hole, points in zip(runs.inner_cuts, found["cut inner"], strict=True):
        assert shapely.Polygon(points).area == pytest.approx(-hole.area * 1e6, rel=1e-3)
    assert len(found["engrave"]) == sum(len(p.labels) + len(p.waste_labels) for p in made.panels)


def test_a_closed_path_comes_back_to_its_start_once():
    square = Curve(np.array([[0.0, 0.0], [0.01, 0.0], [0.01, 0.01], [0.0, 0.01]]), np.array([0.0, 0.0, 0.0, 0.0]))
    assert svg.path_data(square, 10.0) == "M0 10L10 10L10 0L0 0Z"
    round_back = replace(square, bulge=np.array([0.0, 0.0, 0.0, 1.0]))
    assert svg.path_data(round_back, 10.0) == "M0 10L10 10L10 0L0 0A5 5 0 0 0 0 10Z"


def test_the_sheets_edge_is_left_out_where_it_is_not_wanted(made, tmp_path):
    plain = replace(made, params=replace(made.params, frame=False))
    flat, drawing, old = export.write_sheets(plain, tmp_path / "sheet", ("svg", "dxf", "dxf-r12"))
    assert 'label="sheet"' not in flat.read_text()
    for path in (drawing, old):
        document = ezdxf.readfile(path)
        assert "SHEET" not in document.layers and not document.modelspace().query('*[layer=="SHEET"]')


@pytest.mark.parametrize("kind, version", [("dxf-r12", "R12"), ("dxf", "R2010")])
def test_dxf_reads_back_in_true_millimetres(made, tmp_path, kind, version, caplog):
    (path,) = export.write_sheets(made, tmp_path / "sheet", (kind,))
    assert not caplog.records
    document = ezdxf.readfile(path)
    assert not document.audit().errors
    assert document.dxfversion == {"R12": "AC1009", "R2010": "AC1024"}[version]
    if version == "R2010":
        assert document.header["$INSUNITS"] == ezdxf.units.MM
    assert [document.layers.get(n).color for n in ("ENGRAVE", "CUT_INNER", "CUT_OUTER")] == [7, 5, 1]
    entities = list(document.modelspace())
    assert {e.dxftype() for e in entities} == {"POLYLINE" if version == "R12" else "LWPOLYLINE"}
    edge, _ = (e for e in entities if e.dxf.layer == "SHEET")
    assert ezdxf.bbox.extents([edge]).size.isclose((600, 400, 0)) and edge.is_closed
    assert version == "R12" or not document.layers.get("SHEET").dxf.plot
    entities = [e for e in entities if e.dxf.layer != "SHEET"]
    names = [e.dxf.layer for e in entities]
    assert names == sorted(names, key=["ENGRAVE", "CUT_INNER", "CUT_OUTER"].index)
    curves = {n: [e for e in entities if e.dxf.layer == n] for n in set(names)}
    size = made.packing.sizes[0] * 1e3
    for area in (("$EXTMIN", "$EXTMAX"), ("$LIMMIN", "$LIMMAX")):
        np.testing.assert_allclose([tuple(document.header[name])[:2] for name in area], [(0, 0), size])
    assert version != "R12" or not re.search(r"\n 42\r?\n-?0(\.0*)?\r?\n", path.read_text()), "a bulge of nothing"
    runs = made.cuts_on_sheet(0)
    for name, expected in {"CUT_OUTER": runs.outer_cuts, "CUT_INNER": runs.inner_cuts}.items():
        for entity, curve in zip(curves[name], expected, strict=True):
            points = [(v.x, v.y) for v in ezdxf.path.make_path(entity).flattening(1e-3)]
            assert shapely.Polygon(points).area == pytest.approx(abs(curve.area) * 1e6, rel=1e-3)
            np.testing.assert_allclose(points[0], curve.points[0] * 1e3, atol=1e-5)
            assert (entity.is_closed if version == "R12" else entity.closed) is True


def test_unknown_formats_are_refused(made, tmp_path):
    with pytest.raises(FlexMapsError, match=", ".join(export.FORMATS)):
        export.write_sheets(made, tmp_path / "sheet", ("dxf", "dxf-r99"))


def test_the_settings_choose_every_format():
    assert export.chosen_formats(ExportParams(dxf="R12", pdf=False, solids="3MF")) == ("svg", "dxf-r12", "3mf")
    off = {kind.setting: False if True in kind.values else "NONE" for kind in export.FORMAT_TABLE.values()}
    with pytest.raises(FlexMapsError, match="switch SVG"):
        export.chosen_formats(ExportParams(**off))
    for name, kind in export.FORMAT_TABLE.items():
        for value in kind.values:
            assert name in export.chosen_formats(ExportParams(**off | {kind.setting: value}))


def test_fewer_sheets_than_before_leave_no_stale_ones(made, tmp_path):
    earlier = svg.svg_document(made, 0)
    for name in ("sheet-02.svg", "sheet-03.svg", "sheet-05.svg"):
        (tmp_path / name).write_text(earlier)
    export.write_sheets(made, tmp_path / "sheet", ("svg",))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["sheet-01.svg", "sheet-05.svg"]


def test_every_kind_of_file_is_known_again_as_the_programs_own(made, tmp_path):
    base = tmp_path / "sheet"
    written = export.write_sheets(made, base, export.FORMATS)
    assert len(written) == len(export.FORMATS)
    for path in written:
        second = path.with_name(path.name.replace("-01", "-02"))
        path.rename(second)
        # what another program wrote, or nobody can read, is left alone
        second.with_name(second.name.replace("-02", "-03")).write_bytes(b"solid of another program")
    left = {p.name for p in tmp_path.iterdir()} - {p.name.replace("-01", "-02") for p in written}
    export.write_sheets(made, base, export.FORMATS)
    assert {p.name for p in tmp_path.iterdir()} == left | {p.name for p in written}


def test_oversize_panels(flat_grid):
    made = fabricable.uniform_design(flat_grid(10, 4, 0.03, cut=lambda x, y: x == 8), SpiralParams())
    small = {"sheet_width": 0.2, "sheet_height": 0.15, "nesting": "FAST"}
    enlarged = sheets.make_sheets(made, SheetParams(**small))
    assert len(enlarged.warnings) == 1
    assert "Panel 1 is 2" in enlarged.warnings[0]
    assert enlarged.packing.sizes.max() >= 0.24
    with pytest.raises(FlexMapsError, match=r"larger than the sheet of 200 x 150 mm.*use a larger sheet") as caught:
        sheets.make_sheets(made, SheetParams(**small, oversize="error"))
    assert caught.value.faces == list(range(32))


def test_margin_larger_than_the_sheet(flat_grid):
    with pytest.raises(FlexMapsError, match="margin"):
        sheets.make_sheets(
            fabricable.uniform_design(flat_grid(1, 1), SpiralParams()),
            SheetParams(sheet_width=0.05, sheet_height=0.05, margin=0.03),
        )


def test_progress_ascends_and_stops(flat_grid):
    made = fabricable.uniform_design(flat_grid(4, 4, cut=lambda x, y: x == 2 or y == 2), SpiralParams())
    seen = []
    sheets.make_sheets(made, SheetParams(nesting="FAST"), Progress(lambda fraction, text: seen.append(fraction)))
    assert seen == sorted(seen)
    assert len(seen) > 5
    with pytest.raises(Cancelled):
        sheets.make_sheets(made, SheetParams(nesting="FAST"), Progress(stopped=lambda: len(seen) > 0))


def test_svg_arc_flags_for_both_senses_and_large_arcs():
    from flexmaps.engine.spirals.curves.arcs import Curve

    # three quarters of a circle to the left, closed by a quarter to the right
    curve = Curve(np.array([[0.001, 0.0], [0.0, -0.001]]), np.array([math.tan(3 * math.pi / 8), 0.3]))
    path = svgelements.Path(svg.path_data(curve, 10.0))
    first = path[1]
    assert first.point(0.5) == svgelements.Point(-math.sqrt(0.5), 10 - math.sqrt(0.5))
    # after a large arc the file goes on where it ended
    assert (first.end.x, first.end.y) == (0.0, 11.0)


@pytest.mark.parametrize(
    "name", ["cubesphere", *(pytest.param(name, marks=pytest.mark.thorough) for name in ("saddle", "two_bodies"))]
)
def test_sheets_of_real_layouts(name):
    from flexmaps.engine.params import LayoutParams
    from flexmaps.engine.patches.flattening import flatten
    from flexmaps.engine.patches.tracing import trace
    from flexmaps.engine.surface import curvature, shapes

    mesh = shapes.make(name)
    flat = flatten.flatten(trace.trace_layout(mesh, LayoutParams()), LayoutParams())
    result = sheets.make_sheets(
        fabricable.design_from_curvature(flat, SpiralParams(), curvature.rms_curvature(mesh)),
        SheetParams(nesting="FAST"),
    )
    assert len(result.panels) == len(flat.layout.patches)
    assert result.slot_min >= 0.3e-3 - 1e-9
    # arms are at least 1 mm wide, necks and walls of connectors 0.8 mm
    assert result.bridge_min >= 0.8e-3 - 1e-9
    for index in range(result.count):
        panels = result.panels_on_sheet(index)
        assert all(_polygon(p).is_valid for p in panels)
        # chords stray from their arcs by a hundredth of a millimetre
        grown = [shapely.Polygon(p.outline.sample(1e-5)).buffer(0.00149) for p in panels]
        one, two = shapely.STRtree(grown).query(grown, predicate="intersects")
        assert (one == two).all()


def test_keys_carry_the_names_of_their_joints(flat_grid):
    spirals = fabricable.uniform_design(
        flat_grid(4, 3, 0.03, cut=lambda x, _: x == 2), SpiralParams(), width=0.002, twist=0.5
    )
    made = sheets.make_sheets(spirals, SheetParams(nesting="FAST"), connectors=ConnectorParams(connector="key"))
    keys = [p for p in made.panels if p.patch < 0]
    assert len(keys) == 3
    for key, joint in zip(keys, made.connections.connectors, strict=True):
        assert len(key.labels) == len(lettering.text_strokes(joint.name))
        material = shapely.Polygon(key.outline.sample(1e-6)).buffer(-0.0001)
        assert all(material.contains(shapely.LineString(s.points)) for s in key.labels)
    small = SheetParams(nesting="FAST", label_min=0.005)
    made = sheets.make_sheets(spirals, small, connectors=ConnectorParams(connector="key"))
    assert not any(p.labels for p in made.panels if p.patch < 0)


@pytest.mark.parametrize("count", [0, 1, 7, 300])
def test_loose_keys_stay_on_sheets_of_the_size_that_is_there(count):
    square = Curve(0.004 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]), np.zeros(4))
    params = SheetParams(sheet_width=0.2, sheet_height=0.1)
    none = packing.Packing(np.zeros(0, int), np.zeros(0), np.zeros((0, 2)), np.zeros((0, 2)))
    found = sheets.with_key_sheets(none, (Outline(square, ()),) * count, params)
    assert len(found.sheet) == count
    assert (found.sizes <= [0.2, 0.1]).all()
    assert sorted(set(found.sheet.tolist())) == list(range(len(found.sizes)))
    for k, size in enumerate(found.sizes):
        boxes = [shapely.box(*(s - 0.004), *(s + 0.004)) for s in found.shift[found.sheet == k]]
        frame = shapely.box(0, 0, *size).buffer(1e-9 - params.margin, join_style="mitre")
        assert all(frame.contains(b) for b in boxes)
        assert shapely.unary_union([b.buffer(0.4999 * params.spacing) for b in boxes]).area == pytest.approx(
            sum(b.buffer(0.4999 * params.spacing).area for b in boxes)
        )


def test_a_smaller_sheet_after_the_layout_is_refused_where_the_panels_could_be_cut(flat_grid):
    small, fits = SheetParams(sheet_width=0.1, sheet_height=0.08), SheetParams()
    flat = flat_grid(10, 3, cut=lambda x, _: x == 9)
    split.check_fits_sheet(flat, fits)
    with pytest.raises(FlexMapsError, match=r"1 of 2 panels are larger than the sheet of 100 x 80 mm") as caught:
        split.check_fits_sheet(flat, small)
    assert caught.value.faces == list(range(27))
    split.check_fits_sheet(flat, SheetParams(sheet_width=0.1, sheet_height=0.08, oversize="enlarge"))
    split.check_fits_sheet(split.split_to_sheet(flat, LayoutParams(), small), small)


def test_the_job_refuses_sheets_smaller_than_its_layout():
    result = job.run(PolygonMesh.from_quads(shapes.make("strip")), Settings(), stop_after="spirals")
    smaller = Settings(sheet=SheetParams(sheet_width=0.07, sheet_height=0.06))
    with pytest.raises(FlexMapsError, match="make the layout again"):
        job.run_stages(result, smaller, ["sheets"])


def test_sizes_in_the_report_are_millimetres(made):
    sizes = np.array(sheets_report.sheets_report(made)["sizes_mm"])
    assert sizes == pytest.approx(1e3 * made.packing.sizes, abs=1e-3)


def test_the_frame_is_closed_and_the_stroke_at_its_origin_is_not(made):
    edge, stroke = operations.frame_curves(replace(made, params=replace(made.params, frame=True)), 0)
    assert edge.closed and not stroke.closed
    assert np.ptp(edge.points, axis=0) == pytest.approx(made.packing.sizes[0])
    assert stroke.points[0] == pytest.approx([0.0, 0.0]) and (stroke.points[1] > 0.0).all()

"""The page, the plots and the pictures of a run, judged by readers that the project did not write."""

from __future__ import annotations

import base64
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import bpy
import numpy as np
import pytest
from flexmaps import api
from flexmaps.bridge.view import images
from flexmaps.bridge.view import report as pages
from flexmaps.engine import colours, figures
from flexmaps.engine.display import arrange, drawing, plots, raster, run_plots
from flexmaps.engine.display.plots import Colouring
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree
from shapely.geometry import MultiPoint

SVG = "{http://www.w3.org/2000/svg}"
VOID = {"meta", "img", "br", "link", "input"}
DRAWN = set(run_plots.PLOT_NAMES)
FEW = {"optimise.iterations": 2, "optimise.codesign": False, "sheet.nesting": "FAST", "spiral.thickness": 1.5}


def report_of(obj: bpy.types.Object) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the report and the plots of an object, without results that are out of date."""
    content = pages.read_input(obj)
    return pages.build_from_input(content.snapshot.to_result(), content)


@pytest.fixture(scope="module")
def strip() -> api.Piece:
    return api.sheets(api.optimise(api.load("shape:strip", edge=20, settings=FEW), supports="lowest"))


@pytest.fixture(scope="module")
def out(strip: api.Piece, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    api.report(strip, folder)
    return folder


class Page(HTMLParser):
    """Tags that were opened and closed, attributes, and the text of table cells."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.wrong: list[str] = []
        self.links: list[str] = []
        self.cells: list[str] = []
        self.text: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.links += [value or "" for name, value in attrs if name in ("src", "href", "data", "xlink:href", "action")]
        if tag not in VOID:
            self.open.append(tag)
        if tag in ("td", "th"):
            self.cells.append("")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        pass

    def handle_endtag(self, tag: str) -> None:
        if not self.open or self.open.pop() != tag:
            self.wrong.append(tag)

    def handle_data(self, data: str) -> None:
        self.text.append(data)
        if self.open and self.open[-1] in ("td", "th"):
            self.cells[-1] += data


def points_of(path: str) -> list[np.ndarray]:
    """The closed or open polylines of a path of moves and lines."""
    return [np.array(re.findall(r"-?[\d.]+", part), float).reshape(-1, 2) for part in path.split("M")[1:]]


# -- the page --------------------------------------------------------------------------------------------------------------


def test_the_page_is_whole_and_needs_no_network(out: Path) -> None:
    text = (out / "report.html").read_text(encoding="utf-8")
    page = Page(text)
    assert not page.wrong and not page.open
    assert all(link.startswith("data:") for link in page.links)
    # the library of the 3D view names two more, see test_page_data; the page's own policy forbids all requests
    addresses = set(re.findall(r"https?://[\w./]+", text))
    assert addresses <= {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xhtml", "https://threejs.org"}
    assert "@import" not in text and "url(" not in text


def test_the_row_of_figures_is_that_of_the_report(out: Path) -> None:
    report = json.loads((out / "report.json").read_text())
    cells = Page((out / "report.html").read_text(encoding="utf-8")).cells
    row = dict(zip(cells[:10], cells[10:20]))
    assert row["Spirals"] == "54" == str(report["spirals"]["count"])
    assert row["Patches"] == str(report["layout"]["patches"])
    assert float(row["Opt. (s)"]) == pytest.approx(report["seconds"]["optimise"], abs=0.06)
    assert float(row["RMSE before (mm)"]) == pytest.approx(report["optimise"]["laplacian_rmse_mm_before"], abs=6e-4)
    assert float(row["RMSE (mm)"]) == pytest.approx(report["equilibrium"]["laplacian_rmse_mm"], abs=6e-4)
    assert row["RMS distance (%)"] == figures.format_figure(report["equilibrium"]["rms_percent"])
    assert row["Max. distance (%)"] == figures.format_figure(report["equilibrium"]["max_percent"])


def test_the_page_says_what_differs_from_the_defaults_and_what_to_mind(strip: api.Piece, out: Path) -> None:
    page = Page((out / "report.html").read_text(encoding="utf-8"))
    assert "Thickness (spiral.thickness)" in page.cells
    assert page.cells[page.cells.index("Thickness (spiral.thickness)") + 1] == "1.5 mm"
    assert "Width of the thinnest arm" not in page.text and "Smallest width (spiral.width_min)" not in page.cells
    assert strip.result.limits is not None and strip.result.limits.advice in page.text


def test_names_that_look_like_html_stay_names(strip: api.Piece, tmp_path: Path) -> None:
    from dataclasses import replace

    api.report(replace(strip, name="<b>a & b</b>.obj"), tmp_path)
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "<b>a & b" not in text
    assert "<b>a & b</b>" in Page(text).text[0] + "".join(Page(text).text)


def test_pictures_are_inside(strip: api.Piece) -> None:
    from flexmaps.engine.runs import report_page

    png = b"\x89PNG\r\n\x1a\n" + bytes(range(256))
    text = report_page.render_page(api.report(strip), {}, [("A picture", png)])
    found = re.search(r'src="data:image/png;base64,([^"]+)"', text)
    assert found is not None and base64.b64decode(found.group(1)) == png
    pages = [report_page.render_page(api.report(strip), {}, [("One", png)] * n) for n in (3, 4)]
    assert [page.count("class=wide") - text.count("class=wide") for page in pages] == [0, 1]


def test_the_piece_in_3d_is_in_the_page_and_alone_beside_it(strip: api.Piece, out: Path, tmp_path: Path) -> None:
    pages = {name: (out / name).read_text(encoding="utf-8") for name in ("report.html", "share.html")}
    found = {
        name: re.search(r'<script type="application/json" id=piece>(.*?)</script>', text)
        for name, text in pages.items()
    }
    held = {name: json.loads(match.group(1)) for name, match in found.items() if match is not None}
    assert held["report.html"] == held["share.html"] and held["share.html"]["simulated"]
    api.report(api.change(strip, {"page.viewer": False}), tmp_path)
    assert not (tmp_path / "share.html").exists()
    assert "id=piece" not in (tmp_path / "report.html").read_text(encoding="utf-8")
    api.report(strip, tmp_path)
    assert (tmp_path / "share.html").is_file()
    api.report(api.load("shape:strip", edge=20), tmp_path)
    assert not (tmp_path / "share.html").exists(), "what is no longer true goes"


def test_a_page_to_share_of_a_piece_and_of_what_an_object_holds(strip: api.Piece, tmp_path: Path) -> None:
    def read(path: Path) -> Any:
        match = re.search(r'<script type="application/json" id=piece>(.*?)</script>', path.read_text(encoding="utf-8"))
        assert match is not None
        return json.loads(match.group(1))

    one = read(api.share(strip, tmp_path / "one.html"))
    obj = api.show(strip)
    two = read(api.share(obj, tmp_path / "two.html"))
    assert one["simulated"] and two["simulated"] and two["title"] == obj.name
    for panel in (*one["panels"], *two["panels"]):
        panel.pop("hub")  # those in the middle of the strip are equally near to its centre
    for name in ("panels", "seams", "length"):
        assert one[name] == two[name]
    for track, other in zip(one["tracks"], two["tracks"], strict=True):  # the object keeps its pose in single precision
        assert np.array(track["places"][-1]) == pytest.approx(np.array(other["places"][-1]), abs=0.01)
    early = read(api.share(api.load("shape:strip", edge=20), tmp_path / "early.html"))
    assert not early["simulated"] and early["length"] == 0
    bpy.data.objects.remove(obj)


def test_the_button_writes_the_page_to_share(strip: api.Piece, tmp_path: Path) -> None:
    obj = api.show(strip)
    bpy.context.view_layer.objects.active = obj
    obj.flexmaps.export.folder = str(tmp_path)
    assert bpy.ops.flexmaps.share() == {"FINISHED"}
    assert [path.name for path in tmp_path.glob("[!.]*")] == [f"{obj.name}-share.html"]
    bpy.data.objects.remove(obj)
    early = api.show(api.layout(api.load("shape:strip", edge=20)))
    bpy.context.view_layer.objects.active = early
    assert not bpy.ops.flexmaps.share.poll()  # there are no spirals yet
    bpy.data.objects.remove(early)


def test_every_stage_that_is_missing_is_left_out(tmp_path: Path) -> None:
    early = api.load("shape:strip", edge=20)
    api.report(early, tmp_path)
    assert [p.name for p in (tmp_path / "plots").glob("[!.]*")] == ["surface.svg"]
    api.report(api.spirals(early), tmp_path)
    there = {p.stem for p in (tmp_path / "plots").iterdir()}
    assert there == {"surface", "patches", "distortion", "width", "anisotropy", "twist"}
    api.report(early, tmp_path)
    assert [p.name for p in (tmp_path / "plots").glob("[!.]*")] == ["surface.svg"], "what is no longer true goes"


# -- the plots -------------------------------------------------------------------------------------------------------------


def test_every_plot_is_a_file_that_others_can_read(out: Path) -> None:
    found = {path.stem: ElementTree.parse(path).getroot() for path in (out / "plots").glob("*.svg")}
    assert set(found) == DRAWN
    for name, root in found.items():
        _, _, width, height = map(float, root.attrib["viewBox"].split())
        assert root.find(f"{SVG}title") is not None
        for path in root.iter(f"{SVG}path"):
            points = np.concatenate(points_of(path.attrib["d"]))
            assert np.isfinite(points).all()
            assert (points >= -0.1).all() and (points <= np.array([width, height]) + 0.1).all(), name


def test_a_map_has_every_quad_in_its_place_and_colour(strip: api.Piece) -> None:
    """The squares of areas on the page and in metres go together, and colours are those of the scale."""
    flat = strip.result.flat
    assert flat is not None
    values = np.arange(len(flat.corners), dtype=float)
    corners = flat.corners + arrange.arrange_patches(flat)[flat.layout.patch_of][:, None]
    sides = np.zeros((len(corners), 4), bool)
    made = plots.draw_flat_map(
        corners, sides, Colouring.from_values("Numbers", values, "no unit", colours.QUANTITY_SCALE, 0.0, values[-1])
    )
    root = ElementTree.fromstring(drawing.to_svg(made))
    quads = [
        (points, path.attrib["fill"])
        for path in root.iter(f"{SVG}path")
        if path.attrib["fill"] != "none"
        for points in points_of(path.attrib["d"])
    ][: len(corners)]
    assert len(quads) == len(corners)
    found = {tuple(np.round(q.mean(axis=0), 0)): colour for q, colour in quads}
    low, high = corners.reshape(-1, 2).min(axis=0), corners.reshape(-1, 2).max(axis=0)
    factor = np.ptp(np.concatenate([q for q, _ in quads])[:, 0]) / (high - low)[0]
    top = np.concatenate([q for q, _ in quads]).min(axis=0)
    for k in (0, 17, 38, len(corners) - 1):
        middle = (corners[k].mean(axis=0) - [low[0], high[1]]) * factor * [1, -1] + top
        near = min(found, key=lambda at: np.hypot(at[0] - middle[0], at[1] - middle[1]))
        assert np.hypot(near[0] - middle[0], near[1] - middle[1]) < 1.5
        wanted = [np.interp(k / values[-1], np.linspace(0, 1, 4), colours.QUANTITY_SCALE[:, c]) for c in range(3)]
        assert drawing.parse_colour(found[near]) == pytest.approx(wanted, abs=0.02)


def test_a_histogram_counts_every_spiral_once() -> None:
    values = np.random.default_rng(3).gamma(2.0, 1.5, 500)
    made = plots.plot_histogram(values, "Distances", "Distance (mm)", [(3.0, "a mark")])
    bars = next(item for item in made.items if isinstance(item, drawing.FilledShapes))
    heights = np.ptp(bars.points[..., 1], axis=1)
    unit = heights.sum() / 500
    assert heights / unit == pytest.approx(np.round(heights / unit), abs=1e-6)
    left = bars.points[..., 0].min(axis=1)
    bins = np.histogram(values, 28, (0.0, values.max() * 1.02))[0]
    assert (np.round(heights / unit)[np.argsort(left)] == bins[bins > 0]).all()


@pytest.mark.parametrize("values, steps", [([3.0, 2.0, 1.5], 0.0), ([1.0, 0.1, 0.01], 1.0)])
def test_a_history_is_logarithmic_where_it_spans_much(values: list[float], steps: float) -> None:
    """Equal ratios are equal heights then; else equal differences are, from zero on."""
    made = plots.plot_history(values, "Match", "RMSE (mm)")
    line = next(item for item in made.items if isinstance(item, drawing.Line) and len(item.points) == 3)
    y = line.points[:, 1]
    fall = (y[1] - y[0]) / (y[2] - y[1])
    assert fall == pytest.approx(1.0 if steps else (3.0 - 2.0) / (2.0 - 1.5))


@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e6))
def test_ticks_are_round_and_within(low: float, span: float) -> None:
    found = drawing.tick_values(low, low + span)
    assert found == sorted(found) and len(found) <= 12
    slack = 1e-6 * max(span, abs(low) * 1e-6)
    assert all(low - slack <= t <= low + span + slack for t in found)
    if len(found) > 1:
        step = found[1] - found[0]
        lead = step / 10 ** np.floor(np.log10(step * 1.0001))
        rounding = 20.0 * np.spacing(abs(low) + span) / step
        assert min(abs(lead - m) for m in (1, 2, 5, 10)) < 1e-3 + rounding


# -- pixels ----------------------------------------------------------------------------------------------------------------


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.floats(5, 95), st.floats(5, 55)), min_size=3, max_size=6), st.booleans())
def test_filled_shapes_have_their_area(points: list[tuple[float, float]], clockwise: bool) -> None:
    hull = MultiPoint(points).convex_hull
    if hull.geom_type != "Polygon" or hull.area < 20:
        return
    ring = np.array(hull.exterior.coords)[:-1]
    ring = ring[::-1] if clockwise else ring
    made = drawing.Drawing("A shape", 100, 60, [drawing.Line(np.array([[0.0, 0.0], [0.1, 0.0]]), "#ffffff", 0.1)])
    empty = raster.render_drawing(made, {})
    canvas = np.ascontiguousarray(np.repeat(np.repeat(empty, raster.SUBPIXELS, 0), raster.SUBPIXELS, 1))
    raster._fill_polygon(canvas, ring * raster.PIXEL_SCALE * raster.SUBPIXELS, np.zeros(4))
    area = (canvas[..., 0] < 0.5).sum() / (raster.PIXEL_SCALE * raster.SUBPIXELS) ** 2
    assert area == pytest.approx(hull.area, abs=0.15 * hull.length + 0.1)


def test_letters_stand_where_they_are_asked_to() -> None:
    def ink(**how: Any) -> np.ndarray:
        made = drawing.Drawing("Text", 200, 100, [drawing.Text((100, 50), "Widths", 16, "#000000", **how)])
        return np.argwhere(raster.render_drawing(made, images.glyphs())[..., 0] < 0.5) / raster.PIXEL_SCALE

    start, end, turned = ink(), ink(anchor="end"), ink(is_vertical=True, anchor="middle")
    assert start[:, 1].min() == pytest.approx(100, abs=2) and end[:, 1].max() == pytest.approx(100, abs=2)
    assert start[:, 0].max() == pytest.approx(50, abs=1), "on the baseline"
    assert np.ptp(turned[:, 0]) == pytest.approx(np.ptp(start[:, 1]), abs=1)
    assert turned[:, 0].mean() == pytest.approx(50, abs=2) and turned[:, 1].max() <= 101


def test_letters_are_those_of_blender_as_it_sets_them() -> None:
    """A whole line, made by Blender at once, has the same corners and the same area."""
    text = "RMS 0.312 mm (6.83 %), gÄW"
    letters, alone = images.glyphs(), images._text_triangles(text.replace("Ä", raster.MISSING_GLYPH))
    placed = raster._text_triangles(drawing.Text((0, 0), text, 1 / 1.05), letters) * np.array([1, -1])
    area = [np.abs(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])).sum() for t in (placed, alone)]
    assert area[0] == pytest.approx(area[1], rel=1e-4)
    for one, other in ((placed, alone), (alone, placed)):  # only diagonals may differ
        assert KDTree(one.reshape(-1, 2)).query(other.reshape(-1, 2))[0].max() < 1e-4


def test_every_letter_of_the_plots_is_known(strip: api.Piece) -> None:
    drawn = report_of(api.show(strip))[1]
    texts = [item.text for made in drawn.values() for item in made.items if isinstance(item, drawing.Text)]
    assert set(drawn) == DRAWN and not set("".join(texts)) - set(images.LETTERS)


# -- in Blender --------------------------------------------------------------------------------------------------------------


def test_what_an_object_holds_tells_the_same(strip: api.Piece, out: Path, tmp_path: Path) -> None:
    obj = api.show(strip)
    described = api.report(obj, tmp_path)
    first = json.loads((out / "report.json").read_text())
    for block in ("layout", "spirals", "reach"):
        for key, value in first[block].items():
            assert described[block][key] == (pytest.approx(value, rel=1e-4) if isinstance(value, float) else value)
    assert described["optimise"]["history"] == first["optimise"]["history"]
    assert described["sheets"]["mass_g"] == first["sheets"]["mass_g"]
    for name in DRAWN:
        both = [(folder / "plots" / f"{name}.svg").read_text() for folder in (out, tmp_path)]
        roots = [ElementTree.fromstring(text) for text in both]
        texts = [[t.text for t in root.iter(f"{SVG}text")] for root in roots]
        assert texts[0] == texts[1], name


def test_the_button(strip: api.Piece, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(raster, "SUBPIXELS", 1)  # rough edges, which is quicker
    obj = api.show(strip)
    obj.flexmaps.export.folder = str(tmp_path)
    assert bpy.ops.flexmaps.report() == {"FINISHED"}
    made = {name: bpy.data.images[f"{obj.name} {name}"] for name in DRAWN}
    for name, image in made.items():
        pixels = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(pixels)
        rows = pixels.reshape(image.size[1], image.size[0], 4)
        assert image.packed_file is not None and (rows[..., 3] == 1).all()
        assert 0.005 < (rows[..., :3].min(axis=2) < 0.9).mean() < 0.9, name
        assert rows[: image.size[1] // 2].std() > 0 and rows[image.size[1] // 2 :].std() > 0
    assert (tmp_path / f"{obj.name}-report" / "report.html").is_file()
    count = len(bpy.data.images)
    assert bpy.ops.flexmaps.report(files=False) == {"FINISHED"}
    assert len(bpy.data.images) == count, "painted over"


def test_the_button_in_a_file_that_was_never_saved(dome: Any) -> None:
    assert not bpy.ops.flexmaps.report.poll()
    bpy.ops.flexmaps.merge()
    assert bpy.ops.flexmaps.report() == {"FINISHED"}
    assert bpy.data.images[f"{dome.name} patches"].size[0] > 500
    assert f"{dome.name} distance" not in bpy.data.images


def test_drawing_for_the_report_needs_no_blender(strip: api.Piece) -> None:
    """What is taken from an object stays true while Blender goes on: the window is alive meanwhile."""
    obj = api.show(strip)
    found = pages.read_input(obj)
    wanted = report_of(obj)
    bpy.data.objects.remove(obj)
    described, drawn = pages.build_from_input(found.snapshot.to_result(), found)
    for block in ("layout", "spirals", "equilibrium", "optimise", "settings"):
        assert described[block] == wanted[0][block]
    assert {name: drawing.to_svg(one) for name, one in drawn.items()} == {
        name: drawing.to_svg(one) for name, one in wanted[1].items()
    }


def test_an_old_simulation_is_not_reported(strip: api.Piece) -> None:
    obj = api.show(strip)
    assert "equilibrium" in report_of(obj)[0]
    obj.flexmaps.material.material = "birch"
    described, drawn = report_of(obj)
    assert not {"equilibrium", "reach", "optimise"} & set(described)
    assert not {"distance", "safety", "history"} & set(drawn)

"""Remnants: read from drawings that other programs wrote, and panels laid inside them, judged by shapely."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import ezdxf
import numpy as np
import pytest
import shapely
import shapely.affinity
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.fabrication.nesting import nest, remnants
from flexmaps.engine.fabrication.nesting.packing import Packing, fill_ratio
from flexmaps.engine.params import SheetParams

L_SHAPE = np.array([[0, 0], [300, 0], [300, 120], [130, 120], [130, 250], [0, 250]], dtype=float)  # mm
HOLE = np.array([[150.0, 40.0], [190.0, 40.0], [190.0, 80.0], [150.0, 80.0]])
AREA = 300 * 120 + 130 * 130 - 40 * 40  # of both, by hand, in square millimetres


def as_dxf(path: Path, units: int = 4, factor: float = 1.0) -> Path:
    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = units
    space = document.modelspace()
    space.add_lwpolyline(L_SHAPE / factor + 7.0, close=True)
    for a, b in zip(HOLE, np.roll(HOLE, -1, axis=0), strict=True):  # a hole of single lines
        space.add_line(a / factor + 7.0, b / factor + 7.0)
    space.add_text("scrap").set_placement((1, 1))
    document.saveas(path)
    return path


def as_svg(path: Path, head: str = 'width="300mm" height="250mm" viewBox="0 0 300 250"', inside: str = "") -> Path:
    outline = " ".join(f"{x},{250 - y}" for x, y in L_SHAPE)
    path.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" {head}><g transform="translate(10 5) translate(-10,-5)">'
        f'<polygon points="{outline}"/><rect x="150" y="170" width="40" height="40"/>{inside}</g></svg>',
        encoding="utf-8",
    )
    return path


def placed(shapes: list[np.ndarray], packing: Packing) -> list[shapely.Polygon]:
    turned = [shapely.affinity.rotate(shapely.Polygon(s), r, origin=(0, 0), use_radians=True)
              for s, r in zip(shapes, packing.rotation, strict=True)]  # fmt: skip
    return [shapely.affinity.translate(p, *move) for p, move in zip(turned, packing.shift, strict=True)]


def stars(count: int, seed: int = 0) -> list[np.ndarray]:
    """Uneven shapes with bays, 20 to 90 mm."""
    random, found = np.random.default_rng(seed), []
    for _ in range(count):
        angle = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
        radius = random.uniform(0.01, 0.045) * random.uniform(0.5, 1.0, 24)
        found.append(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]))
    return found


# -- reading -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["r.dxf", "r.svg", "inch.dxf", "px.svg"])
def test_an_outline_with_a_hole_is_read(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    if name == "px.svg":
        made = as_svg(path, 'viewBox="0 0 300 250" width="11.811023622in" height="9.8425196850in"')
    else:
        made = as_svg(path) if name.endswith("svg") else as_dxf(path, *((1, 25.4) if "inch" in name else (4, 1.0)))
    (found,) = remnants.read_file(made)
    assert found.size == pytest.approx([0.3, 0.25], rel=1e-6)
    assert 1e6 * found.polygon.area == pytest.approx(AREA, rel=1e-4) and len(found.holes) == 1
    # the right way up: the tall part lies on the left
    assert found.polygon.contains(shapely.Point(0.02, 0.24)) and not found.polygon.contains(shapely.Point(0.28, 0.24))
    assert shapely.Polygon(found.holes[0]).bounds == pytest.approx((0.15, 0.04, 0.19, 0.08), abs=1e-6)


def test_circles_arcs_and_turned_groups(tmp_path: Path) -> None:
    path = tmp_path / "disc.svg"
    path.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="400mm" height="400mm" viewBox="0 0 400 400"><defs><circle r="500"/></defs>'
        '<g transform="rotate(30) scale(2)"><circle cx="100" cy="0" r="50"/>'
        '<path d="M 90 0 a 10 10 0 1 0 20 0 a 10 10 0 1 0 -20 0 z"/></g></svg>', encoding="utf-8",
    )  # fmt: skip
    (found,) = remnants.read_file(path)
    assert found.size == pytest.approx([0.2, 0.2], rel=1e-3)
    assert found.polygon.area == pytest.approx(np.pi * (0.1**2 - 0.02**2), rel=2e-3)
    document = ezdxf.new()
    document.header["$INSUNITS"] = 4
    document.modelspace().add_circle((50, 60), 80)
    document.modelspace().add_circle((300, 60), 20)
    document.saveas(tmp_path / "two.dxf")
    two = remnants.read_remnants(f"{tmp_path / 'two.dxf'}; {path}")
    assert [round(1e3 * float(r.size[0])) for r in two] == [160, 40, 200]


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("a.png", "", "cannot be read"),
        ("a.svg", "<svg", "cannot be read as SVG"),
        ("a.svg", "<html/>", "cannot be read as SVG"),
        ("a.svg", '<svg xmlns="http://www.w3.org/2000/svg"><path d="M 0 0 L 5"/></svg>', "cannot be read as SVG"),
        ("a.svg", '<svg xmlns="http://www.w3.org/2000/svg"><path d="M 0 0 L 50 50"/></svg>', "no closed outline"),
        ("a.svg", '<svg xmlns="http://www.w3.org/2000/svg"><rect width="1e9" height="1e9"/></svg>', "m large"),
        ("a.dxf", "nothing", "cannot be read as DXF"),
        ("a.dxf", "", "no closed outline"),
    ],
)
def test_what_is_no_drawing_is_refused(tmp_path: Path, name: str, text: str, says: str) -> None:
    (tmp_path / name).write_text(text, encoding="utf-8")
    with pytest.raises(FlexMapsError, match=says):
        remnants.read_file(tmp_path / name)
    with pytest.raises(FlexMapsError, match="Cannot read the remnant"):
        remnants.read_remnants(str(tmp_path / "nowhere.dxf"))


def test_a_drawing_is_too_large_from_twenty_metres_on(tmp_path: Path) -> None:
    """The largest of its lines counts, and its longer side."""
    for side, fits in ((19.9e3, True), (20.1e3, False)):
        path = as_svg(
            tmp_path / f"{fits}.svg",
            'width="300mm" height="250mm" viewBox="0 0 300 250"',
            f'<path d="M 0 0 v {side} h 9 z"/>',
        )
        if fits:
            assert len(remnants.read_file(path)) == 2
            continue
        with pytest.raises(FlexMapsError, match="20 m large"):
            remnants.read_file(path)


def test_pieces_up_to_a_square_centimetre_are_ignored(tmp_path: Path) -> None:
    squares = '<rect x="1000" width="10.1" height="10" /><rect x="1020" width="9.9" height="10"/>'
    sizes = [found.size for found in remnants.read_file(as_svg(tmp_path / "a.svg", inside=squares))]
    assert [round(1e3 * float(x), 3) for size in sizes for x in size] == [300.0, 250.0, 10.1, 10.0]


# -- laying panels on them ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rotation", "margin", "spacing"), [("FREE", 0.005, 0.003), ("QUARTER", 0.0, 0.002), ("GRAIN", 0.002, 0.008)]
)
def test_panels_lie_inside_and_apart(tmp_path: Path, rotation: str, margin: float, spacing: float) -> None:
    files = f"{as_dxf(tmp_path / 'a.dxf')};{as_svg(tmp_path / 'b.svg')}"
    params = SheetParams(remnants=files, nesting="FAST", rotation=rotation, margin=margin, spacing=spacing)
    shapes = stars(25)
    packing = nest.nest(shapes, params)
    assert len(packing.remnants) == 2 and packing.sheet.min() == 0
    polygons = placed(shapes, packing)
    for k in range(len(packing.sizes)):
        on = [p for p, s in zip(polygons, packing.sheet, strict=True) if s == k]
        sheet = packing.remnants[k].polygon if k < 2 else shapely.box(0, 0, *packing.sizes[k])
        assert len(on) > 0
        for i, one in enumerate(on):
            assert sheet.contains(one) and one.distance(sheet.boundary) >= margin - 1e-6
            assert all(one.distance(other) >= spacing - 1e-6 for other in on[:i])
    if rotation == "GRAIN":  # as they are given, their grain along x, either way round
        assert np.abs(np.sin(packing.rotation)).max() < 1e-9


def test_none_is_left_over_where_all_have_room(tmp_path: Path) -> None:
    params = SheetParams(remnants=str(as_dxf(tmp_path / "a.dxf")), nesting="FAST")
    packing = nest.nest(stars(4), params)
    assert len(packing.sizes) == 1 and packing.sheet_areas == pytest.approx([1e-6 * AREA], rel=1e-6)
    assert 0.0 < fill_ratio(packing, stars(4), 0.001, params.margin) == pytest.approx(0.001 / (1e-6 * AREA), rel=1e-6)


def test_a_remnant_smaller_than_every_panel_is_refused(tmp_path: Path) -> None:
    document = ezdxf.new(units=4)
    document.modelspace().add_lwpolyline([(0, 0), (30, 0), (30, 30), (0, 30)], close=True)
    document.saveas(tmp_path / "tiny.dxf")
    with pytest.raises(FlexMapsError, match="'tiny' of 30 x 30 mm is smaller than every panel"):
        nest.nest([4.0 * s for s in stars(3)], SheetParams(remnants=str(tmp_path / "tiny.dxf")))


def test_a_piece_on_a_remnant(tmp_path: Path) -> None:
    """The sheet's files show the remnant's edge; its price is not paid again."""
    from flexmaps.engine.fabrication import estimates, sheets_report
    from flexmaps.engine.fabrication.writers import dxf
    from flexmaps.engine.materials import MATERIALS
    from flexmaps.engine.params import CostParams, Settings, with_values
    from flexmaps.engine.runs import job
    from flexmaps.engine.surface import shapes as surfaces
    from flexmaps.engine.surface.mesh import PolygonMesh

    settings = with_values(Settings(), {"sheet.nesting": "FAST", "sheet.remnants": str(as_dxf(tmp_path / "a.dxf"))})
    result = job.run(PolygonMesh.from_quads(surfaces.make("quad", 0.06)), settings)
    made = result.sheets
    assert made is not None and result.design is not None and made.packing.remnants
    assert sheets_report.sheets_report(made)["remnants"] == ["a"]
    dxf.write_dxf(made, 0, tmp_path / "out.dxf")
    lines = [e for e in ezdxf.readfile(tmp_path / "out.dxf").modelspace() if e.dxf.layer == "SHEET" and e.closed]
    assert sorted(round(shapely.Polygon([p[:2] for p in e]).area) for e in lines) == [1600, AREA + 1600]
    figures = estimates.estimate(made, result.design, MATERIALS["pom"], CostParams(sheet_price=10.0))
    assert figures.costs.get("sheets", 0.0) == pytest.approx(10.0 * (made.count - 1))
    plain = replace(settings.sheet, remnants="")
    assert not nest.nest([p.outline.sample(1e-4) for p in made.panels], plain).remnants

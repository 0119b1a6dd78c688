"""Forms of DXF, from R12 to R2018, as remnants: sizes worked out by hand, to 0.01 mm."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import ezdxf
import numpy as np
import pytest
from flexmaps.engine.fabrication.nesting import remnants

RECT = [(10, 10), (210, 10), (210, 110), (10, 110)]
DISC = [(50, 50, 0, 0, 1), (90, 50, 0, 0, 1)]  # of two half circles, as a polyline
Doc, Space = Any, Any  # ezdxf's


def lines(space: Space, corners: Sequence[tuple[float, float]], **more: Any) -> None:
    for a, b in zip(corners, [*corners[1:], corners[0]], strict=True):
        space.add_line(a, b, **more)


def rect(space: Space, layer: str = "0", **more: Any) -> Any:
    return space.add_lwpolyline(RECT, close=True, dxfattribs={"layer": layer, **more})


def hole(space: Space, layer: str = "0", **more: Any) -> Any:
    return space.add_circle((60, 60), 20, dxfattribs={"layer": layer, **more})


def hidden(state: str) -> Callable[[Doc, Space], None]:
    def make(doc: Doc, space: Space) -> None:
        layer = doc.layers.add("GUIDE")
        getattr(layer, state)()
        rect(space)
        hole(space, "guide")  # names of layers know no case

    return make


def block(doc: Doc, name: str, draw: Callable[[Space], Any], **insert: Any) -> Any:
    draw(doc.blocks.new(name))
    return doc.modelspace().add_blockref(name, insert.pop("at", (0, 0)), dxfattribs=insert)


def block_in_block(doc: Doc, space: Space) -> None:
    rect(doc.blocks.new("INNER"))
    doc.blocks.new("OUTER").add_blockref("INNER", (5, 5), dxfattribs={"rotation": 90})
    space.add_blockref("OUTER", (0, 0), dxfattribs={"xscale": 0.5, "yscale": 0.5})


def sheared_blocks(doc: Doc, space: Space) -> None:
    rect(doc.blocks.new("INNER"))
    doc.blocks.new("OUTER").add_blockref("INNER", (0, 0), dxfattribs={"rotation": 45})
    space.add_blockref("OUTER", (0, 0), dxfattribs={"xscale": 2.0})


def block_on_a_hidden_layer(state: str, inner: str) -> Callable[[Doc, Space], None]:
    def make(doc: Doc, space: Space) -> None:
        getattr(doc.layers.add("GUIDE"), state)()
        doc.layers.add("SEEN")
        rect(space)
        block(doc, "A", lambda b: hole(b, inner), layer="GUIDE")

    return make


def block_of_a_hidden_layer(doc: Doc, space: Space) -> None:
    doc.layers.add("GUIDE").off()

    def draw(b: Space) -> None:
        rect(b)
        hole(b, "GUIDE")

    block(doc, "A", draw)


def paper(doc: Doc, space: Space) -> None:
    rect(space)
    hole(doc.layout("Layout1"))


def hatched(doc: Doc, space: Space) -> None:
    rect(space)
    space.add_hatch().paths.add_polyline_path([(40, 40), (90, 40), (90, 90)], is_closed=True)


def hatch_alone(doc: Doc, space: Space) -> None:
    hatch = space.add_hatch()
    hatch.paths.add_polyline_path(RECT, is_closed=True)
    edges = hatch.paths.add_edge_path()
    edges.add_arc((60, 60), 20, 0, 360)


def annotated(doc: Doc, space: Space) -> None:
    rect(space)
    space.add_linear_dim(base=(0, 130), p1=(10, 110), p2=(210, 110)).render()
    space.add_text("scrap").set_placement((20, 20))
    space.add_mtext("scrap")
    space.add_leader([(20, 20), (40, 40), (60, 40)])
    space.add_point((3, 3))
    space.add_xline((0, 0), (1, 0))
    space.add_ray((0, 0), (1, 1))


def old_polyline(closed: bool, **more: Any) -> Callable[[Doc, Space], None]:
    return lambda doc, space: space.add_polyline2d(RECT if closed else [*RECT, RECT[0]], close=closed, dxfattribs=more)


def spline(doc: Doc, space: Space) -> None:
    # a circle of radius 50 as a rational curve of second degree (Piegl and Tiller 1997, example 7.2)
    c = [(50, 0), (50, 50), (0, 50), (-50, 50), (-50, 0), (-50, -50), (0, -50), (50, -50), (50, 0)]
    knots = [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4]
    space.add_rational_spline(c, [1, 0.5**0.5] * 4 + [1], degree=2, knots=knots)


def arcs(doc: Doc, space: Space) -> None:
    space.add_arc((100, 50), 50, 270, 90)
    space.add_arc((0, 50), 50, 90, 270)
    space.add_line((0, 0), (100, 0))
    space.add_line((100, 100), (0, 100))


def overlong(doc: Doc, space: Space) -> None:
    for a, b in (((0, 10), (230, 10)), ((0, 110), (230, 110)), ((10, 0), (10, 130)), ((210, 0), (210, 130))):
        space.add_line(a, b)


def short_of_a_line(doc: Doc, space: Space) -> None:
    space.add_line((0, 10), (230, 10))
    space.add_line((0, 110), (230, 110))
    space.add_line((10, 10.15), (10, 109.85))
    space.add_line((210, 10), (210, 110))


FORMS: dict[str, tuple[Callable[[Doc, Space], Any], list[tuple[float, float, int]]]] = {
    "LWPOLYLINE": (lambda d, s: rect(s), [(200, 100, 0)]),
    "LWPOLYLINE with bulges": (lambda d, s: s.add_lwpolyline(DISC, close=True), [(40, 40, 0)]),
    "LWPOLYLINE that ends where it began": (lambda d, s: s.add_lwpolyline([*RECT, RECT[0]]), [(200, 100, 0)]),
    "LWPOLYLINE with a gap of .2": (lambda d, s: s.add_lwpolyline([*RECT, (10, 10.2)]), [(200, 100, 0)]),
    "LWPOLYLINE with widths": (lambda d, s: rect(s, const_width=3.0), [(200, 100, 0)]),
    "LWPOLYLINE that is raised": (lambda d, s: rect(s, elevation=30.0), [(200, 100, 0)]),
    "POLYLINE": (old_polyline(True), [(200, 100, 0)]),
    "POLYLINE that ends where it began": (old_polyline(False), [(200, 100, 0)]),
    "POLYLINE in space": (lambda d, s: s.add_polyline3d([(*p, 5) for p in RECT], close=True), [(200, 100, 0)]),
    "LINE": (lambda d, s: lines(s, RECT), [(200, 100, 0)]),
    "LINE in any order": (lambda d, s: [s.add_line(*e) for e in ((RECT[2], RECT[1]), (RECT[0], RECT[1]), (RECT[3], RECT[0]),
                                                                 (RECT[3], RECT[2]))], [(200, 100, 0)]),
    "LINE drawn twice": (lambda d, s: [lines(s, RECT), lines(s, RECT[::-1])], [(200, 100, 0)]),
    "LINE beyond the corners": (overlong, [(200, 100, 0)]),
    "LINE short of another": (short_of_a_line, [(200, 100, 0)]),
    "LINE with gaps": (lambda d, s: [s.add_line((0, 0), (200, 0)), s.add_line((200, 0.15), (200, 100)),
                                     s.add_line((200, 100), (0, 100)), s.add_line((0, 100), (0, 0))], [(200, 100, 0)]),
    "ARC and LINE": (arcs, [(200, 100, 0)]),
    "ARC across the start of angles": (lambda d, s: [s.add_arc((0, 0), 50, 300, 60), s.add_arc((0, 0), 50, 60, 300)],
                                       [(100, 100, 0)]),
    "CIRCLE": (lambda d, s: s.add_circle((5, 5), 50), [(100, 100, 0)]),
    "CIRCLE seen from below": (lambda d, s: s.add_circle((5, 5), 50, dxfattribs={"extrusion": (0, 0, -1)}), [(100, 100, 0)]),
    "ELLIPSE": (lambda d, s: s.add_ellipse((0, 0), (80, 0), 0.5), [(160, 80, 0)]),
    "ELLIPSE turned": (lambda d, s: s.add_ellipse((0, 0), (0, 80), 0.25), [(40, 160, 0)]),
    "half an ELLIPSE": (lambda d, s: [s.add_ellipse((0, 0), (80, 0), 0.5, 0, np.pi), s.add_line((-80, 0), (80, 0))],
                        [(160, 40, 0)]),
    "rational SPLINE": (spline, [(100, 100, 0)]),
    "closed SPLINE": (lambda d, s: s.add_spline().set_closed([(0, 0, 0), (90, 0, 0), (90, 90, 0), (0, 90, 0)]), [(82.5, 82.5, 0)]),
    "SPLINE of the first degree": (lambda d, s: s.add_open_spline([*RECT, RECT[0]], degree=1), [(200, 100, 0)]),
    "mirrored LWPOLYLINE": (lambda d, s: rect(s, extrusion=(0, 0, -1)), [(200, 100, 0)]),
    "hole": (lambda d, s: [rect(s), hole(s)], [(200, 100, 1)]),
    "island": (lambda d, s: [rect(s), s.add_circle((60, 60), 40), s.add_circle((60, 60), 20)], [(200, 100, 1), (40, 40, 0)]),
    "notch": (lambda d, s: [rect(s), s.add_circle((210, 60), 20)], [(200, 100, 0)]),
    "two pieces": (lambda d, s: [rect(s), s.add_circle((300, 60), 30)], [(200, 100, 0), (60, 60, 0)]),
    "drawn twice": (lambda d, s: [rect(s), rect(s)], [(200, 100, 0)]),
    "a hole drawn thrice": (lambda d, s: [rect(s), hole(s), hole(s), hole(s)], [(200, 100, 1)]),
    "layer off": (hidden("off"), [(200, 100, 0)]),
    "layer frozen": (hidden("freeze"), [(200, 100, 0)]),
    "layer locked": (hidden("lock"), [(200, 100, 1)]),
    "invisible": (lambda d, s: [rect(s), hole(s, invisible=1)], [(200, 100, 0)]),
    "INSERT": (lambda d, s: block(d, "A", rect), [(200, 100, 0)]),
    "INSERT scaled and turned": (lambda d, s: block(d, "A", rect, xscale=0.5, yscale=2.0, rotation=90), [(200, 100, 0)]),
    "INSERT mirrored": (lambda d, s: block(d, "A", rect, xscale=-1.0), [(200, 100, 0)]),
    "INSERT of a CIRCLE, uneven": (lambda d, s: block(d, "A", hole, xscale=3.0, yscale=4.0), [(120, 160, 0)]),
    "INSERT in INSERT": (block_in_block, [(50, 100, 0)]),
    "INSERT in INSERT, sheared": (sheared_blocks, [(600 * 0.5**0.5, 300 * 0.5**0.5, 0)]),
    "MINSERT": (lambda d, s: block(d, "A", rect, column_count=2, row_count=2, column_spacing=220, row_spacing=130),
                [(200, 100, 0)] * 4),
    "INSERT on a layer that is off": (block_on_a_hidden_layer("off", "0"), [(200, 100, 0)]),
    "INSERT on a layer that is off, with another": (block_on_a_hidden_layer("off", "SEEN"), [(200, 100, 1)]),
    "INSERT on a frozen layer": (block_on_a_hidden_layer("freeze", "SEEN"), [(200, 100, 0)]),
    "INSERT with a layer that is off": (block_of_a_hidden_layer, [(200, 100, 0)]),
    "INSERT that is invisible": (lambda d, s: [rect(s), block(d, "A", hole, invisible=1)], [(200, 100, 0)]),
    "paper": (paper, [(200, 100, 0)]),
    "HATCH": (hatched, [(200, 100, 0)]),
    "HATCH alone": (hatch_alone, [(200, 100, 1)]),
    "SOLID": (lambda d, s: s.add_solid([(0, 0), (200, 0), (0, 100), (200, 100)]), [(200, 100, 0)]),
    "MLINE closed": (lambda d, s: [s.add_mline([(0, 0), (200, 0), (200, 100), (0, 100)], close=True,
                                               dxfattribs={"scale_factor": 20, "justification": 1})], [(220, 120, 1)]),
    "dimensions and texts": (annotated, [(200, 100, 0)]),
}  # fmt: skip


@pytest.mark.parametrize("name", FORMS)
def test_a_form_has_its_size(tmp_path: Path, name: str) -> None:
    document = ezdxf.new("R2010", setup=True, units=4)
    draw, wanted = FORMS[name]
    draw(document, document.modelspace())
    document.saveas(tmp_path / "form.dxf")
    found = remnants.read_file(tmp_path / "form.dxf")
    assert [(*(1e3 * r.size), len(r.holes)) for r in found] == [pytest.approx(w, abs=0.01) for w in wanted]
    assert not any("unit" in remark for r in found for remark in r.remarks)


@pytest.mark.parametrize("version", ["R12", "R2000", "R2004", "R2007", "R2010", "R2013", "R2018"])
def test_versions(tmp_path: Path, version: str) -> None:
    document = ezdxf.new(version, units=4)
    lines(document.modelspace(), RECT)
    document.saveas(tmp_path / "a.dxf")
    assert 1e3 * remnants.read_file(tmp_path / "a.dxf")[0].size == pytest.approx([200, 100])


@pytest.mark.parametrize(
    ("code", "unit"), [(1, 25.4), (2, 304.8), (4, 1.0), (5, 10.0), (6, 1e3), (9, 0.0254), (13, 1e-3), (14, 100.0)]
)
def test_units(tmp_path: Path, code: int, unit: float) -> None:
    document = ezdxf.new(units=code)
    document.modelspace().add_lwpolyline(np.array(RECT) / unit, close=True)
    document.saveas(tmp_path / "a.dxf")
    (found,) = remnants.read_file(tmp_path / "a.dxf", "in")
    assert 1e3 * found.size == pytest.approx([200, 100], abs=0.01) and not found.remarks


@pytest.mark.parametrize("binary", [False, True])
def test_ways_to_write(tmp_path: Path, binary: bool) -> None:
    document = ezdxf.new("R2010", units=4)
    rect(document.modelspace())
    document.saveas(tmp_path / "a.dxf", fmt="bin" if binary else "asc")
    assert 1e3 * remnants.read_file(tmp_path / "a.dxf")[0].size == pytest.approx([200, 100])


def bare(kind: str) -> str:
    """Entities without a header, tables, or handles."""
    pairs = ["0", "SECTION", "2", "ENTITIES"]
    if kind == "LWPOLYLINE":
        pairs += ["0", kind, "8", "0", "100", "AcDbPolyline", "90", "4", "70", "1"]
        pairs += [x for p in RECT for x in ("10", str(p[0]), "20", str(p[1]))]
    elif kind == "POLYLINE":
        pairs += ["0", kind, "8", "0", "66", "1", "70", "1"]
        pairs += [x for p in RECT for x in ("0", "VERTEX", "8", "0", "10", str(p[0]), "20", str(p[1]))] + [
            "0",
            "SEQEND",
        ]
    else:
        for a, b in zip(RECT, RECT[1:] + RECT[:1], strict=True):
            pairs += ["0", "LINE", "8", "0", "10", str(a[0]), "20", str(a[1]), "11", str(b[0]), "21", str(b[1])]
    return "\n".join([*pairs, "0", "ENDSEC", "0", "EOF", ""])


@pytest.mark.parametrize("kind", ["LINE", "POLYLINE", "LWPOLYLINE"])
@pytest.mark.parametrize("damage", ["", "no EOF", "no end of the section", "CRLF", "comment"])
@pytest.mark.parametrize(("unit", "scale"), [("mm", 1.0), ("in", 25.4), ("m", 1000.0)])
def test_entities_alone(tmp_path: Path, kind: str, damage: str, unit: str, scale: float) -> None:
    text = bare(kind)
    text = {
        "no EOF": text.replace("0\nEOF\n", ""),
        "no end of the section": text.replace("0\nENDSEC\n0\nEOF\n", ""),
        "CRLF": text.replace("\n", "\r\n"),
        "comment": "999\nby hand\n" + text,
    }.get(damage, text)
    (tmp_path / "bare.dxf").write_bytes(
        text.replace("210", "21").replace("110", "11").encode() if unit == "m" else text.encode()
    )
    (found,) = remnants.read_file(tmp_path / "bare.dxf", unit)
    wanted = [11e3, 1e3] if unit == "m" else [200 * scale, 100 * scale]
    assert 1e3 * found.size == pytest.approx(wanted, abs=0.01)
    assert found.remarks == (f"bare.dxf names no unit: its lengths are read as {unit}",)

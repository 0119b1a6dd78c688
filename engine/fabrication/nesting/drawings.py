"""Read DXF and SVG drawings with ezdxf and svgelements as polylines in millimetres."""

from __future__ import annotations

import copy
import io
import logging
import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np

from ...errors import FlexMapsError

if TYPE_CHECKING:
    from ezdxf.entities import DXFEntity

# maximum distance in mm between a curve and its chords; larger is faster, but dimensions are off by up to twice as much
CHORD_TOLERANCE = 4e-3
# maximum size of a file in bytes; larger files are refused, because reading them would take long
MAX_BYTES = 50_000_000
MAX_SYMBOLS = 500  # maximum number of symbols placed in an SVG drawing, in case a symbol contains itself
MAX_DEPTH = 32  # maximum nesting depth of blocks, in case a damaged block contains itself
# millimetres per drawing unit, by the unit's code in the header variable $INSUNITS. In order of the codes: inch, foot,
# mile, mm, cm, m, km, microinch, mil, yard, angstrom, nm, micrometre, decimetre, decametre, hectometre, and the foot,
# inch and yard of the US survey
DXF_UNITS = {
    1: 25.4,
    2: 304.8,
    3: 1609344.0,
    4: 1.0,
    5: 10.0,
    6: 1e3,
    7: 1e6,
    8: 25.4e-6,
    9: 0.0254,
    10: 914.4,
    11: 1e-7,
}
DXF_UNITS |= {12: 1e-6, 13: 1e-3, 14: 1e2, 15: 1e4, 16: 1e5, 21: 304.800609601, 22: 25.4000508001, 23: 914.401828804}
PIXEL = 25.4 / 96  # millimetres per pixel of CSS
_LENGTH = re.compile(r"([-+\d.e]+?)\s*(mm|cm|in|pt|pc|px|)")  # matches a length of SVG: a number and its unit, if any
# matches style sheets that svgelements can read: every selector is ``*``, an element type, a class or an id
_SIMPLE_RULES = re.compile(
    r"(?:\s|/\*.*?\*/|{0}(?:\s*,\s*{0})*\s*\{{[^{{}}!]*\}})*".format(r"(?:\*|[\w-]*[.#]?[\w-]+)"), re.DOTALL
)
_POINT = re.compile(r"([-+\d.e]+)(?:px)?[\s,]+([-+\d.e]+)(?:px)?")  # matches a point in pixels, or without unit
FILLED = {"HATCH", "MPOLYGON", "SOLID", "TRACE", "3DFACE"}  # types of DXF entities that fill an area


@dataclass
class LineDrawing:
    """The lines of a drawing.

    lines : for every line its points (N, 2) in mm, y upwards, and whether it is closed
    unitless : whether the file names no unit of length
    unsupported : names of elements in the file that this reader does not support
    """

    lines: list[tuple[np.ndarray, bool]] = field(default_factory=list)
    unitless: bool = False
    unsupported: set[str] = field(default_factory=set)


def read_dxf(path: Path, unit: float) -> LineDrawing:
    """Read every visible line of a DXF drawing.

    path : the file
    unit : millimetres per drawing unit, used if the file names no unit
    """
    import ezdxf

    logging.getLogger("ezdxf").setLevel(logging.ERROR)
    try:
        document = _read_document(path)
        code = int(document.header.get("$INSUNITS", 0) or 0)
        factor = DXF_UNITS[code] if code else unit
        frozen = {layer.dxf.name.lower() for layer in document.layers if layer.is_frozen()}
        off = {layer.dxf.name.lower() for layer in document.layers if layer.is_off()}
        made = LineDrawing(unitless=not code)
        filled: list[tuple[np.ndarray, bool]] = []
        for kind, points, closed in _visible_lines(
            document.modelspace(), _DrawingContext(document.blocks, frozen, off, CHORD_TOLERANCE / factor)
        ):
            if len(points) < 2:
                made.unsupported.add(kind)
            else:
                (filled if kind in FILLED else made.lines).append((factor * points, closed))
        made.lines = made.lines or filled  # if there are lines, filled areas only repeat what they enclose
    except (ezdxf.DXFError, UnicodeError, ValueError, KeyError, IndexError, AttributeError, TypeError, RecursionError):
        raise FlexMapsError(f"{path.name} cannot be read as DXF; save it again, as R2010") from None
    return made


def _read_document(path: Path) -> Any:
    """Read a DXF document with ezdxf, repairing damage."""
    import ezdxf
    from ezdxf import recover

    data = path.read_bytes()
    if data.startswith(b"AutoCAD Binary DXF"):
        return ezdxf.readfile(path)
    if b"SECTION" in data and not data.rstrip().endswith((b"EOF", b"ENDSEC")):
        data = data.rstrip() + b"\n0\nENDSEC\n0\nEOF\n"  # of a truncated file, ezdxf would drop the last section
    try:
        return recover.read(io.BytesIO(data))[0]
    except ezdxf.DXFStructureError:
        return recover.read(io.BytesIO(_with_subclass_markers(data)))[0]


def _with_subclass_markers(data: bytes) -> bytes:
    """Add subclass markers to LWPOLYLINE entities, and a version to the header; ezdxf requires both."""
    lines = [line.strip() for line in data.splitlines()]
    records: list[list[bytes]] = [[]]
    for code, value in zip(lines[::2], lines[1::2]):
        if code == b"0":
            records.append([])
        records[-1] += [code, value]
    for record in records:
        if record[:2] == [b"0", b"LWPOLYLINE"]:
            pairs = [p for p in zip(record[2::2], record[3::2], strict=True) if p[0] != b"100"]
            shared = [p for p in pairs if p[0] in (b"5", b"6", b"8", b"48", b"60", b"62", b"67")]
            own = [p for p in pairs if p not in shared]
            record[2:] = [x for p in ((b"100", b"AcDbEntity"), *shared, (b"100", b"AcDbPolyline"), *own) for x in p]
    head = b"0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1015\n0\nENDSEC\n" if b"$ACADVER" not in data else b""
    return head + b"\n".join(line for record in records for line in record) + b"\n"


@dataclass(frozen=True)
class _DrawingContext:
    """State passed down while nested blocks are expanded.

    blocks : block definitions of the document
    frozen, off : names, in lower case, of the layers that are frozen and that are off
    distance : maximum distance between curves and their chords, in the units of the current block
    layer, depth : layer and nesting depth of the enclosing block; empty and 0 outside blocks
    """

    blocks: Any
    frozen: set[str]
    off: set[str]
    distance: float
    layer: str = ""
    depth: int = 0


def _visible_lines(entities: Iterable[Any], context: _DrawingContext) -> Iterator[tuple[str, np.ndarray, bool]]:
    """Yield the type of every visible entity, its points (N, 2) in drawing units, and whether it is closed.

    Blocks are expanded here and not by ezdxf, for two reasons: entities on layer 0 take the layer of their block, and a
    circle in nested blocks that are rotated and scaled unevenly becomes a curve for which DXF has no entity.
    """
    from ezdxf.disassemble import recursive_decompose

    for entity in entities:
        own = str(entity.dxf.get("layer", "0")).lower()
        own = context.layer if context.layer and own == "0" else own
        kind, block = entity.dxftype(), entity.dxftype() == "INSERT"
        if entity.dxf.get("invisible", 0) or own in context.frozen or (own in context.off and not block):
            continue
        if block and entity.dxf.name in context.blocks and context.depth < MAX_DEPTH:
            for insert in entity.multi_insert() if entity.mcount > 1 else (entity,):
                moves = np.array(insert.matrix44().get_2d_transformation()).reshape(3, 3)
                scale = max(float(np.linalg.norm(moves[:2, :2], 2)), 1e-12)
                inner = replace(context, layer=own, depth=context.depth + 1, distance=context.distance / scale)
                for what, points, closed in _visible_lines(context.blocks[entity.dxf.name], inner):
                    yield what, points @ moves[:2, :2] + moves[2, :2], closed
        elif not block and kind not in ("DIMENSION", "LEADER", "MULTILEADER"):
            for part in recursive_decompose([entity]):
                yield from ((kind, *line) for line in _entity_lines(part, context.distance))


def _entity_lines(entity: DXFEntity, distance: float) -> Iterator[tuple[np.ndarray, bool]]:
    """Yield the polylines of an entity, in its own units, and whether each is closed; text yields an empty polyline."""
    from ezdxf import path

    if entity.dxftype() == "SPLINE":
        yield _spline(entity.construction_tool(), distance), False  # type: ignore[attr-defined]
        return
    try:
        made = list(path.from_hatch(entity)) if entity.dxftype() in ("HATCH", "MPOLYGON") else [path.make_path(entity)]  # type: ignore[arg-type]
    except TypeError:  # an entity without a path, like text
        made = []
        yield np.zeros((0, 2)), False
    for one in made:
        for part in one.sub_paths():
            yield np.array([(v.x, v.y) for v in part.flattening(distance, segments=8)]), part.is_closed


def _spline(spline: Any, distance: float) -> np.ndarray:
    """Return points on a B-spline of ezdxf, over its valid knots, whose chords are within ``distance`` of the curve."""
    knots, degree = np.array(spline.knots()), spline.degree
    inner = np.unique(knots[degree : len(knots) - degree])
    for steps in 8, 32, 128, 512:  # number of segments between two knots, increased until chords are close enough
        parts = [np.linspace(a, b, steps, endpoint=False) for a, b in pairwise(inner.tolist())]
        points = np.array([(v.x, v.y) for v in spline.points([*np.concatenate(parts).tolist(), float(inner[-1])])])
        if np.linalg.norm(np.diff(points, 2, axis=0), axis=1).max() <= 4.0 * distance:
            break
    return points


def read_svg(path: Path, unit: float) -> LineDrawing:
    """Read every visible line of an SVG drawing.

    path : the file
    unit : millimetres per drawing unit, used if the file names no unit
    """
    from svgelements import SVG, Close, Shape
    from svgelements import Path as Curve

    try:
        document = ElementTree.parse(path).getroot()
        if document.tag not in ("svg", "{http://www.w3.org/2000/svg}svg"):
            raise ValueError("no SVG")
        _place_symbols(document)
        _apply_origins(document)
        made = LineDrawing(unitless=_set_size(document), unsupported=_remove_unsupported(document))
        scale = unit if made.unitless else PIXEL
        source = io.BytesIO(ElementTree.tostring(document))
        for shape in SVG.parse(source, ppi=25.4 / scale, reify=False, on_error="raise").elements():
            shown = isinstance(shape, Shape) and shape.values.get("visibility", "visible") == "visible"
            if shown and float(shape.values.get("opacity", 1.0)) > 0.0:
                m = shape.transform  # applied to points below, because svgelements distorts arcs that it shears
                moves = scale * np.array([[m.a, -m.b], [m.c, -m.d]])
                distance = CHORD_TOLERANCE / max(float(np.linalg.norm(moves, 2)), 1e-12)
                for part in Curve(shape.d(transformed=False)).as_subpaths():
                    points = _chords(Curve(part), distance) @ moves + scale * np.array([m.e, -m.f])
                    if len(points) >= 2:
                        made.lines.append((points, any(isinstance(s, Close) for s in part)))
    except (
        ElementTree.ParseError,
        ArithmeticError,
        LookupError,
        RecursionError,
        ValueError,
        TypeError,
        AttributeError,
    ):
        raise FlexMapsError(f"{path.name} cannot be read as SVG; save it again, as plain SVG") from None
    return made


def _set_size(document: ElementTree.Element) -> bool:
    """Write width and height of an SVG document as attributes; return whether the document names no unit.

    Width and height come from the document's style or attributes. If one of the two is missing, it follows from the
    other and the viewBox.
    """
    style = dict(part.split(":", 1) for part in document.get("style", "").split(";") if ":" in part)
    box = [float(x) for x in document.get("viewBox", "").replace(",", " ").split()]
    size = {name: str(style.get(name) or document.get(name, "")).strip().lower() for name in ("width", "height")}
    lengths = {name: _LENGTH.fullmatch(text) for name, text in size.items()}
    for name, other, aspect in (("width", "height", (2, 3)), ("height", "width", (3, 2))):
        known = lengths[other]
        if not size[name] and known is not None and len(box) == 4:
            size[name] = f"{float(known[1]) * box[aspect[0]] / box[aspect[1]]}{known[2]}"
    document.attrib.update({name: text for name, text in size.items() if text})
    return not any(found and found[2] for found in lengths.values())


def _place_symbols(document: ElementTree.Element) -> None:
    """Replace every ``use`` of a symbol in an SVG document by a group with the symbol's elements; remove the symbols.

    A symbol with a viewBox becomes a nested ``svg`` element of the size that the ``use`` element asks for.

    Raises
    ------
    RecursionError : a symbol uses itself, or symbols are used more than ``MAX_SYMBOLS`` times in all
    """
    symbols = {one.get("id"): one for one in document.iter() if _tag(one) == "symbol"}
    for parent in list(document.iter()):
        for child in [one for one in parent if _tag(one) == "symbol"]:
            parent.remove(child)

    def list_uses() -> list[ElementTree.Element]:
        return [one for one in document.iter() if _tag(one) == "use" and _referred(one) in symbols]

    placed = 0
    while uses := list_uses():  # a symbol may use another one
        placed += len(uses)
        if placed > MAX_SYMBOLS:
            raise RecursionError
        for use in uses:
            symbol, space = symbols[_referred(use)], str(use.tag).removesuffix("use")
            if symbol.get("viewBox"):
                frame = {key: use.get(key, symbol.get(key)) for key in ("x", "y", "width", "height")}
                frame |= {key: symbol.get(key) for key in ("viewBox", "preserveAspectRatio")}
                inside = ElementTree.Element(f"{space}svg", {key: text for key, text in frame.items() if text})
            else:
                moved = f"translate({use.get('x', '0')},{use.get('y', '0')})"
                inside = ElementTree.Element(f"{space}g", {"transform": moved})
            inside.extend(copy.deepcopy(list(symbol)))
            use.tag, use[:] = f"{space}g", [inside]
            for key in ("x", "y", "width", "height", *(key for key in use.attrib if key.endswith("href"))):
                use.attrib.pop(key, None)


def _apply_origins(document: ElementTree.Element) -> None:
    """Write transforms about a point, given in pixels or without unit, as transforms about the origin."""
    for element in document.iter():
        style = dict(part.strip().split(":", 1) for part in element.get("style", "").split(";") if ":" in part)
        found = _POINT.fullmatch(str(style.get("transform-origin") or element.get("transform-origin", "")).strip())
        where = style if "transform" in style else element.attrib
        if found is None:
            continue
        x, y = float(found[1]), float(found[2])
        if "transform" in where:
            where["transform"] = f"matrix(1,0,0,1,{x},{y}) {where['transform']} matrix(1,0,0,1,{-x},{-y})"
        for own in (style, element.attrib):
            own.pop("transform-origin", None)
        if style:
            element.set("style", ";".join(f"{name}:{text}" for name, text in style.items()))


def _tag(element: ElementTree.Element) -> str:
    """Return the type of an SVG element, without its namespace."""
    return str(element.tag).rpartition("}")[2]


def _referred(use: ElementTree.Element) -> str:
    """Return the id of the element that a ``use`` element shows; "" if it names none in the document."""
    return use.get("href", use.get("{http://www.w3.org/1999/xlink}href", "")).partition("#")[2]


def _remove_unsupported(document: ElementTree.Element) -> set[str]:
    """Remove markers and masks from an SVG document.

    Return the names of its elements and attributes that are not supported.
    """
    outside: set[str] = set()
    for parent in list(document.iter()):
        for child in list(parent):
            tag = _tag(child)
            outside |= {tag} & {"text", "image", "foreignObject"}
            if tag in ("marker", "mask"):
                parent.remove(child)
            if tag == "style" and not _SIMPLE_RULES.fullmatch("".join(child.itertext())):
                outside.add("style")
        own = f"{' '.join(parent.attrib)} {parent.get('style', '')}"
        outside |= {
            name for name in ("clip-path", "mask", "transform-origin") if re.search(rf"(?<![\w-]){name}\b", own)
        }
    return outside


def _chords(curve: Any, distance: float) -> np.ndarray:
    """Return points (N, 2) on a path of svgelements whose chords are within ``distance`` of it."""
    from svgelements import Arc, CubicBezier, QuadraticBezier

    points: list[np.ndarray] = []
    for part in curve:
        if isinstance(part, Arc):  # a chord over an angle a is within r (1 - cos(a / 2)) of the arc of radius r
            radius = max(part.rx, part.ry, distance)
            steps = math.ceil(abs(part.sweep) / (2.0 * math.acos(max(1.0 - distance / radius, 0.0))))
        elif isinstance(part, (CubicBezier, QuadraticBezier)):  # a chord is within step^2 |second derivative| / 8
            corners = np.array([complex(*p) for p in part])
            bend = len(corners) * (len(corners) - 1) * np.abs(np.diff(corners, 2)).max()
            steps = math.ceil(math.sqrt(bend / (8.0 * distance)))
        else:
            points += [np.array([[part.end.x, part.end.y]])] if part.end is not None else []
            continue
        points.append(np.asarray(part.npoint(np.linspace(0.0, 1.0, max(steps, 1) + 1))).reshape(-1, 2))
    return np.concatenate(points) if points else np.zeros((0, 2))

"""Remnants: odd pieces of sheet that are left from other work, drawn as closed curves with holes in a DXF or SVG file.

Of nested curves the outermost are pieces, those in them holes, those in holes pieces again, as both formats fill areas by the
even-odd rule. Layers, colours and what is not closed do not matter.
"""

from __future__ import annotations

import logging
import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from ...arrays import Float
from ...errors import FlexMapsError

SEPARATOR = ";"  # between the files of a setting; no name of a drawing has it
FLAT = 1e-4  # metres that chords may stray from curves, which are then drawn in by as much
JOINED = 2e-5  # metres within which the ends of single lines count as one
LEAST = 1e-4  # square metres of a piece that something could be cut from
LARGEST = 20.0  # metres; larger ones are in a wrong unit
MOST = 50_000_000  # bytes of a file that is read
# millimetres of the units of SVG, at 96 pixels an inch (CSS Values 3)
UNITS = {
    "mm": 1.0,
    "cm": 10.0,
    "in": 25.4,
    "pt": 25.4 / 72.0,
    "pc": 25.4 / 6.0,
    "px": 25.4 / 96.0,
    "": 25.4 / 96.0,
    "m": 1000.0,
}
# millimetres of the units of DXF's $INSUNITS (inch, foot, mm, cm, m, microinch, mil, yard, micrometre, decimetre)
DRAWING_UNITS = {1: 25.4, 2: 304.8, 4: 1.0, 5: 10.0, 6: 1000.0, 8: 25.4e-6, 9: 0.0254, 10: 914.4, 13: 1e-3, 14: 100.0}

Lines = Iterable[tuple[np.ndarray, bool]]  # points in mm, and whether they are closed


@dataclass(frozen=True, eq=False)
class Remnant:
    """A piece of sheet, moved so that its box begins at the origin; metres.

    outline : counter-clockwise; holes : where nothing is; name : of its file
    """

    name: str
    outline: Float[np.ndarray, "_ 2"]
    holes: tuple[Float[np.ndarray, "_ 2"], ...] = ()

    @property
    def size(self) -> Float[np.ndarray, " 2"]:
        """Width and height of its box."""
        return np.ptp(self.outline, axis=0)

    @property
    def polygon(self) -> Any:
        """As shapely's."""
        from shapely import Polygon

        return Polygon(self.outline, self.holes)


def read(files: str) -> list[Remnant]:
    """The remnants of some files, named one after the other with ``;`` between them; raises ``FlexMapsError``."""
    found: list[Remnant] = []
    for name in filter(None, map(str.strip, files.split(SEPARATOR))):
        found += read_file(Path(name))
    return found


def read_file(path: Path) -> list[Remnant]:
    """The pieces that are drawn in a file, the largest first."""
    readers = {".dxf": _of_dxf, ".svg": _of_svg}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise FlexMapsError(f"{path.name} is no drawing of a remnant that can be read; give a DXF or an SVG file")
    try:
        if path.stat().st_size > MOST:
            raise FlexMapsError(f"{path.name} is too large for the drawing of a remnant; draw its outline alone")
        made = _pieces(path.stem, list(reader(path)))
    except OSError as error:
        if error.errno is None:  # ezdxf's word for a file that is none of its kind
            raise FlexMapsError(f"{path.name} is no DXF drawing that can be read; save it again, as R2010") from None
        raise FlexMapsError(f"Cannot read the remnant {path}: {error.strerror or error}") from None
    if not made:
        raise FlexMapsError(
            f"There is no closed outline in {path.name}; draw the remnant as a closed polyline, in its true size"
        )
    return made


def _pieces(name: str, lines: Lines) -> list[Remnant]:
    """Pieces with their holes from lines in millimetres."""
    import shapely

    closed: list[np.ndarray] = []
    open_: list[np.ndarray] = []
    for points, shut in lines:
        if not np.isfinite(points).all():
            raise FlexMapsError(f"The drawing {name} holds coordinates that are no numbers; draw it again")
        some = np.asarray(points, dtype=float)[:, :2] * 1e-3
        near = len(some) > 2 and float(np.linalg.norm(some[0] - some[-1])) < JOINED
        (closed if shut or near else open_).append(some)
    rings = [shapely.Polygon(p) for p in closed if len(p) >= 3]
    if open_:
        snapped = [shapely.LineString(np.round(p / JOINED) * JOINED) for p in open_ if len(p) >= 2]
        rings += [shapely.Polygon(p.exterior) for p in shapely.get_parts(shapely.polygonize(snapped))]
    whole = None
    for ring in sorted((r.buffer(0.0) for r in rings), key=lambda r: -r.area):
        whole = ring if whole is None else whole.symmetric_difference(ring)
    if whole is None:
        return []
    extent = max(whole.bounds[2] - whole.bounds[0], whole.bounds[3] - whole.bounds[1])
    if extent > LARGEST:
        raise FlexMapsError(
            f"The drawing {name} is {extent:.0f} m large; look at its unit, which should be the millimetre"
        )
    parts = [p for p in shapely.get_parts(whole) if p.geom_type == "Polygon" and p.area > LEAST]
    found = []
    for part in sorted(parts, key=lambda p: -p.area):
        part = shapely.geometry.polygon.orient(part)
        low = np.array(part.bounds[:2])
        holes = tuple(np.asarray(r.coords)[:-1] - low for r in part.interiors)
        found.append(Remnant(name, np.asarray(part.exterior.coords)[:-1] - low, holes))
    return found


def _of_dxf(path: Path) -> Iterator[tuple[np.ndarray, bool]]:
    """Every line of a DXF drawing, in millimetres; text and dimensions are none."""
    import ezdxf
    from ezdxf import path as paths
    from ezdxf.entities import Insert

    logging.getLogger("ezdxf").setLevel(logging.ERROR)
    try:
        document = ezdxf.readfile(path)
    except (ezdxf.DXFError, UnicodeError, ValueError, KeyError, IndexError, AttributeError, TypeError):
        raise FlexMapsError(f"{path.name} is no DXF drawing that can be read; save it again, as R2010") from None
    factor = DRAWING_UNITS.get(int(document.header.get("$INSUNITS", 4) or 4), 1.0)
    for entity in document.modelspace():
        parts = entity.virtual_entities() if isinstance(entity, Insert) else (entity,)
        for part in parts:
            try:
                made = paths.make_path(part)
            except TypeError:  # what has no path
                continue
            points = np.array([(v.x, v.y) for v in made.flattening(1e3 * FLAT / factor)])
            if len(points) >= 2:
                yield factor * points, made.is_closed


def _of_svg(path: Path) -> Iterator[tuple[np.ndarray, bool]]:
    """Every line of an SVG drawing, in millimetres, y upwards; groups may be moved and turned."""
    try:
        root = ElementTree.parse(path).getroot()
        assert root.tag.rpartition("}")[2] == "svg"
        yield from _inside(root, _viewport(root))
    except (ElementTree.ParseError, AssertionError, ValueError, KeyError, IndexError, TypeError, ZeroDivisionError):
        raise FlexMapsError(f"{path.name} is no SVG drawing that can be read; save it again, as plain SVG") from None


def _viewport(root: ElementTree.Element) -> np.ndarray:
    """(2, 3): from a drawing's own units to millimetres, y turned upwards."""
    box = [float(x) for x in re.split(r"[\s,]+", root.get("viewBox", "").strip()) if x]
    across = [_length(root.get(name, "")) for name in ("width", "height")]
    scale = [UNITS[""]] * 2
    if len(box) == 4:
        scale = [size / extent if size is not None else UNITS[""] for size, extent in zip(across, box[2:], strict=True)]
    return np.array([[scale[0], 0.0, 0.0], [0.0, -scale[1], 0.0]])


def _length(text: str) -> float | None:
    """Millimetres of a length; None where it is none or a share of something."""
    found = re.fullmatch(r"\s*([-+.\deE]+?)\s*(mm|cm|in|pt|pc|px|m|)\s*", text)
    return float(found[1]) * UNITS[found[2]] if found else None


def _inside(element: ElementTree.Element, frame: np.ndarray) -> Iterator[tuple[np.ndarray, bool]]:
    from fontTools.pens.recordingPen import RecordingPen
    from fontTools.svgLib.path import parse_path
    from fontTools.svgLib.path.shapes import PathBuilder

    tag = str(element.tag).rpartition("}")[2]
    if tag in ("defs", "clipPath", "mask", "symbol", "marker", "pattern", "metadata"):
        return
    for word, given in re.findall(r"(\w+)\s*\(([^)]*)\)", element.get("transform", "")):
        move = _transform(word, [float(x) for x in re.split(r"[\s,]+", given.strip()) if x])
        frame = np.column_stack([frame[:, :2] @ move[:, :2], frame[:, :2] @ move[:, 2] + frame[:, 2]])
    builder, bare = (
        PathBuilder(),
        ElementTree.Element(element.tag, {k: v for k, v in element.attrib.items() if k != "transform"}),
    )
    builder.add_path_from_element(bare)
    for text in builder.paths:
        pen = RecordingPen()
        parse_path(text, pen)
        for points, closed in _drawn(pen.value):
            yield points @ frame[:, :2].T + frame[:, 2], closed
    for child in element:
        yield from _inside(child, frame)


def _transform(word: str, given: list[float]) -> np.ndarray:
    """(2, 3) of one of SVG's transforms."""
    if word == "matrix":
        return np.array(given).reshape(3, 2).T
    if word == "translate":
        return np.array([[1.0, 0.0, given[0]], [0.0, 1.0, given[1] if len(given) > 1 else 0.0]])
    if word == "scale":
        return np.array([[given[0], 0.0, 0.0], [0.0, given[-1], 0.0]])
    angle = math.radians(given[0])
    if word in ("skewX", "skewY"):
        return np.array(
            [[1.0, math.tan(angle) * (word == "skewX"), 0.0], [math.tan(angle) * (word == "skewY"), 1.0, 0.0]]
        )
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    about = np.array(given[1:3]) if len(given) == 3 else np.zeros(2)
    return np.column_stack([turn, about - turn @ about])


def _drawn(commands: list[tuple[str, tuple[Any, ...]]]) -> Iterator[tuple[np.ndarray, bool]]:
    """Points of every part of a path; curves as so many chords that a circle of a metre strays by a tenth of a millimetre."""
    share = np.linspace(0.0, 1.0, 1 + math.ceil(0.25 * math.pi / math.sqrt(2.0 * FLAT)))[1:, None]
    points: list[np.ndarray] = []
    for name, given in commands:
        some = [np.array(p, dtype=float) for p in given if p is not None]
        if name == "moveTo":
            points = [some[0][None]]
        elif name == "lineTo":
            points.append(some[0][None])
        elif name in ("curveTo", "qCurveTo"):
            start = points[-1][-1]
            if name == "qCurveTo":
                some = [start + (some[0] - start) * 2.0 / 3.0, some[1] + (some[0] - some[1]) * 2.0 / 3.0, some[1]]
            one, two, end = some
            rest = 1.0 - share
            points.append(rest**3 * start + 3.0 * rest**2 * share * one + 3.0 * rest * share**2 * two + share**3 * end)
        elif points:
            yield np.concatenate(points), name == "closePath"
            points = []

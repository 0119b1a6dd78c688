"""Remnants: irregular pieces of sheet left from other work, drawn as closed curves with holes in a DXF or SVG file.

Outermost curves are pieces, curves inside them holes, and curves inside holes material again. A hole that crosses an
outline makes a notch. Colours, open lines, and hidden layers or elements are ignored.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...arrays import Float
from ...errors import FlexMapsError
from .drawings import MAX_BYTES, LineDrawing, read_dxf, read_svg
from .rings import enclosed_areas

SEPARATOR = ";"  # separates file names in a setting
MIN_AREA = 1e-4  # minimum useful area of a piece, m2; smaller closed curves are ignored
MAX_EXTENT = 20.0  # maximum extent of a drawing in metres; a larger drawing is refused, as its unit must be wrong
# millimetres per unit, for the units that the user may choose for files without a unit
UNITS = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4, "pt": 25.4 / 72.0, "px": 25.4 / 96.0}
_READERS = {".dxf": read_dxf, ".svg": read_svg}


@dataclass(frozen=True, eq=False)
class Remnant:
    """A piece of sheet, moved so that its bounding box begins at the origin; metres.

    name : file name without suffix
    outline : outer curve, counter-clockwise
    holes : closed curves without material inside
    remarks : sentences for the user about how the file was read
    """

    name: str
    outline: Float[np.ndarray, "_ 2"]
    holes: tuple[Float[np.ndarray, "_ 2"], ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def size(self) -> Float[np.ndarray, " 2"]:
        """Width and height of the bounding box, metres."""
        return np.ptp(self.outline, axis=0)

    @property
    def polygon(self) -> Any:
        """The piece as a shapely polygon."""
        from shapely import Polygon

        return Polygon(self.outline, self.holes)


def read_remnants(files: str, unit: str = "mm") -> list[Remnant]:
    """Read the remnants in files whose names are separated by ``;``.

    Parameters
    ----------
    files : names of DXF or SVG files
    unit : key of ``UNITS``, for files without a unit

    Raises
    ------
    FlexMapsError : a file cannot be read, is too large, or has no closed outline
    """
    found: list[Remnant] = []
    for name in filter(None, map(str.strip, files.split(SEPARATOR))):
        found += read_file(Path(name), unit)
    return found


def read_file(path: Path, unit: str = "mm") -> list[Remnant]:
    """Read the pieces drawn in a file, largest first.

    Parameters
    ----------
    path : DXF or SVG file
    unit : key of ``UNITS``, for files without a unit

    Raises
    ------
    FlexMapsError : the file cannot be read, is too large, or has no closed outline
    """
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise FlexMapsError(f"{path.name} cannot be read as the drawing of a remnant; give a DXF or an SVG file")
    try:
        if path.stat().st_size > MAX_BYTES:
            raise FlexMapsError(f"{path.name} is too large for the drawing of a remnant; draw its outline alone")
        drawing = reader(path, UNITS[unit])
    except OSError as error:
        if error.errno is None:  # ezdxf raises this for a file that is not DXF
            raise FlexMapsError(f"{path.name} cannot be read as DXF; save it again, as R2010") from None
        raise FlexMapsError(f"Cannot read the remnant {path}: {error.strerror or error}") from None
    return _remnants_of_drawing(path, drawing, unit)


def _remnants_of_drawing(path: Path, drawing: LineDrawing, unit: str) -> list[Remnant]:
    """Return the areas enclosed by the lines of a drawing, with remarks about an assumed unit and unread elements."""
    import shapely

    if not all(np.isfinite(points).all() for points, _ in drawing.lines):
        raise FlexMapsError(f"The drawing {path.stem} has coordinates that are not numbers; draw it again")
    extent = max((float(np.ptp(points, axis=0).max()) for points, _ in drawing.lines), default=0.0) * 1e-3
    if extent > MAX_EXTENT:
        raise FlexMapsError(
            f"The drawing {path.stem} is {extent:.0f} m large; look at its unit, which should be the millimetre"
        )
    parts = [
        p for p in enclosed_areas((1e-3 * points, closed) for points, closed in drawing.lines) if p.area > MIN_AREA
    ]
    unread = ", ".join(sorted(drawing.unsupported))
    if not parts:
        what = f"; it holds {unread}, which is not read" if unread else ""
        raise FlexMapsError(
            f"There is no closed outline in {path.name}{what}; draw the remnant as a closed polyline, in its true size"
        )
    remarks = [f"{path.name} names no unit: its lengths are read as {unit}"] if drawing.unitless else []
    remarks += [f"{path.name} holds what is not read: {unread}"] if unread else []
    found = []
    for part in map(shapely.geometry.polygon.orient, parts):
        low = np.array(part.bounds[:2])
        holes = tuple(np.asarray(r.coords)[:-1] - low for r in part.interiors)
        found.append(Remnant(path.stem, np.asarray(part.exterior.coords)[:-1] - low, holes, tuple(remarks)))
    return found

"""DXF files of the sheets: millimetres, one named layer per operation, polylines with arcs (through ezdxf)."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from .errors import FlexMapsError
from .files import replacing_many
from .sheets import CutSheets
from .svg import PROGRAM, NewFile, numbered, numbered_before, operations

# name and AutoCAD colour index, in the order of the work; 7 is black on white
LAYERS = (("ENGRAVE", 7), ("CUT_INNER", 5), ("CUT_OUTER", 1))
VERSIONS = ("R12", "R2010")


def write(
    sheets: CutSheets, path: str | os.PathLike[str], version: str = "R2010", new: NewFile | None = None
) -> list[Path]:
    """Write one file per sheet: ``path`` out/sheet.dxf gives out/sheet-01.dxf, out/sheet-02.dxf, ...; returns their paths.

    version : "R2010", the richer, or "R12", which every cutter's program reads. All files appear or none; ``new`` comes
    from ``files.replacing_many`` where they shall appear together with others. Raises ``FlexMapsError`` where they cannot be
    written.
    """
    if version not in VERSIONS:
        raise FlexMapsError(f"DXF version '{version}' is not one of {', '.join(VERSIONS)}")
    if new is None:
        with replacing_many(numbered_before(path, sheets.count)) as new:
            return write(sheets, path, version, new)
    paths = numbered(path, sheets.count)
    for index, target in enumerate(paths):
        _document(sheets, index, version).saveas(new(target))
    return paths


def _document(sheets: CutSheets, index: int, version: str):  # type: ignore[no-untyped-def]  # ezdxf's Drawing
    import ezdxf
    from ezdxf import units

    document = ezdxf.new(version)
    if version != "R12":  # which has no units; millimetres are its custom
        document.units = units.MM
        document.header["$MEASUREMENT"] = 1
    document.header["$EXTMIN"] = (0.0, 0.0, 0.0)
    document.header["$EXTMAX"] = (*(float(x) * 1e3 for x in sheets.packing.sizes[index]), 0.0)
    document.header["$LIMMAX"] = document.header["$EXTMAX"][:2]
    if version != "R12":
        document.header.custom_vars.append("Program", PROGRAM)
    for name, colour in LAYERS:
        document.layers.add(name, color=colour)
    space = document.modelspace()
    for (name, _), curves in zip(LAYERS, operations(sheets.on_sheet(index)), strict=True):
        for curve in curves:
            rows = np.column_stack([np.round(curve.points * 1e3, 6), curve.bulge]).tolist()
            if version == "R12":
                space.add_polyline2d(rows, format="xyb", close=curve.closed, dxfattribs={"layer": name})
            else:
                space.add_lwpolyline(rows, format="xyb", close=curve.closed, dxfattribs={"layer": name})
    return document

"""DXF files of the sheets: millimetres, one named layer per operation, polylines with arcs (through ezdxf)."""

from __future__ import annotations

import io
import logging
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

import numpy as np

from ... import PROGRAM
from ...errors import FlexMapsError
from ...files import NewFile, replacing_many
from ...progress import SILENT, Progress
from ...spirals.arcs import Curve
from ..sheets import CutSheets
from .series import numbered, numbered_before
from .svg import WRITING, operations

# name and AutoCAD colour index, in the order of the work; 7 is black on white
LAYERS = (("ENGRAVE", 7), ("CUT_INNER", 5), ("CUT_OUTER", 1))
VERSIONS = ("R12", "R2010")
TOLD = 1000  # pieces of text that are written from one word of the progress to the next, some hundredths of a second


def write(
    sheets: CutSheets,
    path: str | os.PathLike[str],
    version: str = "R2010",
    new: NewFile | None = None,
    progress: Progress = SILENT,
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
            return write(sheets, path, version, new, progress)
    paths = numbered(path, sheets.count)
    for index, target in enumerate(paths):
        part = progress.part(index / sheets.count, (index + 1) / sheets.count)
        if version == "R12":
            new(target).write_text(_r12(sheets, index, part), encoding="ascii", newline="\r\n")
        else:
            drawing = _document(sheets, index, version, _entities(sheets, index, part.part(0.0, 0.7)))
            with open(new(target), "w", encoding=drawing.output_encoding) as stream:
                drawing.write(_Told(stream, part.part(0.7, 0.7)))
    return paths


class _Told:
    """A stream that tells the progress of what is written to it, for ezdxf writes a whole drawing at once."""

    def __init__(self, stream: TextIO, progress: Progress):
        self.stream, self.progress, self.count = stream, progress, 0

    def write(self, text: str) -> None:
        self.count += 1
        if self.count % TOLD == 0:
            self.progress(0.0, WRITING)
        self.stream.write(text)


def _document(  # type: ignore[no-untyped-def]  # ezdxf's Drawing
    sheets: CutSheets, index: int, version: str, entities: Iterable[tuple[str, Curve]] = ()
):
    import ezdxf
    from ezdxf import units

    with _quiet():  # R12 has no units, millimetres are its custom, and ezdxf warns of that every time
        document = ezdxf.new(version, units=units.MM)
    if version != "R12":
        document.header["$MEASUREMENT"] = 1
        document.header.custom_vars.append("Program", PROGRAM)
    document.header["$EXTMIN"] = (0.0, 0.0, 0.0)
    document.header["$EXTMAX"] = (*(float(x) * 1e3 for x in sheets.packing.sizes[index]), 0.0)
    document.header["$LIMMAX"] = document.header["$EXTMAX"][:2]
    for name, colour in LAYERS:
        document.layers.add(name, color=colour)
    for name, curve in entities:
        document.modelspace().add_lwpolyline(_rows(curve), format="xyb", close=curve.closed, dxfattribs={"layer": name})
    return document


@contextmanager
def _quiet() -> Iterator[None]:
    logger = logging.getLogger("ezdxf")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)


def _entities(sheets: CutSheets, index: int, progress: Progress) -> Iterator[tuple[str, Curve]]:
    for (name, _), curves in zip(LAYERS, operations(sheets, index, progress), strict=True):
        for curve in curves:
            yield name, curve


def _rows(curve: Curve) -> list[list[float]]:
    """x and y in mm, and the bulge, of every node."""
    return np.column_stack([np.round(curve.points * 1e3, 6), curve.bulge]).tolist()


def _r12(sheets: CutSheets, index: int, progress: Progress) -> str:
    """An R12 document: header and tables from ezdxf; the polylines, one entity per node there, written straight into it."""
    frame = io.StringIO()
    _document(sheets, index, "R12").write(frame)
    before, mark, after = frame.getvalue().partition("  2\nENTITIES\n")
    assert mark, "a DXF document has a section of entities"
    parts = [f"999\n{PROGRAM}\n", before, mark]  # a comment: R12 has no place for the program's name
    for name, curve in _entities(sheets, index, progress):
        parts.append(f"  0\nPOLYLINE\n  8\n{name}\n 66\n1\n 10\n0.0\n 20\n0.0\n 30\n0.0\n 70\n{int(curve.closed)}\n")
        head = f"  0\nVERTEX\n  8\n{name}\n 10\n"
        parts.extend(f"{head}{x:.10g}\n 20\n{y:.10g}\n 30\n0.0\n 42\n{bulge:.12g}\n" for x, y, bulge in _rows(curve))
        parts.append(f"  0\nSEQEND\n  8\n{name}\n")
    return "".join([*parts, after])

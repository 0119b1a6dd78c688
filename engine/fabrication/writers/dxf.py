"""DXF files of the sheets: millimetres, one named layer per operation, polylines with arcs (through ezdxf)."""

from __future__ import annotations

import io
import logging
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

import numpy as np

from ... import MARK
from ...progress import SILENT, Progress
from ...spirals.arcs import Curve
from .operations import FRAME, OPERATIONS, WRITING, Drawn, Operation, frame, on_sheet

FLAT = 1e-4  # bulge; FreeCAD loses whole polylines at flatter arcs, and one of 20 mm is then 1 um off
WRITES = 250  # pieces of text that are written from one word of the progress to the next, some hundredths of a second


def write(sheets: Drawn, index: int, path: Path, progress: Progress = SILENT) -> None:
    """Write one sheet as R2010, which knows its units."""
    drawing = _document(sheets, index, "R2010", _entities(sheets, index, progress.part(0.0, 0.7)))
    with open(path, "w", encoding=drawing.output_encoding) as stream:
        drawing.write(_Monitored(stream, progress.part(0.7, 0.7)))


def write_r12(sheets: Drawn, index: int, path: Path, progress: Progress = SILENT) -> None:
    """Write one sheet as R12, which every cutter's program reads.

    Header and tables come from ezdxf; the polylines, one entity per node there, are written straight between them.
    """
    frame = io.StringIO()
    _document(sheets, index, "R12").write(frame)
    before, mark, after = frame.getvalue().partition("  2\nENTITIES\n")
    assert mark, "a DXF document has a section of entities"
    parts = [f"999\n{MARK}\n", before, mark]  # a comment: R12 has no place for the program's name
    for name, curve in _entities(sheets, index, progress):
        parts.append(f"  0\nPOLYLINE\n  8\n{name}\n 66\n1\n 10\n0.0\n 20\n0.0\n 30\n0.0\n 70\n{int(curve.closed)}\n")
        head = f"  0\nVERTEX\n  8\n{name}\n 10\n"
        # some programs lose every polyline that has the bulge of a straight segment
        parts.extend(
            f"{head}{x:.10g}\n 20\n{y:.10g}\n 30\n0.0\n{f' 42{chr(10)}{bulge:.12g}{chr(10)}' if bulge else ''}"
            for x, y, bulge in _rows(curve)
        )
        parts.append(f"  0\nSEQEND\n  8\n{name}\n")
    path.write_text("".join([*parts, after]), encoding="ascii", newline="\r\n")


class _Monitored:
    """A stream that reports to the progress while it is written to, for ezdxf writes a whole drawing at once."""

    def __init__(self, stream: TextIO, progress: Progress):
        self.stream, self.progress, self.count = stream, progress, 0

    def write(self, text: str) -> None:
        self.count += 1
        if self.count % WRITES == 0:
            self.progress(0.0, WRITING)
        self.stream.write(text)


def _document(  # type: ignore[no-untyped-def]  # ezdxf's Drawing
    sheets: Drawn, index: int, version: str, entities: Iterable[tuple[str, Curve]] = ()
):
    import ezdxf
    from ezdxf import units

    with _quiet():  # R12 has no units, millimetres are its custom, and ezdxf warns of that every time
        document = ezdxf.new(version, units=units.MM)
    if version != "R12":
        document.header["$MEASUREMENT"] = 1
        document.header.custom_vars.append("Program", MARK)
    size = tuple(float(x) * 1e3 for x in sheets.packing.sizes[index])
    # ezdxf writes those of the modelspace, but the header's where they begin at the origin
    document.header["$EXTMIN"], document.header["$EXTMAX"] = (0.0, 0.0, 0.0), (*size, 0.0)
    document.modelspace().reset_extents((0.0, 0.0, 0.0), (*size, 0.0))
    document.modelspace().reset_limits((0.0, 0.0), size)
    for operation in OPERATIONS:
        document.layers.add(_layer(operation), color=operation.aci)
    if sheets.params.frame:
        document.layers.add(_layer(FRAME), color=FRAME.aci, plot=False)
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


def _entities(sheets: Drawn, index: int, progress: Progress) -> Iterator[tuple[str, Curve]]:
    for operation, curves in on_sheet(sheets, index, progress):
        for curve in curves:
            yield _layer(operation), curve
    for curve in frame(sheets, index):
        yield _layer(FRAME), curve


def _layer(operation: Operation) -> str:
    return operation.name.upper().replace(" ", "_")


def _rows(curve: Curve) -> list[list[float]]:
    """x and y in mm, and the bulge, of every node; 0 for arcs that are flatter than FreeCAD reads."""
    bulge = np.where(np.abs(curve.bulge) < FLAT, 0.0, curve.bulge)
    return np.column_stack([np.round(curve.points * 1e3, 6), bulge]).tolist()

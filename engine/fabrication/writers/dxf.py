"""DXF files of the sheets: millimetres, one named layer per operation, polylines with arcs (through ezdxf)."""

from __future__ import annotations

import io
import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ... import MARK
from ...progress import SILENT, Progress
from ...spirals.curves.arcs import Curve
from .operations import FRAME, OPERATIONS, DrawableSheets, Operation, curves_by_operation, frame_curves

# Minimum bulge of an arc; flatter arcs become straight lines, because FreeCAD loses polylines that contain them. Larger
# is less exact; at 1e-4 the error is 1 um on a chord of 20 mm
MIN_BULGE = 1e-4


def write_dxf(sheets: DrawableSheets, index: int, path: Path, progress: Progress = SILENT) -> None:
    """Write one sheet as DXF R2010, which stores its units.

    Parameters
    ----------
    sheets : the sheets
    index : number of the sheet, from 0
    path : file to write
    progress : called with the fraction done; may cancel
    """
    document = _new_document(sheets, index, "R2010")
    owner, handles = document.modelspace().layout_key, document.entitydb.handles
    parts, handle = list[str](), int(str(handles), 16)
    for name, curve in _entities(sheets, index, progress):
        parts.append(
            f"  0\nLWPOLYLINE\n  5\n{handle:X}\n330\n{owner}\n100\nAcDbEntity\n  8\n{name}\n100\nAcDbPolyline\n"
            f" 90\n{len(curve.points)}\n 70\n{int(curve.closed)}\n"
        )
        parts.extend(f" 10\n{x}\n 20\n{y}\n{_bulge_tag(bulge, 17)}" for x, y, bulge in _node_rows(curve))
        handle += 1
    handles.reset(f"{handle:X}")  # the next free handle, which ezdxf writes into the header
    path.write_text(_with_entities(document, parts), encoding=document.output_encoding)


def write_dxf_r12(sheets: DrawableSheets, index: int, path: Path, progress: Progress = SILENT) -> None:
    """Write one sheet as DXF R12, which the programs of all cutters read; every vertex is an entity of its own.

    Parameters
    ----------
    sheets, index, path, progress : as for ``write_dxf``
    """
    parts = list[str]()
    for name, curve in _entities(sheets, index, progress):
        parts.append(f"  0\nPOLYLINE\n  8\n{name}\n 66\n1\n 10\n0.0\n 20\n0.0\n 30\n0.0\n 70\n{int(curve.closed)}\n")
        head = f"  0\nVERTEX\n  8\n{name}\n 10\n"
        parts.extend(
            f"{head}{x:.10g}\n 20\n{y:.10g}\n 30\n0.0\n{_bulge_tag(bulge, 12)}" for x, y, bulge in _node_rows(curve)
        )
        parts.append(f"  0\nSEQEND\n  8\n{name}\n")
    # R12 has no field for the program's name, so write it as a comment (group code 999)
    text = f"999\n{MARK}\n{_with_entities(_new_document(sheets, index, 'R12'), parts)}"
    path.write_text(text, encoding="ascii", newline="\r\n")


def _bulge_tag(bulge: float, digits: int) -> str:
    """Return the DXF tag of a bulge; empty if it is 0, because some programs lose polylines with a bulge of 0."""
    return f" 42\n{bulge:.{digits}g}\n" if bulge else ""


def _with_entities(document: Any, entities: Sequence[str]) -> str:
    """Return the text of a document with these entities inserted; ezdxf would write them ten times as slowly."""
    stream = io.StringIO()
    document.write(stream)
    before, mark, after = stream.getvalue().partition("  2\nENTITIES\n")
    assert mark, "a DXF document has a section of entities"
    return "".join([before, mark, *entities, after])


def _new_document(sheets: DrawableSheets, index: int, version: str) -> Any:
    """Return a document with header and layers for one sheet."""
    import ezdxf
    from ezdxf import units

    with _without_warnings():  # ezdxf warns that R12 stores no units; millimetres are customary there
        document = ezdxf.new(version, units=units.MM)
    if version != "R12":
        document.header["$MEASUREMENT"] = 1
        document.header.custom_vars.append("Program", MARK)
    size = tuple(float(x) * 1e3 for x in sheets.packing.sizes[index])
    # when it writes the file, ezdxf replaces the header's extents by those of the modelspace, so set both
    document.header["$EXTMIN"], document.header["$EXTMAX"] = (0.0, 0.0, 0.0), (*size, 0.0)
    document.modelspace().reset_extents((0.0, 0.0, 0.0), (*size, 0.0))
    document.modelspace().reset_limits((0.0, 0.0), size)
    for operation in OPERATIONS:
        document.layers.add(_layer_name(operation), color=operation.aci)
    if sheets.params.frame:
        document.layers.add(_layer_name(FRAME), color=FRAME.aci, plot=False)
    return document


@contextmanager
def _without_warnings() -> Iterator[None]:
    """Suppress warnings of ezdxf."""
    logger = logging.getLogger("ezdxf")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)


def _entities(sheets: DrawableSheets, index: int, progress: Progress) -> Iterator[tuple[str, Curve]]:
    """Yield the name of the layer and the curve, for every cut and for every line of the frame."""
    for operation, curves in curves_by_operation(sheets, index, progress):
        for curve in curves:
            yield _layer_name(operation), curve
    for curve in frame_curves(sheets, index):
        yield _layer_name(FRAME), curve


def _layer_name(operation: Operation) -> str:
    """Return the name of an operation's layer."""
    return operation.name.upper().replace(" ", "_")


def _node_rows(curve: Curve) -> list[list[float]]:
    """Return x and y in mm and the bulge of every node; a bulge below ``MIN_BULGE`` becomes 0."""
    bulge = np.where(np.abs(curve.bulge) < MIN_BULGE, 0.0, curve.bulge)
    return np.column_stack([np.round(curve.points * 1e3, 6), bulge]).tolist()

"""What is done to a sheet, operation by operation, and how every kind of flat file tells the operations apart."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from ...params import CutParams, SheetParams
from ...progress import SILENT, Progress
from ...spirals.arcs import Curve
from ..nesting.packing import Packing
from ..panels.toolpath import Runs


class Drawn(Protocol):
    """What flat files are written from: ``CutSheets``, or any other sheets whose runs are known."""

    @property
    def packing(self) -> Packing: ...
    @property
    def params(self) -> SheetParams: ...
    @property
    def cut(self) -> CutParams: ...
    @property
    def count(self) -> int: ...
    def runs(self, index: int, progress: Progress = SILENT) -> Runs: ...


class Operation(NamedTuple):
    """Its name, the colour "#rrggbb" that programs of laser cutters know it by, and AutoCAD's colour index (ACI)."""

    name: str
    colour: str
    aci: int


# in the order of the work: nothing moves before it is engraved, and a panel comes loose last; ACI 7 is black on white
OPERATIONS = (
    Operation("engrave", "#000000", 7),
    Operation("cut inner", "#0000ff", 5),
    Operation("cut outer", "#ff0000", 1),
)
# LightBurn's first tool layer, whose lines it shows and never cuts; in DXF the layer is one that is not plotted
FRAME = Operation("sheet", "#f36926", 30)
ORIGIN = 0.005  # metres, length of the mark at the sheet's origin; the letters of a label are half as high
WRITING = "writing the sheets"  # what the progress says


def frame(sheets: Drawn, index: int) -> list[Curve]:
    """The edge of one sheet, and a stroke from its origin, the lower left corner of its box, into the sheet; none if not wanted."""
    if not sheets.params.frame:
        return []
    width, height = sheets.packing.sizes[index].tolist()
    corners = np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])
    edges = [corners]
    if index < len(sheets.packing.remnants):
        remnant = sheets.packing.remnants[index]
        edges = [remnant.outline, *remnant.holes]
    lines = [Curve(points, np.zeros(len(points))) for points in edges]
    return [*lines, Curve(np.array([[0.0, 0.0], [ORIGIN, ORIGIN]]), np.zeros(2), closed=False)]


def on_sheet(sheets: Drawn, index: int, progress: Progress = SILENT) -> Iterator[tuple[Operation, Iterator[Curve]]]:
    """Every operation with its curves on one sheet; ``progress`` hears of the curves as they are asked for."""
    runs = sheets.runs(index, progress.part(0.0, 0.5))
    curves = [runs.engraved, runs.inner, runs.outer]
    total = max(sum(map(len, curves)), 1)
    done = iter(range(total))

    def heard(some: Sequence[Curve]) -> Iterator[Curve]:
        for curve in some:
            progress(0.5 + 0.5 * next(done) / total, WRITING)
            yield curve

    return zip(OPERATIONS, map(heard, curves), strict=True)

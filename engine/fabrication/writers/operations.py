"""The operations on a sheet, and how flat files distinguish them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from ...params import CutParams, SheetParams
from ...progress import SILENT, Progress
from ...spirals.curves.arcs import Curve
from ..nesting.packing import Packing
from ..panels.toolpath import SheetCuts


class DrawableSheets(Protocol):
    """Input of the flat files: ``CutSheets``, or other sheets with known cuts."""

    @property
    def packing(self) -> Packing: ...
    @property
    def params(self) -> SheetParams: ...
    @property
    def cut(self) -> CutParams: ...
    @property
    def count(self) -> int: ...
    def runs(self, index: int, progress: Progress = SILENT) -> SheetCuts: ...


class Operation(NamedTuple):
    """Name, colour "#rrggbb" by which laser cutters' programs identify it, and AutoCAD's colour index (ACI)."""

    name: str
    colour: str
    aci: int


# In the order of the work: engrave before anything can move, and release panels last. ACI 7 is black on white
OPERATIONS = (
    Operation("engrave", "#000000", 7),
    Operation("cut inner", "#0000ff", 5),
    Operation("cut outer", "#ff0000", 1),
)
# LightBurn's first tool layer, which is shown and never cut; in DXF a layer that is not plotted
FRAME = Operation("sheet", "#f36926", 30)
ORIGIN = 0.005  # extent in x and y of the mark at the origin of a sheet, metres; twice the usual height of letters
WRITING = "writing the sheets"  # text of the progress


def frame(sheets: DrawableSheets, index: int) -> list[Curve]:
    """Return the edge of one sheet and a stroke from its lower left corner inwards; empty if not requested."""
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


def on_sheet(
    sheets: DrawableSheets, index: int, progress: Progress = SILENT
) -> Iterator[tuple[Operation, Iterator[Curve]]]:
    """Yield every operation with its curves on one sheet; ``progress`` advances as the curves are consumed."""
    runs = sheets.runs(index, progress.part(0.0, 0.5))
    curves = [runs.engraved, runs.inner, runs.outer]
    total = max(sum(map(len, curves)), 1)
    done = iter(range(total))

    def heard(some: Sequence[Curve]) -> Iterator[Curve]:
        for curve in some:
            progress(0.5 + 0.5 * next(done) / total, WRITING)
            yield curve

    return zip(OPERATIONS, map(heard, curves), strict=True)

"""The operations on a sheet, and the colours and layer names by which files distinguish them."""

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
    """Input of the writers of SVG, DXF and PDF: ``CutSheets``, or any other sheets with cuts."""

    @property
    def packing(self) -> Packing: ...
    @property
    def params(self) -> SheetParams: ...
    @property
    def cut(self) -> CutParams: ...
    @property
    def count(self) -> int: ...
    def cuts_on_sheet(self, index: int, progress: Progress = SILENT) -> SheetCuts: ...


class Operation(NamedTuple):
    """An operation of the cutter.

    colour : "#rrggbb", by which the programs of laser cutters identify the operation
    aci : AutoCAD's colour index, for DXF
    """

    name: str
    colour: str
    aci: int


# In the order of cutting: engraving comes before parts can move, and outlines, which release the panels, come last.
# Colour index 7 is shown as black on a white background
OPERATIONS = (
    Operation("engrave", "#000000", 7),
    Operation("cut inner", "#0000ff", 5),
    Operation("cut outer", "#ff0000", 1),
)
# edge of the sheet, shown but not cut: the colour of LightBurn's first tool layer, and in DXF a layer without plotting
FRAME = Operation("sheet", "#f36926", 30)
ORIGIN_MARK_SIZE = (
    0.005  # extent in x and y of the mark at the origin of a sheet, metres; twice the usual height of letters
)
WRITING = "writing the sheets"  # text shown with the progress


def frame_curves(sheets: DrawableSheets, index: int) -> list[Curve]:
    """Return the edges of one sheet and a stroke that marks its origin; empty if the frame is not requested."""
    if not sheets.params.frame:
        return []
    width, height = sheets.packing.sizes[index].tolist()
    corners = np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])
    edges = [corners]
    if index < len(sheets.packing.remnants):
        remnant = sheets.packing.remnants[index]
        edges = [remnant.outline, *remnant.holes]
    lines = [Curve(points, np.zeros(len(points))) for points in edges]
    return [*lines, Curve(np.array([[0.0, 0.0], [ORIGIN_MARK_SIZE, ORIGIN_MARK_SIZE]]), np.zeros(2), closed=False)]


def curves_by_operation(
    sheets: DrawableSheets, index: int, progress: Progress = SILENT
) -> Iterator[tuple[Operation, Iterator[Curve]]]:
    """Yield every operation with its curves on one sheet; ``progress`` advances while the curves are consumed."""
    runs = sheets.cuts_on_sheet(index, progress.part(0.0, 0.5))
    curves = [runs.engraving, runs.inner_cuts, runs.outer_cuts]
    total = max(sum(map(len, curves)), 1)
    done = iter(range(total))

    def heard(some: Sequence[Curve]) -> Iterator[Curve]:
        for curve in some:
            progress(0.5 + 0.5 * next(done) / total, WRITING)
            yield curve

    return zip(OPERATIONS, map(heard, curves), strict=True)

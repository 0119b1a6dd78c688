"""Lay the calibration pieces on a sheet that is no larger than needed, and write its files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...errors import FlexMapsError
from ...fabrication.nesting.packing import Packing
from ...fabrication.panels.toolpath import SheetCuts
from ...fabrication.writers import dxf, pdf, svg
from ...files import write_all_atomically
from ...own_files import Guard
from ...params import CutParams, Settings, SheetParams
from ...progress import SILENT, Progress
from . import calibration_pieces
from .calibration_pieces import DrawnPiece
from .coupons import CALIBRATION_FILE, KINDS, Coupons
from .sizes import choose_coupons

WRITERS = {
    "svg": (".svg", svg.write_svg),
    "dxf": (".dxf", dxf.write_dxf),
    "dxf-r12": ("-r12.dxf", dxf.write_dxf_r12),
    "pdf": (".pdf", pdf.write_pdf),
}
DEFAULT_FORMATS = ("svg", "dxf", "pdf")


@dataclass(frozen=True, eq=False)
class CalibrationDrawing:
    """One sheet of calibration pieces, metres, in the form that the file writers need.

    coupons : sizes of the pieces, stored for the evaluation
    pieces : drawings of the pieces in their places, with finished sizes
    packing : size of the sheet, without panels
    """

    coupons: Coupons
    pieces: tuple[DrawnPiece, ...]
    packing: Packing
    params: SheetParams
    cut: CutParams
    count: int = 1

    def cuts_on_sheet(self, index: int, progress: Progress = SILENT) -> SheetCuts:
        """Return the cutter's paths: shared lines unchanged, outlines and holes offset by half of the kerf.

        The arguments are unused; the file writers expect them.
        """
        made = calibration_pieces.combine_pieces(
            piece.cut(self.coupons.kerf, self.coupons.kerf_holes) for piece in self.pieces
        )
        return SheetCuts(made.engraved, (*made.holes, *made.shared), made.outlines, 0, 0)


def make_calibration_sheet(settings: Settings) -> CalibrationDrawing:
    """Make the calibration sheet for the machine and the material in these settings."""
    sizes = choose_coupons(settings)
    says = f"{sizes.material} {sizes.thickness * 1e3:g} mm - drawn for a kerf of {sizes.kerf * 1e3:g}"
    pieces = [
        *(calibration_pieces.draw_spiral(sizes, one) for one in sizes.spirals),
        calibration_pieces.draw_strip(sizes),
        calibration_pieces.draw_comb(sizes, says),
        *(calibration_pieces.draw_ladder(sizes, settings.connect, kind) for kind in KINDS),
    ]
    margin, spacing = settings.sheet.margin, max(settings.sheet.spacing, 2.0 * max(sizes.kerf, sizes.mill))
    placed, size = _arrange_in_rows(pieces, margin, spacing)
    nothing = np.zeros(0)
    packing = Packing(nothing.astype(int), nothing, nothing.reshape(0, 2), size[None])
    return CalibrationDrawing(sizes, placed, packing, replace(settings.sheet, frame=True), settings.cut)


def _arrange_in_rows(
    pieces: Sequence[DrawnPiece], margin: float, spacing: float
) -> tuple[tuple[DrawnPiece, ...], np.ndarray]:
    """Lay the pieces in rows from the top, two in the first; return them and the sheet's width and height, metres."""
    boxes = [piece.box for piece in pieces]
    width = max(float(np.ptp([b[0][0], b[1][0]])) for b in boxes)
    width = max(width, float(sum(b[1][0] - b[0][0] for b in boxes[:2])) + spacing)
    x, y, high, placed = 0.0, 0.0, 0.0, []
    for piece, (low, top) in zip(pieces, boxes, strict=True):
        if x > 0.0 and x + top[0] - low[0] > width + 1e-9:
            x, y, high = 0.0, y - high - spacing, 0.0
        placed.append(piece.moved(np.array([x, y]) - [low[0], top[1]]))
        x, high = x + float(top[0] - low[0]) + spacing, max(high, float(top[1] - low[1]))
    shift = np.array([margin, margin + high - y])
    return tuple(p.moved(shift) for p in placed), np.array([width, high - y]) + 2.0 * margin


def write_calibration_sheet(
    sheet: CalibrationDrawing,
    folder: Path,
    formats: Sequence[str] = DEFAULT_FORMATS,
    name: str = "calibration",
    progress: Progress = SILENT,
    guard: Guard | None = None,
) -> list[Path]:
    """Write the sheet's files and ``calibration.json`` into a folder, all or none; return their paths.

    Parameters
    ----------
    sheet : drawing of the calibration pieces
    folder : folder for the files, made if it is missing
    formats : keys of ``WRITERS``
    name : name of the files without suffix
    progress : called with the fraction done; may cancel
    guard : refuses to replace files that this program did not write

    Raises
    ------
    FlexMapsError : an unknown format, or none
    """
    unknown = set(formats) - set(WRITERS)
    if unknown or not formats:
        wrong = f"There is no format '{min(unknown)}' of the calibration sheet" if unknown else "No format is chosen"
        raise FlexMapsError(f"{wrong}; choose among {', '.join(WRITERS)}")
    written = []
    with write_all_atomically(alone_in=folder, guard=guard) as new:
        for key in dict.fromkeys(formats):
            ending, writer = WRITERS[key]
            written.append(folder / f"{name}{ending}")
            writer(sheet, 0, new(written[-1]), progress)
        written.append(folder / CALIBRATION_FILE)
        new(written[-1]).write_text(sheet.coupons.text(), encoding="utf-8")
    return written

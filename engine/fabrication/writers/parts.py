"""Parts list as CSV: a row for every panel, plate and loose key, for spreadsheets, orders and checks."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ... import MARK
from ...materials import Material
from ...spirals.design import SpiralDesign
from ...surface.checking.finding import with_count
from ..panels.labels import panel_name
from ..sheets import CutSheets

COLUMNS = (
    "part",
    "kind",
    "sheet",
    "spirals",
    "joints",
    "width_mm",
    "height_mm",
    "area_cm2",
    "cut_length_mm",
    "mass_g",
    "note",
)


def write_parts_list(sheets: CutSheets, designs: Sequence[SpiralDesign], material: Material, path: Path) -> Path:
    """Write the parts list as CSV (RFC 4180), with sums in its last row, and return its path.

    Width and height describe the bounding box of a part as it lies on its sheet; holes do not count as area. A part's
    row counts its side of every joint, and the last row counts every joint once.

    Parameters
    ----------
    sheets : the sheets
    designs : designs of the pieces on the sheets, indexed by ``Panel.piece``
    material : material of the sheets
    path : file to write
    """
    rows = _part_rows(sheets, designs, material)
    numbers = range(COLUMNS.index("spirals"), COLUMNS.index("note"))
    boxes = {COLUMNS.index("width_mm"), COLUMNS.index("height_mm")}
    sums = ["" if i in boxes else _format(sum(row[i] for row in rows)) for i in numbers]
    sums[COLUMNS.index("joints") - numbers.start] = _format(
        sum(int(design.flat.layout.cut.sum()) for design in designs)
    )
    with open(path, "w", encoding="utf-8", newline="") as stream:
        table = csv.writer(stream)
        table.writerow(COLUMNS)
        table.writerows([*row[: numbers.start], *map(_format, row[numbers.start :]), ""] for row in rows)
        table.writerow([f"{with_count(len(rows), 'part', 'parts')}", "", sheets.count, *sums, MARK])
    return path


def _part_rows(sheets: CutSheets, designs: Sequence[SpiralDesign], material: Material) -> list[list[float]]:
    """Return one row of values per part, in the order of ``COLUMNS`` without the last, the note."""
    where, found, of_kind = sheets.packing, [], Counter[tuple[int, str]]()
    for number, panel in enumerate(sheets.panels):
        layout = designs[panel.piece].flat.layout
        quads = layout.patches[panel.patch] if panel.patch >= 0 else np.zeros(0, dtype=np.int64)
        joints = layout.cut[layout.mesh.quad_edges[quads]].sum()
        of_kind[panel.piece, panel.kind] += 1
        count = of_kind[panel.piece, panel.kind]
        placed = panel.outline.transform(float(where.rotation[number]), where.shift[number])
        width, height = np.ptp(placed.sample(1e-5), axis=0) * 1e3
        length = sum(curve.length for curve in (panel.outline, *panel.holes))
        mass = material.density * sheets.thickness * panel.area
        found.append([
            panel_name(panel.number, panel.mark) if panel.patch >= 0 else f"{panel.mark} {panel.kind} {count}".strip(),
            panel.kind, int(where.sheet[number]) + 1, len(quads), int(joints),
            width, height, panel.area * 1e4, length * 1e3, mass * 1e3,
        ])  # fmt: skip
    return found


def _format(value: float) -> str:
    """Format a number with two decimals, or an integer without."""
    return str(value) if isinstance(value, int) else f"{value:.2f}"

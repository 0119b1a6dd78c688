"""SVG files of the sheets: true millimetres, one layer and colour per operation, arcs as arcs."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path

import numpy as np

from ... import PROGRAM
from ...files import NewFile, replacing_many
from ...progress import SILENT, Progress
from ...spirals.arcs import Curve
from ..sheets import CutSheets
from .series import numbered, numbered_before

# in the order of the work: nothing moves before it is engraved, and a panel comes loose last
LAYERS = (("engrave", "#000000"), ("cut inner", "#0000ff"), ("cut outer", "#ff0000"))
WRITING = "writing the sheets"  # what the progress says
HAIRLINE = 0.0254  # mm; a thousandth of an inch, which drivers of laser cutters take for a cut


def write(
    sheets: CutSheets, path: str | os.PathLike[str], new: NewFile | None = None, progress: Progress = SILENT
) -> list[Path]:
    """Write one file per sheet: ``path`` out/sheet.svg gives out/sheet-01.svg, out/sheet-02.svg, ...; returns their paths.

    All of them appear or none. ``new`` comes from ``files.replacing_many`` where they shall appear together with others.
    Raises ``FlexMapsError`` where they cannot be written.
    """
    if new is None:
        with replacing_many(numbered_before(path, sheets.count)) as new:
            return write(sheets, path, new, progress)
    paths = numbered(path, sheets.count)
    for index, target in enumerate(paths):
        part = progress.part(index / sheets.count, (index + 1) / sheets.count)
        new(target).write_text(text(sheets, index, part), encoding="utf-8")
    return paths


def operations(sheets: CutSheets, index: int, progress: Progress = SILENT) -> list[Iterator[Curve]]:
    """The curves of every layer of ``LAYERS`` on one sheet; ``progress`` hears of them as they are asked for."""
    runs = sheets.runs(index, progress.part(0.0, 0.5))
    layers = [runs.engraved, runs.inner, runs.outer]
    total = max(sum(map(len, layers)), 1)
    done = iter(range(total))

    def told(curves: Sequence[Curve]) -> Iterator[Curve]:
        for curve in curves:
            progress(0.5 + 0.5 * next(done) / total, WRITING)
            yield curve

    return [told(curves) for curves in layers]


def text(sheets: CutSheets, index: int, progress: Progress = SILENT) -> str:
    """The SVG document of one sheet."""
    width, height = (float(x) * 1e3 for x in sheets.packing.sizes[index])
    title = escape(f"sheet {index + 1} of {sheets.count}")
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<svg xmlns="http://www.w3.org/2000/svg" xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" version="1.1"'
        f' width="{width:.6g}mm" height="{height:.6g}mm" viewBox="0 0 {width:.6g} {height:.6g}">',
        f"<title>{title}</title>",
        f"<metadata>{PROGRAM}</metadata>",
    ]
    for (name, colour), curves in zip(LAYERS, operations(sheets, index, progress), strict=True):
        lines.append(
            f'<g id="{name.replace(" ", "-")}" inkscape:groupmode="layer" inkscape:label="{name}" fill="none"'
            f' stroke="{colour}" stroke-width="{HAIRLINE}">'
        )
        lines.extend(f'<path d="{path_data(c, height)}"/>' for c in curves)
        lines.append("</g>")
    lines.append("</svg>\n")
    return "\n".join(lines)


def path_data(curve: Curve, height: float) -> str:
    """The path of a curve on a sheet of this height in mm, y pointing down as SVG has it."""
    points = np.round(curve.points * 1e3, 4)
    x, y = points[:, 0], np.round(height - points[:, 1], 4)
    after = np.roll(points, -1, axis=0)
    bulge = curve.bulge
    chord = np.linalg.norm(after - points, axis=1)
    size = np.abs(bulge)
    radius = chord * (1.0 + size * size) / (4.0 * np.maximum(size, 1e-12))
    # flatter than a thousandth of the rounding: a straight line
    straight = size * chord < 1e-6
    count = len(points) if curve.closed else len(points) - 1
    parts = [f"M{x[0]:.10g} {y[0]:.10g}"]
    ends = zip(np.roll(x, -1)[:count].tolist(), np.roll(y, -1)[:count].tolist(), strict=True)
    for (ex, ey), line, r, b in zip(ends, straight.tolist(), radius.tolist(), bulge.tolist()):
        if line:
            parts.append(f"L{ex:.10g} {ey:.10g}")
        else:
            parts.append(f"A{r:.7g} {r:.7g} 0 {int(abs(b) > 1.0)} {int(b < 0.0)} {ex:.10g} {ey:.10g}")
    return "".join(parts) + ("Z" if curve.closed else "")

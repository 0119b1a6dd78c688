"""SVG files of the sheets: true size in millimetres or inches, one layer and colour per operation, arcs as arcs."""

from __future__ import annotations

from html import escape
from itertools import chain
from pathlib import Path

import numpy as np

from ... import MARK
from ...progress import SILENT, Progress
from ...spirals.curves.arcs import Curve
from .operations import FRAME, DrawableSheets, curves_by_operation, frame_curves

UNITS = {"mm": 1e-3, "in": 0.0254}  # metres per unit
DIGITS = {1e-3: 4, 0.0254: 6}  # decimals of coordinates by metres per unit: steps of 0.1 um or finer


def write_svg(sheets: DrawableSheets, index: int, path: Path, progress: Progress = SILENT) -> None:
    """Write one sheet as SVG.

    Parameters
    ----------
    sheets : the sheets
    index : number of the sheet, from 0
    path : file to write
    progress : called with the fraction done; may cancel
    """
    path.write_text(svg_document(sheets, index, progress), encoding="utf-8")


def svg_document(sheets: DrawableSheets, index: int, progress: Progress = SILENT) -> str:
    """Return the SVG document of one sheet; ``index`` is its number, from 0."""
    size = sheets.packing.sizes[index]
    unit = UNITS[sheets.cut.svg_unit]
    width, height = (float(x) / unit for x in size)
    title = escape(f"sheet {index + 1} of {sheets.count}")
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<svg xmlns="http://www.w3.org/2000/svg" xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" version="1.1"'
        f' width="{width:.6g}{sheets.cut.svg_unit}" height="{height:.6g}{sheets.cut.svg_unit}" viewBox="0 0 {width:.6g} {height:.6g}">',
        f"<title>{title}</title>",
        f"<metadata>{MARK}</metadata>",
    ]
    edge = frame_curves(sheets, index)
    # the frame is the last layer, so that layers which programs select by their order keep their numbers
    layers = chain(curves_by_operation(sheets, index, progress), [(FRAME, iter(edge))] if edge else [])
    for (name, colour, _), curves in layers:
        lines.append(
            f'<g id="{name.replace(" ", "-")}" inkscape:groupmode="layer" inkscape:label="{name}" fill="none"'
            f' stroke="{colour}" stroke-width="{sheets.cut.line_width / unit:.6g}">'
        )
        lines.extend(f'<path d="{path_data(c, height, unit)}"/>' for c in curves)
        lines.append("</g>")
    lines.append("</svg>\n")
    return "\n".join(lines)


def path_data(curve: Curve, height: float, unit: float = UNITS["mm"]) -> str:
    """Return the SVG path data of a curve on a sheet, with y downwards.

    Parameters
    ----------
    curve : lines and arcs, metres, y upwards
    height : height of the sheet, in units of ``unit``
    unit : metres per unit of the drawing
    """
    digits = DIGITS[unit]
    points = np.round(curve.points / unit, digits)
    x, y = points[:, 0], np.round(height - points[:, 1], digits)
    after = np.roll(points, -1, axis=0)
    bulge = curve.bulge
    chord = np.linalg.norm(after - points, axis=1)
    size = np.abs(bulge)
    radius = chord * (1.0 + size * size) / (4.0 * np.maximum(size, 1e-12))
    # an arc whose sagitta is far smaller than the rounding of coordinates is drawn as a straight line
    straight = size * chord < 1e-6
    # the Z command draws the last side of a closed curve if that side is straight
    count = len(points) if curve.closed and not straight[-1] else len(points) - 1
    parts = [f"M{x[0]:.10g} {y[0]:.10g}"]
    ends = zip(np.roll(x, -1)[:count].tolist(), np.roll(y, -1)[:count].tolist(), strict=True)
    for (ex, ey), line, r, b in zip(ends, straight.tolist(), radius.tolist(), bulge.tolist()):
        if line:
            parts.append(f"L{ex:.10g} {ey:.10g}")
        else:
            parts.append(f"A{r:.7g} {r:.7g} 0 {int(abs(b) > 1.0)} {int(b < 0.0)} {ex:.10g} {ey:.10g}")
    return "".join(parts) + ("Z" if curve.closed else "")

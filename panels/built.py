"""The tab *As built* of the section *Check*: comparison of a scan of the built piece with the predicted shape."""

from __future__ import annotations

from typing import Any

import bpy

from ..engine.figures import format_figure
from .rows import button, results_box, tr, wrapped_text
from .stages import results_column


def draw(body: Any, context: bpy.types.Context) -> None:
    button(body, "flexmaps.compare_file", tr("Compare with a scan"), "POINTCLOUD_DATA")
    stored = results_column(body, context, "scan")
    if stored is None:
        return
    layout, block = stored
    for text in block["remarks"]:
        wrapped_text(layout, context, tr(text))
    size = "{} %, {} mm"
    results_box(
        layout,
        (tr("Distance, mean"), size.format(*(format_figure(block[name]) for name in ("rms_percent", "rms_mm")))),
        (tr("Distance, largest"), size.format(*(format_figure(block[name]) for name in ("max_percent", "max_mm")))),
        (tr("Spirals seen"), f"{100 * block['covered']:.0f} %"),
        (tr("Points beside it"), f"{100 * block['points_beside']:.0f} %"),
    )


CLASSES = ()

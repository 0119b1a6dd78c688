"""The tab *Explore* of the section *Check*: candidate designs of other sizes, sheets and materials in a list."""

from __future__ import annotations

from typing import Any

import bpy

from ..bridge.store import exploration
from ..engine.figures import format_figure
from ..engine.materials import OVERSTRAIN_SHARE
from .rows import PER_ROW, button, setting_row, tr, wrapped_text

MAX_CANDIDATES = 6  # largest number of candidates listed; more make the section longer; chosen by eye
VARY_TOGGLES = (
    ("vary_size", "Size"), ("vary_thickness", "Thickness"), ("vary_widths", "Width"), ("vary_twist", "Twist"),
    ("vary_material", "Material"), ("vary_arms", "Arms"), ("vary_panels", "Panels"),
)  # fmt: skip


def draw(body: Any, context: bpy.types.Context) -> None:
    obj = context.object
    settings = obj.flexmaps.explore
    column = body.column(align=True)
    for first in range(0, len(VARY_TOGGLES), PER_ROW):
        row = column.row(align=True)
        for name, label in VARY_TOGGLES[first : first + PER_ROW]:
            row.prop(settings, name, text=tr(label), toggle=True, translate=False)
    column = body.column(align=True)
    for name, label in (
        ("candidates", "Tries"),
        ("ratio", "Up to times"),
        ("largest", "Distance (%)"),
        ("sheets", "Sheets"),
    ):
        setting_row(column, settings, name, tr(label))
    button(body, "flexmaps.explore", tr("Explore"), "VIEWZOOM")
    kept = exploration.read(obj)
    if kept is None:
        return
    wrapped_text(body, context, tr(kept["note"]), max_lines=3)
    column = body.box().column(align=True)
    for number, row in enumerate(kept["rows"][:MAX_CANDIDATES]):
        line = column.split(factor=0.62, align=True)
        text = ", ".join(exploration.describe_value(*one) for one in row["values"].items())
        button(line, "flexmaps.use_candidate", text).number = number
        measures = row["measures"]
        share = measures.get("strain_share", 0.0)
        line.alert = share > OVERSTRAIN_SHARE
        line.label(text=f"{format_figure(measures.get('rms_percent', 0.0))} %, {100 * share:.0f} %", translate=False)


CLASSES = ()

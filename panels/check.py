"""The section *Check*: structural check, comparison with the built piece, and other sizes and sheets."""

from __future__ import annotations

from typing import Any

import bpy

from ..bridge.store import explored
from ..engine.extras.structure import cases
from ..engine.figures import format_figure
from ..engine.materials import OVERLOADED, STRAINED
from .rows import button, figures, popover, sentence, tr, value
from .stages import block_of, look

CANDIDATES, OUTCOMES = 6, 4  # rows shown at most, so that the section stays short; by eye
VARIED = (
    ("vary_size", "Size"), ("vary_thickness", "Thickness"), ("vary_widths", "Width"), ("vary_twist", "Twist"),
    ("vary_material", "Material"), ("vary_arms", "Arms"), ("vary_panels", "Panels"),
)  # fmt: skip
A_ROW = 3  # toggles in a row; more would cut their words
EXAMPLE = "Sums of load cases with factors, such as: all = 1.35 weight + 1.5 snow"


def draw(body: Any, context: bpy.types.Context) -> None:
    tab = context.window_manager.flexmaps_tab
    body.row(align=True).prop(tab, "check", expand=True)
    {"LOADS": _loads, "BUILT": _built, "EXPLORE": _explore}[tab.check](body, context)


def _loads(body: Any, context: bpy.types.Context) -> None:
    wanted = context.object.flexmaps.structure
    row = body.row()
    column = row.box().column(align=True)
    for number, text in enumerate(cases.lines(wanted.cases)):
        one = column.row(align=True)
        one.label(text=text, translate=False)
        one.operator("flexmaps.remove_load", text="", icon="X", emboss=False).number = number
    column = row.column(align=True)
    column.operator("flexmaps.add_load", text="", icon="ADD")
    column.popover("FLEXMAPS_PT_loads", text="", icon="DOWNARROW_HLT")
    value(body.column(align=True), wanted, "factor_max", tr("Up to times"))
    button(body, "flexmaps.structure", tr("Check the loads"), "MOD_PHYSICS")
    stored = block_of(body, context, "structure")
    if stored is None:
        return
    layout, block = stored
    rows: list[Any] = []
    for outcome in block["outcomes"][:OUTCOMES]:
        rows += _outcome(outcome)
    figures(layout, *rows)


def _outcome(row: dict[str, Any]) -> list[tuple[str, str, bool]]:
    """Return the rows of one load case: how far the piece bends, utilisation, and how far the load may rise."""
    name = tr(row["name"]) if row["kind"] == row["name"] else row["name"]
    critical = row["critical"]
    times = f"> {row['followed_to']:.3g}" if critical is None else f"{critical:.3g}"
    made = [(tr("{}: gives way at", name), tr("{} times", times), not row["reached"])]
    if row["reached"]:
        made.append((tr("Bends by"), f"{row['deflection_max_mm']:.3g} mm", False))
    for key, label, most in (("arms", "Arms", STRAINED), ("joints", "Joints", OVERLOADED)):
        if key in row:
            made.append((tr(label), tr("{} % of limit", f"{100 * row[key]:.0f}"), row[key] > most))
    return made


def _built(body: Any, context: bpy.types.Context) -> None:
    button(body, "flexmaps.compare_file", tr("Compare with a scan"), "POINTCLOUD_DATA")
    stored = block_of(body, context, "scan")
    if stored is None:
        return
    layout, block = stored
    for text in block["remarks"]:
        sentence(layout, context, tr(text))
    size = "{} %, {} mm"
    figures(
        layout,
        (tr("Distance, mean"), size.format(*(format_figure(block[name]) for name in ("rms_percent", "rms_mm")))),
        (tr("Distance, largest"), size.format(*(format_figure(block[name]) for name in ("max_percent", "max_mm")))),
        (tr("Spirals seen"), f"{100 * block['covered']:.0f} %"),
        (tr("Points beside it"), f"{100 * block['points_beside']:.0f} %"),
    )


def _explore(body: Any, context: bpy.types.Context) -> None:
    obj = context.object
    wanted = obj.flexmaps.explore
    column = body.column(align=True)
    for first in range(0, len(VARIED), A_ROW):
        row = column.row(align=True)
        for name, label in VARIED[first : first + A_ROW]:
            row.prop(wanted, name, text=tr(label), toggle=True, translate=False)
    column = body.column(align=True)
    for name, label in (
        ("candidates", "Tries"),
        ("ratio", "Up to times"),
        ("largest", "Distance (%)"),
        ("sheets", "Sheets"),
    ):
        value(column, wanted, name, tr(label))
    button(body, "flexmaps.explore", tr("Explore"), "VIEWZOOM")
    kept = explored.read(obj)
    if kept is None:
        return
    sentence(body, context, tr(kept["note"]), most=3)
    column = body.box().column(align=True)
    for number, row in enumerate(kept["rows"][:CANDIDATES]):
        line = column.split(factor=0.62, align=True)
        text = ", ".join(explored.said(*one) for one in row["values"].items())
        button(line, "flexmaps.use_candidate", text).number = number
        measures = row["measures"]
        share = measures.get("strain_share", 0.0)
        line.alert = share > STRAINED
        line.label(text=f"{format_figure(measures.get('rms_percent', 0.0))} %, {100 * share:.0f} %", translate=False)


def key(context: bpy.types.Context) -> str:
    """Return the figure beside the heading: the smallest load factor at which the piece gives way."""
    block = look(context).blocks.get("structure")
    if block is None or not block["outcomes"]:
        return ""
    least = min(row["followed_to"] if row["critical"] is None else row["critical"] for row in block["outcomes"])
    return tr("{} times", f"{least:.3g}")


def _text(layout: Any, wanted: Any) -> None:
    sentence(layout, bpy.context, tr(EXAMPLE), units=15)
    layout.prop(wanted.structure, "combinations")
    layout.prop(wanted.structure, "cases")


CLASSES = (popover("loads", "Load cases", _text),)

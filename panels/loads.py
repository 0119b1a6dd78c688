"""The tab *Loads* of the section *Check*: load cases, and the results of the structural analysis."""

from __future__ import annotations

from typing import Any

import bpy

from ..engine.extras.structure import cases
from ..engine.materials import OVERLOADED, OVERSTRAIN_SHARE
from .rows import button, popover, results_box, setting_row, tr, wrapped_text
from .stages import results_column

MAX_OUTCOMES = 4  # largest number of load cases whose results are listed; more make the section longer; chosen by eye
EXAMPLE = "Sums of load cases with factors, such as: all = 1.35 weight + 1.5 snow"


def draw(body: Any, context: bpy.types.Context) -> None:
    settings = context.object.flexmaps.structure
    row = body.row()
    column = row.box().column(align=True)
    for number, text in enumerate(cases.split_lines(settings.cases)):
        one = column.row(align=True)
        one.label(text=text, translate=False)
        one.operator("flexmaps.remove_load", text="", icon="X", emboss=False).number = number
    column = row.column(align=True)
    column.operator("flexmaps.add_load", text="", icon="ADD")
    column.popover("FLEXMAPS_PT_loads", text="", icon="DOWNARROW_HLT")
    setting_row(body.column(align=True), settings, "factor_max", tr("Up to times"))
    button(body, "flexmaps.structure", tr("Check the loads"), "MOD_PHYSICS")
    stored = results_column(body, context, "structure")
    if stored is None:
        return
    layout, block = stored
    rows: list[Any] = []
    for outcome in block["outcomes"][:MAX_OUTCOMES]:
        rows += _outcome_rows(outcome)
    results_box(layout, *rows)


def _outcome_rows(row: dict[str, Any]) -> list[tuple[str, str, bool]]:
    """Return the rows of a load case's results, as ``results_box`` takes them.

    They are the load factor at which the piece gives way, the largest deflection, and utilisation of arms and joints.
    """
    name = tr(row["name"]) if row["kind"] == row["name"] else row["name"]
    critical = row["critical"]
    times = f"> {row['followed_to']:.3g}" if critical is None else f"{critical:.3g}"
    made = [(tr("{}: gives way at", name), tr("{} times", times), not row["reached"])]
    if row["reached"]:
        made.append((tr("Bends by"), f"{row['deflection_max_mm']:.3g} mm", False))
    for key, label, most in (("arms", "Arms", OVERSTRAIN_SHARE), ("joints", "Joints", OVERLOADED)):
        if key in row:
            made.append((tr(label), tr("{} % of limit", f"{100 * row[key]:.0f}"), row[key] > most))
    return made


def _draw_load_texts(layout: Any, settings: Any) -> None:
    wrapped_text(layout, bpy.context, tr(EXAMPLE), units=15)
    layout.prop(settings.structure, "combinations")
    layout.prop(settings.structure, "cases")


CLASSES = (popover("loads", "Load cases", _draw_load_texts),)

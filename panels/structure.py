"""The panel of the load cases: what acts on the piece, and what it bears."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_iface as iface_

from ..bridge.store import notes
from ..engine.params import StructureParams
from ..engine.structure import cases
from .rows import choice_row, fold, number, settings_rows, wrapped
from .stages import StagePanel, button, result

EXAMPLE = "Sums of load cases with factors, such as: all = 1.35 weight + 1.5 snow"


class StructurePanel(StagePanel, bpy.types.Panel):
    bl_idname = "FLEXMAPS_PT_structure"
    bl_label = "Structure"
    bl_parent_id = "FLEXMAPS_PT_simulate"
    bl_options = {"DEFAULT_CLOSED"}
    stage = "structure"

    def draw(self, context: bpy.types.Context) -> None:
        layout, obj = self.layout, context.object
        column = layout.column(align=True)
        for number_, line in enumerate(cases.lines(obj.flexmaps.structure.cases)):
            row = column.row(align=True)
            row.label(text=line, translate=False)
            row.operator("flexmaps.remove_load", text="", icon="X").number = number_
        column.operator("flexmaps.add_load", icon="ADD")
        body = fold(layout, "flexmaps_structure", "Combinations and text")
        if body is not None:
            wrapped(body, context, EXAMPLE, icon="INFO")
            body.prop(obj.flexmaps.structure, "combinations", text="")
            body.label(text="Load cases")
            body.prop(obj.flexmaps.structure, "cases", text="")
        settings_rows(layout, obj.flexmaps.structure, StructureParams, ("factor_max",))
        button(layout, context, "flexmaps.structure", icon="MOD_PHYSICS")
        block = notes.read(obj.data).get("structure")
        if block is None:
            return
        layout = result(layout, context, "structure")
        for finding in block.get("findings", ()):
            wrapped(layout.box(), context, finding["message"], icon="ERROR")
        for row in block["outcomes"]:
            _outcome(layout.box().column(align=True), row)
        choice_row(layout, context.window_manager, "flexmaps_overlay", (("UTILISATION", "Utilisation"),))


def _outcome(column: Any, row: dict[str, Any]) -> None:
    """One case: how far the piece gives way, what is carried, and how far the load may rise."""
    column.label(text=iface_(row["name"]) if row["kind"] == row["name"] else row["name"], translate=False)
    if row["reached"]:
        number(column, "Largest deflection", f"{row['deflection_max_mm']:.3g} mm")
    for key, label in (("arms", "Arms"), ("joints", "Joints")):
        if key in row:
            share = iface_("{:.0f} % of limit").format(100 * row[key])
            number(column, label, share, alert=row[key] > 1.0005)
    critical = row["critical"]
    over = iface_("over {} times").format(f"{row['followed_to']:.3g}")
    times = over if critical is None else iface_("{} times").format(f"{critical:.3g}")
    number(column, "Gives way at", times, alert=not row["reached"])


CLASSES = (StructurePanel,)

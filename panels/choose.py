"""The panel of the layouts that were compared: what is wanted, and little pictures with their figures."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_iface as iface_

from ..bridge.store import notes
from ..bridge.view import choices
from ..engine.params import ChooseParams
from .rows import duration, settings_rows, wrapped
from .stages import StagePanel, button, result

PICTURE = 5.0  # size of a picture, in rows: as high as the lines beside it


class ChoosePanel(StagePanel, bpy.types.Panel):
    bl_idname = "FLEXMAPS_PT_choose"
    bl_label = "Choose a layout"
    bl_parent_id = "FLEXMAPS_PT_patches"
    bl_options = {"DEFAULT_CLOSED"}
    stage = "choose"

    def draw(self, context: bpy.types.Context) -> None:
        layout, obj = self.layout, context.object
        wanted = obj.flexmaps.choose
        settings_rows(layout.column(align=True), wanted, ChooseParams, ("goal",))
        if wanted.goal in {"match", "panels"}:
            layout.prop(wanted, wanted.goal)
        button(layout, context, "flexmaps.choose", icon="PRESET")
        block = notes.read(obj.data).get("choose")
        if block is None:
            return
        layout = result(layout, context, "choose")
        wrapped(layout, context, block["note"], icon="INFO" if block["reached"] else "ERROR")
        rows = block["proposals"]
        for number, (row, icon) in enumerate(zip(rows, choices.icons(obj, len(rows)), strict=True)):
            _proposal(layout.box().row(), number, row, icon, number == block["taken"])


def _proposal(layout: Any, number: int, row: dict[str, Any], icon: int, taken: bool) -> None:
    """One layout: its picture, its figures, and the button that takes it."""
    if icon:
        layout.template_icon(icon_value=icon, scale=PICTURE)
    column = layout.column(align=True)
    head = column.row(align=True)
    panels = iface_("1 panel") if row["panels"] == 1 else iface_("{} panels").format(row["panels"])
    text = iface_("{}, {} joints").format(panels, row["joints"])
    options = {"text": text, "depress": taken, "translate": False}
    if row["symmetries_kept"] > 1:
        options["icon"] = "MOD_MIRROR"
    head.operator("flexmaps.take_choice", **options).number = number
    share = f"{row['rms_percent']:.2g} %"
    match = share if row["proved"] else iface_("at most {}").format(share)
    lines = [
        iface_("RMS distance {}").format(match),
        iface_("Strain {} of its limit").format(f"{100 * row['strain_share_max']:.0f} %"),
        iface_("{} to join").format(duration(row["join_minutes"])),
    ]
    sheets = iface_("{} sheets").format(row["sheets"]) if row["sheets"] > 1 else iface_("1 sheet")
    cut = iface_("{} to cut").format(duration(row["cut_minutes"])) if "cut_minutes" in row else ""
    lines.append(", ".join(part for part in (sheets, cut) if part))
    for line in lines:
        column.label(text=line, translate=False)


CLASSES = (ChoosePanel,)

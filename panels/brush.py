"""Painting in the Spirals panel: the brush, and weights and colours that other tools made."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_iface as iface_

from ..bridge.store import fields
from ..bridge.view import easel
from .rows import fold, setting_row


def draw(layout: Any, context: bpy.types.Context) -> None:
    """The button that takes the brush; its settings while it is in hand; and what else changes spirals by hand."""
    brush, obj = context.window_manager.flexmaps_brush, context.object
    in_hand = easel.active(context)
    layout.operator("flexmaps.pick_brush", icon="BRUSH_DATA", depress=in_hand)
    if in_hand:
        column = layout.column(align=True)
        column.prop(brush, "brush", text="")
        for name, pressure in (("size", "pressure_size"), ("strength", "pressure_strength")):
            row = column.row(align=True)
            setting_row(row, brush, name)
            row.prop(brush, pressure, text="", icon="STYLUS_PRESSURE")
        column.prop(brush, "mirror", toggle=True)
    marked = fields.protected(obj)
    if marked:
        row = layout.row(align=True)
        row.label(text=iface_("{} protected").format(marked), icon="LOCKED", translate=False)
        row.operator("flexmaps.unprotect", text="", icon="X")
    body = fold(layout, "flexmaps_paint_from", "From weights")
    if body is not None:
        body.prop(brush, "source", text="", icon="GROUP_VERTEX")
        body.prop(brush, "what", text="")
        if brush.what == "along":
            body.prop(brush, "direction", expand=True)
        button = body.operator("flexmaps.paint_from", text="Paint from it", icon="IMPORT")
        button.source, button.what, button.direction = brush.source, brush.what, brush.direction

"""The Preview panel: the assembled piece with its true spirals."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_iface as iface_

from ..bridge.store import states
from ..bridge.view import preview
from ..engine.params import FilmParams, PreviewParams, RenderParams
from .rows import heading, more, number, numbers, settings_rows, wrapped
from .stages import StagePanel


class PreviewPanel(StagePanel, bpy.types.Panel):
    bl_idname = "FLEXMAPS_PT_preview"
    bl_label = "Preview"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout, obj = self.layout, context.object
        settings_rows(layout.column(align=True), obj.flexmaps.preview, PreviewParams)
        layout.operator("flexmaps.preview", icon="HIDE_OFF")
        _figures(layout, context, obj)
        heading(layout, "Assembly, step by step")
        settings_rows(layout.column(align=True), obj.flexmaps.film, FilmParams)
        layout.operator("flexmaps.animate", icon="RENDER_ANIMATION")
        heading(layout, "Picture")
        settings_rows(layout.column(align=True), obj.flexmaps.render, RenderParams, RENDER)
        more(layout, "flexmaps_render", obj.flexmaps.render, RenderParams, RENDER)
        layout.operator("flexmaps.render", icon="RENDER_STILL")


RENDER = ("finish", "file")


def _figures(layout: Any, context: bpy.types.Context, obj: bpy.types.Object) -> None:
    """Figures of the assembled piece, or that it is out of date."""
    figures = preview.note_of(obj)
    if not figures:
        return
    if states.is_old_unnoted(obj, context.scene, "preview"):
        wrapped(layout, context, "The spirals or their shape are others now; press Preview again", icon="INFO")
        return
    grid = numbers(layout)
    number(grid, "Spirals", str(figures["spirals"]))
    if figures["triangles"]:
        number(grid, "Triangles", f"{figures['triangles']:,}".replace(",", "\N{THIN SPACE}"))
    number(grid, "Made in", f"{figures['seconds']:.1f} s")
    if not figures["simulated"]:
        number(grid, "Not simulated", iface_("on the target"))


CLASSES = (PreviewPanel,)

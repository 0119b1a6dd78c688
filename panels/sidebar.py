"""The tab in the 3D view's sidebar: one panel with a head that is always shown and seven sections that fold."""

from __future__ import annotations

from typing import Any

import bpy

from ..bridge.hosts import background, preload
from ..bridge.store import states, stored_report
from ..bridge.store.objects import is_linked, usage_problem
from . import check, head, layout, make, piece, presets, shape, show, workshop
from .rows import button, tr
from .stages import ICONS, read_stages

# key of a section, heading, popover of rarely used settings ("" for none), module that draws the section, and stages
# whose states the section's icon summarises
SECTIONS = (
    ("piece", "Piece", "", piece, ()),
    ("layout", "Layout", "limits", layout, ("layout",)),
    ("shape", "Shape", "shape", shape, ("spirals", "equilibrium", "optimise")),
    ("check", "Check", "", check, ("structure",)),
    ("make", "Make", "", make, ("sheets",)),
    ("show", "Show", "", show, ()),
    ("workshop", "Workshop", "", workshop, ()),
)
STEPS = (
    ("MESH_MONKEY", "Model any surface, open or closed"),
    ("PLAY", "Press Next, again and again"),
    ("TOOL_SETTINGS", "Cut the sheets, join the panels"),
)


class MainPanel(bpy.types.Panel):
    bl_idname = "FLEXMAPS_PT_main"
    bl_label = "FlexMaps"
    bl_space_type, bl_region_type, bl_category = "VIEW_3D", "UI", "FlexMaps"

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        if usage_problem(context.object) is None:
            presets.PresetPanel.draw_by_name(self.layout, context.object)

    def draw(self, context: bpy.types.Context) -> None:
        panel, problem = self.layout, usage_problem(context.object)
        preload.start()
        if problem is None:
            read_stages(context, refresh=True)
        head.draw(panel, context, problem)
        if problem is not None:
            if context.object is not None and is_linked(context.object):
                panel.operator("object.make_local", text=tr("Make local")).type = "SELECT_OBDATA"
            _draw_welcome(panel)
            return
        for section in SECTIONS:
            _draw_section(panel, context, *section)
        if not any(stored_report.NAME in mesh for mesh in bpy.data.meshes):
            _tutorial_buttons(panel)


def _draw_section(
    panel: Any, context: bpy.types.Context, key: str, title: str, gear: str, module: Any, stages: Any
) -> None:
    """Draw a section: if folded, its heading with a figure and an icon; if open, its heading and its content.

    Parameters
    ----------
    panel : layout of the tab
    context : Blender's context
    key, title, gear, module, stages : a row of ``SECTIONS``
    """
    header, body = panel.panel_prop(context.window_manager.flexmaps_tab, f"open_{key}")
    header.label(text=tr(title), translate=False)
    right = header.row(align=True)
    right.alignment = "RIGHT"
    if body is None:
        figure = right.row()
        figure.active = False
        figure.alignment = "RIGHT"
        figure.label(text=module.heading_text(context) if hasattr(module, "heading_text") else "", translate=False)
        right.label(text="", icon=_section_icon(context, module, stages))
        return
    if gear:
        right.emboss = "NONE"
        right.popover(f"FLEXMAPS_PT_{gear}", text="", icon="OPTIONS")
    body.enabled = background.current_job() is None
    module.draw(body, context)


def _section_icon(context: bpy.types.Context, module: Any, stages: tuple[str, ...]) -> str:
    """Return the icon that summarises a section's stages: out of date, to do, past a limit, or a tick."""
    seen = read_stages(context)
    kinds = {seen.states[stage].kind for stage in stages if stage in seen.states}
    if states.STALE in kinds:
        return ICONS[states.STALE]
    if states.TODO in kinds or not kinds:
        return ICONS[states.TODO]
    if hasattr(module, "past_limit") and module.past_limit(context):
        return "ERROR"
    sources = dict.fromkeys(("spirals", "optimise"), "equilibrium")
    worse = {notice.key.partition("/")[0] for notice in seen.guidance.objections}
    return "ERROR" if any(sources.get(stage, stage) in worse for stage in stages) else ICONS[states.DONE]


def _draw_welcome(panel: Any) -> None:
    """Draw an introduction in place of the sections, while there is no usable mesh."""
    column = panel.column()
    for icon, words in STEPS:
        column.label(text=tr(words), icon=icon, translate=False)
    _tutorial_buttons(panel)


def _tutorial_buttons(panel: Any) -> None:
    """Draw buttons for the tutorial and the example; shown until the file holds a result."""
    row = panel.row(align=True)
    button(row, "flexmaps.tutorial", tr("Tutorial"), "LIGHT")
    button(row, "flexmaps.example", tr("Example"), "ADD")


MODULES = (head, presets, piece, layout, shape, check, make, show, workshop)
CLASSES = (MainPanel, *(cls for module in MODULES for cls in module.CLASSES))

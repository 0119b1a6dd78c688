"""Tool of the 3D view that paints spirals with a brush, and its settings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from ..bridge.store.i18n import translate
from ..bridge.view import brush_settings

TOOL = "flexmaps.brush"
# the tool's icon in newer and older versions of Blender
ICONS = ("brush.generic", "brush.paint_weight.draw", "ops.generic.select_circle")
SETTINGS = "window_manager.flexmaps_brush"  # data path for Blender's own keys F (size) and Shift F (strength)


def _keymap_item(operator: str, **keys: Any) -> tuple[str, dict[str, Any], Any]:
    properties = keys.pop("properties", [])
    return operator, {"type": "LEFTMOUSE", "value": "PRESS"} | keys, {"properties": properties}


class BrushTool(bpy.types.WorkSpaceTool):
    bl_space_type = "VIEW_3D"
    bl_context_mode = "OBJECT"
    bl_idname = TOOL
    bl_label = "Paint Spirals"
    bl_description = "Paint the spirals of a FlexMaps surface stiffer, softer, smoother, or protect them"
    bl_icon = ""  # set at registration
    bl_cursor = "CROSSHAIR"
    bl_keymap = (
        _keymap_item("flexmaps.paint_stroke"),
        _keymap_item("flexmaps.paint_stroke", ctrl=True, properties=[("inverted", True)]),
        _keymap_item("flexmaps.paint_stroke", shift=True, properties=[("smooth", True)]),
        _keymap_item("wm.radial_control", type="F", properties=[("data_path_primary", f"{SETTINGS}.size")]),
        _keymap_item(
            "wm.radial_control", type="F", shift=True, properties=[("data_path_primary", f"{SETTINGS}.strength")]
        ),
    )

    @staticmethod
    def draw_settings(context: bpy.types.Context, layout: bpy.types.UILayout, tool: bpy.types.WorkSpaceTool) -> None:
        draw_settings(layout, context)

    @staticmethod
    def draw_cursor(context: bpy.types.Context, tool: bpy.types.WorkSpaceTool, xy: tuple[float, float]) -> None:
        from gpu_extras.presets import draw_circle_2d

        draw_circle_2d(xy, (1.0, 1.0, 1.0, 0.8), context.window_manager.flexmaps_brush.size, segments=48)


def draw_settings(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the brush's settings in the 3D view's header."""
    brush = context.window_manager.flexmaps_brush
    layout.prop(brush, "brush", text="")
    for name, pressure in (("size", "pressure_size"), ("strength", "pressure_strength")):
        row = layout.row(align=True)
        row.prop(brush, name)
        row.prop(brush, pressure, text="", icon="STYLUS_PRESSURE")
    layout.prop(brush, "mirror", text="X", toggle=True)
    layout.label(text=translate("Ctrl: the other way. Shift: smooth. F: size"), translate=False)


def register() -> None:
    from ..bridge.view import paint_session

    brush_settings.register()
    handlers = bpy.app.handlers
    handlers.load_pre.append(paint_session.discard_session)
    handlers.undo_post.append(paint_session.schedule_update)
    handlers.redo_post.append(paint_session.schedule_update)
    if not bpy.app.background:  # without a window there is no toolbar
        icons = Path(bpy.utils.system_resource("DATAFILES"), "icons")
        BrushTool.bl_icon = next((name for name in ICONS if (icons / f"{name}.dat").is_file()), ICONS[-1])
        bpy.utils.register_tool(BrushTool, separator=True)


def unregister() -> None:
    from ..bridge.view import paint_session

    if not bpy.app.background:
        bpy.utils.unregister_tool(BrushTool)
    handlers = bpy.app.handlers
    handlers.load_pre.remove(paint_session.discard_session)
    handlers.undo_post.remove(paint_session.schedule_update)
    handlers.redo_post.remove(paint_session.schedule_update)
    paint_session.discard_session()
    brush_settings.unregister()


CLASSES = (brush_settings.BrushSettings,)

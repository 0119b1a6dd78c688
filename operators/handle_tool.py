"""Tool of the 3D view that sets handles (holds, forces and drag targets) on single spirals."""

from __future__ import annotations

import bpy

from ..bridge.hosts import live
from ..bridge.store.i18n import translate
from ..bridge.view.handle_gizmos import HandleGizmoMixin
from ..engine.errors import FlexMapsError
from .stage import ImmediateOperator, ObjectOperator


class HandleGizmos(HandleGizmoMixin, bpy.types.GizmoGroup):
    bl_idname = "FLEXMAPS_GGT_handles"
    bl_label = "FlexMaps handles"
    bl_space_type, bl_region_type = "VIEW_3D", "WINDOW"
    bl_options = {"3D", "PERSISTENT"}
    shape_of = staticmethod(live.live_shape_of)


class _HandleTool:
    """Click a spiral to hold it or to let it go; drag one to pull it; drag with Ctrl to set where Optimise shall bring it"""

    bl_space_type = "VIEW_3D"
    bl_idname = "flexmaps.handles"
    bl_label = "FlexMaps handles"
    bl_description = (
        "Click a spiral to hold it or to let it go.\n"
        "Drag one to pull it.\n"
        "Drag with Ctrl to set where Optimise shall bring it"
    )
    bl_icon = "ops.transform.vertex_random"
    bl_widget = HandleGizmos.bl_idname

    @staticmethod
    def draw_settings(context: bpy.types.Context, layout: bpy.types.UILayout, tool: bpy.types.WorkSpaceTool) -> None:
        layout.label(text=translate("Click: hold. Drag: pull. Ctrl drag: drag target"), translate=False)

    bl_keymap = (
        ("flexmaps.hold_spiral", {"type": "LEFTMOUSE", "value": "CLICK"}, None),
        ("flexmaps.drag_spiral", {"type": "LEFTMOUSE", "value": "CLICK_DRAG"}, {"properties": [("kind", "PULL")]}),
        (
            "flexmaps.drag_spiral",
            {"type": "LEFTMOUSE", "value": "CLICK_DRAG", "ctrl": True},
            {"properties": [("kind", "WISH")]},
        ),
    )


class HandleTool(_HandleTool, bpy.types.WorkSpaceTool):
    bl_context_mode = "OBJECT"


class HandleToolInEditMode(_HandleTool, bpy.types.WorkSpaceTool):
    bl_context_mode = "EDIT_MESH"


class UseHandles(ImmediateOperator, ObjectOperator, bpy.types.Operator):
    """Take the tool for handles: click a spiral to hold it or to let it go, drag one to pull it, drag with Ctrl to set where Optimise shall bring it"""

    bl_idname = "flexmaps.use_handles"
    bl_label = "Handles"
    bl_options = {"REGISTER"}

    def run(self, context: bpy.types.Context) -> None:
        if context.area is None or context.area.type != "VIEW_3D":
            raise FlexMapsError(translate("Handles are set in a 3D view"))
        bpy.ops.wm.tool_set_by_id(name=HandleTool.bl_idname)


TOOLS = (HandleTool, HandleToolInEditMode)


def register() -> None:
    for tool in TOOLS:
        bpy.utils.register_tool(tool, separator=tool is HandleTool)


def unregister() -> None:
    for tool in reversed(TOOLS):
        bpy.utils.unregister_tool(tool)


CLASSES = (HandleGizmos, UseHandles)

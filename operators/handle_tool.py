"""The tool in the 3D view's toolbar with which handles are set, and the gizmos of those that are there."""

from __future__ import annotations

from typing import Any

import bpy

from ..bridge.store.i18n import translate
from .handles import _shape, edge_of
from .stage import OnObject

MOST = 200  # gizmos at the most, so that a piece that is held all along its border is drawn at once; by eye
# sRGB of held spirals, pulls and wishes: told apart in both themes, by eye
COLOURS = {"held": (0.95, 0.35, 0.30), "pull": (0.25, 0.65, 0.95), "wish": (0.45, 0.80, 0.35)}


class HandleGizmos(bpy.types.GizmoGroup):
    """A ring where a spiral is held, an arrow where one is pulled, an arrow with a box to where one is wished"""

    bl_idname = "FLEXMAPS_GGT_handles"
    bl_label = "FlexMaps handles"
    bl_space_type = "VIEW_3D"
    bl_region_type = "WINDOW"
    bl_options = {"3D", "PERSISTENT"}

    def setup(self, context: bpy.types.Context) -> None:
        self._made: list[tuple[str, int]] = []

    def refresh(self, context: bpy.types.Context) -> None:
        """As many gizmos as there are handles."""
        wanted = [(kind, quad) for kind, quad, _, _ in _handles(context)]
        if wanted == getattr(self, "_made", []):
            return
        self.gizmos.clear()
        for kind, quad in wanted:
            one = self.gizmos.new("GIZMO_GT_move_3d" if kind == "held" else "GIZMO_GT_arrow_3d")
            one.color, one.color_highlight = COLOURS[kind], (1.0, 1.0, 1.0)
            one.alpha, one.alpha_highlight = 0.9, 1.0
            one.use_draw_modal = True
            if kind == "held":
                one.draw_options = {"FILL", "ALIGN_VIEW"}
                one.scale_basis = 0.08
                given = one.target_set_operator("flexmaps.drag_spiral")
                given.quad, given.kind, given.tap = quad, "PULL", True
            else:
                one.draw_style = "NORMAL" if kind == "pull" else "BOX"
                one.use_draw_scale = False
                given = one.target_set_operator("flexmaps.drag_spiral")
                given.quad, given.kind = quad, kind.upper()
        self._made = wanted

    def draw_prepare(self, context: bpy.types.Context) -> None:
        """Where they are now: a live piece moves between two changes."""
        self.refresh(context)
        if not self._made:
            return
        # heads of arrows grow with their frame: an edge of a quad
        edge = edge_of(context.object)
        for one, (kind, _, place, way) in zip(self.gizmos, _handles(context), strict=False):
            one.matrix_basis = _frame(place, way, 1.0 if kind == "held" else edge)
            if kind != "held":
                one.length = max(way.length / edge, 1e-3)


def _handles(context: bpy.types.Context) -> list[tuple[str, int, Any, Any]]:
    """Kind, quad, place and way of every handle, in the scene's units and world axes."""
    import numpy as np
    from mathutils import Vector

    from ..bridge.store import handles
    from ..bridge.store.objects import unusable
    from ..bridge.view import picking

    obj = context.object
    if unusable(obj) is not None or not any(handles.PREFIXED[name] in obj.data.attributes for name in handles.NAMES):
        return []
    points, quads = picking.seen(obj, _shape(obj))
    if not len(quads):
        return []
    found: list[tuple[str, int, Any, Any]] = []
    matrix = np.array(obj.matrix_world)[:3, :3]
    for name in handles.NAMES:
        values = handles.read(obj, name)
        if len(values) != len(quads):
            continue
        for quad in np.flatnonzero(values if name == handles.HELD else values.any(axis=1))[:MOST].tolist():
            place = points[quads[quad]].mean(axis=0)
            way = np.zeros(3)
            if name == handles.PULL:
                way = edge_of(obj) * values[quad]
            elif name == handles.WISH:
                # from where it is now to where it shall come
                way = picking.target(obj)[quads[quad]].mean(axis=0) + matrix @ values[quad] - place
            found.append((name, quad, Vector(place), Vector(way)))
    return found


def _frame(place: Any, way: Any, size: float) -> Any:
    from mathutils import Matrix

    turn = way.to_track_quat("Z", "Y").to_matrix().to_4x4() if way.length else Matrix.Identity(4)
    return Matrix.Translation(place) @ turn @ Matrix.Scale(size, 4)


class _HandleTool:
    """Click a spiral to hold it or to let it go; drag one to pull it; drag with Ctrl to wish it somewhere for Optimise"""

    bl_space_type = "VIEW_3D"
    bl_idname = "flexmaps.handles"
    bl_label = "FlexMaps handles"
    bl_description = (
        "Click a spiral to hold it or to let it go.\n"
        "Drag one to pull it.\n"
        "Drag with Ctrl to wish it somewhere for Optimise"
    )
    bl_icon = "ops.transform.vertex_random"
    bl_widget = HandleGizmos.bl_idname

    @staticmethod
    def draw_settings(context: Any, layout: Any, tool: Any) -> None:
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


class UseHandles(OnObject, bpy.types.Operator):
    """Take the tool for handles: click a spiral to hold it or to let it go, drag one to pull it, drag with Ctrl to wish it somewhere for Optimise"""

    bl_idname = "flexmaps.use_handles"
    bl_label = "Handles"

    def execute(self, context: bpy.types.Context) -> set[str]:
        if context.area is None or context.area.type != "VIEW_3D":
            self.report({"WARNING"}, translate("Handles are set in a 3D view"))
            return {"CANCELLED"}
        bpy.ops.wm.tool_set_by_id(name=HandleTool.bl_idname)
        return {"FINISHED"}


TOOLS = (HandleTool, HandleToolInEditMode)


def register() -> None:
    for tool in TOOLS:
        bpy.utils.register_tool(tool, separator=tool is HandleTool)


def unregister() -> None:
    for tool in reversed(TOOLS):
        bpy.utils.unregister_tool(tool)


CLASSES = (HandleGizmos, UseHandles)

"""Operators for handles on single spirals: hold a spiral, pull it, or set a drag target for Optimise."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy

from ..bridge.hosts import live
from ..bridge.store.i18n import translate
from .stage import ImmediateOperator, ObjectOperator, redraw

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    import numpy as np
    from mathutils import Vector

KINDS = (
    ("PULL", "Pull", "A force: as many newtons as edges of a quad that you drag it"),
    ("WISH", "Wish", "A place: Optimise brings the spiral there, as near as the piece lets it"),
)
UNDER_MOUSE = -1  # value of ``quad`` that stands for the quad under the mouse


class _OnSpiral(ObjectOperator):
    """Base of operators on the spiral ``quad``; in edit mode, on all selected quads if ``quad`` is among them."""

    bl_options = {"REGISTER", "UNDO"}

    quad: int
    report: Any

    def _pick_quad(self, context: bpy.types.Context, event: bpy.types.Event) -> bool:
        """Set ``quad`` to the quad under the mouse unless it is set; return whether there is a quad."""
        from bpy_extras import view3d_utils

        from ..bridge.view import picking

        if self.quad != UNDER_MOUSE:
            return True
        if context.region_data is None:
            return False
        mouse = event.mouse_region_x, event.mouse_region_y
        origin = view3d_utils.region_2d_to_origin_3d(context.region, context.region_data, mouse)
        way = view3d_utils.region_2d_to_vector_3d(context.region, context.region_data, mouse)
        points, quads = picking.visible_surface(context.object, live.live_shape_of(context.object))
        hit = picking.hit_quad(points, quads, origin, way)
        self.quad = UNDER_MOUSE if hit is None else hit
        return hit is not None

    def _affected_quads(self, obj: bpy.types.Object) -> list[int]:
        """Return ``quad``, or all selected quads if it is selected in edit mode; [] where it does not exist."""
        count = len(obj.data.polygons)
        if obj.mode == "EDIT":
            import bmesh

            bm = bmesh.from_edit_mesh(obj.data)
            selected = [face.index for face in bm.faces if face.select]
            if self.quad in selected:
                return selected
            count = len(bm.faces)
        return [self.quad] if 0 <= self.quad < count else []

    def _warn_no_spiral(self) -> set[str]:
        self.report({"WARNING"}, translate("There is no spiral there"))
        return {"CANCELLED"}


class HoldSpiral(_OnSpiral, bpy.types.Operator):
    """Hold a spiral where it lies in the target, or let go of it"""

    bl_idname = "flexmaps.hold_spiral"
    bl_label = "Hold or let go"

    quad: bpy.props.IntProperty(name="Quad", default=UNDER_MOUSE, min=UNDER_MOUSE, options={"SKIP_SAVE"})  # type: ignore[valid-type]

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return self.execute(context) if self._pick_quad(context, event) else {"PASS_THROUGH"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ..bridge.store import handles

        quads = self._affected_quads(context.object)
        if not quads:
            return self._warn_no_spiral()
        values = handles.read(context.object, handles.HELD)
        values[quads] = 0.0 if values[self.quad] > 0.5 else 1.0
        handles.write(context.object, handles.HELD, values)
        redraw(context)
        return {"FINISHED"}


class DragSpiral(_OnSpiral, bpy.types.Operator):
    """Drag a spiral: a force that pulls at it, or a place where Optimise shall bring it"""

    bl_idname = "flexmaps.drag_spiral"
    bl_label = "Pull or wish"
    bl_options = {"REGISTER", "UNDO", "BLOCKING"}

    quad: bpy.props.IntProperty(name="Quad", default=UNDER_MOUSE, min=UNDER_MOUSE, options={"SKIP_SAVE"})  # type: ignore[valid-type]
    kind: bpy.props.EnumProperty(name="Kind", items=KINDS, default="PULL")  # type: ignore[valid-type]
    by: bpy.props.FloatVectorProperty(  # type: ignore[valid-type]
        name="By",
        description="In world axes: newtons of a pull, millimetres of a wish beside the target; 0 takes it away",
        size=3,
        options={"SKIP_SAVE"},
    )
    tap: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Tap",
        description="A press that does not move holds the spiral, or lets it go",
        options={"SKIP_SAVE", "HIDDEN"},
    )
    _press_position: Any = None  # mouse position at the press, pixels of the window
    _is_drag = False  # whether the mouse has moved far enough for a drag
    _stored_values: Any = None  # values of the handle's attribute for all quads before the drag
    _grip: Any = None  # the mouse's start point in 3D, and the quad's centre, in the scene's units
    _start_value: Any = None  # the handle's value at the start of the drag, in the units of ``by``

    def execute(self, context: bpy.types.Context) -> set[str]:
        quads = self._affected_quads(context.object)
        if not quads:
            return self._warn_no_spiral()
        self._write_value(context, quads)
        return {"FINISHED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        import numpy as np

        from ..bridge.store import handles
        from ..bridge.view import picking

        if not self._pick_quad(context, event):
            return {"PASS_THROUGH"}
        obj = context.object
        self._stored_values = handles.read(obj, _handle_name(self.kind))
        scale = context.scene.unit_settings.scale_length
        points, quads = picking.visible_surface(obj, live.live_shape_of(obj))
        middle = points[quads[self.quad]].mean(axis=0)
        if self.kind == "WISH":
            self._start_value = 1e3 * scale * (middle - picking.target_vertices(obj)[quads[self.quad]].mean(axis=0))
            if self._stored_values[self.quad].any():  # continue from an existing drag target
                self._start_value = 1e3 * scale * (np.array(obj.matrix_world)[:3, :3] @ self._stored_values[self.quad])
        else:
            self._start_value = self._stored_values[self.quad].copy()
        self._grip = self._mouse_in_space(context, event, middle), middle
        self._press_position, self._is_drag = (event.mouse_x, event.mouse_y), not self.tap
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        from ..bridge.store import handles

        if event.type in {"ESC", "RIGHTMOUSE"} and event.value == "PRESS":
            handles.write(context.object, _handle_name(self.kind), self._stored_values)
            self._end_drag(context)
            return {"CANCELLED"}
        far = max(abs(event.mouse_x - self._press_position[0]), abs(event.mouse_y - self._press_position[1]))
        self._is_drag |= far > context.preferences.inputs.drag_threshold_mouse
        if event.type == "MOUSEMOVE" and self._is_drag:
            self.by = self._dragged_value(context, event)
            self._write_value(context, self._affected_quads(context.object))
            _show_value(context, self.kind, self.by)
        if event.type == "LEFTMOUSE" and event.value == "RELEASE":
            self._end_drag(context)
            if self._is_drag:
                return {"FINISHED"}
            bpy.ops.flexmaps.hold_spiral(quad=self.quad)
            return {"CANCELLED"}
        return {"RUNNING_MODAL"}

    def _end_drag(self, context: bpy.types.Context) -> None:
        if context.area is not None:
            context.area.header_text_set(None)
            context.workspace.status_text_set(None)
        redraw(context)

    def _mouse_in_space(self, context: bpy.types.Context, event: bpy.types.Event, depth: Sequence[float]) -> Vector:
        from bpy_extras import view3d_utils
        from mathutils import Vector

        mouse = event.mouse_region_x, event.mouse_region_y
        return view3d_utils.region_2d_to_location_3d(context.region, context.region_data, mouse, Vector(depth))

    def _dragged_value(self, context: bpy.types.Context, event: bpy.types.Event) -> np.ndarray:
        """Return the handle's value: the value at the start plus the mouse's displacement, in the units of ``by``."""
        import numpy as np

        from ..bridge.view import picking

        start, middle = self._grip
        way = np.array(self._mouse_in_space(context, event, middle) - start)
        if self.kind == "PULL":
            return self._start_value + way / picking.median_edge(context.object)
        return self._start_value + 1e3 * context.scene.unit_settings.scale_length * way

    def _write_value(self, context: bpy.types.Context, quads: list[int]) -> None:
        import numpy as np

        from ..bridge.store import handles

        obj, name = context.object, _handle_name(self.kind)
        values, by = handles.read(obj, name), np.array(self.by, dtype=float)
        if self.kind == "WISH":
            scale = 1e-3 / context.scene.unit_settings.scale_length
            by = np.linalg.inv(np.array(obj.matrix_world)[:3, :3]) @ (scale * by)
        values[quads] = by
        handles.write(obj, name, values)
        redraw(context)


class ClearHandles(ImmediateOperator, ObjectOperator, bpy.types.Operator):
    """Take all handles away: let go of single spirals, end their pulls and wishes"""

    bl_idname = "flexmaps.clear_handles"
    bl_label = "Take handles away"

    def run(self, context: bpy.types.Context) -> None:
        import numpy as np

        from ..bridge.store import handles

        for name in handles.NAMES:
            handles.write(context.object, name, np.zeros(0))


def _handle_name(kind: str) -> str:
    from ..bridge.store import handles

    return handles.PULL if kind == "PULL" else handles.WISH


def _show_value(context: bpy.types.Context, kind: str, by: Iterable[float]) -> None:
    size = sum(x * x for x in by) ** 0.5
    text = translate("Pull: {:.2f} N", size) if kind == "PULL" else translate("Wish: {:.1f} mm beside the target", size)
    if context.area is not None:
        context.area.header_text_set(text)
        context.workspace.status_text_set(translate("Release: keep, Esc: back"))


CLASSES = (HoldSpiral, DragSpiral, ClearHandles)

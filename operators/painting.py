"""Change spirals by hand: with strokes of the brush, or from vertex weights and colours."""

from __future__ import annotations

import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty, FloatProperty, StringProperty

from ..bridge.hosts import preload
from ..bridge.store import stored_report
from ..bridge.store.i18n import translate
from ..bridge.view.brush_settings import QUANTITY_ITEMS, search_sources
from ..engine.errors import FlexMapsError
from .stage import POLL_INTERVAL, ImmediateOperator, ObjectOperator, PolledOperator, reason_unavailable, redraw


class _PaintOperator(PolledOperator):
    """Base of operators that need existing spirals and object mode."""

    @classmethod
    def problem(cls, context: bpy.types.Context) -> str | None:
        return reason_unavailable(cls.obstacle, context.object)

    @classmethod
    def obstacle(cls, obj: bpy.types.Object) -> str | None:
        if obj.mode != "OBJECT":
            return "Go to Object Mode to paint spirals"
        return stored_report.missing_result(obj.data, "design")


class PickBrush(ImmediateOperator, _PaintOperator, bpy.types.Operator):
    """Paint spirals in the 3D view: drag over the surface. F and Shift F change size and strength, Ctrl turns the brush round, Shift smooths"""

    bl_idname = "flexmaps.pick_brush"
    bl_label = "Paint spirals"
    bl_options = {"REGISTER"}

    def run(self, context: bpy.types.Context) -> None:
        from ..bridge.view import paint_session

        paint_session.get_session(context.object, context.scene)
        bpy.ops.wm.tool_set_by_id(name=paint_session.TOOL_ID)


class PaintStroke(_PaintOperator, bpy.types.Operator):
    """Paint spirals where the pointer goes"""

    bl_idname = "flexmaps.paint_stroke"
    bl_label = "Paint spirals"
    bl_options = {"UNDO"}

    inverted: BoolProperty(options={"SKIP_SAVE"})  # type: ignore[valid-type]
    smooth: BoolProperty(options={"SKIP_SAVE"})  # type: ignore[valid-type]

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        preload.wait()
        from ..bridge.view import brush_path, dab_queue, paint_session

        try:
            self._session = paint_session.get_session(context.object, context.scene)
        except FlexMapsError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self._path = brush_path.BrushPath(context.object, self._session)
        self._ending = False
        if self._path.cast_ray(context, event.mouse_region_x, event.mouse_region_y) is None:
            return {"PASS_THROUGH"}
        paint_session.begin_stroke()
        brush = context.window_manager.flexmaps_brush.brush
        name = "smooth" if self.smooth and brush != "protect" else brush
        self._dabs = dab_queue.DabQueue(self._session, name, self.inverted)
        self._timer = context.window_manager.event_timer_add(POLL_INTERVAL, window=context.window)
        context.window_manager.modal_handler_add(self)
        self._add_dabs(context, event)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        taken_back = event.type in {"ESC", "RIGHTMOUSE"} and event.value == "PRESS"
        try:
            if taken_back:
                self._dabs.close()
                self._session.revert()
            elif event.type == "MOUSEMOVE" and not self._ending:
                self._add_dabs(context, event)
            elif event.type == "LEFTMOUSE" and event.value == "RELEASE":
                self._ending = True
            elif self._ending and _is_press(event):  # another stroke or key began: finish this stroke first
                self._dabs.wait()
            if not taken_back and self._dabs.poll():
                redraw(context)
            if self._ending and not taken_back and self._dabs.try_finish():
                return self._finish_stroke(context, event)
        except Exception:
            self._end_stroke(context)
            raise
        if taken_back:
            self._end_stroke(context)
            return {"CANCELLED"}
        return {"RUNNING_MODAL"}

    def _add_dabs(self, context: bpy.types.Context, event: bpy.types.Event) -> None:
        made = self._path.extend(context, event)
        if made is not None:
            self._dabs.add(*made)

    def _finish_stroke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Write the stroke into the object, and pass on the event if it is a new press."""
        from ..bridge.view import paint_session

        try:
            self._session.write(context.scene)
        except FlexMapsError as error:  # the object was deleted
            self.report({"ERROR"}, str(error))
            paint_session.discard_session()
            return {"CANCELLED"}
        finally:
            self._end_stroke(context)
        return {"FINISHED", "PASS_THROUGH"} if _is_press(event) else {"FINISHED"}

    def cancel(self, context: bpy.types.Context) -> None:
        self._end_stroke(context)

    def _end_stroke(self, context: bpy.types.Context) -> None:
        from ..bridge.view import paint_session

        self._dabs.close()
        context.window_manager.event_timer_remove(self._timer)
        paint_session.end_stroke()
        redraw(context)


def _is_press(event: bpy.types.Event) -> bool:
    """Return whether the event is the press of a key or mouse button."""
    return event.value == "PRESS" and event.type not in {"MOUSEMOVE", "INBETWEEN_MOUSEMOVE", "TIMER"}


class PaintFrom(ImmediateOperator, _PaintOperator, bpy.types.Operator):
    """Change all spirals by a vertex group's weights, a colour's brightness or other numbers of the object, which weight paint, vertex paint or geometry nodes made"""

    bl_idname = "flexmaps.paint_from"
    bl_label = "Paint from weights or colours"

    source: StringProperty(name="From", search=search_sources)  # type: ignore[valid-type]
    what: EnumProperty(name="Sets", items=QUANTITY_ITEMS)  # type: ignore[valid-type]
    strength: FloatProperty(name="Strength", default=1.0, min=0.0, max=1.0, subtype="FACTOR")  # type: ignore[valid-type]
    inverted: BoolProperty(name="The other way round")  # type: ignore[valid-type]
    direction: EnumProperty(name="Along", items=(("x", "X", ""), ("y", "Y", ""), ("z", "Z", "")))  # type: ignore[valid-type]

    def run(self, context: bpy.types.Context) -> str:
        from ..bridge.store import fields, mesh
        from ..bridge.view import paint_session
        from ..engine.spirals.painting import Stroke

        obj = context.object
        if not self.source:
            raise FlexMapsError("Choose a vertex group, a colour or other numbers of the object under From")
        values = fields.read_field(obj, mesh.read_surface(obj, context.scene), self.source)
        on = paint_session.get_session(obj, context.scene)
        way = np.eye(3)["xyz".index(self.direction)]
        weight = np.full(len(values), self.strength) if self.what == "stiffness" else self.strength * values
        if self.what == "protect":
            weight = values
        on.paint(self.what, weight, Stroke(self.inverted, way, values))
        changed = int(on.changed_spirals.sum())
        on.write(context.scene)
        if self.what == "protect":
            kept = int(on.protected.sum())
            return translate("{} spiral is protected" if kept == 1 else "{} spirals are protected", kept)
        return translate("{} spiral painted" if changed == 1 else "{} spirals painted", changed)


class Unprotect(ImmediateOperator, ObjectOperator, bpy.types.Operator):
    """Let Optimise and the brushes change all spirals again"""

    bl_idname = "flexmaps.unprotect"
    bl_label = "Protect none"

    def run(self, context: bpy.types.Context) -> None:
        from ..bridge.store import fields
        from ..bridge.view import paint_session

        fields.write_protected(context.object, None)
        paint_session.discard_session()


CLASSES = (PickBrush, PaintStroke, PaintFrom, Unprotect)

"""Spirals changed by hand: by strokes of the brush, and by weights and colours that other tools made."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty, FloatProperty, StringProperty

from ..bridge.hosts import background, preload
from ..bridge.store import notes
from ..bridge.store.i18n import translate
from ..bridge.store.objects import changed_by_modifiers, unusable
from ..engine.errors import FlexMapsError
from .brush import FROM, sources
from .stage import TICK, OnObject, Polled, redraw, still_running

SPACING = 0.25  # of the radius, between two dabs on the way of the pointer
FLOW = 0.4  # of the strength, by one dab: four of them, as one place gets them from a passing brush, make nine tenths of it; by eye


def why_not(obj: bpy.types.Object | None) -> str | None:
    """Why its spirals cannot be painted, as a sentence; ``None`` if they can."""
    running = background.current()
    if running is not None:
        return still_running(running)
    problem = unusable(obj)
    if problem is None and obj is not None:
        problem = changed_by_modifiers(obj) or notes.missing(obj.data, "design")
    if problem is None and obj is not None and obj.mode != "OBJECT":
        return "Go to Object Mode to paint spirals"
    return problem


class _Painter(Polled):
    """Base of what needs spirals that can be painted."""

    @classmethod
    def problem(cls, context: bpy.types.Context) -> str | None:
        return why_not(context.object)


class PickBrush(_Painter, bpy.types.Operator):
    """Paint spirals in the 3D view: drag over the surface. F and Shift F change size and strength, Ctrl turns the brush round, Shift smooths"""

    bl_idname = "flexmaps.pick_brush"
    bl_label = "Paint spirals"

    def execute(self, context: bpy.types.Context) -> set[str]:
        preload.wait()
        from ..bridge.view import easel

        try:
            easel.of(context.object, context.scene)
        except FlexMapsError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        bpy.ops.wm.tool_set_by_id(name=easel.TOOL)
        redraw(context)
        return {"FINISHED"}


class PaintStroke(_Painter, bpy.types.Operator):
    """Paint spirals where the pointer goes"""

    bl_idname = "flexmaps.paint_stroke"
    bl_label = "Paint spirals"
    bl_options = {"UNDO"}

    inverted: BoolProperty(options={"SKIP_SAVE"})  # type: ignore[valid-type]
    smooth: BoolProperty(options={"SKIP_SAVE"})  # type: ignore[valid-type]

    def invoke(self, context: bpy.types.Context, event: Any) -> set[str]:
        preload.wait()
        from ..bridge.view import dabs, easel

        try:
            self._easel = easel.of(context.object, context.scene)
        except FlexMapsError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self._object: Any = context.object
        self._last: np.ndarray | None = None  # of the pointer, in pixels of the region
        self._place: np.ndarray | None = None  # of the last dab, in the object's frame
        self._ending = False
        if self._hit(context, event.mouse_region_x, event.mouse_region_y) is None:
            return {"PASS_THROUGH"}
        easel.stroke_begins()
        brush = context.window_manager.flexmaps_brush.brush
        name = "smooth" if self.smooth and brush != "protect" else brush
        self._dabs = dabs.Dabs(self._easel, name, self.inverted)
        self._timer = context.window_manager.event_timer_add(TICK, window=context.window)
        context.window_manager.modal_handler_add(self)
        self._move(context, event)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: Any) -> set[str]:
        taken_back = event.type in {"ESC", "RIGHTMOUSE"} and event.value == "PRESS"
        try:
            if taken_back:
                self._dabs.close()
                self._easel.revert()
            elif event.type == "MOUSEMOVE" and not self._ending:
                self._move(context, event)
            elif event.type == "LEFTMOUSE" and event.value == "RELEASE":
                self._ending = True
            elif self._ending and _pressed(event):  # the next stroke, or another key: this one first
                self._dabs.wait()
            if not taken_back and self._dabs.look():
                redraw(context)
            if self._ending and not taken_back and self._dabs.over():
                return self._written(context, event)
        except Exception:
            self._over(context)
            raise
        if taken_back:
            self._over(context)
            return {"CANCELLED"}
        return {"RUNNING_MODAL"}

    def _written(self, context: bpy.types.Context, event: Any) -> set[str]:
        """The object gets the stroke; what was pressed meanwhile is for whoever comes next."""
        from ..bridge.view import easel

        try:
            self._easel.write(context.scene)
        except FlexMapsError as error:  # the object is gone
            self.report({"ERROR"}, str(error))
            easel.forget()
            return {"CANCELLED"}
        finally:
            self._over(context)
        return {"FINISHED", "PASS_THROUGH"} if _pressed(event) else {"FINISHED"}

    def cancel(self, context: bpy.types.Context) -> None:
        self._over(context)

    def _over(self, context: bpy.types.Context) -> None:
        from ..bridge.view import easel

        self._dabs.close()
        context.window_manager.event_timer_remove(self._timer)
        easel.stroke_ends()
        redraw(context)

    def _hit(self, context: bpy.types.Context, x: float, y: float) -> tuple[Any, Any] | None:
        """Where the ray through a pixel of the region meets the object, and its normal there, in the object's frame."""
        from bpy_extras import view3d_utils

        region, view = context.region, context.region_data
        inverse = self._object.matrix_world.inverted_safe()
        start = inverse @ view3d_utils.region_2d_to_origin_3d(region, view, (x, y))
        way = inverse.to_3x3() @ view3d_utils.region_2d_to_vector_3d(region, view, (x, y))
        seen = self._object.evaluated_get(context.evaluated_depsgraph_get())
        found, place, normal, _ = seen.ray_cast(start, way.normalized())
        if not found:
            return None
        return place, normal if normal.dot(way) < 0.0 else -normal

    def _move(self, context: bpy.types.Context, event: Any) -> None:
        """Dabs from where the pointer was to where it is, put together into one change."""
        brush = context.window_manager.flexmaps_brush
        pressure = event.pressure if event.is_tablet else 1.0
        size = brush.size * (pressure if brush.pressure_size else 1.0)
        here = np.array([event.mouse_region_x, event.mouse_region_y], dtype=float)
        last = here if self._last is None else self._last
        steps = max(1, int(np.linalg.norm(here - last) / max(SPACING * size, 1.0)))
        if self._last is not None and np.linalg.norm(here - last) < SPACING * size:
            return
        self._last = here
        weights, ways = list[np.ndarray](), list[np.ndarray]()
        for k in range(steps):
            found = self._hit(context, *(last + (here - last) * (k + 1) / steps))
            if found is None:
                self._place = None
                continue
            weights.append(self._dab(context, *found, size))
            place = np.array(found[0])
            if self._place is not None:
                ways.append(place - self._place)
            self._place = place
        if weights:
            strength = FLOW * brush.strength * (pressure if brush.pressure_strength else 1.0)
            strength = 1.0 if brush.brush == "protect" else strength
            way = np.array(self._object.matrix_world.to_3x3()) @ np.sum([np.zeros(3), *ways], axis=0)
            self._dabs.add([strength * weight for weight in weights], way)

    def _dab(self, context: bpy.types.Context, place: Any, normal: Any, size: float) -> np.ndarray:
        """The weight of one dab, mirrored where the brush is."""
        from bpy_extras import view3d_utils
        from mathutils import Vector

        frame, scale = self._object.matrix_world, context.scene.unit_settings.scale_length
        region, view = context.region, context.region_data
        centre = view3d_utils.location_3d_to_region_2d(region, view, frame @ place)
        beside = view3d_utils.region_2d_to_location_3d(region, view, centre + Vector((size, 0.0)), frame @ place)
        radius = (beside - frame @ place).length * scale
        turned = frame.to_3x3().inverted_safe().transposed()
        sides = (1.0, -1.0) if context.window_manager.flexmaps_brush.mirror else (1.0,)
        found = []
        for side in sides:
            over = Vector((side, 1.0, 1.0))
            where = np.array(frame @ (place * over)) * scale
            found.append(self._easel.ground.weight(where, np.array(turned @ (normal * over)), radius))
        return np.max(found, axis=0)


def _pressed(event: Any) -> bool:
    """Whether a key or a button went down."""
    return event.value == "PRESS" and event.type not in {"MOUSEMOVE", "INBETWEEN_MOUSEMOVE", "TIMER"}


class PaintFrom(_Painter, bpy.types.Operator):
    """Change all spirals by a vertex group's weights, a colour's brightness or other numbers of the object, which weight paint, vertex paint or geometry nodes made"""

    bl_idname = "flexmaps.paint_from"
    bl_label = "Paint from weights or colours"
    bl_options = {"REGISTER", "UNDO"}

    source: StringProperty(name="From", search=sources)  # type: ignore[valid-type]
    what: EnumProperty(name="Sets", items=FROM)  # type: ignore[valid-type]
    strength: FloatProperty(name="Strength", default=1.0, min=0.0, max=1.0, subtype="FACTOR")  # type: ignore[valid-type]
    inverted: BoolProperty(name="The other way round")  # type: ignore[valid-type]
    direction: EnumProperty(name="Along", items=(("x", "X", ""), ("y", "Y", ""), ("z", "Z", "")))  # type: ignore[valid-type]

    def execute(self, context: bpy.types.Context) -> set[str]:
        preload.wait()
        from ..bridge.store import fields, mesh
        from ..bridge.view import easel
        from ..engine.spirals.painting import Stroke

        obj = context.object
        try:
            if not self.source:
                raise FlexMapsError("Choose a vertex group, a colour or other numbers of the object under From")
            values = fields.of(obj, mesh.read_surface(obj, context.scene), self.source)
            on = easel.of(obj, context.scene)
            way = np.eye(3)["xyz".index(self.direction)]
            weight = np.full(len(values), self.strength) if self.what == "stiffness" else self.strength * values
            if self.what == "protect":
                weight = values
            on.paint(self.what, weight, Stroke(self.inverted, way, values))
            changed = int(on.changed.sum())
            on.write(context.scene)
        except FlexMapsError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        redraw(context)
        kept = int(on.protected.sum())
        text = (
            translate("{} spirals are protected", kept)
            if self.what == "protect"
            else translate("{} spirals painted", changed)
        )
        self.report({"INFO"}, text)
        return {"FINISHED"}


class Unprotect(OnObject, bpy.types.Operator):
    """Let Optimise and the brushes change all spirals again"""

    bl_idname = "flexmaps.unprotect"
    bl_label = "Protect none"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        preload.wait()
        from ..bridge.store import fields
        from ..bridge.view import easel

        fields.protect(context.object, None)
        easel.forget()
        redraw(context)
        return {"FINISHED"}


CLASSES = (PickBrush, PaintStroke, PaintFrom, Unprotect)

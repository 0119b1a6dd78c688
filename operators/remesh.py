"""Making quads, and giving them their size."""

from __future__ import annotations

from typing import Any

import bpy

from ..bridge import job, notes, settings, warm
from ..bridge.objects import find, unusable
from ..bridge.words import named, told
from ..engine.errors import Cancelled, FlexMapsError
from ..engine.params import ObjectSettings
from ..engine.progress import Progress
from .stage import Stage, Work, redraw, show_progress, still_running


class QuadRemesh(bpy.types.Operator):
    """Make a new object of quads in the shape of this one, and hide this one. Modifiers are applied on the way"""

    bl_idname = "flexmaps.quad_remesh"
    bl_label = "Quad remesh"
    bl_options = {"REGISTER", "UNDO"}

    _work: job.Steps
    _timer: Any = None
    _source = 0  # Blender's id of the object that is remeshed

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        obj = context.object
        running = job.current()
        problem = unusable(obj) if running is None else still_running(running)
        if problem is None and obj.mode != "OBJECT":
            problem = "Go to Object Mode: a new object is made"
        if problem is not None:
            cls.poll_message_set(told(problem))
        return problem is None

    def execute(self, context: bpy.types.Context) -> set[str]:
        work = self._begin(context)
        while not work.finished:
            work.step()
        return self._end(context, work)

    def invoke(self, context: bpy.types.Context, event: Any) -> set[str]:
        if bpy.app.background:
            return self.execute(context)
        self._work = self._begin(context)
        manager = context.window_manager
        self._timer = manager.event_timer_add(0.05, window=context.window)
        manager.progress_begin(0, 100)
        manager.modal_handler_add(self)
        show_progress(context, self._work)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: Any) -> set[str]:
        """Only the stop is heard: what Blender works on must not be edited meanwhile."""
        if event.type == "ESC" and event.value == "PRESS":
            self._work.stop()
        elif event.type == "TIMER":
            self._work.step()
            if self._work.finished:
                return self._end(context, self._work)
        show_progress(context, self._work)
        return {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Called by Blender when the window closes meanwhile."""
        self._clear(context, self._work)

    def _begin(self, context: bpy.types.Context) -> job.Steps:
        warm.wait()
        from ..bridge import remesh

        self._source = context.object.session_uid
        wanted = settings.read(context.object.flexmaps, ObjectSettings).remesh
        work = job.Steps(self.bl_label, remesh.quads_in_pieces(context.object, context, wanted.quads, wanted.smooth))
        work.start()
        return work

    def _end(self, context: bpy.types.Context, work: job.Steps) -> set[str]:
        self._clear(context, work)
        if isinstance(work.error, Cancelled):
            self.report({"WARNING"}, told("{} was stopped; nothing was changed", named(self.bl_label)))
            return {"CANCELLED"}
        if isinstance(work.error, FlexMapsError):
            self.report({"ERROR"}, str(work.error))
            return {"CANCELLED"}
        if work.error is not None:
            raise work.error
        self.report({"INFO"}, _take_over(context, find(self._source), work.result))
        return {"FINISHED"}

    def _clear(self, context: bpy.types.Context, work: job.Steps) -> None:
        work.end()
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            context.window_manager.progress_end()
            self._timer = None
        if context.workspace is not None:
            context.workspace.status_text_set(None)
        redraw(context)


def _take_over(context: bpy.types.Context, obj: bpy.types.Object, made: bpy.types.Object) -> str:
    """The new object takes the place of the old one, with its settings; returns what there is to say."""
    from ..bridge import beside, mesh
    from ..engine.surface import check

    settings.write(made.flexmaps, settings.read(obj.flexmaps, ObjectSettings))
    beside.clear(obj)
    obj.select_set(False)
    obj.hide_set(True)
    obj.hide_render = True
    context.view_layer.objects.active = made
    made.select_set(True)
    redraw(context)
    edge = check.median_edge(mesh.read_surface(made, context.scene).polygons)
    return told("'{}': {} quads, edge {:.3g} mm", made.name, len(made.data.polygons), edge * 1e3)


class SetSize(Stage, bpy.types.Operator):
    """Scale the object so that the median edge of its quads has the length that is set. Seams stay; flat patches go"""

    bl_idname = "flexmaps.set_size"
    bl_label = "Scale to quad edge"

    @classmethod
    def obstacle(cls, obj: bpy.types.Object) -> str | None:
        return "The object's scale is locked; unlock it first" if any(obj.lock_scale) else None

    def prepare(self, surface: Any, settings: ObjectSettings) -> Work:
        def work(progress: Progress) -> Any:
            from ..engine.surface import check

            progress(0.0, "Measuring edges")
            now = check.median_edge(surface.polygons)
            if not 0 < now < float("inf"):
                raise FlexMapsError("The mesh has no size: its edges have no length; scale it by hand first")
            scaled = check.scaled(surface.polygons, edge=settings.remesh.edge)
            return settings.remesh.edge / now, check.findings(scaled)

        return work

    def finish(self, context: bpy.types.Context, obj: bpy.types.Object, surface: Any, result: Any) -> str:
        from ..bridge import beside, mesh

        factor, findings = result
        obj.scale = [s * factor for s in obj.scale]
        context.view_layer.update()
        mesh.forget(obj, mesh.NAMES)
        beside.clear(obj)
        notes.drop_from(obj.data, "layout")
        notes.write_checks(obj.data, findings)
        return told("Scaled by {:.4g}", factor)


CLASSES = (QuadRemesh, SetSize)

"""Making quads, and giving them their size."""

from __future__ import annotations

from typing import Any

import bpy

from ..bridge import notes
from ..engine.errors import FlexMapsError
from ..engine.params import ObjectSettings
from ..engine.progress import Progress
from .stage import Stage, Work, redraw


class QuadRemesh(bpy.types.Operator):
    """Make a new object of quads in the shape of this one, and hide this one. Modifiers are applied on the way"""

    bl_idname = "flexmaps.quad_remesh"
    bl_label = "Quad remesh"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        from ..bridge import job
        from ..bridge.objects import unusable

        obj = context.object
        running = job.current()
        problem = f"{running.title} is running" if running is not None else unusable(obj)
        if problem is None and obj.mode != "OBJECT":
            problem = "Go to Object Mode: a new object is made"
        if problem is not None:
            cls.poll_message_set(problem)
        return problem is None

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ..bridge import beside, mesh, remesh, settings
        from ..engine import check

        obj = context.object
        wanted = settings.read(obj.flexmaps, ObjectSettings)
        try:
            made = remesh.quads_from(obj, context, wanted.remesh.quads, wanted.remesh.smooth)
            quads = check.as_quad_mesh(mesh.read_surface(made, context.scene).polygons)
        except FlexMapsError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        settings.write(made.flexmaps, wanted)
        beside.clear(obj)
        obj.select_set(False)
        obj.hide_set(True)
        obj.hide_render = True
        context.view_layer.objects.active = made
        made.select_set(True)
        redraw(context)
        self.report({"INFO"}, f"'{made.name}': {len(quads.quads)} quads, edge {quads.median_edge * 1e3:.3g} mm")
        return {"FINISHED"}


class SetSize(Stage, bpy.types.Operator):
    """Scale the object so that the median edge of its quads has the length that is set. Seams stay; flat patches go"""

    bl_idname = "flexmaps.set_size"
    bl_label = "Scale to quad edge"

    @classmethod
    def obstacle(cls, obj: bpy.types.Object) -> str | None:
        return "The object's scale is locked; unlock it first" if any(obj.lock_scale) else None

    def prepare(self, surface: Any, settings: ObjectSettings) -> Work:
        def work(progress: Progress) -> Any:
            from ..engine import check

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
        return f"Scaled by {factor:.4g}"


CLASSES = (QuadRemesh, SetSize)

"""A surface to try everything on."""

from __future__ import annotations

import bpy

from ..bridge.hosts import background, preload
from ..bridge.store.i18n import translate
from .stage import still_running

NAME = "demo"  # of ``engine.surface.shapes``: a canopy on three feet, through all stages in a minute


class Example(bpy.types.Operator):
    """Add a canopy of 20 mm quads at the 3D cursor, to try everything on"""

    bl_idname = "flexmaps.example"
    bl_label = "Add an example"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        running = background.current()
        problem = still_running(running) if running is not None else None
        if problem is None and context.mode != "OBJECT":
            problem = translate("Go to Object Mode: a new object is made")
        if problem is not None:
            cls.poll_message_set(problem)
        return problem is None

    def execute(self, context: bpy.types.Context) -> set[str]:
        preload.wait()
        from ..bridge.view import framing, scene
        from ..engine.surface import shapes

        for other in context.selected_objects:
            other.select_set(False)
        obj = scene.add_model(context.scene, shapes.make(NAME), "FlexMaps example")
        obj.location = context.scene.cursor.location
        obj.select_set(True)
        context.view_layer.objects.active = obj
        context.view_layer.update()
        framing.frame(context)
        return {"FINISHED"}


CLASSES = (Example,)

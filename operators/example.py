"""A surface to try everything on."""

from __future__ import annotations

import bpy

from ..bridge.hosts import preload
from .stage import NewObject

NAME = "demo"  # of ``engine.surface.shapes``: a canopy on three feet, through all stages in a minute


class Example(NewObject, bpy.types.Operator):
    """Add a canopy of 20 mm quads at the 3D cursor, to try everything on"""

    bl_idname = "flexmaps.example"
    bl_label = "Add an example"
    bl_options = {"REGISTER", "UNDO"}

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

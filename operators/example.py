"""Add an example surface to the scene."""

from __future__ import annotations

import bpy

from .stage import AddObjectOperator, ImmediateOperator

NAME = "demo"  # shape in ``engine.surface.shapes``: a canopy on three feet, which passes all stages in a minute


class Example(ImmediateOperator, AddObjectOperator, bpy.types.Operator):
    """Add a canopy of 20 mm quads at the 3D cursor, to try everything on"""

    bl_idname = "flexmaps.example"
    bl_label = "Add an example"

    def run(self, context: bpy.types.Context) -> None:
        from ..bridge.view import framing, scene
        from ..engine.surface import shapes

        obj = scene.add_model(context.scene, shapes.make(NAME), "FlexMaps example")
        obj.location = context.scene.cursor.location
        framing.select_only(context, obj, context.view_layer)


CLASSES = (Example,)

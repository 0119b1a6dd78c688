"""The tutorial's scene: a lamp shade in a room, to go through all stages with."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..bridge.hosts import preload
from ..bridge.store.i18n import translate
from .stage import NewObject

# made by tools/lamp_shade.py
FILE, SCENE, NAME = Path(__file__).resolve().parents[1] / "data" / "lamp_shade.blend", "Lamp shade", "Lamp shade"


class Tutorial(NewObject, bpy.types.Operator):
    """Add the scene of the tutorial, a lamp shade in an evening, to this file and show it; your own scenes stay as they are"""

    bl_idname = "flexmaps.tutorial"
    bl_label = "Open the tutorial"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        preload.wait()
        from ..bridge.view import framing

        try:
            with bpy.data.libraries.load(str(FILE), link=False) as (there, wanted):
                wanted.scenes = [name for name in there.scenes if name == SCENE]
        except OSError as error:
            self.report({"ERROR"}, translate("The tutorial's file is missing; install FlexMaps again ({})", str(error)))
            return {"CANCELLED"}
        (scene,) = wanted.scenes
        obj = next(o for o in scene.objects if o.type == "MESH" and o.name.startswith(NAME))
        if context.window is not None:
            context.window.scene = scene
        layer = scene.view_layers[0]
        for other in layer.objects:
            other.select_set(other == obj, view_layer=layer)
        layer.objects.active = obj
        layer.update()
        framing.frame(context)
        return {"FINISHED"}


CLASSES = (Tutorial,)

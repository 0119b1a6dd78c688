"""Add the tutorial's scene to the .blend file: a lamp shade in a room."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..bridge.store.i18n import translate
from ..engine.errors import FlexMapsError
from .stage import AddObjectOperator, ImmediateOperator

# the file is made by tools/lamp_shade.py
FILE, SCENE, NAME = Path(__file__).resolve().parents[1] / "data" / "lamp_shade.blend", "Lamp shade", "Lamp shade"


class Tutorial(ImmediateOperator, AddObjectOperator, bpy.types.Operator):
    """Add the scene of the tutorial, a lamp shade in an evening, to this file and show it; your own scenes stay as they are"""

    bl_idname = "flexmaps.tutorial"
    bl_label = "Open the tutorial"

    def run(self, context: bpy.types.Context) -> None:
        from ..bridge.view import framing

        try:
            with bpy.data.libraries.load(str(FILE), link=False) as (there, wanted):
                wanted.scenes = [name for name in there.scenes if name == SCENE]
        except OSError as error:
            text = translate("The tutorial's file is missing; install FlexMaps again ({})", str(error))
            raise FlexMapsError(text) from error
        (scene,) = wanted.scenes
        obj = next(o for o in scene.objects if o.type == "MESH" and o.name.startswith(NAME))
        if context.window is not None:
            context.window.scene = scene
        framing.select_only(context, obj, scene.view_layers[0])


CLASSES = (Tutorial,)

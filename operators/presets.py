"""The user's own presets and the bundled ones, in Blender's preset system.

A preset is a script of assignments to ``settings``. Bundled presets lie in ``presets/flexmaps`` and set what a machine
and its material require; a saved preset holds all settings except those of a single object (vertex groups, forces,
folder).
"""

from __future__ import annotations

from pathlib import Path

import bpy
from bl_operators.presets import AddPresetBase

from ..bridge.store import presets
from ..bridge.store.i18n import translate
from .stage import ObjectOperator

FOLDER = Path(__file__).resolve().parent.parent
MENU = "FLEXMAPS_PT_presets"


class Preset(ObjectOperator, AddPresetBase, bpy.types.Operator):
    """Keep the settings of this object under a name, or remove those kept under it"""

    bl_idname = "flexmaps.preset"
    bl_label = "Add or remove a FlexMaps preset"
    preset_menu = MENU
    preset_subdir = "flexmaps"
    preset_defines = ["settings = bpy.context.object.flexmaps"]
    preset_values = presets.list_expressions()


class ApplyPreset(ObjectOperator, bpy.types.Operator):
    """Take these settings for this object"""

    bl_idname = "flexmaps.apply_preset"
    bl_label = "Apply preset"
    bl_options = {"REGISTER", "UNDO", "INTERNAL"}

    filepath: bpy.props.StringProperty(subtype="FILE_PATH", options={"SKIP_SAVE"})  # type: ignore[valid-type]

    def execute(self, context: bpy.types.Context) -> set[str]:
        if not Path(self.filepath).is_file():
            self.report({"ERROR"}, translate("There is no preset {}; choose another one", self.filepath))
            return {"CANCELLED"}
        # Blender's own operator makes no undo step; called from this operator, it gets one
        done: set[str] = bpy.ops.script.execute_preset(filepath=self.filepath, menu_idname=MENU)
        presets.write_last_preset(context.object, Path(self.filepath))
        return done


def register() -> None:
    if hasattr(bpy.utils, "register_preset_path"):  # Blender 4.3 and later
        bpy.utils.register_preset_path(str(FOLDER))


def unregister() -> None:
    if hasattr(bpy.utils, "unregister_preset_path"):
        bpy.utils.unregister_preset_path(str(FOLDER))


CLASSES = (Preset, ApplyPreset)

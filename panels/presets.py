"""Blender's menu of presets, at the right of the tab's heading, labelled with the name of the last applied preset."""

from __future__ import annotations

from typing import Any

import bpy
from bl_ui.utils import PresetPanel as BlenderPresets

from ..bridge.store import presets
from .rows import tr


class PresetPanel(BlenderPresets, bpy.types.Panel):
    bl_idname = "FLEXMAPS_PT_presets"
    bl_label = "FlexMaps presets"
    preset_subdir = "flexmaps"
    preset_operator = "flexmaps.apply_preset"
    preset_add_operator = "flexmaps.preset"

    @classmethod
    def draw_by_name(cls, layout: Any, obj: bpy.types.Object) -> None:
        """Draw the menu, labelled with the last applied preset, and a star if a setting was changed since."""
        layout.popover(panel=cls.bl_idname, text=presets.read_last_preset(obj)[0] or tr("Presets"), translate=False)


CLASSES = (PresetPanel,)

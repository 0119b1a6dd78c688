"""Blender's menu of presets, at the right of the tab's first heading."""

from __future__ import annotations

from typing import Any

import bpy
from bl_ui.utils import PresetPanel as BlenderPresets


class PresetPanel(BlenderPresets, bpy.types.Panel):
    bl_idname = "FLEXMAPS_PT_presets"
    bl_label = "FlexMaps presets"
    preset_subdir = "flexmaps"
    preset_operator = "flexmaps.apply_preset"
    preset_add_operator = "flexmaps.preset"

    @classmethod
    def draw_panel_header(cls, layout: Any) -> None:
        """As Blender's own, which fails where a class's name is not its idname."""
        layout.emboss = "NONE"
        layout.popover(panel=cls.bl_idname, icon="PRESET", text="")

"""Add a remnant (left-over piece of sheet) from a drawing."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..bridge.store.i18n import translate
from .file_writer import FileDialogOperator
from .stage import ImmediateOperator, ObjectOperator


class AddRemnant(FileDialogOperator, ImmediateOperator, ObjectOperator, bpy.types.Operator):
    """Choose a DXF or SVG drawing of an odd piece of sheet, which is filled before whole sheets are"""

    bl_idname = "flexmaps.add_remnant"
    bl_label = "Add remnant"

    filepath: bpy.props.StringProperty(subtype="FILE_PATH", options={"SKIP_SAVE"})  # type: ignore[valid-type]
    filter_glob: bpy.props.StringProperty(default="*.dxf;*.svg", options={"HIDDEN"})  # type: ignore[valid-type]

    def run(self, context: bpy.types.Context) -> str:
        from ..engine.fabrication.nesting.remnants import SEPARATOR, read_file

        remnants = read_file(Path(bpy.path.abspath(self.filepath)))
        sheet = context.object.flexmaps.sheet
        sheet.remnants = SEPARATOR.join([*filter(None, [sheet.remnants.strip()]), bpy.path.abspath(self.filepath)])
        sizes = ", ".join(f"{1e3 * one.size[0]:.0f} x {1e3 * one.size[1]:.0f} mm" for one in remnants)
        return translate("Remnant of {}", sizes)


CLASSES = (AddRemnant,)

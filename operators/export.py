"""The sheets as files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from ..bridge import notes
from ..engine.errors import FlexMapsError
from ..engine.params import ObjectSettings
from ..engine.progress import Progress
from .stage import Stage, Work


class Export(Stage, bpy.types.Operator):
    """Place the panels on sheets and write them as SVG and DXF, in true millimetres"""

    bl_idname = "flexmaps.export"
    bl_label = "Export sheets"

    @classmethod
    def obstacle(cls, obj: bpy.types.Object) -> str | None:
        return None if "spirals" in notes.read(obj.data) else "Press Spirals first"

    def prepare(self, surface: Any, settings: ObjectSettings) -> Work:
        from ..bridge import mesh
        from ..bridge.objects import find

        base = _folder(settings.export.folder) / _file_name(find(surface.uid).name)
        versions = {"NONE": (), "BOTH": ("R2010", "R12")}.get(settings.export.dxf, (settings.export.dxf,))
        if not versions and not settings.export.svg:
            raise FlexMapsError("No file type is chosen; switch SVG or DXF on")

        def work(progress: Progress) -> Any:
            from ..engine import check, dxf, sheets, svg

            progress(0.0, "Reading the spirals")
            flat = mesh.current_flat(surface, check.as_quad_mesh(surface.polygons))
            design = mesh.design_of(surface, flat, settings.spiral)
            if design is None:
                raise FlexMapsError("There are no spirals yet; press Spirals first")
            made = sheets.make_sheets(design, settings.sheet, progress.part(0.0, 0.8))
            progress(0.8, "Writing files")
            _make_folder(base.parent)
            files = []
            if settings.export.svg:
                files.append(base.with_suffix(".svg"))
                svg.write(made, files[-1])
            for version in versions:
                progress(0.9, "Writing files")
                files.append(base.parent / f"{base.name}{'-r12' if version == 'R12' else ''}.dxf")
                dxf.write(made, files[-1], version=version)
            return made, sheets.sheets_report(made) | {"files": [file.name for file in files]}, base.parent

        return work

    def finish(self, context: bpy.types.Context, obj: bpy.types.Object, surface: Any, result: Any) -> str:
        _, block, folder = result
        notes.write(obj.data, "sheets", block)
        return f"{', '.join(block['files'])} in {folder}"


def _folder(text: str) -> Path:
    if text.startswith("//") and not bpy.data.filepath:
        raise FlexMapsError("Save the .blend file first, or choose a folder that does not begin with //")
    if not text.strip():
        raise FlexMapsError("Choose a folder for the files")
    return Path(bpy.path.abspath(text))


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FlexMapsError(f"The folder {folder} cannot be made ({error.strerror}); choose another one") from error


def _file_name(name: str) -> str:
    return bpy.path.clean_name(name) or "flexmaps"


CLASSES = (Export,)

"""The sheets as files."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy

from ..bridge import notes
from ..bridge.words import told
from ..engine.errors import FlexMapsError
from ..engine.params import ExportParams, ObjectSettings
from ..engine.progress import Progress
from .spirals import Drawn
from .stage import Stage, Work


class Export(Stage, bpy.types.Operator):
    """Place the panels on sheets and write them for the cutter or the printer, in true millimetres, with an assembly sheet"""

    bl_idname = "flexmaps.export"
    bl_label = "Export sheets"

    @classmethod
    def obstacle(cls, obj: bpy.types.Object) -> str | None:
        return None if "spirals" in notes.read(obj.data) else "Press Spirals first"

    def prepare(self, surface: Any, settings: ObjectSettings) -> Work:
        from ..bridge import beside, equilibrium, mesh, supports
        from ..bridge.objects import find

        formats = _formats(settings.export)
        obj = find(surface.uid)
        name, look = obj.name, Drawn.look_of(settings)
        # panels that stand beside the model with other connectors are drawn anew
        stale = any(o.get(beside.LOOK, look) != look for o in beside.panels_of(obj))
        base = _folder(settings.export.folder) / _file_name(name)
        # joints bear forces where the piece rests, and the assembly sheet names those that bear too much
        resting = equilibrium.resting(obj, bpy.context.scene, surface)
        held = supports.supported(obj, surface, settings.loads)
        force = supports.force(obj, surface, settings.loads)

        def work(progress: Progress) -> Any:
            from ..engine import files
            from ..engine.assembling import assembly_check, assembly_sheet
            from ..engine.fabrication import estimates, export, sheets
            from ..engine.mechanics import simulate
            from ..engine.patches import split
            from ..engine.surface import check

            progress(0.0, "Reading the spirals")
            quads = check.as_quad_mesh(surface.polygons)
            flat = mesh.current_flat(surface, quads)
            design = mesh.design_of(surface, flat, settings.spiral)
            if design is None:
                raise FlexMapsError("There are no spirals yet; press Spirals first")
            split.check_size(flat, settings.layout, settings.sheet)
            made = sheets.make_sheets(design, settings.sheet, progress.part(0.0, 0.8), settings.connect, settings.cut)
            figures = estimates.estimate(made, design, settings.material.chosen)
            found = None
            if resting is not None and settings.export.guide:
                progress(0.8, "Forces in the joints")
                once, quiet = replace(settings.simulate, restarts=0), progress.quiet()
                found = simulate.simulate(
                    design,
                    quads,
                    settings.material.chosen,
                    once,
                    supports=held,
                    force=force,
                    start=resting,
                    progress=quiet,
                )
            checked = assembly_check.check_assembly(design, made.connections, found)
            progress(0.85, "Writing files")
            with files.replacing_many(export.stale(base, made.count), base.parent) as new:
                written = export.write(made, base, formats, new, progress.part(0.85, 0.95))
                if settings.export.guide:
                    progress(0.95, "Drawing the assembly sheet")
                    guide = base.with_name(f"{base.name}-assembly.pdf")
                    written.append(
                        assembly_sheet.write(design, made, figures, guide, name, new, checked, progress.part(0.95, 1.0))
                    )
            block = sheets.sheets_report(made) | estimates.estimates_report(figures)
            drawn = Drawn.made_of(design, made.connections, settings) if stale else None
            return block | {"files": [file.name for file in written]}, base.parent, drawn, checked.warnings

        return work

    def after(self, context: bpy.types.Context, surface: Any, result: Any) -> Iterator[None]:
        return iter(()) if result[2] is None else result[2].show(context, surface)

    def finish(self, context: bpy.types.Context, obj: bpy.types.Object, surface: Any, result: Any) -> str:
        block, folder, _, warnings = result
        notes.write(obj.data, "sheets", block)
        text = told("{} in {}", ", ".join(block["files"]), folder)
        if not warnings:
            return text
        self.level = "WARNING"
        return f"{text}. {'. '.join(warnings)}"


def _folder(text: str) -> Path:
    if text.startswith("//") and not bpy.data.filepath:
        raise FlexMapsError("Save the .blend file first, or choose a folder that does not begin with //")
    if not text.strip():
        raise FlexMapsError("Choose a folder for the files")
    return Path(bpy.path.abspath(text))


def _formats(params: ExportParams) -> tuple[str, ...]:
    dxf = {"NONE": (), "R2010": ("dxf",), "R12": ("dxf-r12",), "BOTH": ("dxf", "dxf-r12")}[params.dxf]
    solids = {"NONE": (), "STL": ("stl",), "3MF": ("3mf",), "BOTH": ("stl", "3mf")}[params.solids]
    formats = (("svg",) if params.svg else ()) + dxf + (("pdf",) if params.pdf else ()) + solids
    if not formats:
        raise FlexMapsError("No kind of file is chosen; switch SVG, DXF or PDF on")
    return formats


def _file_name(name: str) -> str:
    return bpy.path.clean_name(name) or "flexmaps"


CLASSES = (Export,)

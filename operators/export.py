"""Write the sheets as files."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import bpy

from ..bridge.hosts import letters
from ..bridge.store import stored_report
from ..bridge.store.i18n import translate
from ..bridge.store.paths import file_name, resolve_folder
from ..engine import files
from ..engine.progress import Progress
from .continued_stage import Continuation, ContinuedStage
from .file_writer import FolderWriter

if TYPE_CHECKING:
    from pathlib import Path

    from ..bridge.store.snapshot import Snapshot
    from ..bridge.store.surface import ObjectSurface
    from ..bridge.view.flat_panels import PanelDrawing
    from ..engine.runs.result import Result

    # report blocks, the folder of the files, panels to redraw or None, and warnings
    SheetFiles = tuple[dict[str, dict[str, Any]], Path, PanelDrawing | None, tuple[str, ...]]


class Export(FolderWriter, ContinuedStage["SheetFiles"], bpy.types.Operator):
    """Place the panels on sheets and write them for the cutter or the printer, in true millimetres, with an assembly sheet"""

    bl_idname = "flexmaps.export"
    bl_label = "Write the files"

    required_output = "design"
    reads_loads = True

    def continuation(self, obj: bpy.types.Object, snapshot: Snapshot) -> Continuation[SheetFiles]:
        from ..bridge.store import equilibrium
        from ..bridge.view import flat_panels
        from ..engine.fabrication.writers import export

        settings = snapshot.settings
        formats, look = export.chosen_formats(settings.export), flat_panels.connector_fingerprint(settings)
        # the panels drawn beside the model must be redrawn if their connectors differ from the settings
        stale = any(o.get(flat_panels.FINGERPRINT_KEY, look) != look for o in flat_panels.panels_of(obj))
        base = resolve_folder(settings.export.folder) / file_name(snapshot.name)
        guard = self.guard(settings, export.existing_files(base, formats), base.parent)
        letters.add_outlines(snapshot.name)
        # the assembly sheet lists joints overloaded in the simulated shape, and a base stands under that shape
        asked = settings.export.guide or settings.base.base != "none"
        rest = equilibrium.read_rest_pose(obj, bpy.context.scene, snapshot.surface) if asked else None

        def go_on(result: Result, progress: Progress) -> SheetFiles:
            from ..bridge.hosts import job_folder
            from ..engine.runs import job, report
            from ..engine.runs.outputs import DesignVersion, MakingEstimate, SheetPlan

            if rest is not None:
                result = job.simulate_from_pose(result, rest, settings, progress.part(0.0, 0.05))
            made = job.run_stages(result, settings, ("sheets",), progress.part(0.05, 0.85))
            sheets, estimate = made.need(SheetPlan).sheets, made.need(MakingEstimate)
            progress(0.85, "Writing files")
            with files.write_all_atomically(export.surplus_files(base, sheets.count), base.parent, guard) as new:
                guide = job_folder.assembly_sheet_path(base) if settings.export.guide else None
                written = job_folder.write_sheets(
                    made, snapshot.name, base, formats, new, guide, progress.part(0.85, 1.0)
                )
            blocks = report.report_blocks(made, ("sheets", "assembly"))
            blocks["sheets"] |= {"files": [file.name for file in written]}
            cut = made.need(DesignVersion).design if sheets.base is None else sheets.base.design
            again = stale or sheets.base is not None
            drawing = flat_panels.PanelDrawing.from_connections(cut, sheets.connections, settings) if again else None
            return blocks, base.parent, drawing, estimate.assembly.warnings

        return go_on

    def after_write(self, context: bpy.types.Context, obj: bpy.types.Object, result: SheetFiles) -> Iterator[None]:
        return iter(()) if result[2] is None else result[2].show(obj, context.scene)

    def finish(
        self, context: bpy.types.Context, obj: bpy.types.Object, surface: ObjectSurface, result: SheetFiles
    ) -> str:
        blocks, folder, _, warnings = result
        stored_report.write_all(obj.data, blocks)
        text = translate("{} files in {}", len(blocks["sheets"]["files"]), folder)
        if not warnings:
            return text
        self.level = "WARNING"
        return f"{text}. {'. '.join(warnings)}"


CLASSES = (Export,)

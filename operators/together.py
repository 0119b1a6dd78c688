"""Export all selected objects on common sheets, with a number of copies of each."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import bpy

from ..bridge.hosts import preload
from ..bridge.store.i18n import sheets as counted_sheets
from ..bridge.store.i18n import translate
from ..bridge.store.objects import usage_problem
from ..bridge.store.paths import file_name, resolve_folder
from ..engine.errors import FlexMapsError
from ..engine.progress import Progress
from .file_writer import FolderWriter
from .stage import AnyMeshOperator, StageOperator, Work

if TYPE_CHECKING:
    from pathlib import Path

    # the files, number of sheets, number of pieces, and the folder
    BatchFiles = tuple[list[Path], int, int, Path]

ENDING = "together"  # suffix of the file names, after the active object's name


class ExportTogether(FolderWriter, AnyMeshOperator, StageOperator["BatchFiles"], bpy.types.Operator):
    """Lay the panels of all selected objects with spirals on common sheets, each object as often as its copies say, and write the files"""

    bl_idname = "flexmaps.export_together"
    bl_label = "Export selected together"
    bl_options = {"REGISTER"}

    def _read(self, context: bpy.types.Context) -> Work[BatchFiles]:
        preload.wait()
        from ..bridge.hosts import job_folder, letters
        from ..bridge.store import snapshot
        from ..engine import files
        from ..engine.extras.together.nest_together import nest_together
        from ..engine.fabrication.writers import export

        objects = _usable_selection(context)
        stored = [snapshot.read_piece(obj) for obj in objects]
        letters.add_outlines(*(obj.name for obj in objects))
        names, settings = [obj.name for obj in objects], [one.settings for one in stored]
        missing = [
            name for name, one in zip(names, stored, strict=True) if one.result is None or one.result.design is None
        ]
        if missing:
            raise FlexMapsError(
                f"There are no spirals yet on {', '.join(missing)}; make them, or select only objects that have them"
            )
        first = settings[0]
        formats = export.chosen_formats(first.export)
        base = resolve_folder(first.export.folder) / f"{file_name(names[0])}-{ENDING}"
        guard = self.guard(first, export.existing_files(base, formats), base.parent)

        def work(progress: Progress) -> BatchFiles:
            results = [one.result for one in stored if one.result is not None]
            made = nest_together(names, results, settings, progress.part(0.0, 0.85))
            with files.write_all_atomically(export.surplus_files(base, made.sheets.count), base.parent, guard) as new:
                guides, rest = first.export.guide, progress.part(0.85, 1.0)
                written = job_folder.write_batch(made, base, formats, new, guides, rest)
            return written, made.sheets.count, len(made.of), base.parent

        return work

    def _write(self, context: bpy.types.Context, result: BatchFiles) -> Iterator[None]:
        written, sheets, pieces, folder = result
        text = translate("{} pieces on {}: {} files in {}", pieces, counted_sheets(sheets), len(written), folder)
        self.report({"INFO"}, text)
        yield


def _usable_selection(context: bpy.types.Context) -> list[bpy.types.Object]:
    """Return the selected objects that FlexMaps can work on, the active one first."""
    active = context.object
    # leave out objects that FlexMaps drew beside a model
    others = [o for o in context.selected_objects if o != active and not usage_problem(o) and "flexmaps_kind" not in o]
    return [active, *sorted(others, key=lambda obj: obj.name)]


CLASSES = (ExportTogether,)

"""The sheets as files."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterator
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy

from ..bridge.hosts import letters
from ..bridge.store import notes
from ..bridge.store.i18n import translate
from ..bridge.store.settings import unsaved
from ..engine import files
from ..engine.errors import FlexMapsError
from ..engine.progress import Progress
from .continued import Continuation, ContinuedStage
from .writes import Writes

if TYPE_CHECKING:
    from ..bridge.store.snapshot import Snapshot
    from ..engine.runs.result import Result


class Export(Writes, ContinuedStage, bpy.types.Operator):
    """Place the panels on sheets and write them for the cutter or the printer, in true millimetres, with an assembly sheet"""

    bl_idname = "flexmaps.export"
    bl_label = "Export sheets"

    needs = "design"
    loaded = True

    def continuation(self, obj: bpy.types.Object, snapshot: Snapshot) -> Continuation:
        from ..bridge.store import equilibrium
        from ..bridge.view import flat_panels
        from ..engine.fabrication.writers import export

        settings = snapshot.settings
        formats, look = export.chosen(settings.export), flat_panels.look_of(settings)
        # panels that stand beside the model with other connectors are drawn anew
        stale = any(o.get(flat_panels.LOOK, look) != look for o in flat_panels.panels_of(obj))
        base = folder_of(settings.export.folder) / file_name(snapshot.name)
        guard = self.guard(settings, export.present(base, formats), base.parent)
        letters.learn(snapshot.name)
        # joints bear forces where the piece rests, and the assembly sheet names those that bear too much
        # and a base stands under the simulated shape
        asked = settings.export.guide or settings.base.base != "none"
        rest = equilibrium.resting(obj, bpy.context.scene, snapshot.surface) if asked else None
        once = replace(settings, simulate=replace(settings.simulate, restarts=0))
        names = ("sheets",) if rest is None else ("simulate", "sheets")

        def go_on(result: Result, progress: Progress) -> Any:
            from ..bridge.hosts import job_folder
            from ..engine.runs import job, report

            made = job.go_on(replace(result, rest=rest), once, names, progress.part(0.0, 0.85))
            assert made.sheets is not None
            assert made.design is not None
            assert made.assembly is not None
            progress(0.85, "Writing files")
            with files.replacing_many(export.stale(base, made.sheets.count), base.parent, guard) as new:
                guide = job_folder.guide_of(base) if settings.export.guide else None
                written = job_folder.write_sheets(
                    made, snapshot.name, base, formats, new, guide, progress.part(0.85, 1.0)
                )
            blocks = report.blocks(made, ("sheets", "assembly"))
            blocks["sheets"] |= {"files": [file.name for file in written]}
            cut = made.design if made.sheets.base is None else made.sheets.base.design
            again = stale or made.sheets.base is not None
            drawing = flat_panels.PanelDrawing.connected(cut, made.sheets.connections, settings) if again else None
            return blocks, base.parent, drawing, made.assembly.warnings

        return go_on

    def after(self, context: bpy.types.Context, obj: bpy.types.Object, result: Any) -> Iterator[None]:
        return iter(()) if result[2] is None else result[2].show(obj, context.scene)

    def finish(self, context: bpy.types.Context, obj: bpy.types.Object, surface: Any, result: Any) -> str:
        blocks, folder, _, warnings = result
        notes.write_all(obj.data, blocks)
        text = translate("{} files in {}", len(blocks["sheets"]["files"]), folder)
        if not warnings:
            return text
        self.level = "WARNING"
        return f"{text}. {'. '.join(warnings)}"


def folder_of(text: str) -> Path:
    """The folder that a setting names; raises ``FlexMapsError`` where there is none."""
    if unsaved(text):
        raise FlexMapsError("Save the .blend file first, or choose a folder that does not begin with //")
    if not text.strip():
        raise FlexMapsError("Choose a folder for the files")
    return Path(bpy.path.abspath(text))


def file_name(name: str) -> str:
    """What an object's files are called, unlike those of all other meshes of this .blend file.

    Two names may come to the same, as a.b and a_b do, and on Windows and macOS so may names that differ in case or in how an accent
    is written alone: the later of them in the order of the names get a number.
    """
    taken = set[str]()
    for other in sorted({name} | {o.name for o in bpy.data.objects if o.type == "MESH"}):
        numbers = (_plain(other) if number == 1 else f"{_plain(other)}_{number}" for number in count(1))
        own = next(free for free in numbers if _on_disk(free) not in taken)
        if other == name:
            return own
        taken.add(_on_disk(own))
    raise AssertionError("the name itself is among them")


def _on_disk(name: str) -> str:
    """By what those systems tell names apart that look at neither case nor the way in which an accent is written."""
    return unicodedata.normalize("NFC", name).casefold()


def _plain(name: str) -> str:
    return files.named(name) or "flexmaps"


CLASSES = (Export,)

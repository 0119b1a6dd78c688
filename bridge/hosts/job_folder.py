"""Write the output folder of the main job: sheets, a .blend file, pictures, the report as HTML and ``report.json``."""

from __future__ import annotations

import ctypes
import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...engine import files
from ...engine.extras import registry
from ...engine.fabrication.writers import export, parts
from ...engine.own_files import Guard
from ...engine.params import ObjectSettings
from ...engine.progress import SILENT, Progress
from ...engine.runs import job, page_data, report, report_page
from ...engine.runs.outputs import DesignVersion, MakingEstimate, SheetPlan
from ...engine.runs.page_data import ViewContent

if TYPE_CHECKING:
    import bpy

    from ...engine.extras.together.batch import Batch

SHEET, GUIDE, MODEL, REPORT = "sheet", "assembly.pdf", "model.blend", "report.json"
PICTURES = {
    "layout.png": "The surface with its panels",
    "panels.png": "The flat panels with their spirals",
    "shape.png": "The shape that the assembled panels take",
    "together.png": "The surface, the assembled piece and its panels",
}
TITLE = "together.png"  # picture at the top of the report


@contextmanager
def open_folder(out: Path, guard: Guard, formats: tuple[str, ...], pictures: bool) -> Iterator[files.NewFile]:
    """Open the folder for writing: all new files appear together on success; on an error the old files stay.

    Parameters
    ----------
    out : the folder
    guard : protects the user's files from being replaced
    formats : file formats of the sheets; empty without sheets
    pictures : whether pictures will be written

    Yields
    ------
    Function that maps the path of a file to the temporary path to write it at; an argument of ``write``.

    Raises
    ------
    FlexMapsError : another run is writing into the folder, or ``guard`` forbids replacing a file
    """
    refuse_to_replace(out, guard, formats, pictures)
    with files.write_all_atomically(_list_stale(out), out, guard) as new:
        new(out / REPORT)  # fail before the work begins if the folder is read-only
        yield new


def write(
    result: job.Result,
    settings: ObjectSettings,
    name: str,
    out: Path,
    new: files.NewFile,
    formats: tuple[str, ...],
    pictures: bool,
    progress: Progress,
) -> dict[str, Any]:
    """Write all results of the main job, and return the report. Replaces the file that is open in Blender.

    Parameters
    ----------
    result : results of the stages
    settings : settings of the job
    name : name of the piece
    out : the folder
    new : function yielded by ``open_folder``
    formats : file formats of the sheets
    pictures : whether to render pictures
    progress : called with a fraction and a text
    """
    from ..view import picture, scene
    from . import letters

    written: list[Path] = []
    shown: list[tuple[str, Path]] = []
    with suppress_output():
        if result.sheets is not None:
            progress(0.0, "writing the sheets")
            title, part = Path(name).stem, progress.part(0.0, 0.2)
            letters.add_outlines(title)
            written = write_sheets(result, title, out / SHEET, formats, new, out / GUIDE, part)
        progress(0.2, "building the Blender file")
        model = scene.show_result(result, name, settings, progress.part(0.2, 0.28))
        findings = _findings(model)
        progress(0.28, "saving the Blender file")
        scene.save_file(new(out / MODEL))
        if pictures:
            simulated = result.simulation is not None
            made = (True, result.flat is not None, simulated, simulated)
            draws = (picture.render_layout, picture.render_panels, picture.render_shape, picture.render_overview)
            shares = (0.3, 0.42, 0.55, 0.73)
            for share, wanted, draw, (file, says) in zip(shares, made, draws, PICTURES.items(), strict=True):
                if wanted:
                    progress(share, f"rendering {file}")
                    draw(model, new(out / file))
                    shown.insert(0 if file == TITLE else len(shown), (says, new(out / file)))
    described = report.build_report(result, source=name, files=written, settings=settings) | findings
    new(out / REPORT).write_text(json.dumps(described, indent=2) + "\n", encoding="utf-8")
    drawn = report_page.draw_plots(result, described, settings.layout.distortion_limit)
    view, show = ViewContent.from_result(result), settings.page.viewer
    rest = progress.part(0.9, 1.0)
    piece = page_data.to_json(view, settings, report_page.title_of(described), rest) if view and show else None
    report_page.write_page(described, drawn, out, new, shown, piece=piece)
    progress(1.0, "done")
    return described


def _findings(model: bpy.types.Object) -> dict[str, Any]:
    """Return the report's block "findings": notices with their remedies. Empty if the extension is not registered."""
    import bpy

    from ..store import guidance

    if not hasattr(model, "flexmaps"):
        return {}
    return {"findings": guidance.read_guidance(model, bpy.context.scene).findings()}


def write_sheets(
    result: job.Result,
    title: str,
    base: Path,
    formats: tuple[str, ...],
    new: files.NewFile,
    guide: Path | None,
    progress: Progress = SILENT,
) -> list[Path]:
    """Write the sheets (base-01.svg, ...), the parts list (base-parts.csv) and the assembly sheet.

    Parameters
    ----------
    result : the piece with its sheets
    title : title of the assembly sheet
    base : folder and start of the file names
    formats : file formats of the sheets
    new : maps a file to the temporary path to write it at, see ``files.write_all_atomically``
    guide : file of the assembly sheet; None to leave it out
    progress : called with a fraction and a text

    Returns
    -------
    Paths of the files.
    """
    made, estimate, design = (
        result.need(SheetPlan).sheets,
        result.need(MakingEstimate),
        result.need(DesignVersion).design,
    )
    figures = estimate.estimates
    written = export.write_sheets(made, base, formats, new, progress.part(0.0, 0.7))
    listed = base.with_name(f"{base.name}-parts.csv")
    parts.write_parts_list(made, [design], figures.material, new(listed))
    written.append(listed)
    if guide is not None and registry.has("assembly_sheet"):
        from ...engine.extras.assembly_sheet import sheet as assembly_sheet

        drawing = progress.part(0.7, 1.0)
        drawing(0.0, "drawing the assembly sheet")
        written.append(
            assembly_sheet.write_assembly_sheet(design, made, figures, guide, title, new, estimate.assembly, drawing)
        )
    return written


def write_batch(
    batch: Batch, base: Path, formats: tuple[str, ...], new: files.NewFile, guides: bool, progress: Progress = SILENT
) -> list[Path]:
    """Write the common sheets of several pieces, one parts list, and an assembly sheet for every piece.

    Parameters
    ----------
    batch : the pieces, nested on common sheets
    base : folder and start of the file names
    formats : file formats of the sheets
    new : maps a file to the temporary path to write it at, see ``files.write_all_atomically``
    guides : whether to write assembly sheets
    progress : called with a fraction and a text

    Returns
    -------
    Paths of the files.
    """
    written = export.write_sheets(batch.sheets, base, formats, new, progress.part(0.0, 0.7))
    written.append(base.with_name(f"{base.name}-parts.csv"))
    parts.write_parts_list(batch.sheets, batch.designs, batch.parts[0].material, new(written[-1]))
    if not guides or not registry.has("assembly_sheet"):
        return written
    from ...engine.extras.assembly_sheet import sheet as assembly_sheet

    for number, part in enumerate(batch.parts):
        drawing = progress.part(0.7 + 0.3 * number / len(batch.parts), 0.7 + 0.3 * (number + 1) / len(batch.parts))
        drawing(0.0, "drawing the assembly sheets")
        letters = batch.letters_of(number)
        path = base.with_name(f"{base.name}-{letters[0]}-assembly.pdf")
        title = f"{part.name} ({', '.join(letters)})"
        written.append(
            assembly_sheet.write_assembly_sheet(
                part.design, batch.seen_by(number), part.figures, path, title, new, part.assembly, drawing
            )
        )
    return written


def assembly_sheet_path(base: Path) -> Path:
    """Return the path of the assembly sheet that belongs to sheets named base-01.svg, ..."""
    return base.with_name(f"{base.name}-assembly.pdf")


def refuse_to_replace(out: Path, guard: Guard, formats: tuple[str, ...], pictures: bool) -> None:
    """Raise ``FlexMapsError`` if ``write`` would replace a file that ``guard`` protects.

    Parameters
    ----------
    out : the folder
    guard : protects the user's files from being replaced
    formats : file formats of the sheets
    pictures : whether pictures will be written
    """
    guard.check(_list_replaced(out, formats, pictures), out)


def _list_replaced(out: Path, formats: tuple[str, ...], pictures: bool) -> list[Path]:
    """Return the existing files that ``write`` would replace or remove, and the files that it always writes."""
    names = [out / name for name in (MODEL, REPORT, *(PICTURES if pictures else ()))]
    return [*export.existing_files(out / SHEET, formats), *names, *report_page.stale_files(out)]


def _list_stale(out: Path) -> list[Path]:
    """Return the files of an earlier run that this run may not write again; it removes them if FlexMaps wrote them."""
    return [
        *export.existing_files(out / SHEET, export.FORMATS),
        *map(out.joinpath, PICTURES),
        out / GUIDE,
        out / f"{SHEET}-parts.csv",
        *report_page.stale_files(out),
    ]


@contextmanager
def suppress_output() -> Iterator[None]:
    """Suppress Blender's own output, such as a line per render step; Blender writes it from C, past ``sys.stdout``."""
    sys.stdout.flush()
    kept = os.dup(1)
    with open(os.devnull, "w", encoding="utf-8") as nowhere:
        try:
            os.dup2(nowhere.fileno(), 1)
            with redirect_stdout(nowhere):
                yield
        finally:
            _flush_c_output()
            os.dup2(kept, 1)
            os.close(kept)


def _flush_c_output() -> None:
    """Flush the C library's buffer; otherwise Blender's suppressed output would appear later."""
    with suppress(OSError, AttributeError, TypeError):
        (ctypes.cdll.ucrtbase if sys.platform == "win32" else ctypes.CDLL(None)).fflush(None)

"""Write a piece as sheets, as a report, as a web page, or all in one folder; make and evaluate calibration sheets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..engine.extras import registry
from ..engine.fabrication.writers.export import DEFAULT_FORMATS
from ..engine.own_files import Guard
from ..engine.params import ObjectSettings, with_values
from ..engine.progress import Progress
from ..engine.runs import job
from ..engine.runs.outputs import LAYOUTS, SheetPlan
from ..engine.runs.piece import Piece
from ..engine.surface.far import recentre_quads
from ..engine.surface.formats.meshio import SHAPE_PREFIX
from .pieces import ProgressLike, Supports, as_progress, load, make_guard, remnant_files, run_stages, run_until
from .steps import sheets, spirals

if TYPE_CHECKING:
    import bpy

    from ..engine.extras.calibrating.calibrate import Calibration
    from ..engine.extras.together.batch import Batch


def export(
    piece: Piece | Sequence[Piece],
    folder: str | Path,
    *,
    formats: Sequence[str] = DEFAULT_FORMATS,
    name: str = "sheet",
    overwrite: bool = False,
    progress: ProgressLike = None,
) -> list[Path]:
    """Write the sheets and the assembly sheet into a folder; on an error, no file is written.

    Parameters
    ----------
    piece : a piece, or several pieces to nest on common sheets with the sheet settings of the first; each piece is cut
        ``export.copies`` times
    folder : folder for the files
    formats : any of "svg", "dxf", "dxf-r12", "pdf", "stl", "3mf"
    name : start of the file names: name-01.svg, name-assembly.pdf, ...
    overwrite : also replace files that FlexMaps did not write or that changed since; never the pieces' own input files
    progress : called with a fraction and a text

    Returns
    -------
    The paths of the files.

    Raises
    ------
    FlexMapsError where a file may not be replaced, or the sheets cannot be made.
    """
    from ..bridge.hosts import job_folder, letters
    from ..engine import files
    from ..engine.fabrication.writers import export as exporting

    reporter, base = as_progress(progress), Path(folder) / name
    pieces = [piece] if isinstance(piece, Piece) else list(piece)
    guard = make_guard(pieces, overwrite)
    guard.check(exporting.existing_files(base, formats), base.parent)
    files.check_folder(base.parent)
    letters.add_outlines(*(one.name for one in pieces))
    if len(pieces) != 1 or pieces[0].settings.export.copies > 1:
        made = _nest_together(pieces, reporter.part(0.0, 0.8))
        with files.write_all_atomically(exporting.surplus_files(base, made.sheets.count), base.parent, guard) as new:
            return job_folder.write_batch(made, base, tuple(formats), new, True, reporter.part(0.8, 1.0))
    one = pieces[0]
    ready = one if one.result.sheets is not None else sheets(one, progress=reporter.part(0.0, 0.8))
    packed = ready.result.need(SheetPlan).sheets
    with files.write_all_atomically(exporting.surplus_files(base, packed.count), base.parent, guard) as new:
        title, guide, rest = Path(one.name).stem, job_folder.assembly_sheet_path(base), reporter.part(0.8, 1.0)
        return job_folder.write_sheets(ready.result, title, base, tuple(formats), new, guide, rest)


def _nest_together(pieces: Sequence[Piece], progress: Progress) -> Batch:
    """Nest several pieces on common sheets; first run their missing stages up to the spirals."""
    registry.need("together")
    from ..engine.extras.together.nest_together import nest_together

    shares = [progress.part(0.7 * k / len(pieces), 0.7 * (k + 1) / len(pieces)) for k in range(len(pieces))]
    ready = [run_until(piece, "design", share) for piece, share in zip(pieces, shares, strict=True)]
    settings = [piece.settings for piece in ready]
    return nest_together(
        [Path(p.name).stem for p in ready], [p.result for p in ready], settings, progress.part(0.7, 1.0)
    )


def report(
    piece: Piece | bpy.types.Object,
    folder: str | Path | None = None,
    *,
    overwrite: bool = False,
    progress: ProgressLike = None,
) -> dict[str, Any]:
    """Return the figures of all stages that have run, as in report.json; with a folder, also write the report there.

    The page needs no network. If the piece has spirals, the page shows it in 3D, and share.html beside it contains the
    3D view alone, unless ``page.viewer`` is off.

    Parameters
    ----------
    piece : a piece, or a Blender object whose stored results are reported
    folder : folder for report.html, report.json and plots; None writes nothing
    overwrite : as in ``export``
    progress : called with a fraction and a text

    Returns
    -------
    The report: for each stage a dict of figures.

    Raises
    ------
    FlexMapsError where a file in the folder may not be replaced.
    """
    from ..bridge.hosts import pages

    if folder is None:
        return pages.build_report(piece)
    return pages.write(piece, Path(folder), _make_guard(piece, overwrite), as_progress(progress))


def share(
    piece: Piece | bpy.types.Object, path: str | Path, *, overwrite: bool = False, progress: ProgressLike = None
) -> Path:
    """Write a single HTML file that shows the piece in 3D.

    A piece without a simulation is shown as flat panels and target. Missing spirals are computed first.

    Parameters
    ----------
    piece : a piece, or a Blender object whose stored results are shown
    path : the .html file
    overwrite : as in ``export``
    progress : called with a fraction and a text

    Returns
    -------
    The path.

    Raises
    ------
    FlexMapsError where the file may not be replaced.
    """
    from ..bridge.hosts import pages

    reporter, guard = as_progress(progress), _make_guard(piece, overwrite)
    guard.check([Path(path)])
    if isinstance(piece, Piece) and piece.result.design is None:
        piece, reporter = spirals(piece, progress=reporter.part(0.0, 0.5)), reporter.part(0.5, 1.0)
    return pages.write_share_page(piece, Path(path), guard, reporter)


def _make_guard(piece: Piece | bpy.types.Object, overwrite: bool) -> Guard:
    """Return a guard that keeps the input files of a piece or object, and the user's files, from being overwritten."""
    if isinstance(piece, Piece):
        return make_guard([piece], overwrite)
    from ..bridge.store import objects

    return Guard(objects.list_open_files(), overwrite)


def calibration_sheet(
    folder: str | Path,
    settings: ObjectSettings | Mapping[str, Any] | None = None,
    *,
    formats: Sequence[str] | None = None,
    name: str = "calibration",
    overwrite: bool = False,
    progress: ProgressLike = None,
) -> list[Path]:
    """Write a small test sheet for measuring a machine and a material.

    It has a comb for the kerf, ladders of connectors with growing clearance, a strip to bend, and two spirals.

    Parameters
    ----------
    folder : folder for the files and for ``calibration.json``, which ``calibrated`` reads
    settings : as in ``load``; what is already known: thickness, material, kerf, widths
    formats : any of "svg", "dxf", "dxf-r12", "pdf"; default ``sheet_files.DEFAULT_FORMATS``
    name : start of the file names
    overwrite : as in ``export``
    progress : called with a fraction and a text

    Returns
    -------
    The paths of the files.

    Raises
    ------
    FlexMapsError where a file may not be replaced, or a setting is out of its bounds.
    """
    registry.need("calibrating")
    from ..engine.extras.calibrating import sheet_files

    wanted = settings if isinstance(settings, ObjectSettings) else with_values(ObjectSettings(), settings or {})
    guard, kinds = Guard(remnant_files(wanted), overwrite), sheet_files.DEFAULT_FORMATS if formats is None else formats
    return sheet_files.write_calibration_sheet(
        sheet_files.make_calibration_sheet(wanted), Path(folder), kinds, name, as_progress(progress), guard
    )


def calibrated(sheet: str | Path, *, name: str | None = None, **readings: Any) -> Calibration:
    """Compute kerf, clearance and stiffness from measurements on a calibration sheet.

    Parameters
    ----------
    sheet : ``calibration.json`` or its folder
    name : also save the result as a preset of this name
    readings : measurements in millimetres and grams, a number or several repeats: ``kerf_comb``, ``clearance`` with
        ``kind``, ``thickness``, ``strip_sag``, ``strip_weight``, ``strip_mass``; ``spiral_sag`` and ``spiral_weight``
        as pairs for spirals A and B. Missing weights default to those engraved on the sheet.

    Returns
    -------
    A ``Calibration``; pass its ``settings`` to ``change``.

    Raises
    ------
    FlexMapsError where the sheet or a measurement cannot be read.
    """
    registry.need("calibrating")
    from ..engine.extras.calibrating import calibrate, coupons

    made = calibrate.calibrate(coupons.read_coupons(sheet), calibrate.Readings.from_measurements(**readings))
    if name is not None:
        from ..bridge.store import presets

        presets.write_preset(name, made.settings)
    return made


def run(
    source: Any,
    out: str | Path,
    *,
    edge: float | None = None,
    height: float | None = None,
    up: str | None = None,
    quads: int | None = None,
    remeshed: bool = True,
    settings: ObjectSettings | Mapping[str, Any] | None = None,
    supports: Supports = None,
    optimised: bool = False,
    chosen: bool = False,
    structured: bool = False,
    stop_after: str = "sheets",
    formats: Sequence[str] = DEFAULT_FORMATS,
    pictures: bool = True,
    overwrite: bool = False,
    progress: ProgressLike = None,
) -> dict[str, Any]:
    """Run the whole main job, from a source to a folder with all files.

    Existing patches and spirals are computed anew. Earlier files in the folder are replaced only if the whole job
    succeeds.

    Parameters
    ----------
    source, edge, height, up, quads, remeshed, settings, supports : as in ``load``
    out : the folder
    optimised, structured, pictures : whether to optimise the spirals, analyse load cases, render pictures
    chosen : whether to compare layouts and use the best, by the settings of the section "choose"
    stop_after : name of the last stage to run
    formats, overwrite, progress : as in ``export``

    Returns
    -------
    The report, as ``report`` returns it.

    Raises
    ------
    FlexMapsError, before the work starts, where a file may not be replaced, as in ``export``.
    """
    from ..bridge.hosts import job_folder

    reporter = as_progress(progress)
    names = job.stages(stop_after, optimised, chosen, structured)
    guard = Guard(_input_files(source, settings), overwrite)
    written = tuple(formats) if "sheets" in names else ()
    # Open the folder first, so that a read-only folder fails before the work.
    with job_folder.open_folder(Path(out), guard, written, pictures) as new:
        piece = load(source, edge=edge, height=height, up=up, quads=quads, remeshed=remeshed, settings=settings,
                     supports=supports, progress=reporter.part(0.0, 0.2))  # fmt: skip
        guard.also([*piece.files, *remnant_files(piece.settings)])
        job_folder.refuse_to_replace(Path(out), guard, written, pictures)
        piece = replace(piece, made=piece.result.without(*LAYOUTS).with_surface(mesh=recentre_quads(piece.mesh)))
        piece = run_stages(piece, names[1:], reporter.part(0.2, 0.6), lenient=True)
        return job_folder.write(
            piece.result, piece.settings, piece.name, Path(out), new, tuple(formats), pictures, reporter.part(0.6, 1.0)
        )


def _input_files(source: Any, settings: ObjectSettings | Mapping[str, Any] | None) -> list[str]:
    """Return the paths of the input files: the source and the remnants in the settings."""
    paths = [str(source)] if isinstance(source, str | Path) and not str(source).startswith(SHAPE_PREFIX) else []
    return paths + remnant_files(
        settings if isinstance(settings, ObjectSettings) else with_values(ObjectSettings(), settings or {})
    )

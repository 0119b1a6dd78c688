"""What a piece becomes: sheets, reports, pages, and whole folders of them; and sheets to calibrate a machine with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..engine.calibrating import calibrate, coupons
from ..engine.calibrating import sheet as calibration
from ..engine.calibrating.calibrate import Calibration
from ..engine.fabrication.writers.export import USUAL
from ..engine.own_files import Guard
from ..engine.params import ObjectSettings, changed
from ..engine.progress import Progress
from ..engine.runs import job, stages
from ..engine.runs.piece import Piece
from ..engine.surface.far import near
from ..engine.surface.files.meshio import SHAPE
from .pieces import Supports, Tell, go_on, go_to, guard_of, load, progress_of, remnants_of
from .steps import sheets, spirals

if TYPE_CHECKING:
    import bpy

    from ..engine.fabrication.batch import Batch


def export(
    piece: Piece | Sequence[Piece],
    folder: str | Path,
    *,
    formats: Sequence[str] = USUAL,
    name: str = "sheet",
    overwrite: bool = False,
    progress: Tell = None,
) -> list[Path]:
    """Write the sheets and the assembly sheet into a folder, all of them or none; returns their paths.

    piece : or several, on common sheets as the first one's settings say, each as often as its ``export.copies``
    formats : of "svg", "dxf", "dxf-r12", "pdf", "stl", "3mf"; name : the files become name-01.svg, name-assembly.pdf, ...
    overwrite : also replace files that FlexMaps did not write, or that were changed since; never what the pieces were read from
    """
    from ..bridge.hosts import job_folder, letters
    from ..engine import files
    from ..engine.fabrication.writers import export as exporting

    told, base = progress_of(progress), Path(folder) / name
    pieces = [piece] if isinstance(piece, Piece) else list(piece)
    guard = guard_of(pieces, overwrite)
    guard.check(exporting.present(base, formats), base.parent)
    letters.learn(*(one.name for one in pieces))
    if len(pieces) != 1 or pieces[0].settings.export.copies > 1:
        made = _together(pieces, told.part(0.0, 0.8))
        with files.replacing_many(exporting.stale(base, made.sheets.count), base.parent, guard) as new:
            return job_folder.write_batch(made, base, tuple(formats), new, True, told.part(0.8, 1.0))
    one = pieces[0]
    ready = one if one.result.sheets is not None else sheets(one, progress=told.part(0.0, 0.8))
    laid = stages.needed(ready.result, "sheets")
    with files.replacing_many(exporting.stale(base, laid.count), base.parent, guard) as new:
        title, guide, rest = Path(one.name).stem, job_folder.guide_of(base), told.part(0.8, 1.0)
        return job_folder.write_sheets(ready.result, title, base, tuple(formats), new, guide, rest)


def _together(pieces: Sequence[Piece], told: Progress) -> Batch:
    """Several pieces on common sheets; what is still missing of each is made first, its own sheets the quick way."""
    from ..engine.runs.together import together

    shares = [told.part(0.7 * k / len(pieces), 0.7 * (k + 1) / len(pieces)) for k in range(len(pieces))]
    ready = [go_to(piece, "design", share) for piece, share in zip(pieces, shares, strict=True)]
    settings = [piece.settings for piece in ready]
    return together([Path(p.name).stem for p in ready], [p.result for p in ready], settings, told.part(0.7, 1.0))


def report(
    piece: Piece | bpy.types.Object,
    folder: str | Path | None = None,
    *,
    overwrite: bool = False,
    progress: Tell = None,
) -> dict[str, Any]:
    """The figures of everything that has run, as in report.json; with a folder, writes report.html, report.json and plots there.

    Of an object, instead of a piece: of what was last done to it in Blender. The page opens without a network; where there are
    spirals it holds them in 3D, and share.html beside it holds them alone, unless ``page.viewer`` is off.
    ``overwrite`` : as in ``export``.
    """
    from ..bridge.hosts import pages

    if folder is None:
        return pages.described(piece)
    return pages.write(piece, Path(folder), _guard(piece, overwrite), progress_of(progress))


def share(piece: Piece | bpy.types.Object, path: str | Path, *, overwrite: bool = False, progress: Tell = None) -> Path:
    """Write one page that holds the piece in 3D, to send to somebody; of one that was not simulated, flat panels and target.

    ``overwrite`` : as in ``export``.
    """
    from ..bridge.hosts import pages

    told, guard = progress_of(progress), _guard(piece, overwrite)
    guard.check([Path(path)])
    if isinstance(piece, Piece) and piece.result.design is None:
        piece, told = spirals(piece, progress=told.part(0.0, 0.5)), told.part(0.5, 1.0)
    return pages.share(piece, Path(path), guard, told)


def _guard(piece: Piece | bpy.types.Object, overwrite: bool) -> Guard:
    """The guard of a piece, or of an object and the file that it lies in."""
    if isinstance(piece, Piece):
        return guard_of([piece], overwrite)
    from ..bridge.store import objects

    return Guard(objects.files_read(), overwrite)


def calibration_sheet(
    folder: str | Path,
    settings: ObjectSettings | Mapping[str, Any] | None = None,
    *,
    formats: Sequence[str] = calibration.USUAL,
    name: str = "calibration",
    overwrite: bool = False,
    progress: Tell = None,
) -> list[Path]:
    """Write a small sheet to measure a machine and a material with: kerf comb, ladders of clearances, a strip, two spirals.

    settings : what is known so far, as ``load`` takes them: thickness, material, kerf, widths; formats : of "svg", "dxf",
    "dxf-r12", "pdf". Beside the files lies ``calibration.json``, which ``calibrated`` reads. Returns their paths.
    ``overwrite`` : as in ``export``.
    """
    wanted = settings if isinstance(settings, ObjectSettings) else changed(ObjectSettings(), settings or {})
    guard = Guard(remnants_of(wanted), overwrite)
    return calibration.write(calibration.make(wanted), Path(folder), formats, name, progress_of(progress), guard)


def calibrated(sheet: str | Path, *, name: str | None = None, **readings: Any) -> Calibration:
    """Kerf, clearance and stiffness from what was measured on a calibration sheet; its ``settings`` are as ``change`` takes them.

    sheet : ``calibration.json`` or its folder; readings : millimetres and grams, one number or several readings: ``kerf_comb``,
    ``clearance`` with ``kind``, ``thickness``, ``strip_sag``, ``strip_weight``, ``strip_mass``, ``spiral_sag`` and
    ``spiral_weight`` of A and B; weights as engraved unless given. name : keeps it among Blender's presets of FlexMaps.
    """
    made = calibrate.calibrate(coupons.read(sheet), calibrate.Readings.shown(**readings))
    if name is not None:
        from ..bridge.store import presets

        presets.keep(name, made.settings)
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
    formats: Sequence[str] = USUAL,
    pictures: bool = True,
    overwrite: bool = False,
    progress: Tell = None,
) -> dict[str, Any]:
    """The whole main job: from a source, as ``load`` takes it, to a folder with all its files; returns the report.

    optimised, chosen : spirals are optimised, and layouts compared and one chosen, as the settings of the section choose say.
    structured : the piece is examined under the load cases of the settings
    Patches and spirals that an object already has are made anew. The open file of Blender is left for an empty one. An
    earlier run's files in the folder stay as they are unless everything succeeds. Raises ``FlexMapsError`` before the work where
    a file would be replaced that is read, or, unless ``overwrite`` is set, that FlexMaps did not write or that was changed since.
    """
    from ..bridge.hosts import job_folder

    told = progress_of(progress)
    names = job.stages(stop_after, optimised, chosen, structured)
    guard = Guard(_named_files(source, settings), overwrite)
    written = tuple(formats) if "sheets" in names else ()
    # a folder that cannot be written to says so before the work, not after
    with job_folder.folder(Path(out), guard, written, pictures) as new:
        piece = load(source, edge=edge, height=height, up=up, quads=quads, remeshed=remeshed, settings=settings,
                     supports=supports, progress=told.part(0.0, 0.2))  # fmt: skip
        guard.also([*piece.files, *remnants_of(piece.settings)])
        job_folder.refuse(Path(out), guard, written, pictures)
        piece = replace(piece, made=stages.without(piece.result, {"layout"}))
        piece = replace(piece, made=replace(piece.result, mesh=near(piece.mesh)))
        piece = go_on(piece, names[1:], told.part(0.2, 0.6), lenient=True)
        return job_folder.write(
            piece.result, piece.settings, piece.name, Path(out), new, tuple(formats), pictures, told.part(0.6, 1.0)
        )


def _named_files(source: Any, settings: ObjectSettings | Mapping[str, Any] | None) -> list[str]:
    """The paths that a call names to be read."""
    given = [str(source)] if isinstance(source, str | Path) and not str(source).startswith(SHAPE) else []
    return given + remnants_of(
        settings if isinstance(settings, ObjectSettings) else changed(ObjectSettings(), settings or {})
    )

"""FlexMaps from Python: every stage as a function, on an object in Blender, on a mesh file, or on arrays.

    from bl_ext.user_default.flexmaps import api     # in Blender, with the extension installed
    from flexmaps import api                         # beside Blender as a Python module, from a checkout

    piece = api.load("surface.obj", edge=20)         # quads of 20 mm
    piece = api.layout(api.regularise(piece))
    piece = api.optimise(api.spirals(piece), supports="lowest")
    print(api.report(piece)["optimise"]["laplacian_rmse_mm"])
    api.export(piece, "out/surface")

A ``Piece`` never changes: every stage returns a new one, so that variants can be compared. A stage first runs those
before it that are still missing. Sizes and settings are in the units of the sidebar, millimetres and degrees; the arrays
inside a piece are the engine's, in metres and radians. What a user can get wrong raises ``FlexMapsError``;
``progress(fraction, text)`` may be any function, and may raise ``Cancelled`` to stop.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .engine.calibrating import calibrate, coupons
from .engine.calibrating import sheet as calibration
from .engine.calibrating.calibrate import Calibration
from .engine.errors import Cancelled, FlexMapsError
from .engine.exploring.explore import Exploration
from .engine.exploring.run import explored
from .engine.exploring.space import GOALS, MINIMISED, SIZES, space
from .engine.fabrication.writers.export import USUAL
from .engine.mechanics.loads import standing
from .engine.params import ObjectSettings, changed, wish
from .engine.progress import SILENT, Progress
from .engine.runs import job, stages
from .engine.runs.piece import Piece
from .engine.surface.checking import check as checking
from .engine.surface.checking.check import Finding
from .engine.surface.files import meshio
from .engine.surface.mesh import PolygonMesh, QuadMesh

if TYPE_CHECKING:
    import bpy

    from .engine.fabrication.batch import Batch

__all__ = ["Calibration", "Cancelled", "Finding", "FlexMapsError", "ObjectSettings", "Piece", "calibrated", "calibration_sheet",
           "change", "check", "choose", "compare", "explore", "export", "layout", "load", "optimise", "regularise", "remesh",
           "report", "run", "save", "share", "sheets", "show",
           "simulate", "spirals", "structure", "take", "use"]  # fmt: skip

Source = "bpy.types.Object | str | Path | QuadMesh | PolygonMesh"
Supports = str | Sequence[int] | None
Tell = Callable[[float, str], None] | Progress | None


# -- from and to Blender and files -------------------------------------------------------------------------------------


def load(
    source: Any,
    *,
    edge: float | None = None,
    height: float | None = None,
    up: str | None = None,
    quads: int | None = None,
    remeshed: bool = False,
    settings: ObjectSettings | Mapping[str, Any] | None = None,
    supports: Supports = None,
    progress: Tell = None,
) -> Piece:
    """A piece from an object in Blender, a file (.obj .off .ply .stl .blend), "shape:NAME", or a mesh of the engine.

    edge, height : millimetres, the wanted median edge of the quads or extent along z; without, the source is in metres
    up : the file's axis that points up, "x", "y" or "z"; y for .obj, else z, as in Blender's importers
    quads : about so many new quads are made of it first, see ``remesh``; with ``remeshed`` as set, if not all faces are quads
    settings : "section.name" -> value in shown units, instead of the object's settings or the defaults
    supports : quads that stand: "lowest", their numbers from 0 on, "1,2,3", or a vertex group of the object

    An object brings its settings, vertex groups, seams, flat patches and spirals along. A .blend file is opened in place of the
    one that is open. Raises ``FlexMapsError`` where there is nothing to read.
    """
    from_blender = hasattr(source, "bl_rna") or str(source).lower().endswith(".blend")
    piece = _from_blender(source) if from_blender else _from_elsewhere(source, up)
    if edge is not None or height is not None or piece.made is None:
        piece = _begun(piece, _metres(edge), _metres(height))
    piece = change(piece, settings)
    others = checking.not_quads(piece.source) if remeshed and quads is None and piece.made is None else 0
    if others or quads is not None:
        piece = remesh(piece, quads=quads, progress=progress)
    if others and piece.made is not None:
        piece = replace(piece, made=replace(piece.made, findings=[*piece.made.findings, checking.remeshed(others)]))
    return change(piece, supports=supports)


def change(
    piece: Piece, settings: ObjectSettings | Mapping[str, Any] | None = None, *, supports: Supports = None
) -> Piece:
    """The piece with other settings or supports; what they make out of date is dropped, and made again when it is needed."""
    wanted = settings if isinstance(settings, ObjectSettings) else changed(piece.settings, settings or {})
    if isinstance(supports, str) and piece.uid is not None:
        from .bridge.store import supports as groups

        if groups.is_group(piece.uid, supports):
            wanted, supports = changed(wanted, {"loads.supports": supports}), None
    made = piece.made
    if made is not None:
        made = stages.outdated(made, piece.settings, wanted)
        if wanted.loads != piece.settings.loads:
            if piece.uid is None:
                raise FlexMapsError(
                    "Only an object in Blender has vertex groups; name the supports by numbers, or 'lowest'"
                )
            from .bridge.store import supports as groups

            held, force = groups.loads_of(piece.uid, wanted.loads)
            made = replace(made, supports=held, force=force)
        if wanted.structure != piece.settings.structure and piece.uid is not None:
            from .bridge.store import supports as groups

            made = replace(made, groups=groups.named_of(piece.uid, wanted.structure))
        if supports is not None:
            made = replace(stages.without(made, stages.concerned({"loads"})), supports=standing(made.mesh, supports))
        made = job.completed(made, wanted)
    return replace(piece, settings=wanted, made=made)


def show(piece: Piece, obj: bpy.types.Object | None = None) -> bpy.types.Object:
    """Write the piece into the object that it was read from, or another one of the same quads; without one, into a new one.

    The object gets seams, the UV map, attributes, the simulated shape as a shape key, its panels beside it, and the settings.
    """
    import bpy

    from .bridge.store import objects
    from .bridge.view import scene

    if obj is None and piece.uid is not None:
        obj = objects.find(piece.uid)
    elif obj is None:
        obj = scene.add_model(bpy.context.scene, piece.mesh, piece.name)
    scene.put(piece.result, obj, bpy.context.scene, piece.settings)
    return obj


def save(piece: Piece, path: str | Path) -> Path:
    """Save a .blend file with the piece: the file it came from with the object brought up to date, else one of its own.

    Blender's open file stays as it is, but for an object that is brought up to date.
    """
    from .bridge.view import scene
    from .engine import files

    if piece.uid is not None:
        show(piece)
    with files.replacing(path) as new:
        if piece.uid is None:
            scene.save_alone(new, piece.result, piece.name, piece.settings)
        else:
            scene.save(new)
    return Path(path)


# -- stages ------------------------------------------------------------------------------------------------------------


def check(piece: Piece) -> list[Finding]:
    """Everything that is wrong with the mesh, errors first; with an error no other stage can run."""
    return checking.findings(piece.source)


def remesh(piece: Piece, *, quads: int | None = None, progress: Tell = None) -> Piece:
    """Quads in the shape of any mesh, by Blender's own tools, in the size that was asked for; the object itself stays.

    quads : about how many; else as the settings say. What had to be left out or joined is among the findings of ``check``.
    Raises ``FlexMapsError`` where Blender finds none.
    """
    from .bridge.hosts import remesh as remeshing

    wanted = piece.settings if quads is None else changed(piece.settings, {"remesh.quads": quads})
    found = remeshing.quads_of(piece.source, wanted.remesh.quads, wanted.remesh.smooth, _progress(progress))
    made = _begun(Piece(piece.name, found.polygons, piece.settings), piece.edge, piece.height)
    if made.made is None:
        return made
    return replace(made, made=replace(made.made, findings=[*made.made.findings, *found.findings]))


def regularise(piece: Piece, *, progress: Tell = None) -> Piece:
    """Squarer quads; what was laid out before is dropped."""
    return _go_on(piece, ("regularise",), progress)


def layout(piece: Piece, *, keep_seams: bool = False, progress: Tell = None) -> Piece:
    """Flat patches: traced and merged, or, with ``keep_seams``, those between the seams that the object has.

    A mesh that is no object is regularised first, unless it has been: as in the main job.
    """
    if not keep_seams:
        return _to(replace(piece, made=stages.without(piece.result, {"layout"})), "flat", progress)
    if piece.seams is None:
        raise FlexMapsError(f"{piece.name} has no seams to keep; load an object, or let the patches be traced")
    made = job.flattened(piece.result, piece.seams, piece.settings.layout, _progress(progress))
    return replace(piece, made=made)


def spirals(piece: Piece, *, progress: Tell = None) -> Piece:
    """Width and twist of every spiral from the curvature."""
    return _to(replace(piece, made=stages.without(piece.result, {"design"})), "design", progress)


def choose(piece: Piece, *, panels: int | None = None, match: float | None = None, progress: Tell = None) -> Piece:
    """Flat patches chosen among many layouts, by the shape that their panels take; the others are in ``result.choice``.

    panels : most panels; match : RMS distance in percent of the size that may be left; with neither, as the settings say
    """
    wanted = changed(piece.settings, wish(panels=panels, match=match))
    return _to(replace(piece, settings=wanted), "flat", progress, "choose")


def take(piece: Piece, proposal: int) -> Piece:
    """The piece in the layout of another proposal of its ``choose``, numbered from 0 on; what came after is dropped."""
    return replace(piece, made=job.taken(piece.result, proposal))


def simulate(piece: Piece, *, supports: Supports = None, progress: Tell = None) -> Piece:
    """The shape that the assembled panels take, and what keeps it from the target."""
    held = change(piece, supports=supports)
    return _to(held, "design", progress, "simulate")


def compare(piece: Piece, scan: str | Path, *, unit: str = "", anywhere: bool = True, progress: Tell = None) -> Piece:
    """Lay a scan of the built piece over the simulated shape, or over the target where there is none; ``result.scan`` has it.

    scan : an .ply, .obj, .stl or .off file of points or of a mesh; unit : mm, cm, m or in, else metres or millimetres by the size
    anywhere : False where the scan is turned by 30 degrees at most; quicker and surer
    """
    from .engine.scanning import reading

    ready = replace(piece.result, scanned=reading.read(scan, unit, anywhere))
    if piece.uid is not None and ready.simulation is None:
        from .bridge.store import snapshot

        ready = replace(ready, rest=snapshot.rest_of(piece.uid))
    return _go_on(replace(piece, made=ready), ("compare",), progress)


def structure(
    piece: Piece,
    *cases: str,
    combinations: Sequence[str] = (),
    supports: Supports = None,
    progress: Tell = None,
) -> Piece:
    """What a simulated piece bears: deflection, utilisation, joints, and how far each load may rise, in ``result.structure``.

    cases, combinations : as "snow: snow 500" and "all = 1.35 weight + 1.5 snow", see ``engine/structure/cases.py``; else as the settings say
    """
    given = {"structure.cases": ";".join(cases), "structure.combinations": ";".join(combinations)}
    held = change(piece, {name: text for name, text in given.items() if text}, supports=supports)
    return _to(held, "simulation", progress, "structure")


def optimise(piece: Piece, *, supports: Supports = None, progress: Tell = None) -> Piece:
    """Spirals whose assembly comes closest to the target, from those that are there on; simulated too."""
    held = change(piece, supports=supports)
    return _to(held, "design", progress, "optimise", "simulate")


def explore(
    piece: Piece,
    vary: Mapping[str, Any],
    folder: str | Path | None = None,
    *,
    goals: Sequence[str] = GOALS,
    minimised: Sequence[str] = MINIMISED,
    progress: Tell = None,
    **search: Any,
) -> Exploration:
    """Try many candidates of a piece beside each other, and say which hold the goals; ``use`` takes one of them.

    vary : settings by "section.name", ``edge`` or ``height`` in millimetres, ``quads``; each "low:high" or a list, see ``space``
    folder : gets table, plot and pictures; an exploration that was stopped, which gives what it found so far, goes on there
    goals : as "rms_percent<=1"; minimised : the two measures of the front; search : how many and where, see ``explored``
    """
    told, question = _progress(progress), space(vary, piece.settings, goals, minimised)
    pieces = {count: remesh(piece, quads=count) if count else piece for count in question.quads}
    laid = {count: one if one.result.flat is not None else layout(one) for count, one in pieces.items()}
    results = {count: one.result for count, one in laid.items()}
    return explored(results, piece.settings, question, folder, progress=told, **search)


def use(piece: Piece, values: Mapping[str, Any]) -> Piece:
    """The piece with the settings and in the size of a candidate, its ``values``; what they make out of date is dropped."""
    wanted = change(piece, {name: value for name, value in values.items() if name not in SIZES})
    wanted = remesh(wanted, quads=values["quads"]) if "quads" in values else wanted
    sized = {"edge", "height"} & set(values)
    return _begun(wanted, _metres(values.get("edge")), _metres(values.get("height"))) if sized else wanted


def sheets(piece: Piece, *, progress: Tell = None) -> Piece:
    """The panels with connectors and kerf, nested on sheets."""
    return _to(piece, "design", progress, "sheets")


def export(
    piece: Piece | Sequence[Piece],
    folder: str | Path,
    *,
    formats: Sequence[str] = USUAL,
    name: str = "sheet",
    progress: Tell = None,
) -> list[Path]:
    """Write the sheets and the assembly sheet into a folder, all of them or none; returns their paths.

    piece : or several, on common sheets as the first one's settings say, each as often as its ``export.copies``
    formats : of "svg", "dxf", "dxf-r12", "pdf", "stl", "3mf"; name : the files become name-01.svg, name-assembly.pdf, ...
    """
    from .bridge.hosts import job_folder, letters
    from .engine import files
    from .engine.fabrication.writers import export as exporting

    told, base = _progress(progress), Path(folder) / name
    pieces = [piece] if isinstance(piece, Piece) else list(piece)
    letters.learn(*(one.name for one in pieces))
    if len(pieces) != 1 or pieces[0].settings.export.copies > 1:
        made = _together(pieces, told.part(0.0, 0.8))
        with files.replacing_many(exporting.stale(base, made.sheets.count), base.parent) as new:
            return job_folder.write_batch(made, base, tuple(formats), new, True, told.part(0.8, 1.0))
    one = pieces[0]
    ready = one if one.result.sheets is not None else sheets(one, progress=told.part(0.0, 0.8))
    laid = stages.needed(ready.result, "sheets")
    with files.replacing_many(exporting.stale(base, laid.count), base.parent) as new:
        title, guide, rest = Path(one.name).stem, job_folder.guide_of(base), told.part(0.8, 1.0)
        return job_folder.write_sheets(ready.result, title, base, tuple(formats), new, guide, rest)


def report(
    piece: Piece | bpy.types.Object, folder: str | Path | None = None, *, progress: Tell = None
) -> dict[str, Any]:
    """The figures of everything that has run, as in report.json; with a folder, writes report.html, report.json and plots there.

    Of an object, instead of a piece: of what was last done to it in Blender. The page opens without a network; where there are
    spirals it holds them in 3D, and share.html beside it holds them alone, unless ``page.viewer`` is off.
    """
    from .bridge.hosts import pages

    if folder is None:
        return pages.described(piece)
    return pages.write(piece, Path(folder), _progress(progress))


def share(piece: Piece | bpy.types.Object, path: str | Path, *, progress: Tell = None) -> Path:
    """Write one page that holds the piece in 3D, to send to somebody; of one that was not simulated, flat panels and target."""
    from .bridge.hosts import pages

    told = _progress(progress)
    if isinstance(piece, Piece) and piece.result.design is None:
        piece, told = spirals(piece, progress=told.part(0.0, 0.5)), told.part(0.5, 1.0)
    return pages.share(piece, Path(path), told)


def calibration_sheet(
    folder: str | Path,
    settings: ObjectSettings | Mapping[str, Any] | None = None,
    *,
    formats: Sequence[str] = calibration.USUAL,
    name: str = "calibration",
    progress: Tell = None,
) -> list[Path]:
    """Write a small sheet to measure a machine and a material with: kerf comb, ladders of clearances, a strip, two spirals.

    settings : what is known so far, as ``load`` takes them: thickness, material, kerf, widths; formats : of "svg", "dxf",
    "dxf-r12", "pdf". Beside the files lies ``calibration.json``, which ``calibrated`` reads. Returns their paths.
    """
    wanted = settings if isinstance(settings, ObjectSettings) else changed(ObjectSettings(), settings or {})
    return calibration.write(calibration.make(wanted), Path(folder), formats, name, _progress(progress))


def calibrated(sheet: str | Path, *, name: str | None = None, **readings: Any) -> Calibration:
    """Kerf, clearance and stiffness from what was measured on a calibration sheet; its ``settings`` are as ``change`` takes them.

    sheet : ``calibration.json`` or its folder; readings : millimetres and grams, one number or several readings: ``kerf_comb``,
    ``clearance`` with ``kind``, ``thickness``, ``strip_sag``, ``strip_weight``, ``strip_mass``, ``spiral_sag`` and
    ``spiral_weight`` of A and B; weights as engraved unless given. name : keeps it among Blender's presets of FlexMaps.
    """
    made = calibrate.calibrate(coupons.read(sheet), calibrate.Readings.shown(**readings))
    if name is not None:
        from .bridge.store import presets

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
    progress: Tell = None,
) -> dict[str, Any]:
    """The whole main job: from a source, as ``load`` takes it, to a folder with all its files; returns the report.

    optimised, chosen : spirals are optimised, and layouts compared and one chosen, as the settings of the section choose say.
    structured : the piece is examined under the load cases of the settings
    Patches and spirals that an object already has are made anew. The open file of Blender is left for an empty one. An
    earlier run's files in the folder stay as they are unless everything succeeds.
    """
    from .bridge.hosts import job_folder

    told = _progress(progress)
    names = job.stages(stop_after, optimised, chosen, structured)
    with job_folder.folder(Path(out)) as new:  # one that cannot be written to says so before the work, not after
        piece = load(source, edge=edge, height=height, up=up, quads=quads, remeshed=remeshed, settings=settings,
                     supports=supports, progress=told.part(0.0, 0.2))  # fmt: skip
        piece = replace(piece, made=stages.without(piece.result, {"layout"}))
        piece = _go_on(piece, names[1:], told.part(0.2, 0.6), lenient=True)
        return job_folder.write(
            piece.result, piece.settings, piece.name, Path(out), new, tuple(formats), pictures, told.part(0.6, 1.0)
        )


# -- within ------------------------------------------------------------------------------------------------------------


def _progress(tell: Tell) -> Progress:
    return tell if isinstance(tell, Progress) else SILENT if tell is None else Progress(tell)


def _together(pieces: Sequence[Piece], told: Progress) -> Batch:
    """Several pieces on common sheets; what is still missing of each is made first, its own sheets the quick way."""
    from .engine.runs.together import together

    shares = [told.part(0.7 * k / len(pieces), 0.7 * (k + 1) / len(pieces)) for k in range(len(pieces))]
    ready = [_to(piece, "design", share) for piece, share in zip(pieces, shares, strict=True)]
    settings = [piece.settings for piece in ready]
    return together([Path(p.name).stem for p in ready], [p.result for p in ready], settings, told.part(0.7, 1.0))


def _metres(millimetres: float | None) -> float | None:
    if not isinstance(millimetres, Real | None) or isinstance(millimetres, bool):
        raise FlexMapsError(f"'{millimetres}' is no length; give a number of millimetres")
    return None if millimetres is None else float(millimetres) / 1e3


def _begun(piece: Piece, edge: float | None, height: float | None) -> Piece:
    """A piece with nothing made yet, in the wanted size, metres; it is no object's any more."""
    source = checking.scaled(piece.source, edge=edge, height=height)
    try:
        made = replace(job.begin(source), edge=edge, height=height)
    except FlexMapsError:
        made = None  # ``check`` says what is wrong, and so does every stage
    uid, seams = (piece.uid, piece.seams) if source is piece.source else (None, None)
    return Piece(piece.name, source, piece.settings, edge, height, made, uid, seams)


def _go_on(piece: Piece, names: Sequence[str], progress: Tell, *, lenient: bool = False) -> Piece:
    return replace(piece, made=job.go_on(piece.result, piece.settings, names, _progress(progress), lenient=lenient))


def _to(piece: Piece, member: str, progress: Tell, *after: str) -> Piece:
    """The piece with the stages that are missing until a member of its result is there, and those asked for ``after``.

    A mesh from elsewhere is regularised before it is cut, unless it has been; the vertices of an object move only when that
    is asked for.
    """
    fresh = piece.uid is None and "regularise" not in piece.result.seconds
    made = job.go_to(piece.result, piece.settings, member, after, _progress(progress), fresh=fresh)
    return replace(piece, made=made)


def _from_blender(source: Any) -> Piece:
    from .bridge.store import snapshot
    from .bridge.view import scene

    obj = source if hasattr(source, "bl_rna") else scene.open_blend(source)
    found = snapshot.read(obj)
    name = obj.name if obj is source else Path(source).name
    return Piece(name, found.source, found.settings, made=found.result, uid=found.uid, seams=found.seams)


def _from_elsewhere(source: Any, up: str | None) -> Piece:
    if isinstance(source, QuadMesh | PolygonMesh):
        polygons = checking.converted(source if isinstance(source, PolygonMesh) else PolygonMesh.of(source))
        return Piece("mesh", polygons, ObjectSettings())
    return Piece(*meshio.named(str(source), up), ObjectSettings())

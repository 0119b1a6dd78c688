"""Read pieces from Blender, files and arrays, and write them back; helpers for the other modules of ``api``."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..engine.errors import FlexMapsError
from ..engine.fabrication.nesting.remnants import SEPARATOR
from ..engine.mechanics.loads import parse_supports
from ..engine.own_files import Guard
from ..engine.params import ObjectSettings, with_values
from ..engine.progress import SILENT, Progress
from ..engine.runs import job
from ..engine.runs.piece import Piece
from ..engine.surface.checking import check as checking
from ..engine.surface.checking.check import Finding
from ..engine.surface.checking.overlaps import overlap_findings
from ..engine.surface.checking.sewing import sew
from ..engine.surface.checking.topology import border_sides, sides_of
from ..engine.surface.far import recentre
from ..engine.surface.formats import meshio
from ..engine.surface.mesh import PolygonMesh, QuadMesh

if TYPE_CHECKING:
    import bpy

Source = "bpy.types.Object | str | Path | QuadMesh | PolygonMesh"
Supports = str | Sequence[int] | None
ProgressLike = Callable[[float, str], None] | Progress | None


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
    progress: ProgressLike = None,
) -> Piece:
    """Read a piece from a Blender object, a file, a built-in shape or a mesh of the engine.

    From a Blender object, settings, vertex groups, seams, flat patches and spirals are read too. Reading a .blend file
    closes Blender's open file. Warns with ``OtherVersion`` if another version, whose results differ, made the piece.

    Parameters
    ----------
    source : an object, a path (.obj .off .ply .stl .blend), "shape:NAME", a ``QuadMesh`` or a ``PolygonMesh``
    edge : wanted median quad edge in millimetres; without ``edge`` and ``height`` the source is in metres
    height : wanted extent along z in millimetres
    up : the file's axis that points up, "x", "y" or "z"; default y for .obj, else z, as in Blender's importers
    quads : first remesh to about this many quads, see ``remesh``
    remeshed : whether to remesh a mesh with faces that are not quads, as the settings say
    settings : "section.name" -> value in the sidebar's unit, overriding the object's settings or the defaults. Unless
        ``spiral.border`` is set, arms at an open border, which have no joint, are left out.
    supports : held quads: "lowest", indices from 0, a text such as "1,2,3", or the name of a vertex group of the object
    progress : called with a fraction and a text

    Returns
    -------
    The piece.

    Raises
    ------
    FlexMapsError where the source cannot be read, or a setting is out of its bounds.
    """
    from_blender = hasattr(source, "bl_rna") or str(source).lower().endswith(".blend")
    piece = _read_blender(source) if from_blender else _read_file_or_mesh(source, up)
    if edge is not None or height is not None or piece.made is None:
        piece = begin_piece(piece, parse_millimetres(edge), parse_millimetres(height))
    piece = change(piece, settings)
    others = checking.count_non_quads(piece.source) if remeshed and quads is None and piece.made is None else 0
    if others or quads is not None:
        before = [replace(one, severity="warning", faces=(), edges=()) for one in overlap_findings(piece.source)]
        piece = remesh(piece, quads=quads, progress=progress)
        if piece.made is not None:
            piece = replace(piece, made=piece.made.with_surface(findings=[*piece.made.findings, *before]))
    if others and piece.made is not None:
        piece = replace(
            piece, made=piece.made.with_surface(findings=[*piece.made.findings, checking.remeshing_warning(others)])
        )
    return change(piece, supports=supports)


def change(
    piece: Piece, settings: ObjectSettings | Mapping[str, Any] | None = None, *, supports: Supports = None
) -> Piece:
    """Change settings or supports, and drop the results that depend on them; they are computed again when needed.

    Parameters
    ----------
    piece : the piece
    settings : "section.name" -> value in the sidebar's unit, or an ``ObjectSettings`` that replaces all settings
    supports : as in ``load``

    Returns
    -------
    A new piece.

    Raises
    ------
    FlexMapsError where a setting is out of its bounds, or a vertex group is named for a piece that is not an object.
    """
    wanted = settings if isinstance(settings, ObjectSettings) else with_values(piece.settings, settings or {})
    if isinstance(supports, str) and piece.uid is not None:
        from ..bridge.store import supports as groups

        if groups.has_group(piece.uid, supports):
            wanted, supports = with_values(wanted, {"loads.supports": supports}), None
    made = piece.made
    if made is not None:
        if wanted != piece.settings:
            made = made.without_outdated(wanted)
        if wanted.loads != piece.settings.loads:
            if piece.uid is None:
                raise FlexMapsError(
                    "Only an object in Blender has vertex groups; name the supports by numbers, or 'lowest'"
                )
            from ..bridge.store import snapshot
            from ..bridge.store import supports as groups

            held, force = groups.read_loads(*snapshot.reread_surface(piece.uid), wanted.loads)
            made = made.with_user(supports=held, force=force)
        # load cases name vertex groups; the section is missing if their extra is not installed
        cases, known = (getattr(one, "structure", None) for one in (wanted, piece.settings))
        if cases != known and piece.uid is not None:
            from ..bridge.store import snapshot
            from ..bridge.store import supports as groups

            made = made.with_user(groups=groups.read_groups(*snapshot.reread_surface(piece.uid), wanted))
        if supports is not None:
            made = made.with_user(supports=parse_supports(made.mesh, supports))
        made = job.run_quick_stages(made, wanted)
    return replace(piece, settings=wanted, made=made)


def show(piece: Piece, obj: bpy.types.Object | None = None) -> bpy.types.Object:
    """Write the piece into a Blender object: seams, UV map, attributes, simulated shape key, panels, settings.

    Parameters
    ----------
    piece : the piece
    obj : an object with the same quads; default the object that the piece was read from, else a new object

    Returns
    -------
    The object.
    """
    import bpy

    from ..bridge.store import objects
    from ..bridge.view import scene

    if obj is None and piece.uid is not None:
        obj = objects.find_by_uid(piece.uid)
    elif obj is None:
        obj = scene.add_model(bpy.context.scene, piece.mesh, piece.name)
    scene.write_result(piece.result, obj, bpy.context.scene, piece.settings)
    return obj


def save(piece: Piece, path: str | Path, *, overwrite: bool = False) -> Path:
    """Save a .blend file with the piece.

    A piece that was read from an object is written back into it, and a copy of Blender's open file is saved. Any other
    piece is saved alone in a new file, and Blender's open file does not change.

    Parameters
    ----------
    piece : the piece
    path : the .blend file
    overwrite : as in ``export``

    Returns
    -------
    The path.

    Raises
    ------
    FlexMapsError if ``path`` is an input file of the piece or, without ``overwrite``, a file that FlexMaps did not
        write or that changed since.
    """
    from ..bridge.view import scene
    from ..engine import files

    guard = make_guard([piece], overwrite)
    guard.check([Path(path)])
    if piece.uid is not None:
        show(piece)
    with files.write_atomically(path, guard) as new:
        if piece.uid is None:
            scene.save_result(new, piece.result, piece.name, piece.settings)
        else:
            scene.save_file(new)
    return Path(path)


def check(piece: Piece) -> list[Finding]:
    """Return all faults of the mesh, errors first. No other stage runs on a mesh with errors."""
    return checking.all_findings(piece.source)


def remesh(piece: Piece, *, quads: int | None = None, progress: ProgressLike = None) -> Piece:
    """Remesh any mesh into quads with Blender's own tools, in the piece's size.

    Parameters
    ----------
    piece : the piece
    quads : approximate number of quads; default as in the settings
    progress : called with a fraction and a text

    Returns
    -------
    A new piece that does not belong to an object; the original object does not change. ``check`` lists bodies that
    were left out or joined.

    Raises
    ------
    FlexMapsError where Blender's tools find no quads.
    """
    from ..bridge.hosts import remesh as remeshing

    wanted = piece.settings if quads is None else with_values(piece.settings, {"remesh.quads": quads})
    remeshed = remeshing.make_quads(piece.source, wanted.remesh.quads, wanted, as_progress(progress))
    made = begin_piece(
        Piece(piece.name, replace(remeshed.polygons, repairs=piece.source.repairs), piece.settings, files=piece.files),
        piece.edge,
        piece.height,
    )
    if made.made is None:
        return made
    return replace(made, made=made.made.with_surface(findings=[*made.made.findings, *remeshed.findings]))


def make_guard(pieces: Sequence[Piece], overwrite: bool) -> Guard:
    """Return a guard against overwriting the pieces' input files, remnants included, and the user's files.

    Parameters
    ----------
    pieces : the pieces
    overwrite : whether other files that FlexMaps did not write, or that changed since, may be replaced
    """
    sources = [path for piece in pieces for path in piece.files]
    return Guard([*sources, *(path for piece in pieces for path in remnant_files(piece.settings))], overwrite)


def remnant_files(settings: ObjectSettings) -> list[str]:
    """Return the paths of the remnant drawings that the settings name."""
    return [path.strip() for path in settings.sheet.remnants.split(SEPARATOR) if path.strip()]


def as_progress(tell: ProgressLike) -> Progress:
    return tell if isinstance(tell, Progress) else SILENT if tell is None else Progress(tell)


def parse_millimetres(millimetres: float | None) -> float | None:
    if not isinstance(millimetres, Real | None) or isinstance(millimetres, bool):
        raise FlexMapsError(f"'{millimetres}' is not a length; give a number of millimetres")
    return None if millimetres is None else float(millimetres) / 1e3


def begin_piece(piece: Piece, edge: float | None, height: float | None) -> Piece:
    """Return the piece scaled to a size and without results; if its size changed, it no longer belongs to its object.

    Parameters
    ----------
    piece : the piece
    edge : wanted median quad edge in metres, or None
    height : wanted extent along z in metres, or None
    """
    source = checking.scale_to_metres(piece.source, edge=edge, height=height)
    try:
        made = job.check_input(source).with_surface(edge=edge, height=height)
    except FlexMapsError:
        made = None  # the mesh has an error, which ``check`` and every stage report
    uid, seams = (piece.uid, piece.seams) if source is piece.source else (None, None)
    return Piece(piece.name, source, piece.settings, edge, height, made, uid, seams, piece.files)


def run_stages(piece: Piece, names: Sequence[str], progress: ProgressLike, *, lenient: bool = False) -> Piece:
    """Run stages by name.

    Parameters
    ----------
    piece : the piece
    names : names of stages, in order
    progress : called with a fraction and a text
    lenient : go on if an optional stage fails, unless it is the last; ``Result.undone`` names failed stages
    """
    return replace(
        piece, made=job.run_stages(piece.result, piece.settings, names, as_progress(progress), lenient=lenient)
    )


def run_until(piece: Piece, name: str, progress: ProgressLike, *after: str) -> Piece:
    """Run the missing stages up to an output, then the stages ``after``.

    A mesh that was not read from an object is regularised first if it was not yet; an object's vertices move only when
    ``regularise`` is named.

    Parameters
    ----------
    piece : the piece
    name : name of the output, such as "design"
    progress : called with a fraction and a text
    after : names of stages to run afterwards
    """
    fresh = piece.uid is None and not piece.result.surface.regularised
    made = job.run_until(piece.result, piece.settings, name, after, as_progress(progress), fresh=fresh)
    return replace(piece, made=made)


def _read_blender(source: Any) -> Piece:
    from ..bridge.store import objects, snapshot, stored_report
    from ..bridge.view import scene
    from ..engine import versions

    obj = source if hasattr(source, "bl_rna") else scene.open_blend(source)
    stored = snapshot.read_piece(obj)
    other = versions.version_warning(stored_report.read_version(obj.data))
    if other:
        warnings.warn(f"'{obj.name}': {other}", versions.OtherVersion, stacklevel=3)
    name = obj.name if obj is source else Path(source).name
    # keep the setting for border arms if the user set it or a layout exists
    own = getattr(obj, "flexmaps", None)  # None if the extension is not registered
    chosen = own is not None and own.spiral.is_property_set("border")
    settled = chosen or stored.result is None or stored.result.flat is not None
    return Piece(
        name,
        stored.source,
        stored.settings if settled else _without_stubs(stored.settings, stored.source),
        made=stored.result,
        uid=stored.uid,
        seams=stored.seams,
        files=objects.list_open_files(),
    )


def _read_file_or_mesh(source: Any, up: str | None) -> Piece:
    if isinstance(source, QuadMesh | PolygonMesh):
        polygons = checking.with_numeric_arrays(
            source if isinstance(source, PolygonMesh) else PolygonMesh.from_quads(source)
        )
        return Piece("mesh", recentre(polygons), _without_stubs(ObjectSettings(), polygons))
    files = () if str(source).startswith(meshio.SHAPE_PREFIX) else (Path(source),)
    name, polygons = meshio.read_upright(str(source), up)
    polygons = sew(polygons)
    return Piece(name, polygons, _without_stubs(ObjectSettings(), polygons), files=files)


def _without_stubs(settings: ObjectSettings, polygons: PolygonMesh) -> ObjectSettings:
    """Return the settings without arms at an open border, which have no joint; unchanged for a closed surface."""
    is_open = len(polygons.sizes) and len(border_sides(sides_of(polygons)))
    return with_values(settings, {"spiral.border": "left_out"}) if is_open else settings

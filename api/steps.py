"""Every stage as a function: from a piece to a piece with more in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..engine.errors import FlexMapsError
from ..engine.exploring.explore import Exploration
from ..engine.exploring.folder import refuse
from ..engine.exploring.run import explored
from ..engine.exploring.space import GOALS, MINIMISED, SIZES, space
from ..engine.params import changed, wish
from ..engine.runs import job, stages
from ..engine.runs.piece import Piece
from .pieces import Supports, Tell, begun, change, go_on, go_to, guard_of, metres, progress_of, remesh


def regularise(piece: Piece, *, progress: Tell = None) -> Piece:
    """Squarer quads; what was laid out before is dropped."""
    return go_on(piece, ("regularise",), progress)


def layout(piece: Piece, *, keep_seams: bool = False, progress: Tell = None) -> Piece:
    """Flat patches: traced and merged, or, with ``keep_seams``, those between the seams that the object has.

    A mesh that is no object is regularised first, unless it has been: as in the main job.
    """
    if not keep_seams:
        return go_to(replace(piece, made=stages.without(piece.result, {"layout"})), "flat", progress)
    if piece.seams is None:
        raise FlexMapsError(f"{piece.name} has no seams to keep; load an object, or let the panels be traced")
    made = job.flattened(piece.result, piece.seams, piece.settings.layout, progress_of(progress))
    return replace(piece, made=made)


def spirals(piece: Piece, *, progress: Tell = None) -> Piece:
    """Width and twist of every spiral from the curvature."""
    return go_to(replace(piece, made=stages.without(piece.result, {"design"})), "design", progress)


def choose(piece: Piece, *, panels: int | None = None, match: float | None = None, progress: Tell = None) -> Piece:
    """Flat patches chosen among many layouts, by the shape that their panels take; the others are in ``result.choice``.

    panels : most panels; match : RMS distance in percent of the size that may be left; with neither, as the settings say
    """
    wanted = changed(piece.settings, wish(panels=panels, match=match))
    return go_to(replace(piece, settings=wanted), "flat", progress, "choose")


def take(piece: Piece, proposal: int) -> Piece:
    """The piece in the layout of another proposal of its ``choose``, numbered from 0 on; what came after is dropped."""
    return replace(piece, made=job.taken(piece.result, proposal))


def simulate(piece: Piece, *, supports: Supports = None, progress: Tell = None) -> Piece:
    """The shape that the assembled panels take, and what keeps it from the target."""
    held = change(piece, supports=supports)
    return go_to(held, "design", progress, "simulate")


def compare(piece: Piece, scan: str | Path, *, unit: str = "", anywhere: bool = True, progress: Tell = None) -> Piece:
    """Lay a scan of the built piece over the simulated shape, or over the target where there is none; ``result.scan`` has it.

    scan : an .ply, .obj, .stl or .off file of points or of a mesh; unit : mm, cm, m or in, else metres or millimetres by the size
    anywhere : False where the scan is turned by 30 degrees at most; quicker and surer
    """
    from ..engine.scanning import reading

    ready = replace(piece.result, scanned=reading.read(scan, unit, anywhere))
    if piece.uid is not None and ready.simulation is None:
        from ..bridge.store import snapshot

        ready = replace(ready, rest=snapshot.rest_of(piece.uid))
    return go_on(replace(piece, made=ready, files=(*piece.files, Path(scan))), ("compare",), progress)


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
    return go_to(held, "simulation", progress, "structure")


def optimise(piece: Piece, *, supports: Supports = None, progress: Tell = None) -> Piece:
    """Spirals whose assembly comes closest to the target, from those that are there on; simulated too."""
    held = change(piece, supports=supports)
    return go_to(held, "design", progress, "optimise", "simulate")


def sheets(piece: Piece, *, progress: Tell = None) -> Piece:
    """The panels with connectors and kerf, nested on sheets."""
    return go_to(piece, "design", progress, "sheets")


def explore(
    piece: Piece,
    vary: Mapping[str, Any],
    folder: str | Path | None = None,
    *,
    goals: Sequence[str] = GOALS,
    minimised: Sequence[str] = MINIMISED,
    overwrite: bool = False,
    progress: Tell = None,
    **search: Any,
) -> Exploration:
    """Try many candidates of a piece beside each other, and say which hold the goals; ``use`` takes one of them.

    vary : settings by "section.name", ``edge`` or ``height`` in millimetres, ``quads``; each "low:high" or a list, see ``space``
    folder : gets table, plot and pictures; an exploration that was stopped, which gives what it found so far, goes on there
    goals : as "rms_percent<=1"; minimised : the two measures of the front; search : how many and where, see ``explored``
    overwrite : also replace files in the folder that FlexMaps did not write, or that were changed since
    """
    if search.get("scheduler"):
        _refuse_offline()
    guard = guard_of([piece], overwrite)
    if folder is not None:
        refuse(Path(folder), guard)
    told, question = progress_of(progress), space(vary, piece.settings, goals, minimised)
    pieces = {count: remesh(piece, quads=count) if count else piece for count in question.quads}
    laid = {count: one if one.result.flat is not None else layout(one) for count, one in pieces.items()}
    results = {count: one.result for count, one in laid.items()}
    return explored(results, piece.settings, question, folder, guard=guard, progress=told, **search)


def _refuse_offline() -> None:
    """A Blender that may not go online reaches no cluster; what Blender as a Python module reaches is its script's to say."""
    import bpy

    if bpy.app.binary_path and not bpy.app.online_access:
        raise FlexMapsError(
            "Blender may not go online, which reaching a cluster needs; allow it under Preferences > System > Network, or start "
            "Blender with --online-mode"
        )


def use(piece: Piece, values: Mapping[str, Any]) -> Piece:
    """The piece with the settings and in the size of a candidate, its ``values``; what they make out of date is dropped."""
    wanted = change(piece, {name: value for name, value in values.items() if name not in SIZES})
    wanted = remesh(wanted, quads=values["quads"]) if "quads" in values else wanted
    sized = {"edge", "height"} & set(values)
    return begun(wanted, metres(values.get("edge")), metres(values.get("height"))) if sized else wanted

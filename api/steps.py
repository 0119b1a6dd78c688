"""Every stage as a function that takes a piece and returns a new piece with one more result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..engine.errors import FlexMapsError
from ..engine.extras import registry
from ..engine.params import goal_values, with_values
from ..engine.runs import manual_changes
from ..engine.runs.outputs import LAYOUTS
from ..engine.runs.piece import Piece
from .pieces import (
    ProgressLike,
    Supports,
    as_progress,
    begin_piece,
    change,
    make_guard,
    parse_millimetres,
    remesh,
    run_stages,
    run_until,
)

if TYPE_CHECKING:
    from ..engine.extras.exploring.explore import Exploration


def regularise(piece: Piece, *, progress: ProgressLike = None) -> Piece:
    """Move the vertices along the surface to make the quads squarer; drop the layout and later results.

    Parameters
    ----------
    piece : the piece
    progress : called with a fraction and a text
    """
    return run_stages(piece, ("regularise",), progress)


def layout(piece: Piece, *, keep_seams: bool = False, progress: ProgressLike = None) -> Piece:
    """Cut the surface into flat patches.

    A mesh that was not read from an object is regularised first if it was not yet, as in the main job.

    Parameters
    ----------
    piece : the piece
    keep_seams : flatten the patches between the object's seams, instead of computing a new layout
    progress : called with a fraction and a text

    Raises
    ------
    FlexMapsError where ``keep_seams`` is set and the piece has no seams.
    """
    if not keep_seams:
        return run_until(replace(piece, made=piece.result.without(*LAYOUTS)), "flat", progress)
    if piece.seams is None:
        raise FlexMapsError(f"{piece.name} has no seams to keep; load an object, or let the panels be traced")
    made = manual_changes.flatten_by_hand(piece.result, piece.seams, piece.settings, as_progress(progress))
    return replace(piece, made=made)


def spirals(piece: Piece, *, progress: ProgressLike = None) -> Piece:
    """Compute the width and twist of every spiral from the surface's curvature.

    Parameters
    ----------
    piece : the piece; missing flat patches are computed first
    progress : called with a fraction and a text
    """
    return run_until(replace(piece, made=piece.result.without("design")), "design", progress)


def choose(
    piece: Piece, *, panels: int | None = None, match: float | None = None, progress: ProgressLike = None
) -> Piece:
    """Compare many layouts by their simulated shapes and use the best; ``result.choice`` holds all of them.

    Parameters
    ----------
    piece : the piece
    panels : maximum number of panels, or None
    match : acceptable RMS distance from the target in percent of its size, or None; the settings count if both are None
    progress : called with a fraction and a text
    """
    registry.need("choosing")
    wanted = with_values(piece.settings, goal_values(panels=panels, match=match))
    return run_until(replace(piece, settings=wanted), "flat", progress, "choose")


def take(piece: Piece, proposal: int) -> Piece:
    """Switch to the layout of another proposal of ``choose``, and drop later results.

    Parameters
    ----------
    piece : a piece after ``choose``
    proposal : index of the proposal, from 0
    """
    registry.need("choosing")
    from ..engine.extras.choosing import choice_stage

    return replace(piece, made=choice_stage.take_proposal(piece.result, proposal, piece.settings))


def simulate(piece: Piece, *, supports: Supports = None, progress: ProgressLike = None) -> Piece:
    """Compute the shape that the assembled panels take.

    Parameters
    ----------
    piece : the piece
    supports : as in ``load``
    progress : called with a fraction and a text
    """
    held = change(piece, supports=supports)
    return run_until(held, "design", progress, "simulate")


def compare(
    piece: Piece, scan: str | Path, *, unit: str = "", anywhere: bool = True, progress: ProgressLike = None
) -> Piece:
    """Align a 3D scan of the built piece with the simulated shape (or, without one, the target) and compare them.

    Parameters
    ----------
    piece : the piece
    scan : a .ply, .obj, .stl or .off file with points or a mesh
    unit : "mm", "cm", "m" or "in"; default metres or millimetres, guessed from the size
    anywhere : False for a scan that is rotated by 30 degrees at most, which is quicker and more reliable
    progress : called with a fraction and a text

    Returns
    -------
    A new piece with ``result.scan``.

    Raises
    ------
    FlexMapsError where the scan cannot be read.
    """
    registry.need("scanning")
    from ..engine.extras.scanning import scan_reader

    ready = piece.result.with_user(scanned=scan_reader.read_scan(scan, unit, anywhere))
    if piece.uid is not None and ready.simulation is None:
        from ..bridge.store import snapshot

        ready = ready.with_user(rest=snapshot.read_rest_pose(piece.uid))
    return run_stages(replace(piece, made=ready, files=(*piece.files, Path(scan))), ("compare",), progress)


def structure(
    piece: Piece,
    *cases: str,
    combinations: Sequence[str] = (),
    supports: Supports = None,
    progress: ProgressLike = None,
) -> Piece:
    """Analyse a piece under load: deflection, utilisation of arms and joints, and the load factor at which it snaps.

    Parameters
    ----------
    piece : the piece; a missing simulation is computed first
    cases : load cases such as "snow: snow 500", see ``engine/extras/structure/cases.py``; default as in the settings
    combinations : weighted sums of cases, such as "all = 1.35 weight + 1.5 snow"; default as in the settings
    supports : as in ``load``
    progress : called with a fraction and a text

    Returns
    -------
    A new piece with ``result.structure``.

    Raises
    ------
    FlexMapsError for a load case or combination that is not valid.
    """
    registry.need("structure")
    texts = {"structure.cases": ";".join(cases), "structure.combinations": ";".join(combinations)}
    held = change(piece, {name: text for name, text in texts.items() if text}, supports=supports)
    return run_until(held, "simulation", progress, "structure")


def optimise(piece: Piece, *, supports: Supports = None, progress: ProgressLike = None) -> Piece:
    """Optimise the spirals so that the assembled piece comes closest to the target, then simulate.

    The search starts from the present spirals.

    Parameters
    ----------
    piece : the piece
    supports : as in ``load``
    progress : called with a fraction and a text
    """
    held = change(piece, supports=supports)
    return run_until(held, "design", progress, "optimise", "simulate")


def sheets(piece: Piece, *, progress: ProgressLike = None) -> Piece:
    """Draw the panels with connectors and kerf, and nest them on sheets.

    Parameters
    ----------
    piece : the piece
    progress : called with a fraction and a text
    """
    return run_until(piece, "design", progress, "sheets")


def explore(
    piece: Piece,
    vary: Mapping[str, Any],
    folder: str | Path | None = None,
    *,
    goals: Sequence[str] | None = None,
    minimised: Sequence[str] | None = None,
    overwrite: bool = False,
    progress: ProgressLike = None,
    **search: Any,
) -> Exploration:
    """Evaluate many variants (candidates) of a piece, and report which meet the goals; ``use`` applies a candidate.

    Parameters
    ----------
    piece : the piece
    vary : what to vary: "section.name", "edge" or "height" (millimetres) or "quads" -> "low:high" or a list of values,
        see ``make_space``
    folder : folder for table, plot and pictures; an exploration that was stopped there is continued
    goals : such as "rms_percent<=1"; default ``space.DEFAULT_GOALS``
    minimised : the two measures of the Pareto front; default ``space.DEFAULT_OBJECTIVES``
    overwrite : also replace files in the folder that FlexMaps did not write or that changed since
    progress : called with a fraction and a text; if it raises ``Cancelled``, the candidates so far are returned
    search : further arguments ``candidates``, ``scheduler``, ``cores``, ``effort``, ``seed``, see ``explore_piece``

    Raises
    ------
    FlexMapsError where the folder, the cluster or a goal cannot be used.
    """
    registry.need("exploring")
    from ..engine.extras.exploring.folder import refuse_to_replace
    from ..engine.extras.exploring.run_exploration import explore_piece
    from ..engine.extras.exploring.space import DEFAULT_GOALS, DEFAULT_OBJECTIVES, make_space

    if search.get("scheduler"):
        _refuse_offline()
    guard = make_guard([piece], overwrite)
    if folder is not None:
        refuse_to_replace(Path(folder), guard)
    wanted, least = DEFAULT_GOALS if goals is None else goals, DEFAULT_OBJECTIVES if minimised is None else minimised
    reporter, question = as_progress(progress), make_space(vary, piece.settings, wanted, least)
    pieces = {count: remesh(piece, quads=count) if count else piece for count in question.quads}
    laid_out = {count: one if one.result.flat is not None else layout(one) for count, one in pieces.items()}
    results = {count: one.result for count, one in laid_out.items()}
    return explore_piece(results, piece.settings, question, folder, guard=guard, progress=reporter, **search)


def _refuse_offline() -> None:
    """Raise ``FlexMapsError`` if Blender's online access is off; Blender as a Python module leaves this to scripts."""
    import bpy

    if bpy.app.binary_path and not bpy.app.online_access:
        raise FlexMapsError(
            "Blender may not go online, which reaching a cluster needs; allow it under Preferences > System > Network, or start "
            "Blender with --online-mode"
        )


def use(piece: Piece, values: Mapping[str, Any]) -> Piece:
    """Apply the settings and the size of a candidate, and drop the results that depend on them.

    Parameters
    ----------
    piece : the piece that was explored
    values : the candidate's ``values``
    """
    registry.need("exploring")
    from ..engine.extras.exploring.space import SIZES

    wanted = change(piece, {name: value for name, value in values.items() if name not in SIZES})
    wanted = remesh(wanted, quads=values["quads"]) if "quads" in values else wanted
    sized = {"edge", "height"} & set(values)
    return (
        begin_piece(wanted, parse_millimetres(values.get("edge")), parse_millimetres(values.get("height")))
        if sized
        else wanted
    )

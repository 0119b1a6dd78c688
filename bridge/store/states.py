"""State of every stage of an object: not run, done or out of date. Fast enough for every redraw.

A stage is done while all inputs of its result are unchanged. ``stamp`` stores a checksum of every input (the shape, the
seams, a section of the settings) on the mesh, beside the stages' results; ``read_states`` compares it with the present
input. When an earlier stage runs again, the results of later stages are removed but their checksums stay, so that a
stage that has to run again differs from a stage that never ran.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import bpy

from ...engine.files import FolderError
from ...engine.runs import stages
from . import stored_report
from .checksums import Checksums
from .objects import list_other_users
from .paths import resolve_folder

TODO, DONE, STALE = "TODO", "DONE", "STALE"

# fields of the engine's ``Result`` that the user can edit by hand in Blender -> input; the mesh first, because another
# mesh has other seams and spirals too
EDITABLE = {"mesh": "shape", "merged": "seams", "design": "design"}
FILES = "files"  # input of the sheets: files of their names in the folder that the settings name


def _list_inputs(members: Iterable[str], settings: Iterable[str]) -> tuple[str, ...]:
    """Return the names of the inputs that a result depends on: the parts that the user can edit, then the settings."""
    ingredients = stages.dependencies(members)
    own = tuple(part for member, part in EDITABLE.items() if member in ingredients)
    named = tuple(dict.fromkeys(settings))
    return (*own, *named, *(("down",) if "loads" in named else ()))


def _block_inputs(block: str) -> tuple[str, ...]:
    writers = stages.stages_writing(block)
    return _list_inputs((m for s in writers for m in s.needs), (name for s in writers for name in s.settings))


# report block of a stage -> names of its inputs; settings by the name of their section, see ``stages.Stage``
INPUTS: dict[str, tuple[str, ...]] = {"checks": ("shape",)} | {block: _block_inputs(block) for block in stages.BLOCKS}
INPUTS["sheets"] += ("export",)  # the block lists files, which depend on these settings
# results that have no report block -> names of their inputs
SIDE_RESULTS: dict[str, tuple[str, ...]] = {
    "regularise": _list_inputs(stages.STAGES["regularise"].needs, stages.STAGES["regularise"].settings),
    "preview": (*_list_inputs(("design",), ("spiral",)), "pose"),
    "forecast": _list_inputs(("merged",), stages.PHYSICS),  # predicted strains, computed with a layout
}
MESH_INPUTS = {*EDITABLE.values(), "pose"}
# inputs that are settings, and "down", the direction of gravity in the object's frame
SETTINGS_INPUTS = {part for parts in (*INPUTS.values(), *SIDE_RESULTS.values()) for part in parts} - MESH_INPUTS
# report block -> report blocks of the stages whose results it uses
BLOCKS_USED = {
    block: stages.blocks_describing(need for stage in stages.stages_writing(block) for need in stage.needs) - {block}
    for block in stages.BLOCKS
}


@dataclass(frozen=True)
class StageState:
    """State of one stage.

    kind : ``TODO`` (never run), ``DONE`` or ``STALE`` (out of date)
    changed_input : the stage's input that changed; "" if only a result of an earlier stage changed
    """

    kind: str
    changed_input: str = ""


# -- stamps ------------------------------------------------------------------------------------------------------------


def read_settings_checksums(obj: bpy.types.Object, scene: bpy.types.Scene) -> dict[str, str]:
    """Return checksums of the settings for ``stamp``. Call it when a stage starts: settings may change while it runs.

    Parameters
    ----------
    obj : the mesh object
    scene : its scene
    """
    now = Checksums(obj, scene)
    return {part: now[part] for part in SETTINGS_INPUTS}


def stamp(obj: bpy.types.Object, scene: bpy.types.Scene, settings_checksums: dict[str, str] | None = None) -> None:
    """Store the input checksums of all results written since the last call. Call it after writing results.

    Parameters
    ----------
    obj, scene : the mesh object and its scene
    settings_checksums : from ``read_settings_checksums`` when the work began; None takes the present settings
    """
    mesh = obj.data
    fresh = stored_report.pop_unstamped(mesh)
    if not fresh:
        return
    if mesh.is_editmode:
        obj.update_from_editmode()
    now = Checksums(obj, scene, settings_checksums)
    made = {stage: {part: now[part] for part in INPUTS[stage]} for stage in fresh if stage in INPUTS}
    stored_report.write_input_checksums(mesh, made)


def stamp_side_result(
    obj: bpy.types.Object, scene: bpy.types.Scene, name: str, settings_checksums: dict[str, str] | None = None
) -> None:
    """Store the input checksums of a result that has no report block.

    Parameters
    ----------
    obj, scene : the mesh object and its scene
    name : a key of ``SIDE_RESULTS``
    settings_checksums : as for ``stamp``
    """
    if obj.data.is_editmode:
        obj.update_from_editmode()
    now = Checksums(obj, scene, settings_checksums)
    stored_report.write_input_checksums(obj.data, {name: {part: now[part] for part in SIDE_RESULTS[name]}})


# -- states ------------------------------------------------------------------------------------------------------------


def read_states(obj: bpy.types.Object, scene: bpy.types.Scene) -> dict[str, StageState]:
    """Return the state of every stage; edits of a large mesh count only after the user leaves edit mode.

    Parameters
    ----------
    obj : the mesh object
    scene : its scene
    """
    blocks, stamps, now = (
        stored_report.read(obj.data),
        stored_report.read_input_checksums(obj.data),
        Checksums(obj, scene),
    )
    states: dict[str, StageState] = {}
    for stage, parts in INPUTS.items():
        made = stamps.get(stage)
        earlier = [states[name] for name in BLOCKS_USED.get(stage, ()) if name in states]
        if stage not in blocks:
            states[stage] = StageState(TODO if made is None else STALE)
            continue
        changed = next((part for part in parts if made is not None and made.get(part) != now[part]), None)
        if changed is not None:
            states[stage] = StageState(STALE, changed)
        else:
            states[stage] = StageState(DONE if all(state.kind == DONE for state in earlier) else STALE)
    if states["sheets"].kind == DONE and not _has_files(obj, blocks["sheets"]):
        states["sheets"] = StageState(STALE, FILES)
    return states


def _has_files(obj: bpy.types.Object, block: dict[str, Any]) -> bool:
    """Return whether any file of the sheets is in the object's folder; True where the report names no files."""
    names = block.get("files", ())
    try:
        folder = resolve_folder(obj.flexmaps.export.folder) if names else None
    except FolderError:
        return False
    return folder is None or any((folder / name).exists() for name in names)


def current_blocks(obj: bpy.types.Object, stage_states: dict[str, StageState]) -> dict[str, Any]:
    """Return the stored report blocks that are up to date, without blocks of extras that are not installed.

    Parameters
    ----------
    obj : the mesh object
    stage_states : states from ``read_states``
    """
    blocks = stored_report.read(obj.data)
    return {name: block for name, block in blocks.items() if name in stage_states and stage_states[name].kind == DONE}


def has_results_of_another(obj: bpy.types.Object, scene: bpy.types.Scene, stage_states: dict[str, StageState]) -> bool:
    """Return whether results on a shared mesh are out of date for one object, but not for another one that uses the mesh.

    Parameters
    ----------
    obj, scene : the mesh object and its scene
    stage_states : states of its stages from ``read_states``
    """
    stale = [stage for stage, state in stage_states.items() if state.kind == STALE and stage != "checks"]
    others = list_other_users(obj) if stale else []
    return any(read_states(other, scene)[stage].kind == DONE for other in others for stage in stale)


def is_stale(obj: bpy.types.Object, scene: bpy.types.Scene, stage: str) -> bool:
    """Return whether a stage has a result whose own inputs changed since; changes of earlier stages do not count.

    Parameters
    ----------
    obj, scene : the mesh object and its scene
    stage : name of the stage's report block; False for a stage of an extra that is not installed
    """
    return (
        stage in INPUTS and stage in stored_report.read(obj.data) and _inputs_changed(obj, scene, stage, INPUTS[stage])
    )


def is_side_result_stale(obj: bpy.types.Object, scene: bpy.types.Scene, name: str) -> bool:
    """Return whether a result (a key of ``SIDE_RESULTS``) exists and its inputs changed since."""
    return _inputs_changed(obj, scene, name, SIDE_RESULTS[name])


def is_side_result_current(obj: bpy.types.Object, scene: bpy.types.Scene, name: str) -> bool:
    """Return whether a result (a key of ``SIDE_RESULTS``) exists and is up to date."""
    return name in stored_report.read_input_checksums(obj.data) and not is_side_result_stale(obj, scene, name)


def _inputs_changed(obj: bpy.types.Object, scene: bpy.types.Scene, name: str, parts: tuple[str, ...]) -> bool:
    made = stored_report.read_input_checksums(obj.data).get(name)
    if made is None:
        return False
    now = Checksums(obj, scene)
    return any(made.get(part) != now[part] for part in parts)

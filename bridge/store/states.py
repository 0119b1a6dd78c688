"""State of every stage of an object: not run, done or out of date. Fast enough for every redraw.

A stage is done while all inputs of its result are unchanged. ``stamp`` stores a checksum of every input (the shape, the
seams, a section of the settings) on the mesh, beside the stages' results; ``read_states`` compares it with the present
input. When an earlier stage runs again, the results of later stages are removed but their checksums stay: this tells a
stage that has to run again from one that never ran.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import bpy

from ...engine.runs import stages
from . import stored_report
from .checksums import Checksums

TODO, DONE, OLD = "TODO", "DONE", "OLD"

# fields of the engine's ``Result`` that the user can edit by hand in Blender -> input; the most often edited first
BY_HAND = {"merged": "seams", "design": "design", "mesh": "shape"}


def _parts(members: Iterable[str], settings: Iterable[str]) -> tuple[str, ...]:
    """Return the names of the inputs that a result depends on: the parts that the user can edit, then the settings."""
    ingredients = stages.dependencies(members)
    own = tuple(part for member, part in BY_HAND.items() if member in ingredients)
    named = tuple(dict.fromkeys(settings))
    return (*own, *named, *(("down",) if "loads" in named else ()))


def _parts_of(block: str) -> tuple[str, ...]:
    writers = stages.writers(block)
    return _parts((m for s in writers for m in s.needs), (name for s in writers for name in s.settings))


# report block of a stage -> names of its inputs; settings by the name of their section, see ``stages.Stage``
PARTS: dict[str, tuple[str, ...]] = {"checks": ("shape",)} | {block: _parts_of(block) for block in stages.BLOCKS}
PARTS["sheets"] += ("export",)  # the block lists files, which depend on these settings
# results that have no report block -> names of their inputs
UNNOTED: dict[str, tuple[str, ...]] = {
    "regularise": _parts(stages.STAGES["regularise"].needs, stages.STAGES["regularise"].settings),
    "preview": (*_parts(("design",), ("spiral",)), "pose"),
    "forecast": _parts(("merged",), stages.PHYSICS),  # predicted strains, computed with a layout
}
OF_MESH = {*BY_HAND.values(), "pose"}
# inputs that are settings, and "down", the direction of gravity in the object's frame
OF_SETTINGS = {part for parts in (*PARTS.values(), *UNNOTED.values()) for part in parts} - OF_MESH
# report block -> report blocks of the stages whose results it uses
AFTER = {
    block: stages.blocks_describing(need for stage in stages.writers(block) for need in stage.needs) - {block}
    for block in stages.BLOCKS
}


@dataclass(frozen=True)
class StageState:
    """State of one stage.

    kind : ``TODO`` (never run), ``DONE`` or ``OLD`` (out of date)
    part : the input that changed; "" where none of its own inputs changed, but an earlier stage did
    """

    kind: str
    part: str = ""


# -- stamps ------------------------------------------------------------------------------------------------------------


def settings_now(obj: bpy.types.Object, scene: bpy.types.Scene) -> dict[str, str]:
    """Return checksums of the settings for ``stamp``. Call it when a stage starts: settings may change while it runs.

    Parameters
    ----------
    obj : the mesh object
    scene : its scene
    """
    now = Checksums(obj, scene)
    return {part: now[part] for part in OF_SETTINGS}


def stamp(obj: bpy.types.Object, scene: bpy.types.Scene, begun: dict[str, str] | None = None) -> None:
    """Store the input checksums of all results written since the last call. Call it after writing results.

    Parameters
    ----------
    obj, scene : the mesh object and its scene
    begun : checksums from ``settings_now``, taken when the work began; None takes the present settings
    """
    mesh = obj.data
    fresh = stored_report.take_fresh(mesh)
    if not fresh:
        return
    if mesh.is_editmode:
        obj.update_from_editmode()
    now = Checksums(obj, scene, begun)
    made = {stage: {part: now[part] for part in PARTS[stage]} for stage in fresh if stage in PARTS}
    stored_report.write_made_from(mesh, made)


def stamp_unnoted(
    obj: bpy.types.Object, scene: bpy.types.Scene, name: str, begun: dict[str, str] | None = None
) -> None:
    """Store the input checksums of a result that has no report block.

    Parameters
    ----------
    obj, scene : the mesh object and its scene
    name : a key of ``UNNOTED``
    begun : as for ``stamp``
    """
    if obj.data.is_editmode:
        obj.update_from_editmode()
    now = Checksums(obj, scene, begun)
    stored_report.write_made_from(obj.data, {name: {part: now[part] for part in UNNOTED[name]}})


# -- states ------------------------------------------------------------------------------------------------------------


def read_states(obj: bpy.types.Object, scene: bpy.types.Scene) -> dict[str, StageState]:
    """Return the state of every stage; edits of a large mesh count only after the user leaves edit mode.

    Parameters
    ----------
    obj : the mesh object
    scene : its scene
    """
    blocks, stamps, now = stored_report.read(obj.data), stored_report.made_from(obj.data), Checksums(obj, scene)
    states: dict[str, StageState] = {}
    for stage, parts in PARTS.items():
        made = stamps.get(stage)
        earlier = [states[name] for name in AFTER.get(stage, ()) if name in states]
        if stage not in blocks:
            states[stage] = StageState(TODO if made is None else OLD)
            continue
        changed = next((part for part in parts if made is not None and made.get(part) != now[part]), None)
        if changed is not None:
            states[stage] = StageState(OLD, changed)
        else:
            states[stage] = StageState(DONE if all(state.kind == DONE for state in earlier) else OLD)
    return states


def current_blocks(obj: bpy.types.Object, known: dict[str, StageState]) -> dict[str, Any]:
    """Return the stored report blocks that are up to date, without blocks of extras that are not installed.

    Parameters
    ----------
    obj : the mesh object
    known : states from ``read_states``
    """
    blocks = stored_report.read(obj.data)
    return {name: block for name, block in blocks.items() if name in known and known[name].kind == DONE}


def is_old(obj: bpy.types.Object, scene: bpy.types.Scene, stage: str) -> bool:
    """Return whether a stage has a result whose own inputs changed since; changes of earlier stages do not count.

    Parameters
    ----------
    obj, scene : the mesh object and its scene
    stage : name of the stage's report block; the result is False if it belongs to an extra that is not installed
    """
    return stage in PARTS and stage in stored_report.read(obj.data) and _inputs_changed(obj, scene, stage, PARTS[stage])


def is_old_unnoted(obj: bpy.types.Object, scene: bpy.types.Scene, name: str) -> bool:
    """Return whether a result (a key of ``UNNOTED``) exists and its inputs changed since."""
    return _inputs_changed(obj, scene, name, UNNOTED[name])


def is_current_unnoted(obj: bpy.types.Object, scene: bpy.types.Scene, name: str) -> bool:
    """Return whether a result (a key of ``UNNOTED``) exists and is up to date."""
    return name in stored_report.made_from(obj.data) and not is_old_unnoted(obj, scene, name)


def _inputs_changed(obj: bpy.types.Object, scene: bpy.types.Scene, name: str, parts: tuple[str, ...]) -> bool:
    made = stored_report.made_from(obj.data).get(name)
    if made is None:
        return False
    now = Checksums(obj, scene)
    return any(made.get(part) != now[part] for part in parts)

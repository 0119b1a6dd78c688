"""The state of every stage of an object; quick enough for every redraw.

A stage is done while all inputs of its result are unchanged. ``stamp`` stores checksums of the inputs, part by part (the
shape, the seams, a group of settings), beside the notes; ``read_states`` compares them with the present. A stamp outlives a note
that an earlier stage dropped, which tells a stage that has to run again from one that never ran.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import bpy

from ...engine.runs import stages
from . import notes
from .checksums import Checksums

TODO, DONE, OLD = "TODO", "DONE", "OLD"

# members of a result that the user can edit on a Blender mesh, most likely first: seams of edges, spirals of faces, vertices
BY_HAND = {"merged": "seams", "design": "design", "mesh": "shape"}


def _parts(members: Iterable[str], settings: Iterable[str]) -> tuple[str, ...]:
    """Return the parts that a result depends on: those of its members that the user can edit, then the settings."""
    ingredients = stages.dependencies(members)
    own = tuple(part for member, part in BY_HAND.items() if member in ingredients)
    named = tuple(dict.fromkeys(settings))
    return (*own, *named, *(("down",) if "loads" in named else ()))


def _parts_of(block: str) -> tuple[str, ...]:
    writers = stages.writers(block)
    return _parts((m for s in writers for m in s.needs), (name for s in writers for name in s.settings))


# block of the notes -> parts that it depends on; settings by the name of their section, see ``stages.Stage``
PARTS: dict[str, tuple[str, ...]] = {"checks": ("shape",)} | {block: _parts_of(block) for block in stages.BLOCKS}
PARTS["sheets"] += ("export",)  # the note names the files
# results without a note -> parts that they depend on
UNNOTED: dict[str, tuple[str, ...]] = {
    "regularise": _parts(stages.STAGES["regularise"].needs, stages.STAGES["regularise"].settings),
    "preview": (*_parts(("design",), ("spiral",)), "pose"),
    "forecast": _parts(("merged",), stages.PHYSICS),  # of strains, made with a layout
}
OF_MESH = {*BY_HAND.values(), "pose"}
# includes "down", the direction of gravity
OF_SETTINGS = {part for parts in (*PARTS.values(), *UNNOTED.values()) for part in parts} - OF_MESH
# block -> blocks of the stages that it builds on
AFTER = {
    block: stages.blocks_describing(need for stage in stages.writers(block) for need in stage.needs) - {block}
    for block in stages.BLOCKS
}


@dataclass(frozen=True)
class StageState:
    """State of one stage: ``TODO``, ``DONE`` or ``OLD`` (out of date).

    part : the part that changed, "" where an earlier stage changed
    """

    kind: str
    part: str = ""


# -- stamps ------------------------------------------------------------------------------------------------------------


def settings_now(obj: bpy.types.Object, scene: bpy.types.Scene) -> dict[str, str]:
    """Return checksums of the settings for ``stamp``; take them when a stage starts, because they may change until it ends.

    Parameters
    ----------
    obj : the mesh object
    scene : its scene
    """
    now = Checksums(obj, scene)
    return {part: now[part] for part in OF_SETTINGS}


def stamp(obj: bpy.types.Object, scene: bpy.types.Scene, begun: dict[str, str] | None = None) -> None:
    """Store the input checksums of all results written since the last stamp; call it after writing.

    Parameters
    ----------
    obj, scene : the mesh object and its scene
    begun : ``settings_now`` from when the work began, if it took a while
    """
    mesh = obj.data
    fresh = notes.take_fresh(mesh)
    if not fresh:
        return
    if mesh.is_editmode:
        obj.update_from_editmode()
    now = Checksums(obj, scene, begun)
    made = {stage: {part: now[part] for part in PARTS[stage]} for stage in fresh if stage in PARTS}
    notes.write_made_from(mesh, made)


def stamp_unnoted(
    obj: bpy.types.Object, scene: bpy.types.Scene, name: str, begun: dict[str, str] | None = None
) -> None:
    """Store the input checksums of one of ``UNNOTED``.

    Parameters
    ----------
    obj, scene : the mesh object and its scene
    name : which
    begun : as for ``stamp``
    """
    if obj.data.is_editmode:
        obj.update_from_editmode()
    now = Checksums(obj, scene, begun)
    notes.write_made_from(obj.data, {name: {part: now[part] for part in UNNOTED[name]}})


# -- states ------------------------------------------------------------------------------------------------------------


def read_states(obj: bpy.types.Object, scene: bpy.types.Scene) -> dict[str, StageState]:
    """Return the state of every stage; in edit mode, a mesh of more than ``MANY`` edges counts as edit mode found it.

    Parameters
    ----------
    obj : the mesh object
    scene : its scene
    """
    blocks, stamps, now = notes.read(obj.data), notes.made_from(obj.data), Checksums(obj, scene)
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
    """Return the stored blocks that are up to date; those of an extra that is missing are left out.

    Parameters
    ----------
    obj : the mesh object
    known : from ``read_states``
    """
    blocks = notes.read(obj.data)
    return {name: block for name, block in blocks.items() if name in known and known[name].kind == DONE}


def is_old(obj: bpy.types.Object, scene: bpy.types.Scene, stage: str) -> bool:
    """Return whether a stage has a result whose inputs changed since; earlier stages are not considered.

    Parameters
    ----------
    obj, scene : the mesh object and its scene
    stage : block of the notes; one of an extra that is missing is never old
    """
    return stage in PARTS and stage in notes.read(obj.data) and _inputs_changed(obj, scene, stage, PARTS[stage])


def is_old_unnoted(obj: bpy.types.Object, scene: bpy.types.Scene, name: str) -> bool:
    """Return whether one of ``UNNOTED`` was made and its inputs changed since."""
    return _inputs_changed(obj, scene, name, UNNOTED[name])


def is_current_unnoted(obj: bpy.types.Object, scene: bpy.types.Scene, name: str) -> bool:
    """Return whether one of ``UNNOTED`` was made and is up to date."""
    return name in notes.made_from(obj.data) and not is_old_unnoted(obj, scene, name)


def _inputs_changed(obj: bpy.types.Object, scene: bpy.types.Scene, name: str, parts: tuple[str, ...]) -> bool:
    made = notes.made_from(obj.data).get(name)
    if made is None:
        return False
    now = Checksums(obj, scene)
    return any(made.get(part) != now[part] for part in parts)

"""How far every stage of an object is; cheap enough to be asked at every redraw.

A stage is done while everything that its result was made from is as it was. ``stamp`` notes that, part by part (the shape,
the seams, a group of settings), as checksums beside the notes; ``of`` compares them with the present. A stamp outlives the
note that an earlier stage dropped, and so tells a stage that has to be run again from one that never ran.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import bpy

from ...engine.runs import stages
from . import notes
from .checksums import Checksums

TODO, DONE, OLD = "TODO", "DONE", "OLD"

# what of a result a hand can change on a Blender mesh, the likeliest first: its edges' seams, its faces' spirals, its vertices
BY_HAND = {"flat": "seams", "design": "design", "mesh": "shape"}


def _parts(members: Iterable[str], settings: Iterable[str]) -> tuple[str, ...]:
    """What something is made from that goes on from some members: what a hand can change of them, then the settings."""
    ingredients = stages.ingredients(members)
    own = tuple(part for member, part in BY_HAND.items() if member in ingredients)
    named = tuple(dict.fromkeys(settings))
    return (*own, *named, *(("down",) if "loads" in named else ()))


def _parts_of(block: str) -> tuple[str, ...]:
    writers = stages.writers(block)
    return _parts((m for s in writers for m in s.needs), (name for s in writers for name in s.settings))


# block of the notes -> what it is made from; settings by the name of their section, see ``stages.Stage``
PARTS: dict[str, tuple[str, ...]] = {"checks": ("shape",)} | {block: _parts_of(block) for block in stages.BLOCKS}
PARTS["sheets"] += ("export",)  # the note names the files
# what has no note, but is made from the same
UNNOTED: dict[str, tuple[str, ...]] = {
    "regularise": _parts(stages.STAGES["regularise"].needs, stages.STAGES["regularise"].settings),
    "preview": (*_parts(("design",), ("spiral",)), "pose"),
}
OF_MESH = {*BY_HAND.values(), "pose"}
OF_SETTINGS = {
    part for parts in (*PARTS.values(), *UNNOTED.values()) for part in parts
} - OF_MESH  # and which way is down
# block -> those of the stages that it goes on from
AFTER = {
    block: stages.blocks_of(need for stage in stages.writers(block) for need in stage.needs) - {block}
    for block in stages.BLOCKS
}
WHY = {
    "seams": "The seams were edited since",
    "shape": "The mesh was changed since",
    "design": "The spirals were changed since",
    "down": "The object was turned since",
}
SETTING, EARLIER = "A setting was changed since", "An earlier stage was changed since"
PROGRAM = "An earlier version of FlexMaps made it, which looked at less"


@dataclass(frozen=True)
class State:
    """One stage: ``TODO``, ``DONE`` or ``OLD`` (out of date); ``part`` is what changed, "" where an earlier stage did.

    known : whether the version that made it took note of that part
    """

    kind: str
    part: str = ""
    known: bool = True

    @property
    def reason(self) -> str:
        """Why it is out of date, as a sentence without its full stop; "" where it is not."""
        if self.kind != OLD:
            return ""
        if not self.known:
            return PROGRAM
        return WHY.get(self.part, SETTING) if self.part else EARLIER


# -- stamps ------------------------------------------------------------------------------------------------------------


def settings_now(obj: bpy.types.Object, scene: bpy.types.Scene) -> dict[str, str]:
    """Checksums of the settings as they are now, for ``stamp``: a stage begins with them, and they may change until it ends."""
    now = Checksums(obj, scene)
    return {part: now[part] for part in OF_SETTINGS}


def stamp(obj: bpy.types.Object, scene: bpy.types.Scene, begun: dict[str, str] | None = None) -> None:
    """Note what the results that were written since the last stamp are made from; call it after writing.

    begun : the ``settings_now`` when the work began, where that is a while ago
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
    """Note what something was made from that is no stage, one of ``UNNOTED``; ``begun`` as for ``stamp``."""
    if obj.data.is_editmode:
        obj.update_from_editmode()
    now = Checksums(obj, scene, begun)
    notes.write_made_from(obj.data, {name: {part: now[part] for part in UNNOTED[name]}})


# -- states ------------------------------------------------------------------------------------------------------------


def of(obj: bpy.types.Object, scene: bpy.types.Scene) -> dict[str, State]:
    """The state of every stage, in edit mode too; a mesh of more than ``MANY`` edges is there as edit mode found it."""
    blocks, stamps, now = notes.read(obj.data), notes.made_from(obj.data), Checksums(obj, scene)
    states: dict[str, State] = {}
    for stage, parts in PARTS.items():
        made = stamps.get(stage)
        earlier = [states[name] for name in AFTER.get(stage, ()) if name in states]
        if stage not in blocks:
            states[stage] = State(TODO if made is None else OLD)
            continue
        changed = next((part for part in parts if made is not None and made.get(part) != now[part]), None)
        if changed is not None:
            states[stage] = State(OLD, changed, made is None or changed in made)
        else:
            states[stage] = State(DONE if all(state.kind == DONE for state in earlier) else OLD)
    return states


def is_old(obj: bpy.types.Object, scene: bpy.types.Scene, stage: str) -> bool:
    """Whether there is a result of a stage that what it was made from has left behind; earlier stages are not looked at."""
    return stage in notes.read(obj.data) and _left_behind(obj, scene, stage, PARTS[stage])


def is_old_unnoted(obj: bpy.types.Object, scene: bpy.types.Scene, name: str) -> bool:
    """The same of one of ``UNNOTED``, which has no note; False where it was never made."""
    return _left_behind(obj, scene, name, UNNOTED[name])


def is_current_unnoted(obj: bpy.types.Object, scene: bpy.types.Scene, name: str) -> bool:
    """Whether one of ``UNNOTED`` was made of what is there now, so that it would make nothing else."""
    return name in notes.made_from(obj.data) and not is_old_unnoted(obj, scene, name)


def _left_behind(obj: bpy.types.Object, scene: bpy.types.Scene, name: str, parts: tuple[str, ...]) -> bool:
    made = notes.made_from(obj.data).get(name)
    if made is None:
        return False
    now = Checksums(obj, scene)
    return any(made.get(part) != now[part] for part in parts)

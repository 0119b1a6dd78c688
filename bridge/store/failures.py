"""Failed stages, kept on the mesh with their inputs, so that *Next* never offers the same action with the same input."""

from __future__ import annotations

from typing import Any

import bpy

from ...engine.errors import FlexMapsError
from . import modifiers, notes
from .checksums import Checksums
from .states import OF_SETTINGS, PARTS

NAME = "flexmaps_failed"  # operator's idname -> its inputs and its message
LET_GO = "flexmaps_let_go"  # key of a notice -> the sentence that the user dismissed
TRIED = "flexmaps_tried"  # call of a cure that *Next* pressed -> how often
# operator -> block of the notes on whose parts it depends; every other operator depends on all parts
WRITES = {
    "flexmaps.flatten": "layout", "flexmaps.merge": "layout", "flexmaps.trace": "layout", "flexmaps.update_from_seams": "layout",
    "flexmaps.spirals": "spirals", "flexmaps.simulate": "equilibrium", "flexmaps.optimise": "optimise",
    "flexmaps.fit": "optimise", "flexmaps.export": "sheets",
}  # fmt: skip


def write(obj: bpy.types.Object, scene: bpy.types.Scene, idname: str, error: FlexMapsError) -> None:
    """Store that an operator failed, with the culprits and checksums of its inputs.

    Parameters
    ----------
    obj, scene : the mesh object and its scene
    idname : the operator
    error : its error
    """
    failure: dict[str, Any] = {
        "message": str(error),
        "faces": error.faces,
        "edges": error.edges,
        "given": _input_checksums(obj, scene, idname),
    }
    failure |= {} if error.quads is None else {"quads": error.quads}
    notes.put_text(obj.data, NAME, notes.get_text(obj.data, NAME) | {idname: failure})


def clear(obj: bpy.types.Object, idname: str) -> None:
    """Forget the failure of an operator that has succeeded since.

    Parameters
    ----------
    obj : the mesh object
    idname : the operator
    """
    failed = notes.get_text(obj.data, NAME)
    if idname in failed:
        notes.put_text(obj.data, NAME, {name: failure for name, failure in failed.items() if name != idname})


def read(obj: bpy.types.Object, scene: bpy.types.Scene) -> dict[str, dict[str, Any]]:
    """Return the operators that would fail again, because their inputs are unchanged.

    Returns
    -------
    idname -> ``message``, ``faces``, ``edges`` and, where remeshing to so many quads would help, ``quads``.
    """
    failed = notes.get_text(obj.data, NAME)
    return {name: failure for name, failure in failed.items() if failure["given"] == _input_checksums(obj, scene, name)}


def _input_checksums(obj: bpy.types.Object, scene: bpy.types.Scene, idname: str) -> dict[str, str]:
    now = Checksums(obj, scene)
    parts = PARTS[WRITES[idname]] if idname in WRITES else ("shape", *sorted(OF_SETTINGS))
    return {part: now[part] for part in parts}


def let_go(mesh: bpy.types.Mesh, key: str, sentence: str) -> None:
    """Store that the user dismissed a notice, as long as its sentence stays the same.

    Parameters
    ----------
    mesh : Blender's mesh
    key, sentence : of the notice
    """
    notes.put_text(mesh, LET_GO, notes.get_text(mesh, LET_GO) | {key: sentence})


def is_let_go(mesh: bpy.types.Mesh, key: str, sentence: str) -> bool:
    """Return whether the user dismissed a notice with this sentence."""
    return notes.get_text(mesh, LET_GO).get(key) == sentence


def note_tried(mesh: bpy.types.Mesh, call: str) -> None:
    """Count that *Next* pressed a cure, so that it offers another one if that was not enough.

    Parameters
    ----------
    mesh : Blender's mesh
    call : ``Cure.call``
    """
    tried = notes.get_text(mesh, TRIED)
    notes.put_text(mesh, TRIED, tried | {call: tried.get(call, 0) + 1})


def tried(mesh: bpy.types.Mesh) -> dict[str, int]:
    """Return the calls of the cures that *Next* has pressed, and how often."""
    return notes.get_text(mesh, TRIED)


def hand_down(old: bpy.types.Mesh, new: bpy.types.Mesh) -> None:
    """Copy pressed cures, dismissed notices and the note of modifiers that were left out to the mesh that replaces another one.

    Parameters
    ----------
    old, new : Blender's meshes
    """
    for name in (TRIED, LET_GO, modifiers.NAME):
        kept = notes.get_text(old, name)
        if kept:
            notes.put_text(new, name, kept)

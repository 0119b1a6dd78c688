"""Failed stages, stored on the mesh with their inputs, so that *Next* does not offer an action that failed already.

Also the notices that the user dismissed, and how often *Next* pressed each cure.
"""

from __future__ import annotations

from typing import Any

import bpy

from ...engine.errors import FlexMapsError
from . import modifiers, stored_report
from .checksums import Checksums
from .states import INPUTS, SETTINGS_INPUTS

NAME = "flexmaps_failed"  # text on the mesh: operator's idname -> checksums of its inputs, and its message
DISMISSED = "flexmaps_let_go"  # text on the mesh: key of a notice -> the sentence that the user dismissed
PRESS_COUNTS = "flexmaps_tried"  # text on the mesh: call of a cure -> how often *Next* pressed it
# operator -> report block that it writes; its inputs are the inputs of this block. Other operators depend on all inputs
WRITES = {
    "flexmaps.flatten": "layout", "flexmaps.merge": "layout", "flexmaps.trace": "layout", "flexmaps.update_from_seams": "layout",
    "flexmaps.spirals": "spirals", "flexmaps.simulate": "equilibrium", "flexmaps.optimise": "optimise",
    "flexmaps.fit": "optimise", "flexmaps.export": "sheets",
}  # fmt: skip


def write(
    obj: bpy.types.Object, scene: bpy.types.Scene, idname: str, error: FlexMapsError, *, folder: bool = False
) -> None:
    """Store that an operator failed, with the faces and edges concerned and the checksums of its inputs.

    Parameters
    ----------
    obj, scene : the mesh object and its scene
    idname : name of the operator
    error : the error that it raised
    folder : whether another export folder could help
    """
    failure: dict[str, Any] = {
        "message": str(error),
        "faces": error.faces,
        "edges": error.edges,
        "given": _input_checksums(obj, scene, idname),
    }
    failure |= {"folder": True} if folder else {}
    failure |= {} if error.quads is None else {"quads": error.quads}
    stored_report.put_text(obj.data, NAME, stored_report.get_text(obj.data, NAME) | {idname: failure})


def clear(obj: bpy.types.Object, idname: str) -> None:
    """Forget the failure of an operator that has succeeded since.

    Parameters
    ----------
    obj : the mesh object
    idname : name of the operator
    """
    failed = stored_report.get_text(obj.data, NAME)
    if idname in failed:
        stored_report.put_text(obj.data, NAME, {name: failure for name, failure in failed.items() if name != idname})


def read(obj: bpy.types.Object, scene: bpy.types.Scene) -> dict[str, dict[str, Any]]:
    """Return the failures of operators that would fail again, because their inputs are unchanged.

    Returns
    -------
    idname -> ``message``, ``faces``, ``edges``; where a remesh could help, the number of ``quads`` to remesh to; and
    ``folder``, True where another folder could help.
    """
    failed = stored_report.get_text(obj.data, NAME)
    return {name: failure for name, failure in failed.items() if failure["given"] == _input_checksums(obj, scene, name)}


def _input_checksums(obj: bpy.types.Object, scene: bpy.types.Scene, idname: str) -> dict[str, str]:
    now = Checksums(obj, scene)
    parts = INPUTS[WRITES[idname]] if idname in WRITES else ("shape", *sorted(SETTINGS_INPUTS))
    return {part: now[part] for part in parts}


def dismiss(mesh: bpy.types.Mesh, key: str, sentence: str) -> None:
    """Store that the user dismissed a notice; it counts as dismissed as long as its sentence stays the same.

    Parameters
    ----------
    mesh : Blender's mesh
    key, sentence : key and sentence of the notice
    """
    stored_report.put_text(mesh, DISMISSED, stored_report.get_text(mesh, DISMISSED) | {key: sentence})


def is_dismissed(mesh: bpy.types.Mesh, key: str, sentence: str) -> bool:
    """Return whether the user dismissed a notice with this sentence."""
    return stored_report.get_text(mesh, DISMISSED).get(key) == sentence


def count_press(mesh: bpy.types.Mesh, call: str) -> None:
    """Count that *Next* pressed a cure, so that it offers another cure next time.

    Parameters
    ----------
    mesh : Blender's mesh
    call : ``Cure.call``
    """
    tried = stored_report.get_text(mesh, PRESS_COUNTS)
    stored_report.put_text(mesh, PRESS_COUNTS, tried | {call: tried.get(call, 0) + 1})


def read_press_counts(mesh: bpy.types.Mesh) -> dict[str, int]:
    """Return how often *Next* pressed each cure, by ``Cure.call``."""
    return stored_report.get_text(mesh, PRESS_COUNTS)


def transfer(old: bpy.types.Mesh, new: bpy.types.Mesh) -> None:
    """Copy pressed cures, dismissed notices and the sentence about ignored modifiers to the mesh that replaces another.

    Parameters
    ----------
    old, new : Blender's meshes
    """
    for name in (PRESS_COUNTS, DISMISSED, modifiers.NAME):
        kept = stored_report.get_text(old, name)
        if kept:
            stored_report.put_text(new, name, kept)

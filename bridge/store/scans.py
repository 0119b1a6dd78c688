"""A comparison with a scan, kept on an object: a face attribute, the block "scan" of the notes, and an object of points.

 flexmaps_scan            face        distance of the spiral's centre from the scan, millimetres; -1 where the scan has a gap

Writing a new simulation removes all of it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy

from . import attributes, notes, states

if TYPE_CHECKING:
    from ...engine.extras.scanning.compare import Comparison

NAME, BLOCK = attributes.PREFIX + "scan", "scan"
POINTS, OWNER = "flexmaps_scan_points", "flexmaps_owner"  # on the object and on its points; each names the other


def forget(obj: bpy.types.Object) -> None:
    """Remove the distances, the note and the points."""
    attributes.remove(obj, NAME)
    if BLOCK in notes.read(obj.data):
        notes.drop_from(obj.data, BLOCK)
    points = obj.get(POINTS)
    if isinstance(points, bpy.types.Object) and points.get(OWNER) == obj.name:
        data = points.data
        bpy.data.objects.remove(points)
        if data is not None and data.users == 0:
            bpy.data.meshes.remove(data)
    if POINTS in obj:
        del obj[POINTS]


def write(obj: bpy.types.Object, found: Comparison, points: bpy.types.Object) -> None:
    """Store the distances and the points of a comparison; the caller writes the note with those of the other stages.

    Parameters
    ----------
    obj : the mesh object
    found : the comparison
    points : the object of points, already in the scene
    """
    forget(obj)
    attributes.put(obj, NAME, "FACE", "FLOAT", found.shown_mm)
    points[OWNER] = obj.name
    obj[POINTS] = points


def current(obj: bpy.types.Object, scene: bpy.types.Scene) -> bool:
    """Return whether a comparison exists and is up to date: the object still has the shape that was compared with the scan.

    Parameters
    ----------
    obj : the mesh object
    scene : its scene
    """
    block = notes.read(obj.data).get(BLOCK)
    if block is None or states.is_old(obj, scene, BLOCK):
        return False
    return block["against"] == "target" or not states.is_old(obj, scene, "equilibrium")


def sentence(block: dict[str, Any]) -> str:
    """Describe a comparison's result for people."""
    from .i18n import translate

    text = "The built piece is RMS {:.2f} mm, {:.2f} % from the {}, at most {:.2f} mm, {:.2f} %; the scan shows {:.0f} % of its spirals."
    figures = [block[name] for name in ("rms_mm", "rms_percent")], [block[name] for name in ("max_mm", "max_percent")]
    against = translate(block["against"])
    return " ".join([translate(text, *figures[0], against, *figures[1], 100 * block["covered"]), *block["remarks"]])

"""What a comparison with a scan left on an object: a face attribute, the block "scan" of the notes, and an object of points.

    flexmaps_scan            face        how far the spiral's centre is from the scan, millimetres; -1 where the scan does not show it

A simulation that is written makes all of it out of date.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy

from . import attributes, notes, states

if TYPE_CHECKING:
    from ...engine.scanning.compare import Comparison

NAME, BLOCK = attributes.PREFIX + "scan", "scan"
POINTS, OWNER = "flexmaps_scan_points", "flexmaps_owner"  # on the object and on its points, each names the other


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
    """The distances and the points of a comparison; the note is written with those of the other stages."""
    forget(obj)
    attributes.put(obj, NAME, "FACE", "FLOAT", found.shown_mm)
    points[OWNER] = obj.name
    obj[POINTS] = points


def current(obj: bpy.types.Object, scene: bpy.types.Scene) -> bool:
    """Whether there is a comparison, and the shape that the scan was compared with is the object's still."""
    block = notes.read(obj.data).get(BLOCK)
    if block is None or states.is_old(obj, scene, BLOCK):
        return False
    return block["against"] == "target" or not states.is_old(obj, scene, "equilibrium")


def sentence(block: dict[str, Any]) -> str:
    """What a comparison found, for people."""
    from .i18n import translate

    text = "The built piece is RMS {:.2f} mm, {:.2f} % from the {}, at most {:.2f} mm, {:.2f} %; the scan shows {:.0f} % of its spirals."
    figures = [block[name] for name in ("rms_mm", "rms_percent")], [block[name] for name in ("max_mm", "max_percent")]
    against = translate(block["against"])
    return " ".join([translate(text, *figures[0], against, *figures[1], 100 * block["covered"]), *block["remarks"]])

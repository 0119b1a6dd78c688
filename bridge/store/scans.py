"""Comparison of the built piece with a 3D scan: a face attribute, the report block "scan", an object of scan points.

 flexmaps_scan    face    distance of the spiral's centre from the scan, millimetres; -1 where the scan has a gap

Writing a new simulation removes all three.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy

from . import attributes, states, stored_report

if TYPE_CHECKING:
    from ...engine.extras.scanning.compare import Comparison

NAME, BLOCK = attributes.PREFIX + "scan", "scan"
# custom properties: on the mesh object, its object of scan points; on the object of scan points, the mesh object's name
POINTS, OWNER = "flexmaps_scan_points", "flexmaps_owner"


def clear(obj: bpy.types.Object) -> None:
    """Remove the distances, the report block and the scan points."""
    attributes.remove(obj, NAME)
    if BLOCK in stored_report.read(obj.data):
        stored_report.drop_from(obj.data, BLOCK)
    points = obj.get(POINTS)
    if isinstance(points, bpy.types.Object) and points.get(OWNER) == obj.name:
        data = points.data
        bpy.data.objects.remove(points)
        if data is not None and data.users == 0:
            bpy.data.meshes.remove(data)
    if POINTS in obj:
        del obj[POINTS]


def write(obj: bpy.types.Object, comparison: Comparison, points: bpy.types.Object) -> None:
    """Store the distances and the scan points of a comparison; the caller writes the report block.

    Parameters
    ----------
    obj : the mesh object
    comparison : the comparison
    points : the object of scan points, already in the scene
    """
    clear(obj)
    attributes.write(obj, NAME, "FACE", "FLOAT", comparison.shown_mm)
    points[OWNER] = obj.name
    obj[POINTS] = points


def is_current(obj: bpy.types.Object, scene: bpy.types.Scene) -> bool:
    """Return whether a comparison exists and the target or simulated shape that was compared is unchanged.

    Parameters
    ----------
    obj : the mesh object
    scene : its scene
    """
    block = stored_report.read(obj.data).get(BLOCK)
    if block is None or states.is_stale(obj, scene, BLOCK):
        return False
    return block["against"] == "target" or not states.is_stale(obj, scene, "equilibrium")


def describe_result(block: dict[str, Any]) -> str:
    """Return a sentence about a comparison's result for the user."""
    from .i18n import translate

    text = "The built piece is RMS {:.2f} mm, {:.2f} % from the {}, at most {:.2f} mm, {:.2f} %; the scan shows {:.0f} % of its spirals."
    figures = [block[name] for name in ("rms_mm", "rms_percent")], [block[name] for name in ("max_mm", "max_percent")]
    against = translate(block["against"])
    return " ".join([translate(text, *figures[0], against, *figures[1], 100 * block["covered"]), *block["remarks"]])

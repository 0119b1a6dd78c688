"""The object that quads were made from, which Quad remesh takes again as long as nobody has changed the quads.

What coarse quads have missed of a shape, finer ones made from them would miss too.
"""

from __future__ import annotations

import zlib

import bpy
import numpy as np

from ...engine.arrays import Float

SOURCE = "flexmaps_source"  # on an object of quads: what they were made from
MADE = "flexmaps_made"  # on its mesh: a checksum of the quads as they were made


def note(made: bpy.types.Object, source: bpy.types.Object) -> None:
    """Note what an object of quads was made from."""
    made[SOURCE], made.data[MADE] = source, _checksum(made.data)


def source_of(obj: bpy.types.Object, scene: bpy.types.Scene) -> bpy.types.Object:
    """What the quads of an object were made from; the object itself where that is gone, or where somebody has changed the quads."""
    source = obj.get(SOURCE)
    if not isinstance(source, bpy.types.Object) or scene.objects.get(source.name) != source:
        return obj
    return source if len(source.data.polygons) and obj.data.get(MADE) == _checksum(obj.data) else obj


def between(source: bpy.types.Object, obj: bpy.types.Object, scene: bpy.types.Scene) -> Float[np.ndarray, "4 4"]:
    """From where a source stands to where the quads stand that were made from it, metres: these may have been moved and scaled since."""
    from .mesh import to_metres  # scipy comes with it

    return to_metres(obj, scene) @ np.linalg.inv(to_metres(source, scene))


def _checksum(mesh: bpy.types.Mesh) -> str:
    positions, corners = np.empty(3 * len(mesh.vertices), np.float32), np.empty(len(mesh.loops), np.int32)
    mesh.vertices.foreach_get("co", positions)
    mesh.loops.foreach_get("vertex_index", corners)
    return f"{zlib.crc32(positions.tobytes() + corners.tobytes()):08x}"

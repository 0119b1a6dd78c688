"""Source object of a quad remesh; Quad remesh starts from it again as long as the user has not changed the quads.

Refining the coarse quads instead would lose the details that they missed.
"""

from __future__ import annotations

import zlib

import bpy
import numpy as np

from ...engine.arrays import Float
from .columns import column

SOURCE = "flexmaps_source"  # custom property of the object of quads: the source object
QUADS_CHECKSUM = "flexmaps_made"  # custom property of the mesh of quads: checksum of the quads right after the remesh


def write_source(quads: bpy.types.Object, source: bpy.types.Object) -> None:
    """Store which object the quads were made from, and a checksum of the quads.

    Parameters
    ----------
    quads : the new object of quads
    source : the object that was remeshed
    """
    quads[SOURCE], quads.data[QUADS_CHECKSUM] = source, _checksum(quads.data)


def read_source(obj: bpy.types.Object, scene: bpy.types.Scene) -> bpy.types.Object:
    """Return the source object of the quads; ``obj`` if the source is gone or the user changed the quads.

    Parameters
    ----------
    obj : object with quads that Quad remesh may have made
    scene : scene that must hold the source
    """
    source = obj.get(SOURCE)
    if not isinstance(source, bpy.types.Object) or scene.objects.get(source.name) != source:
        return obj
    return source if len(source.data.polygons) and obj.data.get(QUADS_CHECKSUM) == _checksum(obj.data) else obj


def source_to_quads(
    source: bpy.types.Object, obj: bpy.types.Object, scene: bpy.types.Scene
) -> Float[np.ndarray, "4 4"]:
    """Return the transform, in metres, from the surface that was remeshed to the quads made from it.

    It is the identity unless one of the two objects was moved, rotated or scaled after the remeshing.

    Parameters
    ----------
    source : object that was remeshed
    obj : object with the quads that the remesh made
    scene : scene of both objects, whose units give the metres
    """
    from .vertex_positions import to_metres  # imported here because it imports scipy

    return to_metres(obj, scene) @ np.linalg.inv(to_metres(source, scene))


def _checksum(mesh: bpy.types.Mesh) -> str:
    positions, corners = column(mesh.vertices, "co"), column(mesh.loops, "vertex_index")
    return f"{zlib.crc32(positions.tobytes() + corners.tobytes()):08x}"

"""The points of a scan, laid over the model as an object of vertices."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
import numpy as np

from . import collection

if TYPE_CHECKING:
    from ...engine.extras.scanning.compare import Comparison


def show(obj: bpy.types.Object, scene: bpy.types.Scene, found: Comparison) -> bpy.types.Object:
    """Lay the scan's points over the model; the attribute ``shows_piece`` is 0 for points beside the piece.

    Parameters
    ----------
    obj, scene : the model and its scene
    found : the comparison
    """
    mesh = bpy.data.meshes.new(f"{obj.name} scan")
    mesh.vertices.add(len(found.points))
    mesh.attributes["position"].data.foreach_set("vector", found.points.astype(np.float32).ravel())
    mesh.attributes.new("shows_piece", "BOOLEAN", "POINT").data.foreach_set("value", found.used)
    mesh.update()
    made = collection.add(obj, scene, "scan", "scan", mesh, np.zeros(3))
    made.hide_render = True  # vertices do not render, but would widen a picture's frame
    return made

"""Show the points of a scan as an object of vertices, aligned with the model."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
import numpy as np

from . import collection

if TYPE_CHECKING:
    from ...engine.extras.scanning.compare import Comparison


def show_points(obj: bpy.types.Object, scene: bpy.types.Scene, comparison: Comparison) -> bpy.types.Object:
    """Make an object of the scan's points; its attribute ``shows_piece`` is False for points that are not on the piece.

    Parameters
    ----------
    obj, scene : the model and its scene
    comparison : comparison of the scan with the simulated shape, with the aligned points
    """
    mesh = bpy.data.meshes.new(f"{obj.name} scan")
    mesh.vertices.add(len(comparison.points))
    mesh.attributes["position"].data.foreach_set("vector", comparison.points.astype(np.float32).ravel())
    mesh.attributes.new("shows_piece", "BOOLEAN", "POINT").data.foreach_set("value", comparison.used)
    mesh.update()
    made = collection.add(obj, scene, "scan", "scan", mesh, np.zeros(3))
    made.hide_render = True  # vertices are not rendered, but the camera would be fitted to them
    return made

"""Frame the selection in the part of a 3D view that sidebar, toolbar and headers leave free."""

from __future__ import annotations

import bmesh
import bpy
import numpy as np

from ...engine.arrays import Float
from ...engine.display.view_fit import Rectangle, free_part, place_view
from ..store.columns import column


def frame_selection(context: bpy.types.Context, area: bpy.types.Area, region: bpy.types.Region) -> None:
    """Pan and zoom a view so that the selection fills its free part; leave camera views and quad views unchanged.

    Parameters
    ----------
    context : Blender's context
    area, region : the 3D view and its main region
    """
    space = area.spaces.active
    orientation = space.region_3d
    points = _selected_points(context)
    if not len(points) or space.region_quadviews or orientation.view_perspective == "CAMERA":
        return

    def rectangle(one: bpy.types.Region) -> Rectangle:
        return Rectangle(one.x, one.y, one.x + one.width, one.y + one.height)

    view = rectangle(region)
    covers = [(one.alignment, rectangle(one)) for one in area.regions if one != region]
    axes = np.array(orientation.view_rotation.to_matrix()).T
    in_perspective = orientation.is_perspective
    location, distance = place_view(points, axes, view, free_part(view, covers), space.lens, in_perspective)
    if distance > space.clip_start:  # a nearer view would be clipped and show nothing
        orientation.view_location, orientation.view_distance = location.tolist(), distance


def _selected_points(context: bpy.types.Context) -> Float[np.ndarray, "points 3"]:
    """Return points that the selection consists of, in world axes and the scene's unit.

    In object mode, these are the vertices of selected meshes and curves, with modifiers, and the corners of other
    objects' bounding boxes. In edit mode of meshes, these are the selected vertices. In other modes there are none.
    """
    parts = [np.empty((0, 3))]
    objects = {"EDIT_MESH": context.objects_in_mode, "OBJECT": context.selected_objects}.get(context.mode, [])
    graph = context.evaluated_depsgraph_get()
    for obj in objects:
        if context.mode == "EDIT_MESH":
            points = np.array([v.co for v in bmesh.from_edit_mesh(obj.data).verts if v.select], dtype=float).reshape(
                -1, 3
            )
        elif obj.type in {"MESH", "CURVE"}:
            evaluated = obj.evaluated_get(graph)
            points = column(evaluated.to_mesh().vertices, "co")
            evaluated.to_mesh_clear()
        else:
            points = np.array(obj.bound_box)
        to_world = np.array(obj.matrix_world)
        parts.append(points @ to_world[:3, :3].T + to_world[:3, 3])
    return np.concatenate(parts)

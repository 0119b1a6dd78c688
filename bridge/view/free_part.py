"""Frame the selection in the part of a 3D view that sidebar, toolbar and headers leave free."""

from __future__ import annotations

import bmesh
import bpy
import numpy as np

from ...engine.arrays import Float
from ...engine.display.view_fit import Rectangle, free_part, place_view
from ..store.columns import column

# end of the clip range, in distances of the farthest point; larger leaves room to move away, and makes orthographic
# views less exact
CLIP_MARGIN = 2.0


def frame_selection(context: bpy.types.Context, area: bpy.types.Area, region: bpy.types.Region) -> None:
    """Pan and zoom a view so that the selection fills its free part; leave camera views and quad views unchanged.

    Parameters
    ----------
    context : Blender's context
    area, region : the 3D view and its main region
    """
    frame_points(area, region, _selected_points(context))


def frame_points(area: bpy.types.Area, region: bpy.types.Region, points: Float[np.ndarray, "points 3"]) -> None:
    """Pan and zoom a view so that points fill its free part; leave camera views and quad views unchanged.

    Parameters
    ----------
    area, region : the 3D view and its main region
    points : the points, in world axes and the scene's unit
    """
    space = area.spaces.active
    orientation = space.region_3d
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
    extend_clipping(space, points)


def extend_clipping(space: bpy.types.SpaceView3D, points: Float[np.ndarray, "points 3"]) -> None:
    """Move the end of a view's clip range beyond points; by default it is at 1000 units, which is near in millimetres.

    Parameters
    ----------
    space : the 3D view
    points : points that must be visible, in world axes and the scene's unit
    """
    view = space.region_3d
    towards_eye = np.array(view.view_rotation.to_matrix())[:, 2]
    farthest = view.view_distance - float(((points - np.array(view.view_location)) @ towards_eye).min())
    if farthest > space.clip_end:
        space.clip_end = CLIP_MARGIN * farthest


def points_of(
    context: bpy.types.Context, obj: bpy.types.Object, selected: bool = False
) -> Float[np.ndarray, "points 3"]:
    """Return points that an object consists of, in world axes and the scene's unit.

    These are the vertices of meshes and curves, with modifiers unless in edit mode, and the corners of other objects'
    bounding boxes.

    Parameters
    ----------
    context : Blender's context
    obj : the object
    selected : whether to return only the selected vertices of a mesh in edit mode
    """
    if obj.type == "MESH" and obj.mode == "EDIT":
        vertices = bmesh.from_edit_mesh(obj.data).verts
        points = np.array([v.co for v in vertices if v.select or not selected], dtype=float).reshape(-1, 3)
    elif obj.type in {"MESH", "CURVE"}:
        evaluated = obj.evaluated_get(context.evaluated_depsgraph_get())
        points = column(evaluated.to_mesh().vertices, "co")
        evaluated.to_mesh_clear()
    else:
        points = np.array(obj.bound_box)
    to_world = np.array(obj.matrix_world)
    return np.asarray(points @ to_world[:3, :3].T + to_world[:3, 3])


def _selected_points(context: bpy.types.Context) -> Float[np.ndarray, "points 3"]:
    """Return points that the selection consists of: selected objects, or in edit mode of meshes selected vertices.

    In other modes there are none.
    """
    objects = {"EDIT_MESH": context.objects_in_mode, "OBJECT": context.selected_objects}.get(context.mode, [])
    return np.concatenate([np.empty((0, 3)), *(points_of(context, obj, selected=True) for obj in objects)])

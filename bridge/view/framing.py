"""Move the 3D views to objects or to faulty places of a mesh, and select these places."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Any

import bpy
import numpy as np

from ...engine.errors import FlexMapsError

if TYPE_CHECKING:
    from ..store.surface import ObjectSurface


FRAMED_KEY = "flexmaps_framed"  # custom property of a model: the views were already framed on its panels
# smallest diameter of a scaled piece, in distances of the eye (1.4 fills a view): a smaller piece is a dot and is framed;
# larger moves more views in which somebody wanted to see the piece small; by eye
SMALLEST = 0.05


def scale_views(context: bpy.types.Context, obj: bpy.types.Object, factor: float) -> None:
    """Move every 3D view so that an object, scaled about its origin, looks as large as before; camera views stay.

    Otherwise a sphere of 2 m that is scaled to 0.2 m would become a dot. An object that is a dot even so is framed: no
    view comes near enough to a mesh of a hundredth of a millimetre.

    Parameters
    ----------
    context : Blender's context
    obj : the object
    factor : scale factor of the object
    """
    from . import collection, followed_views, free_part

    context.view_layer.update()
    diameter = max(obj.dimensions)
    for _, area in _view_areas(context):
        view = area.spaces.active.region_3d
        if view is None or view.view_perspective == "CAMERA":
            continue
        followed_views.scale_view(view, obj.matrix_world.translation, factor)
        if diameter < SMALLEST * view.view_distance:
            free_part.frame_points(area, _main_region(area), free_part.points_of(context, obj))
        free_part.extend_clipping(area.spaces.active, collection.bounding_corners(obj))
        followed_views.note(area, {obj.name})


def frame_views(context: bpy.types.Context, *others: bpy.types.Object) -> None:
    """Frame the selection and further objects in all 3D views, in the part that sidebar and toolbar leave free.

    Blender's *Frame Selected* runs first, because it leaves camera views and works in every mode.

    Parameters
    ----------
    context : Blender's context
    others : further objects to show
    """
    from . import followed_views, free_part

    beside = [other for other in others if not other.select_get() and other.visible_get()]
    for other in beside:
        other.select_set(True)
    names = {obj.name for obj in context.selected_objects}
    for window, area in _view_areas(context):
        region = _main_region(area)
        with context.temp_override(window=window, area=area, region=region):
            bpy.ops.view3d.view_selected()
            free_part.frame_selection(context, area, region)
        followed_views.note(area, names)
    for other in beside:
        other.select_set(False)


def frame_objects(context: bpy.types.Context, *objects: bpy.types.Object) -> None:
    """Frame whole objects in all 3D views, whatever is selected.

    In edit mode, Blender's *Frame Selected* sees selected vertices only.

    Parameters
    ----------
    context : Blender's context
    objects : the objects to show
    """
    from . import followed_views, free_part

    if context.mode == "OBJECT":
        further = [other for other in context.selected_objects if other not in objects]
        for other in further:
            other.select_set(False)
        frame_views(context, *objects)
        for other in further:
            other.select_set(True)
        return
    points = np.concatenate(
        [np.empty((0, 3)), *(free_part.points_of(context, obj) for obj in objects if obj.visible_get())]
    )
    for _, area in _view_areas(context):
        view = area.spaces.active.region_3d
        if view.view_perspective == "CAMERA":
            view.view_perspective = "PERSP"
        free_part.frame_points(area, _main_region(area), points)
        followed_views.note(area, {obj.name for obj in objects})


def select_only(context: bpy.types.Context, obj: bpy.types.Object, layer: bpy.types.ViewLayer) -> None:
    """Make an object active and the only selected one, and frame it in the views.

    Parameters
    ----------
    context : Blender's context
    obj : the object
    layer : the view layer with the object
    """
    for other in layer.objects:
        other.select_set(other == obj, view_layer=layer)
    layer.objects.active = obj
    layer.update()
    frame_views(context)


def _view_areas(context: bpy.types.Context) -> Iterator[tuple[Any, Any]]:
    """Yield window and area of every 3D view."""
    for window in context.window_manager.windows:
        yield from ((window, area) for area in window.screen.areas if area.type == "VIEW_3D")


def _main_region(area: bpy.types.Area) -> bpy.types.Region:
    return next(region for region in area.regions if region.type == "WINDOW")


def select_places(
    context: bpy.types.Context, obj: bpy.types.Object, surface: ObjectSurface, faces: list[int], edges: list[int]
) -> None:
    """Select faces and edges of an object's mesh.

    If Blender has a window and the object is active, enter edit mode to show the selection: in face mode, or in edge
    mode if there are edges only.

    Parameters
    ----------
    context : Blender's context
    obj, surface : the object and its surface
    faces, edges : indices in the engine's order
    """
    from ..store import attributes

    if not bpy.app.background and context.view_layer.objects.active == obj:
        if obj.mode != "EDIT":
            bpy.ops.object.mode_set(mode="EDIT")
        context.tool_settings.mesh_select_mode = (False, not faces, bool(faces))
    culprits = np.asarray(edges, dtype=int)
    attributes.select(obj, np.asarray(faces, dtype=int), surface.edge_of[culprits] if len(culprits) else culprits)


def select_and_frame(context: bpy.types.Context, faces: list[int], edges: list[int]) -> None:
    """Select faces and edges of the active object, and frame them in the views.

    Parameters
    ----------
    context : Blender's context
    faces, edges : indices in the engine's order

    Raises
    ------
    FlexMapsError : the mesh has fewer faces than the indices need
    """
    from ..store import mesh

    surface = mesh.read_surface(context.object, context.scene)
    if any(face >= len(surface.polygons.sizes) for face in faces):
        raise FlexMapsError("The mesh was changed since; press Check again")
    select_places(context, context.object, surface, faces, edges)
    frame_views(context)


def in_scene(context: bpy.types.Context, uid: int) -> AbstractContextManager[Any]:
    """Return a context manager in which ``bpy.context.scene`` is the scene that a job began in.

    The user may have switched to another scene meanwhile.

    Parameters
    ----------
    context : Blender's context
    uid : Blender's session id of the scene; if it was deleted, the present scene is used
    """
    scene = next((scene for scene in context.blend_data.scenes if scene.session_uid == uid), context.scene)
    if scene == context.scene:
        return nullcontext()
    return context.temp_override(scene=scene, view_layer=scene.view_layers[0])

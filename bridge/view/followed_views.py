"""When undo or redo scales a piece, scale the 3D views with it, as FlexMaps did when it scaled the piece.

A view that the user has turned or moved since FlexMaps set it stays.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy

if TYPE_CHECKING:
    from mathutils import Vector

# smallest factor of growth or shrinking that views follow: about where a framed piece leaves the view; smaller moves
# views at every undo of a slight scaling
SLACK = 1.25

# address of a 3D view's area -> the view as FlexMaps set it, and the names of the objects that it shows
_set_by_us: dict[int, tuple[tuple[float, ...], set[str]]] = {}
_sizes: dict[str, float] = {}  # largest dimension of every visible mesh before the undo, by name
_active: list[str] = []  # name of the active object before the undo


def register() -> None:
    """Register the event handlers."""
    for handlers in (bpy.app.handlers.undo_pre, bpy.app.handlers.redo_pre):
        handlers.append(_before_undo)
    for handlers in (bpy.app.handlers.undo_post, bpy.app.handlers.redo_post):
        handlers.append(_after_undo)


def unregister() -> None:
    for handlers in (bpy.app.handlers.undo_pre, bpy.app.handlers.redo_pre):
        handlers.remove(_before_undo)
    for handlers in (bpy.app.handlers.undo_post, bpy.app.handlers.redo_post):
        handlers.remove(_after_undo)
    _set_by_us.clear()


def note(area: bpy.types.Area, names: set[str]) -> None:
    """Store an area's present view as set by FlexMaps, with the names of the objects that it shows."""
    _set_by_us[area.as_pointer()] = _state(area.spaces.active.region_3d), names


def scale_view(view: bpy.types.RegionView3D, origin: Vector, factor: float) -> None:
    """Move a view so that an object scaled about ``origin`` by ``factor`` looks as large as before."""
    view.view_location = origin + (view.view_location - origin) * factor
    view.view_distance *= factor


def _state(view: Any) -> tuple[float, ...]:
    return (*view.view_location, *view.view_rotation, view.view_distance, view.is_perspective)


def _followed_areas() -> list[tuple[bpy.types.Area, set[str]]]:
    """Return the areas whose views are as FlexMaps set them, and the names of the objects that they show."""
    result = []
    for area in (area for window in bpy.context.window_manager.windows for area in window.screen.areas):
        if area.type == "VIEW_3D" and area.as_pointer() in _set_by_us:
            state, names = _set_by_us[area.as_pointer()]
            if state == _state(area.spaces.active.region_3d):
                result.append((area, names))
    return result


@bpy.app.handlers.persistent
def _before_undo(*_: object) -> None:
    _sizes.clear()
    _active.clear()
    layer = bpy.context.view_layer
    if layer.objects.active is None or not _followed_areas():
        return
    _active.append(layer.objects.active.name)
    _sizes.update({obj.name: max(obj.dimensions) for obj in layer.objects if obj.type == "MESH" and obj.visible_get()})


@bpy.app.handlers.persistent
def _after_undo(*_: object) -> None:
    """Scale the views with the active object, or with the object that it replaces, such as a remesh's source."""
    layer = bpy.context.view_layer
    obj = layer.objects.active
    if not _sizes or obj is None or obj.type != "MESH":
        return
    layer.update()
    before = _sizes.get(obj.name)
    if before is None:
        other = layer.objects.get(_active[0])
        before = None if other is not None and other.visible_get() else _sizes.get(_active[0])
    now = max(obj.dimensions)
    if not before or not now or 1.0 / SLACK < now / before < SLACK:
        return
    for area, names in _followed_areas():
        if names & {obj.name, _active[0]}:
            scale_view(area.spaces.active.region_3d, obj.matrix_world.translation, now / before)
            note(area, names | {obj.name})

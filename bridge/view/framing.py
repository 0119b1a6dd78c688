"""What the 3D views look at, where an object becomes larger or smaller."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy


def follow(context: bpy.types.Context, obj: bpy.types.Object, factor: float) -> None:
    """Move every 3D view as an object is scaled about its origin, so that it is seen as before: a ball of 2 m that becomes one
    of 0.2 m would be a dot. Views through a camera stay."""
    origin = obj.matrix_world.translation
    for _, area in _views(context):
        region = area.spaces.active.region_3d
        if region is not None and region.view_perspective != "CAMERA":
            region.view_location = origin + (region.view_location - origin) * factor
            region.view_distance *= factor


def frame(context: bpy.types.Context, *others: bpy.types.Object) -> None:
    """Turn every 3D view to what is selected, and to some other objects, as Blender's *Frame Selected* does."""
    beside = [other for other in others if not other.select_get() and other.visible_get()]
    for other in beside:
        other.select_set(True)
    for window, area in _views(context):
        region = next(region for region in area.regions if region.type == "WINDOW")
        with context.temp_override(window=window, area=area, region=region):
            bpy.ops.view3d.view_selected()
    for other in beside:
        other.select_set(False)


def _views(context: bpy.types.Context) -> Iterator[tuple[Any, Any]]:
    """Windows and areas of all 3D views."""
    for window in context.window_manager.windows:
        yield from ((window, area) for area in window.screen.areas if area.type == "VIEW_3D")

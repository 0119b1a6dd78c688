"""Turn the pointer's path over an object into dabs of the brush (single imprints along a stroke)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy
import numpy as np
from bpy_extras import view3d_utils
from mathutils import Vector

if TYPE_CHECKING:
    from .paint_session import PaintSession

SPACING = 0.25  # distance between dabs along the path, in brush radii; smaller paints more evenly and takes longer
# fraction of the brush's strength that one dab applies; with 0.4 the four dabs of a passing brush reach 0.9 of the
# strength; larger reaches it sooner and paints less evenly; chosen by eye
FLOW = 0.4


class BrushPath:
    """The pointer's path during one stroke over a painted object."""

    def __init__(self, obj: bpy.types.Object, session: PaintSession):
        self._object: bpy.types.Object = obj
        self._session = session
        self._last: np.ndarray | None = None  # the pointer's last position, in pixels of the region
        self._place: np.ndarray | None = None  # the last dab's position, in the object's frame

    def cast_ray(self, context: bpy.types.Context, x: float, y: float) -> tuple[Any, Any] | None:
        """Cast a ray through a pixel; return where it hits the object, and the normal there, in the object's frame.

        The normal points towards the viewer. Return None if the ray misses.

        Parameters
        ----------
        context : context of a 3D view
        x, y : pixel in the region, from its lower left corner
        """
        region, view = context.region, context.region_data
        inverse = self._object.matrix_world.inverted_safe()
        start = inverse @ view3d_utils.region_2d_to_origin_3d(region, view, (x, y))
        way = inverse.to_3x3() @ view3d_utils.region_2d_to_vector_3d(region, view, (x, y))
        seen = self._object.evaluated_get(context.evaluated_depsgraph_get())
        is_hit, place, normal, _ = seen.ray_cast(start, way.normalized())
        if not is_hit:
            return None
        return place, normal if normal.dot(way) < 0.0 else -normal

    def extend(self, context: bpy.types.Context, event: bpy.types.Event) -> tuple[list[np.ndarray], np.ndarray] | None:
        """Return the dabs that a movement adds; None if it adds none.

        Parameters
        ----------
        context : context of a 3D view
        event : movement of the pointer or the pen, with its pressure

        Returns
        -------
        Each dab's weights on the quads (F,), from 0 to 1, and the displacement on the surface (3,) in world axes.
        """
        brush = context.window_manager.flexmaps_brush
        pressure = event.pressure if event.is_tablet else 1.0
        size = brush.size * (pressure if brush.pressure_size else 1.0)
        here = np.array([event.mouse_region_x, event.mouse_region_y], dtype=float)
        last = here if self._last is None else self._last
        steps = max(1, int(np.linalg.norm(here - last) / max(SPACING * size, 1.0)))
        if self._last is not None and np.linalg.norm(here - last) < SPACING * size:
            return None
        self._last = here
        weights, ways = list[np.ndarray](), list[np.ndarray]()
        for k in range(steps):
            hit = self.cast_ray(context, *(last + (here - last) * (k + 1) / steps))
            if hit is None:
                self._place = None
                continue
            weights.append(self._dab_weights(context, *hit, size))
            place = np.array(hit[0])
            if self._place is not None:
                ways.append(place - self._place)
            self._place = place
        if not weights:
            return None
        strength = FLOW * brush.strength * (pressure if brush.pressure_strength else 1.0)
        strength = 1.0 if brush.brush == "protect" else strength
        way = np.array(self._object.matrix_world.to_3x3()) @ np.sum([np.zeros(3), *ways], axis=0)
        return [strength * weight for weight in weights], way

    def _dab_weights(self, context: bpy.types.Context, place: Vector, normal: Vector, size: float) -> np.ndarray:
        """Return a dab's weights on the quads, including its mirror image in x if the brush mirrors.

        ``place`` and ``normal`` are in the object's frame, ``size`` is the radius in pixels.
        """
        frame, scale = self._object.matrix_world, context.scene.unit_settings.scale_length
        region, view = context.region, context.region_data
        centre = view3d_utils.location_3d_to_region_2d(region, view, frame @ place)
        beside = view3d_utils.region_2d_to_location_3d(region, view, centre + Vector((size, 0.0)), frame @ place)
        radius = (beside - frame @ place).length * scale
        turned = frame.to_3x3().inverted_safe().transposed()
        sides = (1.0, -1.0) if context.window_manager.flexmaps_brush.mirror else (1.0,)
        weights = []
        for side in sides:
            over = Vector((side, 1.0, 1.0))
            where = np.array(frame @ (place * over)) * scale
            weights.append(self._session.brush_surface.dab_weights(where, np.array(turned @ (normal * over)), radius))
        return np.max(weights, axis=0)

"""Plot the distance from the target over the steps of an optimisation.

The plot is an icon that the sidebar enlarges, because Blender's panels can show no other pictures.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...engine.display import plots, raster

SIZE = 192  # width and height of the icon, pixels; larger is sharper and slower

_cache: dict[str, Any] = {}  # "previews": Blender's preview collection; "icon": its icon; "values": plotted values


def icon_number(distances: Sequence[float]) -> int:
    """Return Blender's number of the icon, redrawn to plot these values; 0 without a window, as there are no icons."""
    import bpy.utils.previews

    if not _cache:
        _cache["previews"] = bpy.utils.previews.new()
        _cache["icon"] = _cache["previews"].new("history")
        _cache["icon"].image_size = (SIZE, SIZE)
    if tuple(distances) != _cache.get("values"):
        _cache["values"] = tuple(distances)
        pixels = np.round(255 * draw_pixels(distances)).astype(np.uint8)
        _cache["icon"].image_pixels.foreach_set(pixels.view(np.int32).ravel())
    return int(_cache["icon"].icon_id)


def unregister() -> None:
    if _cache:
        import bpy.utils.previews

        bpy.utils.previews.remove(_cache["previews"])
        _cache.clear()


def draw_pixels(distances: Sequence[float]) -> np.ndarray:
    """Draw the plot; return sRGB with premultiplied alpha (SIZE, SIZE, 4), bottom row first, as icons need it."""
    drawn = plots.draw_sparkline(distances, SIZE / raster.PIXEL_SCALE)
    return np.ascontiguousarray(raster.render_drawing(drawn, {}, paper=None)[::-1])

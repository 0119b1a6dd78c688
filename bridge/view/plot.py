"""The distance from the target step by step, as an icon that the sidebar enlarges: panels can show no other pictures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...engine.display import plots, raster

SIZE = 192  # pixels of the icon

_kept: dict[str, Any] = {}  # Blender's preview collection, its icon, and the values that the icon shows


def icon(distances: Sequence[float]) -> int:
    """Return the number of an icon that plots these values, first to last; 0 without a window, where there are no icons."""
    import bpy.utils.previews

    if not _kept:
        _kept["previews"] = bpy.utils.previews.new()
        _kept["icon"] = _kept["previews"].new("history")
        _kept["icon"].image_size = (SIZE, SIZE)
    if tuple(distances) != _kept.get("values"):
        _kept["values"] = tuple(distances)
        pixels = np.round(255 * picture(distances)).astype(np.uint8)
        _kept["icon"].image_pixels.foreach_set(pixels.view(np.int32).ravel())
    return int(_kept["icon"].icon_id)


def unregister() -> None:
    if _kept:
        import bpy.utils.previews

        bpy.utils.previews.remove(_kept["previews"])
        _kept.clear()


def picture(distances: Sequence[float]) -> np.ndarray:
    """Return (SIZE, SIZE, 4) premultiplied sRGB with alpha, bottom row first, as Blender's icons need it."""
    drawn = plots.sparkline(distances, SIZE / raster.SCALE)
    return np.ascontiguousarray(raster.pixels(drawn, {}, paper=None)[::-1])

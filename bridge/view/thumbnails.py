"""Small pictures of the proposed layouts, stored as an image and shown as enlarged icons in the sidebar."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import bpy
import numpy as np

from ...engine.arrays import Float
from ...engine.display import plots, raster
from . import images

if TYPE_CHECKING:
    from ...engine.patches.flattening.flatten import FlatPatches

SIZE = 128  # width and height of an icon, pixels; larger is sharper and takes more room in the file
PREVIEWS = ""  # key of Blender's preview collection in ``_cache``; all other keys are names of images

_cache: dict[str, Any] = {}  # Blender's preview collection under PREVIEWS, and lists of icon numbers by image name


def draw_thumbnails(layouts: Sequence[FlatPatches]) -> Float[np.ndarray, "rows columns 4"]:
    """Draw layouts side by side, each in a square of ``SIZE`` pixels; return sRGB with alpha, top row first."""
    drawn = []
    for flat in layouts:
        layout, mesh = flat.layout, flat.layout.mesh
        small = plots.draw_thumbnail(
            mesh.vertices, mesh.quads, layout.outline_sides, layout.patch_of, SIZE / raster.PIXEL_SCALE
        )
        drawn.append(raster.render_drawing(small, {}, paper=None))
    return np.concatenate(drawn, axis=1)


def store_thumbnails(obj: bpy.types.Object, strip: Float[np.ndarray, "rows columns 4"]) -> None:
    """Store the pictures in the .blend file as an image named after the object's mesh.

    Parameters
    ----------
    obj : the mesh object
    strip : pictures of all layouts side by side, from ``draw_thumbnails``
    """
    kept = images.store_image(_image_name(obj), strip.astype(np.float32))
    kept.use_fake_user = True  # Blender drops data without users when it saves
    _cache.pop(_image_name(obj), None)


def _image_name(obj: bpy.types.Object) -> str:
    return f"{obj.data.name} layouts"


def icon_numbers(obj: bpy.types.Object, count: int) -> list[int]:
    """Return Blender's icon numbers for the layouts; 0 for a layout without a picture, and in background mode.

    Parameters
    ----------
    obj : the mesh object
    count : number of layouts
    """
    name = _image_name(obj)
    if name not in _cache:
        _cache[name] = _make_icons(name, count)
    numbers = _cache[name]
    return [*numbers, *[0] * count][:count]


def _make_icons(name: str, count: int) -> list[int]:
    image = bpy.data.images.get(name)
    if image is None or bpy.app.background or tuple(image.size) != (SIZE * count, SIZE):
        return []
    from bpy.utils import previews

    kept = _cache.get(PREVIEWS)
    if kept is None:
        kept = _cache[PREVIEWS] = previews.new()
    strip = np.empty((SIZE, SIZE * count, 4), np.float32)
    image.pixels.foreach_get(strip.ravel())
    numbers = []
    for k in range(count):
        key = f"{name} {k}"
        if key in kept:
            del kept[key]
        icon = kept.new(key)
        icon.image_size = (SIZE, SIZE)
        square = np.ascontiguousarray(np.round(255 * strip[:, k * SIZE : (k + 1) * SIZE]).astype(np.uint8))
        icon.image_pixels.foreach_set(square.view(np.int32).ravel())
        numbers.append(int(icon.icon_id))
    return numbers


def unregister() -> None:
    from bpy.utils import previews

    kept = _cache.pop(PREVIEWS, None)
    _cache.clear()
    if kept is not None:
        previews.remove(kept)

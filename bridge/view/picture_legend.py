"""Legend of the colours in a rendered picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
import numpy as np

from ...engine import colours
from . import materials, meshes
from .legend import Legend

if TYPE_CHECKING:
    from .studio import Studio


def add_legend(studio: Studio, legend: Legend) -> None:
    """Add a legend in the picture's upper left corner: objects in front of the camera that emit their colours."""
    scene = studio.scene
    camera = scene.camera
    near = 2.0 * camera.data.clip_start
    percent = near * camera.data.sensor_width / camera.data.lens / 100  # 1 % of the picture's width, metres at ``near``
    left, top = -47.0, 50.0 * scene.render.resolution_y / scene.render.resolution_x - 4.0
    if camera.data.type == "PERSP":  # move the content out of the legend's corner
        studio.clear_corner(0.01 * (left + 21.5), 0.01 * (top - 6.5))
        left += 100.0 * camera.data.shift_x

    def add_item(data: bpy.types.ID, x: float, y: float) -> None:
        item = bpy.data.objects.new("FlexMaps legend", data)
        item.parent, item.location, item.scale = camera, (x * percent, y * percent, -near), (percent,) * 3
        item.visible_shadow = item.visible_diffuse = item.visible_glossy = False
        studio.add_temporary(item, data)

    for text, x, y, align in (
        (legend.title, left, top, "LEFT"),
        (legend.low, left, top - 4.6, "LEFT"),
        (legend.high, left + 20.0, top - 4.6, "RIGHT"),
    ):
        letters = bpy.data.curves.new("FlexMaps legend", "FONT")
        letters.body, letters.size, letters.align_x = text, 1.9, align
        letters.materials.append(materials.emissive_material("FlexMaps ink", colours.srgb_to_linear(colours.SEAM)))
        add_item(letters, x, y)
    if legend.scale is not None:
        steps = np.linspace(0.0, 1.0, 41)
        low, high = np.c_[20.0 * steps, 0 * steps, 0 * steps], np.c_[20.0 * steps, 0 * steps + 1.6, 0 * steps]
        index = np.arange(40)
        bar = meshes.make_quad_mesh(
            "FlexMaps legend",
            np.concatenate([low, high]),
            np.stack([index, index + 1, index + 42, index + 41], axis=1),
        )
        meshes.set_corner_colours(
            bar, np.repeat(colours.map_to_scale(steps[:-1] + 0.0125, 0.0, 1.0, legend.scale), 4, axis=0)
        )
        bar.materials.append(materials.emissive_material("FlexMaps scale", None))
        add_item(bar, left, top - 2.4)

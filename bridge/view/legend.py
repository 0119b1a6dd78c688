"""Legend of the model's colours, drawn over the 3D view."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from ...engine import colours
from ...engine.arrays import Float

ROW_HEIGHT = 18  # height of a legend entry, pixels at an interface scale of 1


@dataclass(frozen=True)
class Legend:
    """Content of a legend: a title, and below it a colour bar or a list of colours.

    low, high : labels at the ends of the bar
    scale : sRGB colours of the bar from left to right; None without a bar
    entries : the list: sRGB colours with their labels, from top to bottom
    """

    title: str
    low: str = ""
    high: str = ""
    scale: Float[np.ndarray, "colours 3"] | None = None
    entries: tuple[tuple[tuple[float, ...], str], ...] = ()


def draw(legend: Legend) -> None:
    """Draw a legend at the lower left of the 3D view, on a dark rectangle so that it can be read in any view."""
    import blf

    unit = bpy.context.preferences.system.ui_scale
    x, y, width = 90 * unit, 30 * unit + _covered_pixels(bpy.context), 180 * unit
    blf.size(0, 12 * unit)
    blf.color(0, 1.0, 1.0, 1.0, 1.0)
    below = 34 * unit if legend.scale is not None else ROW_HEIGHT * unit * len(legend.entries)
    broad = blf.dimensions(0, legend.title)[0]
    if legend.scale is not None:
        broad = max(broad, width)
    for _, text in legend.entries:
        broad = max(broad, 20 * unit + blf.dimensions(0, text)[0])
    _draw_rectangle(x - 10 * unit, y - 10 * unit, broad + 20 * unit, below + 32 * unit, (0.1, 0.1, 0.1), 0.5)
    _draw_text(x, y + below, legend.title)
    for k, (rgb, text) in enumerate(reversed(legend.entries)):
        _draw_rectangle(x, y + ROW_HEIGHT * k * unit, 12 * unit, 12 * unit, rgb)
        _draw_text(x + 20 * unit, y + (ROW_HEIGHT * k + 1) * unit, text)
    if legend.scale is not None:
        _draw_bar(x, y + 14 * unit, width, 12 * unit, legend.scale)
        _draw_text(x, y, legend.low)
        _draw_text(x + width - blf.dimensions(0, legend.high)[0], y, legend.high)


def _covered_pixels(context: bpy.types.Context) -> int:
    """Return how many pixels at the bottom of the view Blender's panel *Adjust Last Operation* covers."""
    region = context.region
    tops = [r.y + r.height - region.y for r in context.area.regions if r.type == "HUD" and r.height > 1]
    return max(tops, default=0)


def _draw_bar(x: float, y: float, width: float, height: float, scale: Float[np.ndarray, "colours 3"]) -> None:
    """Draw a colour bar; ``scale`` are its sRGB colours from left to right."""
    import gpu
    from gpu_extras.batch import batch_for_shader

    steps = np.linspace(0.0, 1.0, 25)
    rgb = colours.interpolate_scale(steps, scale)
    points = np.zeros((2 * len(steps), 3), np.float32)
    points[:, 0], points[:, 1] = np.repeat(x + width * steps, 2), np.tile([y, y + height], len(steps))
    rgba = np.repeat(np.c_[rgb, np.ones(len(rgb))], 2, axis=0).astype(np.float32)
    shader = gpu.shader.from_builtin("SMOOTH_COLOR")
    batch_for_shader(shader, "TRI_STRIP", {"pos": points, "color": rgba}).draw(shader)


def _draw_rectangle(
    x: float, y: float, width: float, height: float, rgb: tuple[float, ...], alpha: float = 1.0
) -> None:
    import gpu
    from gpu_extras.batch import batch_for_shader

    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    corners = [(x, y, 0), (x + width, y, 0), (x, y + height, 0), (x + width, y + height, 0)]
    batch = batch_for_shader(shader, "TRI_STRIP", {"pos": corners})
    shader.bind()
    shader.uniform_float("color", (*rgb, alpha))
    gpu.state.blend_set("ALPHA")
    batch.draw(shader)
    gpu.state.blend_set("NONE")


def _draw_text(x: float, y: float, text: str) -> None:
    import blf

    blf.enable(0, blf.SHADOW)
    blf.shadow(0, 3, 0.0, 0.0, 0.0, 0.9)
    blf.position(0, x, y, 0)
    blf.draw(0, text)
    blf.disable(0, blf.SHADOW)

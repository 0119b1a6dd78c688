"""A small plot of how the match improves step by step, as an icon that the sidebar can show large.

Drawn into the pixels of a preview: Blender's panels know no other pictures.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

SIZE = 192  # pixels
MARGIN = 10
CURVE, GRID = np.array([0.98, 0.72, 0.25]), np.array([0.62, 0.62, 0.62])  # sRGB, readable on dark and light themes
DECADE = 8.0  # from this ratio of largest to smallest on, the scale is logarithmic

_kept: dict[str, Any] = {}  # Blender's previews, and which values the one of ours shows


def icon(rmse: Sequence[float]) -> int:
    """The number of an icon that shows these values, first to last; 0 without a window, where there are no icons."""
    import bpy.utils.previews

    if not _kept:
        _kept["previews"] = bpy.utils.previews.new()
        _kept["icon"] = _kept["previews"].new("history")
        _kept["icon"].image_size = (SIZE, SIZE)
    if tuple(rmse) != _kept.get("values"):
        _kept["values"] = tuple(rmse)
        shown = picture(rmse)
        shown[..., :3] *= shown[..., 3:]  # as Blender's icons want it
        pixels = np.round(255 * shown).astype(np.uint8)
        _kept["icon"].image_pixels.foreach_set(pixels.view(np.int32).ravel())
    return int(_kept["icon"].icon_id)


def unregister() -> None:
    if _kept:
        import bpy.utils.previews

        bpy.utils.previews.remove(_kept["previews"])
        _kept.clear()


def picture(rmse: Sequence[float]) -> np.ndarray:
    """(SIZE, SIZE, 4) sRGB with alpha, lowest row first: the values from left to right, the largest at the top.

    The scale starts at zero, or is logarithmic where the values span much.
    """
    rgba = np.zeros((SIZE, SIZE, 4))
    _stroke(rgba, _frame(), GRID, 1.0, 0.9)
    values = np.asarray(rmse, dtype=float)
    values = values[np.isfinite(values) & (values > 0.0)]
    if not len(values):
        return rgba
    height = _heights(values)
    x = MARGIN + (SIZE - 2 * MARGIN) * np.linspace(0.0, 1.0, len(values)) if len(values) > 1 else np.array([MARGIN])
    points = np.stack([x, MARGIN + (SIZE - 2 * MARGIN) * height], axis=1)
    _fill(rgba, points)
    _stroke(rgba, points, CURVE, 3.0, 1.0)
    _stroke(rgba, points[-1:], CURVE, 9.0, 1.0)
    return rgba


def _heights(values: np.ndarray) -> np.ndarray:
    """(n,) in [0, 1]."""
    low, high = values.min(), values.max()
    if high > DECADE * low:
        return 0.06 + 0.9 * np.log(values / low) / np.log(high / low)
    return 0.96 * values / high


def _frame() -> np.ndarray:
    low, high = MARGIN - 3.0, SIZE - MARGIN + 3.0
    return np.array([[low, high], [low, low], [high, low]])


def _fill(rgba: np.ndarray, points: np.ndarray) -> None:
    """A veil below the curve."""
    columns = np.arange(SIZE)
    inside = (columns >= points[0, 0]) & (columns <= points[-1, 0])
    top = np.interp(columns, points[:, 0], points[:, 1])
    veil = inside & (np.arange(SIZE)[:, None] < top) & (np.arange(SIZE)[:, None] >= MARGIN)
    _blend(rgba, CURVE, 0.18 * veil)


def _stroke(rgba: np.ndarray, points: np.ndarray, rgb: np.ndarray, width: float, alpha: float) -> None:
    """A line through points (n, 2), pixels, with soft edges; of a single point a dot."""
    y, x = np.mgrid[:SIZE, :SIZE] + 0.5
    nearest = np.full((SIZE, SIZE), np.inf)
    for a, b in pairwise(points) if len(points) > 1 else [(points[0], points[0])]:
        # only the columns that the piece can reach
        left, right = int(max(a[0] - width, 0)), int(min(b[0] + width, SIZE) + 1)
        left, right = min(left, int(max(b[0] - width, 0))), max(right, int(min(a[0] + width, SIZE) + 1))
        here = np.s_[:, left:right]
        d = b - a
        t = np.clip(((x[here] - a[0]) * d[0] + (y[here] - a[1]) * d[1]) / max(float(d @ d), 1e-12), 0.0, 1.0)
        apart = np.hypot(x[here] - a[0] - t * d[0], y[here] - a[1] - t * d[1])
        nearest[here] = np.minimum(nearest[here], apart)
    _blend(rgba, rgb, alpha * np.clip(0.5 * width + 0.5 - nearest, 0.0, 1.0))


def _blend(rgba: np.ndarray, rgb: np.ndarray, alpha: np.ndarray) -> None:
    """Put a colour over what is there, with an opacity (SIZE, SIZE)."""
    before = rgba[..., 3]
    after = alpha + before * (1.0 - alpha)
    mixed = alpha[..., None] * rgb + (before * (1.0 - alpha))[..., None] * rgba[..., :3]
    rgba[..., :3] = mixed / np.maximum(after, 1e-9)[..., None]
    rgba[..., 3] = after

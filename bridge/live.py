"""The shape that a running simulation has reached, drawn over the 3D view: nothing of the file is touched for it.

It is drawn on top of everything, so that the target, which it almost coincides with, does not hide it.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from . import job

FILL, LINE = np.array([0.97, 0.80, 0.46]), np.array([0.10, 0.11, 0.14])  # sRGB
_LIGHT = np.array([0.27, -0.45, 0.85])


def draw() -> None:
    """Draw handler, after the view's own drawing."""
    running = job.current()
    shape = None if running is None else running.shown
    if not isinstance(shape, Moving):
        return
    import gpu
    from gpu_extras.batch import batch_for_shader

    points, rgba, ends = shape.drawn(bpy.context.scene.unit_settings.scale_length)
    gpu.state.active_framebuffer_get().clear(depth=1.0)
    gpu.state.depth_test_set("LESS_EQUAL")
    gpu.state.depth_mask_set(True)
    gpu.state.blend_set("ALPHA")
    flat = gpu.shader.from_builtin("FLAT_COLOR")
    batch_for_shader(flat, "TRIS", {"pos": points, "color": rgba}).draw(flat)
    pen = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
    pen.bind()
    pen.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
    pen.uniform_float("lineWidth", 1.0)
    pen.uniform_float("color", (*map(float, LINE), 0.6))
    batch_for_shader(pen, "LINES", {"pos": ends}).draw(pen)
    gpu.state.depth_mask_set(False)
    gpu.state.depth_test_set("NONE")
    gpu.state.blend_set("NONE")


class Moving:
    """A shape on its way: vertices (V, 3) metres in world axes, quads (F, 4)."""

    def __init__(self, vertices: np.ndarray, quads: np.ndarray):
        self._vertices, self._quads = vertices, quads

    def drawn(self, unit: float) -> tuple[Any, Any, Any]:
        """Triangles (6 F, 3) in the scene's units, their colours (6 F, 4), and the ends of lines (8 F, 3)."""
        corners = self._vertices[self._quads] / unit
        normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
        edge = np.median(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1))
        rgb = FILL * (0.74 + 0.26 * normal @ _LIGHT)[:, None]
        rgba = np.repeat(np.c_[rgb, np.ones(len(rgb))], 6, axis=0).astype(np.float32)
        lifted = corners + 0.01 * edge * normal[:, None]
        ends = np.stack([lifted, np.roll(lifted, -1, axis=1)], axis=2).reshape(-1, 3)
        return corners[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3).astype(np.float32), rgba, ends.astype(np.float32)

"""Draw the shape of a running simulation over the 3D view, without changing the file.

It is drawn on top of everything, so that the target, with which it almost coincides, does not hide it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy
import numpy as np

from ...engine import colours
from ...engine.arrays import Float, Int
from .legend import Legend

if TYPE_CHECKING:
    from ...engine.params import ObjectSettings
    from ...engine.progress import Progress
    from ...engine.runs.result import Result

FILL, LINE = np.array([0.97, 0.80, 0.46]), np.array([0.10, 0.11, 0.14])  # sRGB of faces and lines; chosen by eye
# height of lines and arms above the faces, in median edge lengths; smaller flickers, larger seems to float;
# not measured
LIFT = 0.01


class LiveShape:
    """Picture of a quad mesh that moves; subclasses give it colours, arms and a legend.

    Parameters
    ----------
    vertices : metres, world axes
    quads : vertex indices
    """

    legend: Legend | None = None  # legend of the colours

    def __init__(self, vertices: Float[np.ndarray, "vertices 3"], quads: Int[np.ndarray, "quads 4"]):
        self._vertices, self._quads = vertices, quads
        self._arrays: tuple[Any, ...] | None = None
        self._batches: tuple[Any, Any, Any] | None = None

    def draw(self) -> None:
        """Draw the shape; call it in a draw handler of the 3D view, of type "POST_VIEW"."""
        import gpu

        faces, bands, lines = self.batches(bpy.context.scene.unit_settings.scale_length)
        gpu.state.active_framebuffer_get().clear(depth=1.0)
        gpu.state.depth_test_set("LESS_EQUAL")
        gpu.state.depth_mask_set(True)
        gpu.state.blend_set("ALPHA")
        faces.draw(gpu.shader.from_builtin("FLAT_COLOR"))
        if bands is not None:
            ink = gpu.shader.from_builtin("UNIFORM_COLOR")
            ink.bind()
            ink.uniform_float("color", (*map(float, LINE), 1.0))
            bands.draw(ink)
        pen = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
        pen.bind()
        pen.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
        pen.uniform_float("lineWidth", 1.0)
        pen.uniform_float("color", (*map(float, LINE), 0.6 if bands is None else 0.2))
        lines.draw(pen)
        gpu.state.depth_mask_set(False)
        gpu.state.depth_test_set("NONE")
        gpu.state.blend_set("NONE")

    @property
    def colours(self) -> Float[np.ndarray, "*quads 3"]:
        """Return the quads' sRGB colours before shading: (F, 3), or (3,) for a common colour."""
        return FILL

    def bands(self, unit: float) -> tuple[Any, Any] | None:
        """Return the dark bands on the quads, which show the arms; None if there are none.

        Parameters
        ----------
        unit : metres in one unit of the scene

        Returns
        -------
        Points (N, 3) in the scene's units, and triangles (T, 3).
        """
        return None

    def prepare(self, unit: float) -> LiveShape:
        """Compute the arrays for drawing and return ``self``; may run in a thread."""
        self._arrays = (*self.faces_and_lines(unit), self.bands(unit))
        return self

    @property
    def is_prepared(self) -> bool:
        """Return whether the arrays for drawing are computed."""
        return self._arrays is not None

    @property
    def prepared_bands(self) -> tuple[Any, Any] | None:
        """Return the bands computed by ``prepare``; None before, or if there are none."""
        return None if self._arrays is None else self._arrays[3]

    def batches(self, unit: float) -> tuple[Any, Any, Any]:
        """Return the GPU batches of faces, bands (or None) and lines; they are made at the first call."""
        if self._batches is None:
            import gpu
            from gpu_extras.batch import batch_for_shader

            if self._arrays is None:
                self.prepare(unit)
            assert self._arrays is not None
            points, rgba, ends, dark = self._arrays
            faces = batch_for_shader(gpu.shader.from_builtin("FLAT_COLOR"), "TRIS", {"pos": points, "color": rgba})
            lines = batch_for_shader(gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR"), "LINES", {"pos": ends})
            bands = None
            if dark is not None:
                ink = gpu.shader.from_builtin("UNIFORM_COLOR")
                bands = batch_for_shader(ink, "TRIS", {"pos": dark[0]}, indices=dark[1])
            self._batches = faces, bands, lines
        return self._batches

    def corners_and_normals(self, unit: float) -> tuple[Float[np.ndarray, "quads 4 3"], Float[np.ndarray, "quads 3"]]:
        """Return corners (F, 4, 3) in the scene's units and unit normals (F, 3) of the quads."""
        corners = self._vertices[self._quads] / unit
        normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
        return corners, normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)

    def faces_and_lines(self, unit: float) -> tuple[Any, Any, Any]:
        """Return triangle corners (12 F, 3) in the scene's units, their colours (12 F, 4), and line ends (8 F, 3).

        Each quad is drawn as four triangles around its centre, so that a warped quad shows no diagonal.
        """
        corners, normal = self.corners_and_normals(unit)
        rgb = self.colours * (0.74 + 0.26 * normal @ colours.LIGHT)[:, None]
        rgba = np.repeat(np.c_[rgb, np.ones(len(rgb))], 12, axis=0).astype(np.float32)
        lifted = corners + LIFT * median_edge(corners) * normal[:, None]
        ends = np.stack([lifted, np.roll(lifted, -1, axis=1)], axis=2).reshape(-1, 3)
        middle = np.broadcast_to(corners.mean(axis=1, keepdims=True), corners.shape)
        fan = np.stack([corners, np.roll(corners, -1, axis=1), middle], axis=2).reshape(-1, 3)
        return fan.astype(np.float32), rgba, ends.astype(np.float32)


def median_edge(corners: Float[np.ndarray, "quads 4 3"]) -> float:
    """Return the median length of the quads' first sides, as a measure of the mesh's edge length."""
    return float(np.median(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)))


def simulate_and_show(result: Result, settings: ObjectSettings, progress: Progress) -> Result:
    """Run the stage "simulate", and show the shape while it moves.

    Parameters
    ----------
    result : a result with spirals
    settings : settings of the object
    progress : called with a fraction, a text and the shapes to show
    """
    from ...engine.runs import job

    moving = progress.showing(lambda vertices: LiveShape(vertices, result.mesh.quads))
    return job.run_stages(result, settings, ("simulate",), moving)

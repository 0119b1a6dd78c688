"""Picture of a running optimisation: the equilibrium shape with its changing spirals, and the falling distance."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import bpy
import numpy as np

from ...engine import colours
from ...engine.display import bands
from .legend import Legend
from .live_shape import LIFT, LiveShape, median_edge

if TYPE_CHECKING:
    from ...engine.optimisation.optimise import OptimisationStep
    from ...engine.params import ObjectSettings, SpiralParams
    from ...engine.progress import Progress
    from ...engine.runs.result import Result


class OptimisationShape(LiveShape):
    """Picture of the shape after a step of the optimisation.

    history : (seconds since the start, RMS distance from the target in metres) of every step so far
    """

    def __init__(
        self, step: OptimisationStep, quads: np.ndarray, params: SpiralParams, history: tuple[tuple[float, float], ...]
    ):
        super().__init__(step.vertices, quads)
        self.history = history
        self._width, self._twist = step.width, step.twist
        self._wind = -step.twist if params.clockwise else step.twist
        self._highest = params.twist_max
        high = f"{np.degrees(params.twist_max):.3g}\N{DEGREE SIGN}"
        title = f"Twist of the spirals; step {step.step}, {1e3 * step.distance:.3g} mm from the target"
        self.legend = Legend(title, "0\N{DEGREE SIGN}", high, colours.mix_with_white(colours.QUANTITY_SCALE))

    @property
    def colours(self) -> np.ndarray:
        # scale to the largest twist that the settings allow, so that a colour means the same in every step
        share = np.clip(self._twist / max(self._highest, 1e-9), 0.0, 1.0)
        return colours.interpolate_scale(share, colours.mix_with_white(colours.QUANTITY_SCALE))

    def bands(self, unit: float) -> tuple[np.ndarray, np.ndarray]:
        """Return points (N, 3) in the scene's units, and triangles (T, 3), of the arms."""
        corners, normal = self.corners_and_normals(unit)
        lift = LIFT * median_edge(corners)
        points, triangles = bands.make_bands(corners, normal, self._width / unit, self._wind, lift)
        return points.astype(np.float32), triangles.astype(np.int32)


def make_optimiser(settings: ObjectSettings) -> Callable[[Result, Progress], Result]:
    """Return a function that optimises spirals and shows every step.

    Call it on the main thread; the returned function may run in another thread.
    """
    unit = bpy.context.scene.unit_settings.scale_length
    once = replace(settings, simulate=replace(settings.simulate, restarts=0))

    def search(start: Result, progress: Progress) -> Result:
        from ...engine.runs import job

        began, history = time.perf_counter(), list[tuple[float, float]]()

        def make_shape(step: OptimisationStep) -> LiveShape:
            history.append((time.perf_counter() - began, step.distance))
            return OptimisationShape(step, start.mesh.quads, settings.spiral, tuple(history)).prepare(unit)

        return job.run_stages(start, once, ("optimise",), progress.showing(make_shape))

    return search

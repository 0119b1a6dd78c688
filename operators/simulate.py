"""The shape that the assembled piece takes by itself."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy

from ..engine.progress import Progress
from .job_stage import GoOn, JobStage

if TYPE_CHECKING:
    from ..bridge.store.stored import Taken
    from ..engine.runs.result import Result


class Simulate(JobStage, bpy.types.Operator):
    """Find the shape that the assembled panels take. The mesh gets it as a shape key, to slide to from the target"""

    bl_idname = "flexmaps.simulate"
    bl_label = "Simulate"
    needs = "design"
    loaded = True

    def going_on(self, obj: bpy.types.Object, taken: Taken) -> GoOn:
        from ..bridge.view import live

        def go_on(result: Result, progress: Progress) -> Result:
            from ..engine.runs import job

            moving = progress.showing(lambda vertices: live.Moving(vertices, result.mesh.quads))
            return job.go_on(result, taken.settings, ("simulate",), moving)

        return go_on

    def finish(self, context: bpy.types.Context, obj: bpy.types.Object, surface: Any, result: Any) -> str:
        from ..bridge.store import equilibrium

        equilibrium.write(obj, context.scene, surface, result.simulation, result.limits)
        text, warning = equilibrium.sentences(result.simulation.report())
        self.level = "WARNING" if warning else "INFO"
        return text


CLASSES = (Simulate,)

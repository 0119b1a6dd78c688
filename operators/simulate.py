"""The shape that the assembled piece takes by itself."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy

from ..bridge.store import notes
from ..engine.progress import Progress
from .continued import Continuation, ContinuedStage

if TYPE_CHECKING:
    from ..bridge.store.snapshot import Snapshot
    from ..engine.runs.result import Result


class Simulate(ContinuedStage, bpy.types.Operator):
    """Find the shape that the assembled panels take. The mesh gets it as a shape key, to slide to from the target"""

    bl_idname = "flexmaps.simulate"
    bl_label = "Simulate"
    needs = "design"
    loaded = True

    def continuation(self, obj: bpy.types.Object, snapshot: Snapshot) -> Continuation:
        from ..bridge.view import live_shape

        def go_on(result: Result, progress: Progress) -> Result:
            from ..engine.runs import job

            moving = progress.showing(lambda vertices: live_shape.LiveShape(vertices, result.mesh.quads))
            return job.go_on(result, snapshot.settings, ("simulate",), moving)

        return go_on

    def finish(self, context: bpy.types.Context, obj: bpy.types.Object, surface: Any, result: Any) -> str:
        from ..bridge.store import equilibrium
        from ..engine.runs import report

        equilibrium.write(obj, context.scene, surface, result.simulation, result.limits)
        blocks = report.blocks(result, ("equilibrium", "reach"))
        notes.write_all(obj.data, blocks)
        text, warning = equilibrium.sentences(blocks["equilibrium"])
        self.level = "WARNING" if warning else "INFO"
        return text


CLASSES = (Simulate,)

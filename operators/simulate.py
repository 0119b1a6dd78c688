"""Compute the equilibrium shape of the assembled piece."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from ..bridge.store import stored_report
from .continued_stage import Continuation, ContinuedStage

if TYPE_CHECKING:
    from ..bridge.store.snapshot import Snapshot
    from ..bridge.store.surface import ObjectSurface
    from ..engine.runs.result import Result


class Simulate(ContinuedStage["Result"], bpy.types.Operator):
    """Find the shape that the assembled panels take. The mesh gets it as a shape key, to slide to from the target"""

    bl_idname = "flexmaps.simulate"
    bl_label = "Simulate"
    overlay_kind = "DISTANCE"
    required_output = "design"
    reads_loads = True

    def continuation(self, obj: bpy.types.Object, snapshot: Snapshot) -> Continuation[Result]:
        from ..bridge.view import live_shape

        return lambda result, progress: live_shape.simulate_and_show(result, snapshot.settings, progress)

    def finish(self, context: bpy.types.Context, obj: bpy.types.Object, surface: ObjectSurface, result: Result) -> str:
        from ..bridge.store import equilibrium
        from ..engine.runs import report
        from ..engine.runs.outputs import SimulatedShape

        shape = result.need(SimulatedShape)
        equilibrium.write(obj, surface, shape.simulation, shape.limits)
        blocks = report.report_blocks(result, ("equilibrium", "reach"))
        stored_report.write_all(obj.data, blocks)
        text, warning = equilibrium.describe_result(blocks["equilibrium"])
        self.level = "WARNING" if warning else "INFO"
        return text


CLASSES = (Simulate,)

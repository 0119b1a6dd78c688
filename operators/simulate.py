"""Find the shape that the assembled piece takes by itself."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy

from ..bridge.store import notes
from .continued import Continuation, ContinuedStage

if TYPE_CHECKING:
    from ..bridge.store.snapshot import Snapshot


class Simulate(ContinuedStage, bpy.types.Operator):
    """Find the shape that the assembled panels take. The mesh gets it as a shape key, to slide to from the target"""

    bl_idname = "flexmaps.simulate"
    bl_label = "Simulate"
    shows = "DISTANCE"
    needs = "design"
    loaded = True

    def continuation(self, obj: bpy.types.Object, snapshot: Snapshot) -> Continuation:
        from ..bridge.view import live_shape

        return lambda result, progress: live_shape.settled(result, snapshot.settings, progress)

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

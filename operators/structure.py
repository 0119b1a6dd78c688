"""What the piece bears under its load cases."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import bpy

from ..bridge.store import notes
from ..bridge.store.i18n import translate
from ..engine.errors import FlexMapsError
from ..engine.progress import Progress
from .continued import Continuation, ContinuedStage

if TYPE_CHECKING:
    from ..bridge.store.snapshot import Snapshot
    from ..engine.runs.result import Result


class CheckStructure(ContinuedStage, bpy.types.Operator):
    """Follow every load case until the piece snaps, and tell how far it gives way, and what its arms and joints carry. The shape itself stays"""

    bl_idname = "flexmaps.structure"
    bl_label = "Check structure"
    needs = "simulation"
    loaded = True
    shows = "UTILISATION"

    def continuation(self, obj: bpy.types.Object, snapshot: Snapshot) -> Continuation:
        from ..bridge.store import equilibrium

        rest = equilibrium.resting(obj, bpy.context.scene, snapshot.surface)
        if rest is None:
            raise FlexMapsError("The simulated shape is no equilibrium, or out of date; press Simulate first")
        settings = snapshot.settings
        once = replace(settings, simulate=replace(settings.simulate, restarts=0))

        def go_on(result: Result, progress: Progress) -> Any:
            from ..engine.runs import job

            made = job.go_on(replace(result, rest=rest), once, ("simulate", "structure"), progress)
            assert made.structure is not None
            return made.structure

        return go_on

    def finish(self, context: bpy.types.Context, obj: bpy.types.Object, surface: Any, result: Any) -> str:
        from ..bridge.store import equilibrium

        equilibrium.write_utilisation(obj, result.utilisation)
        block = result.report()
        notes.write(obj.data, "structure", block)
        told = [finding["message"] for finding in block.get("findings", ())]
        self.level = "WARNING" if told else "INFO"
        return ". ".join(told) or translate("{} loads are borne", len(block["outcomes"]))


CLASSES = (CheckStructure,)

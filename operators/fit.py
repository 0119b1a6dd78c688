"""Make, optimise and simulate the spirals with a single button."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy

from ..bridge.store.flat_target import can_skip_simulation
from ..bridge.store.i18n import translate
from ..engine.progress import Progress
from .continued_stage import Continuation
from .optimise import SearchStage
from .spirals import Spirals

if TYPE_CHECKING:
    from ..bridge.store.snapshot import Snapshot
    from ..bridge.store.surface import ObjectSurface
    from ..engine.runs.result import Result


class Fit(SearchStage, bpy.types.Operator):
    """Give every quad its spiral, and change them until the assembled panels take the target's shape as well as they can. A flat target gets straight spirals alone"""

    bl_idname = "flexmaps.fit"
    bl_label = "Make it fit"

    _flat = False  # whether the target is flat: straight spirals, nothing to optimise
    _start = False  # whether to start from the stored spirals, which are up to date

    def continuation(self, obj: bpy.types.Object, snapshot: Snapshot) -> Continuation:
        from ..bridge.store import states

        self._flat = can_skip_simulation(obj)
        self._start = states.read_states(obj, bpy.context.scene)["spirals"].kind == states.DONE
        return Spirals.continuation(self, obj, snapshot) if self._flat else super().continuation(obj, snapshot)  # type: ignore[arg-type]

    def initial_result(self, result: Result, snapshot: Snapshot, progress: Progress) -> Result:
        from ..engine.runs import job

        if self._start:
            return super().initial_result(result, snapshot, progress)
        return job.run_stages(result, snapshot.settings, ("spirals",), progress)

    def finish(self, context: bpy.types.Context, obj: bpy.types.Object, surface: ObjectSurface, result: Any) -> str:
        if not self._flat:
            return super().finish(context, obj, surface, result)
        made = Spirals.finish(self, context, obj, surface, result)  # type: ignore[arg-type]
        return f"{translate('The target is flat: its spirals are straight')}. {made}"


CLASSES = (Fit,)

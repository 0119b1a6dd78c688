"""Base of the operators that continue from the results of earlier stages, which are stored on the object."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import bpy

from ..bridge.store import stored_report
from ..engine.params import ObjectSettings
from ..engine.progress import Progress
from .stage import Made, StageOperator, Work

if TYPE_CHECKING:
    from ..bridge.store.snapshot import Snapshot
    from ..bridge.store.surface import ObjectSurface
    from ..engine.runs.result import Result

Continuation = Callable[["Result", Progress], Made]


class ContinuedStage(StageOperator[Made]):
    """Base of operators that implement ``continuation`` instead of ``prepare``.

    required_output : output of an earlier stage that must exist, as named in ``stages.TABLE``; "" if any quad mesh will do
    reads_loads : also read supports and forces
    """

    required_output = ""
    reads_loads = False

    @classmethod
    def obstacle(cls, obj: bpy.types.Object) -> str | None:
        return stored_report.missing_result(obj.data, cls.required_output) if cls.required_output else None

    def continuation(self, obj: bpy.types.Object, snapshot: Snapshot) -> Continuation[Made]:
        """Return the work, a function that continues from the stored result.

        It runs in a thread and must not touch Blender's data: read here whatever it needs from Blender.
        """
        raise NotImplementedError

    def prepare(self, surface: ObjectSurface, settings: ObjectSettings) -> Work[Made]:
        from ..bridge.store import snapshot as snapshots
        from ..bridge.store.objects import find_by_uid

        obj, needs = find_by_uid(surface.uid), self.required_output
        # supports are needed too if there is a base, which changes the spirals of supported quads
        loaded = self.reads_loads or settings.base.base != "none"
        snapshot = snapshots.take_snapshot(obj, surface, settings, with_loads=loaded)
        go_on = self.continuation(obj, snapshot)

        def work(progress: Progress) -> Made:
            from ..engine.runs.outputs import OUTPUTS

            progress(0.0, "Reading the object")
            result = snapshot.to_result()
            if needs and needs != "simulation":  # a simulation is stored only as figures and pose, not as an output
                result.need(OUTPUTS[needs])
            return go_on(result, progress)

        return work

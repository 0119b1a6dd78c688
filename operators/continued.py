"""Base of the operators that continue from the results of earlier stages, which the object holds."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import bpy

from ..bridge.store import notes
from ..engine.params import ObjectSettings
from ..engine.progress import Progress
from .stage import StageOperator, Work

if TYPE_CHECKING:
    from ..bridge.store.snapshot import Snapshot
    from ..bridge.store.surface import Surface
    from ..engine.runs.result import Result

Continuation = Callable[["Result", Progress], Any]


class ContinuedStage(StageOperator):
    """An operator that gives ``continuation`` instead of ``prepare``.

    needs : the member of the result that has to be there, see ``stages.TABLE``; "" where any mesh of quads will do
    loaded : whether supports and forces are read too
    """

    needs = ""
    loaded = False

    @classmethod
    def obstacle(cls, obj: bpy.types.Object) -> str | None:
        return notes.missing(obj.data, cls.needs) if cls.needs else None

    def continuation(self, obj: bpy.types.Object, snapshot: Snapshot) -> Continuation:
        """The work that continues from the result, as a function that does not touch Blender's data: read here what it needs."""
        raise NotImplementedError

    def prepare(self, surface: Surface, settings: ObjectSettings) -> Work:
        from ..bridge.store import snapshot as snapshots
        from ..bridge.store.objects import find

        obj, needs = find(surface.uid), self.needs
        # feet change the spirals of what is supported
        loaded = self.loaded or settings.base.base != "none"
        snapshot = snapshots.take(obj, surface, settings, loaded=loaded)
        go_on = self.continuation(obj, snapshot)

        def work(progress: Progress) -> Any:
            from ..engine.runs import stages

            progress(0.0, "Reading the object")
            result = snapshot.result()
            if needs and needs != "simulation":  # an object holds a simulation's figures, not the simulation
                stages.needed(result, needs)
            return go_on(result, progress)

        return work

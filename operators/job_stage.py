"""What operators have in common that go on from what earlier stages have made."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import bpy

from ..bridge.store import notes
from ..engine.params import ObjectSettings
from ..engine.progress import Progress
from .stage import Stage, Work

if TYPE_CHECKING:
    from ..bridge.store.stored import Taken
    from ..bridge.store.surface import Surface
    from ..engine.runs.result import Result

GoOn = Callable[["Result", Progress], Any]

# member of the result -> the note that tells of it, and what to press where it is not there
FIRST = {
    "flat": ("layout", "Merge or flatten first"),
    "design": ("spirals", "Press Spirals first"),
    "simulation": ("equilibrium", "Press Simulate or Optimise first"),
}


class JobStage(Stage):
    """Base of such an operator: it gives ``going_on`` instead of ``prepare``.

    needs : the member of the result that has to be there, one of ``FIRST``; "" where any mesh of quads will do
    loaded : whether it concerns it what holds the piece and what pulls at it
    """

    needs = ""
    loaded = False

    @classmethod
    def obstacle(cls, obj: bpy.types.Object) -> str | None:
        note, sentence = FIRST.get(cls.needs, ("", ""))
        return None if not note or note in notes.read(obj.data) else sentence

    def going_on(self, obj: bpy.types.Object, taken: Taken) -> GoOn:
        """What goes on from the result; what it needs from Blender is read here, the returned function must not touch it."""
        raise NotImplementedError

    def prepare(self, surface: Surface, settings: ObjectSettings) -> Work:
        from ..bridge.store import stored
        from ..bridge.store.objects import find

        obj, needs = find(surface.uid), self.needs
        taken = stored.take(obj, surface, settings, loaded=self.loaded)
        go_on = self.going_on(obj, taken)

        def work(progress: Progress) -> Any:
            from ..engine.runs import stages

            progress(0.0, "Reading the object")
            result = taken.result()
            if needs and needs != "simulation":  # of a simulation the object holds the figures, not the result
                stages.needed(result, needs)
            return go_on(result, progress)

        return work

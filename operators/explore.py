"""Compare many sizes, thicknesses or materials of a piece, and apply a candidate."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from ..bridge.store.i18n import translate
from ..engine.errors import FlexMapsError
from ..engine.progress import Progress
from .continued_stage import Continuation, ContinuedStage
from .stage import AnyMeshOperator, ImmediateOperator

if TYPE_CHECKING:
    from ..bridge.store.snapshot import Snapshot
    from ..bridge.store.surface import ObjectSurface
    from ..engine.extras.exploring.explore import Exploration
    from ..engine.runs.result import Result


class Explore(ContinuedStage["Exploration"], bpy.types.Operator):
    """Try many candidates in other sizes or with other settings, on all cores, and list the best. Nothing of the object changes"""

    bl_idname = "flexmaps.explore"
    bl_label = "Explore"
    on_stop = "what was found is kept"
    required_output = "flat"
    reads_loads = True

    def continuation(self, obj: bpy.types.Object, snapshot: Snapshot) -> Continuation[Exploration]:
        def go_on(result: Result, progress: Progress) -> Exploration:
            from ..engine.extras.exploring.explore_params import ExploreParams
            from ..engine.extras.exploring.run_exploration import explore_piece
            from ..engine.extras.exploring.space import space_from_switches

            settings = snapshot.settings
            wanted = settings.section(ExploreParams)
            question = space_from_switches(wanted, settings, 1e3 * result.mesh.median_edge)
            return explore_piece({0: result}, settings, question, candidates=wanted.candidates, progress=progress)

        return go_on

    def finish(
        self, context: bpy.types.Context, obj: bpy.types.Object, surface: ObjectSurface, result: Exploration
    ) -> str:
        from ..bridge.store import exploration

        exploration.write(obj, result.report())
        held = result.best is not None and not result.space.shortfall(result.candidates[result.best].measures)
        self.level = "INFO" if held else "WARNING"
        many = "{} candidate was tried. {}" if len(result.candidates) == 1 else "{} candidates were tried. {}"
        return translate(many, len(result.candidates), result.note)


class UseCandidate(ImmediateOperator, AnyMeshOperator, bpy.types.Operator):
    """Give the object the settings and the size of this candidate; what they make out of date is to be made again"""

    bl_idname = "flexmaps.use_candidate"
    bl_label = "Use this one"

    number: bpy.props.IntProperty(min=0, options={"SKIP_SAVE"})  # type: ignore[valid-type]

    def run(self, context: bpy.types.Context) -> str:
        from ..bridge.store import exploration

        stored = exploration.read(context.object)
        if stored is None or self.number >= len(stored["rows"]):
            raise FlexMapsError("There is no such candidate; press Explore first")
        exploration.apply_candidate(context.object, context.scene, stored["rows"][self.number]["values"])
        return translate("Settings and size of the candidate were taken")


CLASSES = (Explore, UseCandidate)

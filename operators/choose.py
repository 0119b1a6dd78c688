"""Compare many layouts by their simulated shapes and keep the best; switch to another compared layout."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import bpy

from ..bridge.store import stored_report
from ..bridge.store.i18n import translate
from ..engine.progress import Progress
from .continued_stage import Continuation
from .layout import LayoutStage, with_report

if TYPE_CHECKING:
    from ..bridge.store.snapshot import Snapshot
    from ..bridge.store.surface import ObjectSurface
    from ..engine.mechanics.assembly import Pose
    from ..engine.runs.result import Result


NEAREST = 0.001  # smallest value of the setting "wanted RMS distance", percent of the size


class ChooseStage(LayoutStage):
    """Base of operators that compare layouts, apply the best and store the others."""

    on_stop = "the best so far is kept"
    required_output = "flat"
    reads_loads = True

    def continuation(self, obj: bpy.types.Object, snapshot: Snapshot) -> Continuation:
        pose = _optimised_pose(obj, snapshot)

        def go_on(result: Result, progress: Progress) -> Any:
            from ..bridge.view import thumbnails
            from ..engine.extras.choosing.choice_stage import LayoutChoice
            from ..engine.runs import job
            from ..engine.runs.outputs import DesignVersion
            from ..engine.runs.stages import OPTIMISED

            version = result.get(DesignVersion)
            if pose is not None and version is not None:
                optimised = result.with_outputs(replace(version, origin=OPTIMISED))
                result = job.simulate_from_pose(optimised, pose, snapshot.settings, progress.part(0.0, 0.01))
            made = job.run_stages(result, snapshot.settings, ("choose",), progress.part(0.01, 1.0))
            choice = made.need(LayoutChoice).choice
            strip = thumbnails.draw_thumbnails([one.flat for one in choice.proposals])
            return None if made.flat is result.flat else with_report(made), choice, strip

        return go_on

    def finish(self, context: bpy.types.Context, obj: bpy.types.Object, surface: ObjectSurface, result: Any) -> str:
        from ..bridge.store import choices as stored
        from ..bridge.store import mesh
        from ..bridge.view import thumbnails

        flat, choice, strip = result
        said = translate("The layout stays")
        if flat is not None:
            said = super().finish(context, obj, surface, flat)
            mesh.write_last_spirals(obj, surface, *choice.best.judged.spirals)
        stored.write_cuts(obj, surface, [one.flat.layout.cut for one in choice.proposals])
        thumbnails.store_thumbnails(obj, strip)
        stored_report.write(obj.data, "choose", choice.report())
        self.level = "INFO" if choice.reached else "WARNING"
        return f"{said}. {choice.note}"


def _optimised_pose(obj: bpy.types.Object, snapshot: Snapshot) -> Pose | None:
    """Return the simulated pose of optimised spirals; None unless optimisation and simulation are up to date."""
    from ..bridge.store import equilibrium, states

    scene = bpy.context.scene
    now = states.read_states(obj, scene)
    current = all(now[stage].kind == states.DONE for stage in ("optimise", "equilibrium"))
    return equilibrium.read_rest_pose(obj, scene, snapshot.surface) if current else None


class Choose(ChooseStage, bpy.types.Operator):
    """Cut the surface in many ways, see which shape the panels of each would take, and keep the best; the others stay at hand. Takes a minute or more"""

    bl_idname = "flexmaps.choose"
    bl_label = "Choose layout"


class CutThere(ChooseStage, bpy.types.Operator):
    """Cut the present layout where the shape at rest is to blame, as far as that brings the piece nearer; says how near it comes"""

    bl_idname = "flexmaps.cut_there"
    bl_label = "Cut there"

    def continuation(self, obj: bpy.types.Object, snapshot: Snapshot) -> Continuation:
        wanted = replace(snapshot.settings.choose, goal="match", match=NEAREST, near=True)
        cut = super().continuation(obj, replace(snapshot, settings=replace(snapshot.settings, choose=wanted)))

        def go_on(result: Result, progress: Progress) -> Any:
            from ..engine.runs.outputs import FinalLayout

            layout, design = result.need(FinalLayout), result.design
            if design is not None:
                result = result.with_outputs(replace(layout, start=(design.width, design.twist)))
            return cut(result, progress)

        return go_on


class TakeChoice(LayoutStage, bpy.types.Operator):
    """Take this layout instead"""

    bl_idname = "flexmaps.take_choice"
    bl_label = "Take this layout"

    number: bpy.props.IntProperty(min=0, options={"SKIP_SAVE"})  # type: ignore[valid-type]
    tip: bpy.props.StringProperty(options={"SKIP_SAVE", "HIDDEN"})  # type: ignore[valid-type]
    sure: bpy.props.BoolProperty(options={"SKIP_SAVE", "HIDDEN"})  # type: ignore[valid-type]

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        return ". ".join(filter(None, (translate(cls.__doc__ or ""), properties.tip)))

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Run, but first ask for confirmation where optimised spirals or written sheets would be discarded."""
        if self.sure or not {"optimise", "sheets"} & stored_report.read(context.object.data).keys():
            return super().invoke(context, event)
        number = self.number

        def ask(menu: bpy.types.UIPopupMenu, context: bpy.types.Context) -> None:
            menu.layout.operator_context = "INVOKE_DEFAULT"
            said = translate("Take it: spirals, shape and sheets go")
            taking = menu.layout.operator(self.bl_idname, text=said, translate=False)
            taking.number, taking.sure = number, True

        context.window_manager.popup_menu(ask, title=translate("Take this layout?"), icon="QUESTION")
        return {"CANCELLED"}

    @classmethod
    def obstacle(cls, obj: bpy.types.Object) -> str | None:
        return stored_report.missing_result(obj.data, "choice")

    def continuation(self, obj: bpy.types.Object, snapshot: Snapshot) -> Continuation:
        from ..engine.errors import FlexMapsError

        block, number = stored_report.read(obj.data)["choose"], self.number
        if number >= len(block["proposals"]):
            raise FlexMapsError(f"There is no proposal {number}; they are numbered from 0 on")

        def go_on(result: Result, progress: Progress) -> Any:
            from ..bridge.store import choices
            from ..engine.runs import manual_changes

            cut = choices.read_cuts(snapshot.surface, number)
            return with_report(manual_changes.flatten_by_hand(result, cut, snapshot.settings, progress)), block | {
                "taken": number
            }

        return go_on

    def finish(self, context: bpy.types.Context, obj: bpy.types.Object, surface: ObjectSurface, result: Any) -> str:
        flat, block = result
        said = super().finish(context, obj, surface, flat)
        stored_report.write(obj.data, "choose", block)
        return translate("Taken: {}", said)


CLASSES = (Choose, CutThere, TakeChoice)

"""The button *Next*, and operators of notices: show the place, dismiss the notice, set supports."""

from __future__ import annotations

import time
from contextlib import suppress
from typing import TYPE_CHECKING

import bpy

from ..bridge.store import derived_properties, failures, guidance, objects
from ..bridge.store.i18n import translate
from ..engine.errors import FlexMapsError
from .stage import AnyMeshOperator, ImmediateOperator, ObjectOperator, PolledOperator, error_message

if TYPE_CHECKING:
    from ..bridge.store.notice import Notice

CUTTING_OPERATORS = {"flexmaps.merge", "flexmaps.flatten"}  # operators before which *Next* checks the mesh
ASKING_OPERATORS = {
    "flexmaps.choose_folder"
}  # cures that open a dialog; they are offered again after the user cancels it
# seconds after a change of the label in which presses are ignored, so that a double click does not run two actions;
# larger feels slow
DEBOUNCE_SECONDS = 0.4


class Next(AnyMeshOperator, bpy.types.Operator):
    """Do what a person would do next; the button says what that is"""

    bl_idname = "flexmaps.next"
    bl_label = "Next"
    bl_options = {"REGISTER"}

    _label_change = ("", 0.0)  # the last label, and when it first appeared

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        if context.object is None or objects.usage_problem(context.object) is not None:
            return translate(cls.__doc__ or "")
        return guidance.read_guidance(context.object, context.scene).explanation

    @classmethod
    def note_label(cls, label: str) -> None:
        """Store when the button's label last changed; called whenever the sidebar is drawn."""
        if label != cls._label_change[0]:
            cls._label_change = label, time.monotonic()

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if time.monotonic() - self._label_change[1] < DEBOUNCE_SECONDS:
            return {"CANCELLED"}
        return self._run_action(context, "INVOKE_DEFAULT")

    def execute(self, context: bpy.types.Context) -> set[str]:
        return self._run_action(context, "EXEC_DEFAULT")

    def _run_action(self, context: bpy.types.Context, call_context: str) -> set[str]:
        present = self._check_before_cut(context, guidance.read_guidance(context.object, context.scene))
        if present.action is None:
            self.report({"ERROR"}, present.explanation)
            return {"CANCELLED"}
        if call_context == "EXEC_DEFAULT" and present.action.idname == "wm.path_open":
            self.report({"INFO"}, present.status.text)
            return {"FINISHED"}
        asks = call_context == "INVOKE_DEFAULT" and present.action.idname in ASKING_OPERATORS
        if present.action.cure is not None and not asks:
            failures.count_press(context.object.data, present.action.cure.call)
        group, name = present.action.idname.split(".")
        try:  # True asks for an undo step, which Blender omits where an operator calls another
            pressed: set[str] = getattr(getattr(bpy.ops, group), name)(call_context, True, **present.action.properties)
        except RuntimeError as error:
            self.report({"ERROR"}, error_message(error))
            return {"CANCELLED"}
        return {"FINISHED"} if "RUNNING_MODAL" in pressed else pressed

    def _check_before_cut(self, context: bpy.types.Context, before: guidance.Guidance) -> guidance.Guidance:
        """Check the mesh if the next action cuts it; return the guidance after the check, whose action may differ."""
        from ..bridge.store import states

        stage_states = states.read_states(context.object, context.scene)
        cuts = before.action is not None and before.action.idname in CUTTING_OPERATORS
        if not cuts or stage_states["checks"].kind == states.DONE or bpy.ops.flexmaps.check.poll() is False:
            return before
        with suppress(RuntimeError):  # errors of the mesh are shown as notices
            bpy.ops.flexmaps.check("EXEC_DEFAULT")
        return guidance.read_guidance(context.object, context.scene)


def _find_notice(context: bpy.types.Context, key: str) -> Notice:
    """Return the notice with a key; raise ``FlexMapsError`` where it no longer exists."""
    for notice in guidance.read_guidance(context.object, context.scene).notices:
        if notice.key == key:
            return notice
    raise FlexMapsError("The mesh was changed since; press Check again")


class ShowNotice(ImmediateOperator, ObjectOperator, bpy.types.Operator):
    """Select the place that this is about, and turn the view to it"""

    bl_idname = "flexmaps.show_notice"
    bl_label = "Show the place"

    key: bpy.props.StringProperty(options={"SKIP_SAVE"})  # type: ignore[valid-type]

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        with suppress(FlexMapsError, AttributeError):  # AttributeError where no object is active
            return _find_notice(context, properties.key).sentence
        return translate(cls.__doc__ or "")

    def run(self, context: bpy.types.Context) -> str:
        from ..bridge.view import framing

        notice = _find_notice(context, self.key)
        if notice.faces or notice.edges:
            framing.select_and_frame(context, list(notice.faces), list(notice.edges))
        return notice.sentence


class LetGo(ImmediateOperator, AnyMeshOperator, bpy.types.Operator):
    """Go on in spite of this: it becomes information, until it says something else"""

    bl_idname = "flexmaps.let_go"
    bl_label = "Go on as it is"

    key: bpy.props.StringProperty(options={"SKIP_SAVE"})  # type: ignore[valid-type]

    def run(self, context: bpy.types.Context) -> None:
        notice = _find_notice(context, self.key)
        failures.dismiss(context.object.data, notice.key, notice.sentence)


class StandOn(ImmediateOperator, ObjectOperator, bpy.types.Operator):
    """Let the piece stand on its lowest quads, hold it at its border, or let go of a vertex group that was chosen"""

    bl_idname = "flexmaps.stand_on"
    bl_label = "Hold the piece"

    where: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Where",
        items=(("lowest", "Lowest quads", ""), ("border", "Border", ""), ("nothing", "Nothing", "")),
        options={"SKIP_SAVE"},
    )
    setting: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Setting", items=(("supports", "Supports", ""), ("pulled", "Pulled", "")), options={"SKIP_SAVE"}
    )

    def run(self, context: bpy.types.Context) -> None:
        obj = context.object
        setattr(obj.flexmaps.loads, self.setting, "")
        if self.where == "lowest":
            obj.flexmaps_rests = "STANDS"
        elif self.where == "border":
            derived_properties.set_supports(obj, derived_properties.border_vertices(obj))


class SelectModel(ImmediateOperator, PolledOperator, bpy.types.Operator):
    """Select the model to which these panels, outlines or assembled spirals belong"""

    bl_idname = "flexmaps.select_model"
    bl_label = "Select the model"

    @classmethod
    def problem(cls, context: bpy.types.Context) -> str | None:
        if context.object is None or objects.drawn_model(context.object) is None:
            return "Select something that FlexMaps drew beside a model"
        return None

    def run(self, context: bpy.types.Context) -> None:
        model = objects.drawn_model(context.object)
        if model is None or model.name not in context.view_layer.objects:
            raise FlexMapsError(f"'{context.object.name}' has its model in a collection that is hidden; show it first")
        if context.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        for obj in context.selected_objects:
            obj.select_set(False)
        model.hide_set(False)
        model.select_set(True)
        context.view_layer.objects.active = model


class OwnMesh(ImmediateOperator, AnyMeshOperator, bpy.types.Operator):
    """Give the object a copy of the mesh that it shares with others; theirs stays as it is, with its results"""

    bl_idname = "flexmaps.own_mesh"
    bl_label = "Own mesh"

    def run(self, context: bpy.types.Context) -> None:
        from ..bridge.view import replacing

        replacing.leave_edit_mode(context)
        context.object.data = context.object.data.copy()


CLASSES = (Next, ShowNotice, LetGo, StandOn, SelectModel, OwnMesh)

"""*Next* itself, the places of what there is to look at, and going on as it is."""

from __future__ import annotations

import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import bpy

from ..bridge.hosts import background, preload
from ..bridge.store import failures, guidance
from ..bridge.store.i18n import translate
from ..engine.errors import FlexMapsError
from .stage import AnyMesh, OnObject, reveal

if TYPE_CHECKING:
    from ..bridge.store.notices import Notice

CUTTING = {"flexmaps.merge", "flexmaps.flatten"}  # what takes the mesh as it is
CALM = 0.4  # seconds after the label has changed in which a press does nothing: a double click never starts two steps


class Next(AnyMesh, bpy.types.Operator):
    """Do what a person would do next; the button says what that is"""

    bl_idname = "flexmaps.next"
    bl_label = "Next"
    bl_options = {"REGISTER"}

    _seen = ("", 0.0)  # the last label, and when it was first seen

    @classmethod
    def description(cls, context: bpy.types.Context, properties: Any) -> str:
        act = None if context.object is None else guidance.of(context.object, context.scene).act
        return translate(cls.__doc__ or "") if act is None else act.tooltip

    @classmethod
    def see(cls, label: str) -> None:
        """Note what stands on the button; the sidebar calls it as it draws."""
        if label != cls._seen[0]:
            cls._seen = label, time.monotonic()

    def invoke(self, context: bpy.types.Context, event: Any) -> set[str]:
        if time.monotonic() - self._seen[1] < CALM:
            return {"CANCELLED"}
        return self._press(context, "INVOKE_DEFAULT")

    def execute(self, context: bpy.types.Context) -> set[str]:
        return self._press(context, "EXEC_DEFAULT")

    def _press(self, context: bpy.types.Context, how: str) -> set[str]:
        seen = self._checked(context, guidance.of(context.object, context.scene))
        if seen.act is None:
            stopped = next((notice.sentence for notice in seen.notices), translate("There is nothing to make of it"))
            self.report({"ERROR"}, stopped)
            return {"CANCELLED"}
        if how == "EXEC_DEFAULT" and seen.act.idname == "wm.path_open":
            self.report({"INFO"}, seen.status.text)
            return {"FINISHED"}
        if seen.act.cure is not None:
            failures.note_tried(context.object.data, seen.act.cure.call)
        group, name = seen.act.idname.split(".")
        pressed: set[str] = getattr(getattr(bpy.ops, group), name)(how, **seen.act.properties)
        return {"FINISHED"} if "RUNNING_MODAL" in pressed else pressed

    def _checked(self, context: bpy.types.Context, seen: guidance.Guidance) -> guidance.Guidance:
        """The mesh checked before it is cut, which nobody should have to ask for; what it finds decides what is done."""
        from ..bridge.store import states

        known = states.of(context.object, context.scene)
        cuts = seen.act is not None and seen.act.idname in CUTTING
        if not cuts or known["checks"].kind == states.DONE or bpy.ops.flexmaps.check.poll() is False:
            return seen
        with suppress(RuntimeError):  # an error of the mesh is a notice from now on
            bpy.ops.flexmaps.check("EXEC_DEFAULT")
        return guidance.of(context.object, context.scene)


def _noticed(context: bpy.types.Context, key: str) -> Notice | None:
    return next((n for n in guidance.of(context.object, context.scene).notices if n.key == key), None)


class ShowNotice(OnObject, bpy.types.Operator):
    """Select the place that this is about, and turn the view to it"""

    bl_idname = "flexmaps.show_notice"
    bl_label = "Show the place"
    bl_options = {"REGISTER", "UNDO"}

    key: bpy.props.StringProperty(options={"SKIP_SAVE"})  # type: ignore[valid-type]

    @classmethod
    def description(cls, context: bpy.types.Context, properties: Any) -> str:
        found = None if context.object is None else _noticed(context, properties.key)
        return translate(cls.__doc__ or "") if found is None else found.sentence

    def execute(self, context: bpy.types.Context) -> set[str]:
        preload.wait()
        from ..bridge.store import mesh
        from ..bridge.view import framing

        found = _noticed(context, self.key)
        if found is None:
            return {"CANCELLED"}
        try:
            surface = mesh.read_surface(context.object, context.scene)
            if any(face >= len(surface.polygons.sizes) for face in found.faces):
                raise FlexMapsError("The mesh was changed since; press Check again")
        except FlexMapsError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if found.faces or found.edges:
            reveal(context, context.object, surface, list(found.faces), list(found.edges))
            framing.frame(context)
        self.report({"INFO"}, found.sentence)
        return {"FINISHED"}


class LetGo(OnObject, bpy.types.Operator):
    """Go on in spite of this: it becomes information, until it says something else"""

    bl_idname = "flexmaps.let_go"
    bl_label = "Go on as it is"
    bl_options = {"REGISTER", "UNDO"}

    key: bpy.props.StringProperty(options={"SKIP_SAVE"})  # type: ignore[valid-type]

    @classmethod
    def problem(cls, context: bpy.types.Context) -> str | None:
        running = background.current()
        return super().problem(context) if running is None else translate("Wait until the job has ended")

    def execute(self, context: bpy.types.Context) -> set[str]:
        found = _noticed(context, self.key)
        if found is None:
            return {"CANCELLED"}
        failures.let_go(context.object.data, found.key, found.sentence)
        return {"FINISHED"}


class StandOn(OnObject, bpy.types.Operator):
    """Let the piece stand on its lowest quads, or let go of a vertex group that was chosen"""

    bl_idname = "flexmaps.stand_on"
    bl_label = "Stand on lowest"
    bl_options = {"REGISTER", "UNDO"}

    where: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Where", items=(("lowest", "Lowest quads", ""), ("nothing", "Nothing", "")), options={"SKIP_SAVE"}
    )
    setting: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Setting", items=(("supports", "Supports", ""), ("pulled", "Pulled", "")), options={"SKIP_SAVE"}
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        obj = context.object
        setattr(obj.flexmaps.loads, self.setting, "")
        if self.where == "lowest":
            obj.flexmaps_rests = "STANDS"
        return {"FINISHED"}


CLASSES = (Next, ShowNotice, LetGo, StandOn)

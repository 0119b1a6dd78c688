"""Mend what the check calls wrong and a machine can put right: one press, one undo step."""

from __future__ import annotations

import bpy

from ..bridge.hosts import background, preload
from ..bridge.store.i18n import translate
from ..engine.errors import FlexMapsError
from .remesh import leave_edit_mode
from .stage import OnObject, redraw, still_running

KINDS = (
    ("short-edges", "Merge vertices", "Merge vertices that lie in one place"),
    ("doubles", "Merge doubled vertices", "Merge vertices of the border that lie in one place"),
    ("double-shells", "Delete doubled shells", "Delete one of two shells that lie on each other"),
    ("thin-faces", "Dissolve faces without area", "Dissolve faces that have no area"),
    ("double-faces", "Delete doubled faces", "Delete faces on the same vertices as another one"),
    ("folds", "Delete folded faces", "Delete one of two faces that lie on each other"),
    ("normals", "Turn faces", "Turn faces that look to the other side than their neighbours"),
    ("outside", "Turn bodies", "Turn closed bodies whose faces look inwards"),
    ("loose", "Delete loose parts", "Delete vertices and edges that belong to no face"),
    ("far", "Delete far faces", "Delete faces that lie nowhere near the others"),
    ("not-finite", "Delete lost faces", "Delete faces whose place is no number"),
    ("fans", "Split vertices", "Split vertices at which faces touch that share no edge"),
    ("walls", "Split edges", "Split edges of three or more faces"),
    ("one-sided", "Cut it open", "Cut a body with only one side open"),
)


class Mend(OnObject, bpy.types.Operator):
    """Put right what the check found, as far as a machine can. A mesh that other objects use too is copied first"""

    bl_idname = "flexmaps.mend"
    bl_label = "Mend"
    bl_options = {"REGISTER", "UNDO"}

    what: bpy.props.EnumProperty(name="What", items=KINDS, options={"SKIP_SAVE"})  # type: ignore[valid-type]

    @classmethod
    def problem(cls, context: bpy.types.Context) -> str | None:
        running = background.current()
        return super().problem(context) if running is None else still_running(running)

    def execute(self, context: bpy.types.Context) -> set[str]:
        preload.wait()
        from ..bridge.store import mending, states

        leave_edit_mode(context)
        try:
            message = mending.mend(context.object, context.scene, self.what)
        except FlexMapsError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        states.stamp(context.object, context.scene)
        redraw(context)
        self.report({"INFO"}, translate(message))
        return {"FINISHED"}


CLASSES = (Mend,)

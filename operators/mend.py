"""Repair faults found by the mesh check; each repair is one undo step."""

from __future__ import annotations

import bpy

from ..bridge.store import cures
from ..bridge.store.i18n import translate
from ..bridge.view import replacing
from .stage import AnyMeshOperator, ImmediateOperator


class Mend(ImmediateOperator, AnyMeshOperator, bpy.types.Operator):
    """Put right what the check found, as far as a machine can. A mesh that other objects use too is copied first"""

    bl_idname = "flexmaps.mend"
    bl_label = "Mend"

    what: bpy.props.EnumProperty(name="What", items=cures.REPAIR_KINDS, options={"SKIP_SAVE"})  # type: ignore[valid-type]

    def run(self, context: bpy.types.Context) -> str:
        from ..bridge.store import mesh_repair, states

        replacing.leave_edit_mode(context)
        message = mesh_repair.repair(context.object, context.scene, self.what)
        states.stamp(context.object, context.scene)
        return translate(message)


CLASSES = (Mend,)

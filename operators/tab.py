"""Operators of the sidebar's tab: stop the running job, and hold the piece at the selection."""

from __future__ import annotations

import bpy
import numpy as np

from ..bridge.hosts import background
from ..bridge.store import derived_properties
from ..bridge.store.columns import column
from ..bridge.store.i18n import translate
from ..engine.errors import FlexMapsError
from .stage import AnyMeshOperator, ImmediateOperator, redraw


class Stop(bpy.types.Operator):
    """Stop what is running, as Esc does"""

    bl_idname = "flexmaps.stop"
    bl_label = "Stop"
    bl_options = {"INTERNAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        running = background.current_job()
        if running is not None:
            running.stop()
        redraw(context, "UI")
        return {"FINISHED"}


class HoldSelection(ImmediateOperator, AnyMeshOperator, bpy.types.Operator):
    """Hold the piece at what is selected in Edit Mode: quads with two corners or more in it"""

    bl_idname = "flexmaps.hold_selection"
    bl_label = "Hold the selection"

    def run(self, context: bpy.types.Context) -> str:
        obj = context.object
        obj.update_from_editmode()
        chosen = column(obj.data.vertices, "select")
        if not chosen.any():
            raise FlexMapsError(translate("Select in Edit Mode where the piece is held"))
        derived_properties.set_supports(obj, np.flatnonzero(chosen).tolist())
        count = int(chosen.sum())
        return translate("Held at {} vertex" if count == 1 else "Held at {} vertices", count)


CLASSES = (Stop, HoldSelection)

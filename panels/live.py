"""The switch of live mode and what it has to say, in the Simulate panel."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_iface as iface_

from ..bridge.hosts import live
from ..bridge.store import handles
from .rows import wrapped

FINAL = "Live: press Simulate for the final shape and its figures"


def live_rows(layout: Any, row: Any, context: bpy.types.Context) -> None:
    """The switch, in a row, and below it how things stand."""
    following = live.current()
    own = following is not None and following.uid == context.object.session_uid
    row.operator("flexmaps.live", text="Live", icon="PLAY" if not own else "PAUSE", depress=own)
    if following is None or not own:
        return
    shape = following.shape
    if following.problem:
        wrapped(layout.box(), context, following.problem, icon="ERROR")
        if shape is not None and shape.vertices is not None:
            wrapped(layout, context, "What is shown is the last shape that was found")
    elif shape is None or not following.resting:
        wrapped(layout, context, "Live: on its way", icon="SORTTIME")
    elif shape.snapped:
        text = iface_("The piece snapped: spirals jumped by up to {:.0f} mm. Undo brings it back").format(shape.snapped)
        wrapped(layout.box(), context, text, icon="ERROR")
    elif not following.final:
        wrapped(layout, context, FINAL, icon="INFO")


def handle_rows(layout: Any, obj: bpy.types.Object) -> None:
    """The tool for handles, and what takes them away."""
    row = layout.row(align=True)
    row.operator("flexmaps.use_handles", text="Handles", icon="GIZMO")
    if any(name in obj.data.attributes for name in handles.PREFIXED.values()):
        row.operator("flexmaps.clear_handles", text="", icon="X")

"""What the sub-panels share: where they stand, when they are shown, how far their stage is, and which button comes next."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import bpy

from ..bridge.hosts import background
from ..bridge.store import next_button, notes, states
from ..bridge.store.objects import unusable
from .rows import wrapped

ICONS = {states.TODO: "RADIOBUT_OFF", states.DONE: "CHECKMARK", states.OLD: "FILE_REFRESH"}
FAILED = "CANCEL"  # the sign of a stage that is done and found what stops the next ones
EMPHASIS = 1.4  # height of the button on top of the tab, in rows; by eye
ONE_REDRAW = 0.2  # seconds in which sub-panels use the states that the main panel has computed; not measured


@dataclass(frozen=True)
class Seen:
    """What one redraw of the sidebar knows of the object."""

    uid: int
    seconds: float
    states: dict[str, states.State]
    next_button: str


_seen: list[Seen] = []


def look(context: bpy.types.Context, afresh: bool = False) -> Seen:
    """The states of the active object; the main panel, which is drawn first, asks for new ones (``afresh``)."""
    obj, now = context.object, time.monotonic()
    if afresh or not _seen or _seen[0].uid != obj.session_uid or now - _seen[0].seconds > ONE_REDRAW:
        found = states.of(obj, context.scene)
        following = "" if background.current() is not None else next_button.of(obj, context.scene, found)
        _seen[:] = [Seen(obj.session_uid, now, found, following)]
    return _seen[0]


class Sidebar:
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "FlexMaps"


class StagePanel(Sidebar):
    """A sub-panel; ``stage`` is its name in ``bridge/store/states.py``, "" where it has no state."""

    bl_parent_id = "FLEXMAPS_PT_main"
    stage = ""
    layout: Any

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return unusable(context.object) is None

    def draw_header(self, context: bpy.types.Context) -> None:
        if self.stage:
            self.layout.label(text="", icon=sign(context, self.stage))


def sign(context: bpy.types.Context, stage: str) -> str:
    """The icon that tells how far a stage is; a check that is done and found errors has no tick."""
    kind = look(context).states[stage].kind
    found = notes.read(context.object.data).get("checks") or () if stage == "checks" else ()
    wrong = any(finding["severity"] == "error" for finding in found)
    return FAILED if kind == states.DONE and wrong else ICONS[kind]


def button(layout: Any, context: bpy.types.Context, idname: str, **options: Any) -> Any:
    """An operator's button; the one that comes next stands out."""
    row = layout.row(align=True)
    if look(context).next_button == idname:
        row.active_default = True
    return row.operator(idname, **options)


def result(layout: Any, context: bpy.types.Context, stage: str) -> Any:
    """Where the figures of a stage go: greyed, with the reason above, where the stage is out of date."""
    state = look(context).states[stage]
    if state.kind == states.OLD:
        wrapped(layout, context, state.reason, icon=ICONS[states.OLD])
    column = layout.column()
    column.active = state.kind != states.OLD
    return column

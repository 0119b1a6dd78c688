"""What one redraw of the tab knows of the object: how far its stages are, what comes next, and what there is to look at."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import bpy

from ..bridge.store import guidance, notes, states
from ..bridge.store.guidance import Guidance

ICONS = {states.TODO: "BLANK1", states.DONE: "CHECKMARK", states.OLD: "FILE_REFRESH"}
ONE_REDRAW = 0.2  # seconds in which popovers use the states that the tab has computed; not measured


@dataclass(frozen=True)
class Seen:
    """What is known of the object with this id of Blender's."""

    uid: int
    seconds: float
    states: dict[str, states.State]
    blocks: dict[str, Any]
    guidance: Guidance


_seen: list[Seen] = []


def look(context: bpy.types.Context, afresh: bool = False) -> Seen:
    """The states of the active object; the tab, which is drawn first, asks for new ones (``afresh``)."""
    obj, now = context.object, time.monotonic()
    if afresh or not _seen or _seen[0].uid != obj.session_uid or now - _seen[0].seconds > ONE_REDRAW:
        found = states.of(obj, context.scene)
        said = guidance.of(obj, context.scene, found)
        _seen[:] = [Seen(obj.session_uid, now, found, notes.read(obj.data), said)]
    return _seen[0]


def block_of(layout: Any, context: bpy.types.Context, stage: str) -> tuple[Any, dict[str, Any]] | None:
    """Where the figures of a stage go, which are grey where they are out of date, and its block; None where it has none."""
    seen = look(context)
    if stage not in seen.blocks:
        return None
    column = layout.column()
    column.active = seen.states[stage].kind != states.OLD
    return column, seen.blocks[stage]

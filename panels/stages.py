"""The object's states, results and guidance, computed once for each redraw of the tab."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import bpy

from ..bridge.store import guidance, notes, states
from ..bridge.store.guidance import Guidance

ICONS = {states.TODO: "BLANK1", states.DONE: "CHECKMARK", states.OLD: "FILE_REFRESH"}
ONE_REDRAW = 0.2  # seconds in which popovers reuse the states that the tab computed: longer than a redraw, shorter than a person waits; not measured


@dataclass(frozen=True)
class Seen:
    """States, blocks and guidance of the object with this id of Blender's."""

    uid: int
    seconds: float
    states: dict[str, states.StageState]
    blocks: dict[str, Any]
    guidance: Guidance


_seen: list[Seen] = []


def look(context: bpy.types.Context, afresh: bool = False) -> Seen:
    """Return the states of the active object; ``afresh``, which the tab sets as it is drawn first, recomputes them."""
    obj, now = context.object, time.monotonic()
    if afresh or not _seen or _seen[0].uid != obj.session_uid or now - _seen[0].seconds > ONE_REDRAW:
        current = states.read_states(obj, context.scene)
        advice = guidance.read_guidance(obj, context.scene, current)
        _seen[:] = [Seen(obj.session_uid, now, current, notes.read(obj.data), advice)]
    return _seen[0]


def block_of(layout: Any, context: bpy.types.Context, stage: str) -> tuple[Any, dict[str, Any]] | None:
    """Return a layout for a stage's figures, grey if they are out of date, and the stage's block; None without a result."""
    seen = look(context)
    if stage not in seen.blocks:
        return None
    column = layout.column()
    column.active = seen.states[stage].kind != states.OLD
    return column, seen.blocks[stage]

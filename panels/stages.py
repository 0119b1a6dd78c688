"""States of the active object's stages, their results and the guidance, computed once per redraw of the tab."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import bpy

from ..bridge.store import guidance, states, stored_report
from ..bridge.store.guidance import Guidance

ICONS = {states.TODO: "BLANK1", states.DONE: "CHECKMARK", states.STALE: "FILE_REFRESH"}
# seconds for which popovers reuse the states computed by the tab; has to be longer than a redraw, and is short enough
# that nobody notices old states; not measured
ONE_REDRAW = 0.2


@dataclass(frozen=True)
class StagesSnapshot:
    """Snapshot of an object for one redraw.

    uid : Blender's session id of the object
    seconds : monotonic time of the snapshot
    states : state of every stage: to do, done, or out of date
    blocks : stored results by stage
    guidance : notices and the next step
    """

    uid: int
    seconds: float
    states: dict[str, states.StageState]
    blocks: dict[str, Any]
    guidance: Guidance


_cache: list[StagesSnapshot] = []


def read_stages(context: bpy.types.Context, refresh: bool = False) -> StagesSnapshot:
    """Return the snapshot of the active object, at most ``ONE_REDRAW`` seconds old.

    Parameters
    ----------
    context : Blender's context
    refresh : whether to recompute the snapshot at any age; the tab does, because it is drawn before the popovers
    """
    obj, now = context.object, time.monotonic()
    if refresh or not _cache or _cache[0].uid != obj.session_uid or now - _cache[0].seconds > ONE_REDRAW:
        current = states.read_states(obj, context.scene)
        advice = guidance.read_guidance(obj, context.scene, current)
        _cache[:] = [StagesSnapshot(obj.session_uid, now, current, stored_report.read(obj.data), advice)]
    return _cache[0]


def results_column(layout: Any, context: bpy.types.Context, stage: str) -> tuple[Any, dict[str, Any]] | None:
    """Return a column for a stage's results, and the results; None if the stage has none.

    The column is greyed out if the results are out of date.
    """
    seen = read_stages(context)
    if stage not in seen.blocks:
        return None
    column = layout.column()
    column.active = seen.states[stage].kind != states.STALE
    return column, seen.blocks[stage]

"""Live simulation: the shape follows every change of a piece until *Live* is switched off."""

from __future__ import annotations

import bpy

from ..bridge.hosts import live
from .stage import POLL_INTERVAL, ImmediateOperator, ObjectOperator, redraw


class Live(ImmediateOperator, ObjectOperator, bpy.types.Operator):
    """Show the shape that the piece takes while you change it: settings, supports and loads, spirals, seams, vertices of the target. Press again to stop; press Simulate for the final shape with its figures"""

    bl_idname = "flexmaps.live"
    bl_label = "Live"
    bl_options = {"REGISTER"}

    def run(self, context: bpy.types.Context) -> None:
        following = live.current_watcher()
        if following is not None and following.uid == context.object.session_uid:
            live.stop()
            return
        live.start(context.object)
        if not bpy.app.timers.is_registered(_tick):
            bpy.app.timers.register(_tick)


def _tick() -> float | None:
    following = live.current_watcher()
    if following is None:
        return None
    before = following.is_resting, following.problem
    if following.tick():
        redraw(bpy.context, "WINDOW")
    if before != (following.is_resting, following.problem):
        redraw(bpy.context, "UI")
    return POLL_INTERVAL


def register() -> None:
    handlers = bpy.app.handlers
    handlers.load_pre.append(live.stop)
    handlers.depsgraph_update_post.append(live.on_depsgraph_update)
    for which in (handlers.undo_post, handlers.redo_post):
        which.append(live.on_undo)


def unregister() -> None:
    live.stop()
    handlers = bpy.app.handlers
    for which in (handlers.undo_post, handlers.redo_post):
        which.remove(live.on_undo)
    handlers.depsgraph_update_post.remove(live.on_depsgraph_update)
    handlers.load_pre.remove(live.stop)
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)


CLASSES = (Live,)

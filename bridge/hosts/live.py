"""Live mode: watch an object for changes, and show the equilibrium shape of its piece.

The shape is drawn over the 3D view and never written to the file, so undo, saving and Blender's modes are unaffected.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import bpy

from ...engine.errors import FlexMapsError
from ..store import stored_report
from . import background

if TYPE_CHECKING:
    from ...engine.extras.live.live_input import LiveInput
    from ...engine.extras.live.live_piece import LiveEquilibrium
    from ..view.live_mode_shape import LiveModeShape
    from .live_process import LiveProcess

# seconds between two reads of the object while Blender reports no change, because scripts may change data silently;
# longer notices such changes later, shorter takes more processor time
IDLE_INTERVAL = 0.2
# largest fraction of the main thread's time spent on reading the object, because a drag reports a change at every tick;
# larger follows a drag more closely and slows the window down
READ_SHARE = 0.2

_running: list[ObjectWatcher] = []


def current_watcher() -> ObjectWatcher | None:
    """Return the watcher of the followed object; None while Live is off."""
    return _running[0] if _running else None


def live_shape_of(obj: bpy.types.Object) -> LiveEquilibrium | None:
    """Return the live shape of an object; None if no live shape is drawn for it."""
    following = current_watcher()
    return following.shape if following is not None and following.uid == obj.session_uid and following.picture else None


def shown_picture() -> LiveModeShape | None:
    """Return the picture of the live shape that is drawn over the 3D view, or None."""
    return _running[0].picture if _running else None


def start(obj: bpy.types.Object) -> ObjectWatcher:
    """Follow this object from now on, instead of any other."""
    stop()
    _running.append(ObjectWatcher(obj.session_uid))
    return _running[0]


@bpy.app.handlers.persistent
def stop(*_: object) -> None:
    """Switch Live off; called before a file is loaded and when the extension is disabled."""
    while _running:
        _running.pop().close()


@bpy.app.handlers.persistent
def on_depsgraph_update(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Handle Blender's ``depsgraph_update_post``: mark the followed object to be read again.

    Parameters
    ----------
    scene : updated scene
    depsgraph : dependency graph with the list of updates
    """
    if _running and any(
        isinstance(update.id, bpy.types.Mesh | bpy.types.Object | bpy.types.Key | bpy.types.Scene)
        for update in depsgraph.updates
    ):
        _running[0].is_dirty = True


@bpy.app.handlers.persistent
def on_undo(*_: object) -> None:
    """Handle undo and redo, which replace Blender's data: mark the followed object to be read again."""
    if _running:
        _running[0].is_dirty = True


class ObjectWatcher:
    """Watches one object and passes its changes to the process that computes its live shape.

    uid : Blender's session id of the object
    is_dirty : whether Blender has reported a change since the last read
    picture : picture of the live shape that is drawn, or None
    is_final : whether the object has an up-to-date simulation of its own
    slowest_tick : processor seconds of the slowest tick on the main thread so far
    """

    def __init__(self, uid: int):
        self.uid, self.is_dirty = uid, True
        self.picture: LiveModeShape | None = None
        self.slowest_tick = 0.0
        self.is_final = False
        self._process: LiveProcess | None = None
        self._input: LiveInput | None = None
        self._next_read, self._next_look = 0.0, 0.0
        self._is_gone = False
        self._refusal = ""  # reason why the object cannot be read; "" if it can

    @property
    def problem(self) -> str:
        """Return why the shape does not follow the last change; "" if it does."""
        if self._refusal or self._process is None:
            return self._refusal
        return self._process.error or (self.shape.problem if self.shape is not None else "")

    @property
    def shape(self) -> LiveEquilibrium | None:
        """Return the latest shape, or None before the first one."""
        latest = None if self._process is None else self._process.latest
        return None if latest is None else latest[0]

    @property
    def is_resting(self) -> bool:
        """Return whether the shape of the newest input is computed, so that it moves no further."""
        return self._process is None or self._process.is_resting

    def close(self) -> None:
        if self._process is not None:
            self._process.close()
        self._process = self.picture = None

    def tick(self) -> bool:
        """Read the object if it may have changed; return whether the picture or the reported problem changed."""
        began, before = time.thread_time(), (self.picture, self.problem)
        try:
            self._tick(time.perf_counter())
        finally:
            self.slowest_tick = max(self.slowest_tick, time.thread_time() - began)
        return before != (self.picture, self.problem)

    def _tick(self, now: float) -> None:
        from ..store.objects import find_by_uid

        if (
            background.current_job() is not None
        ):  # leave the processor to the job, and read the object when the job ends
            self.is_dirty = True
            return
        self._is_gone = not any(obj.session_uid == self.uid for obj in bpy.context.scene.objects)
        # read a deleted object at once (to report it), and a changed one as often as ``READ_SHARE`` allows
        if (self._is_gone and not self._refusal) or (
            now >= self._next_read and (self.is_dirty or now >= self._next_look)
        ):
            self.is_dirty = False
            try:
                self._read(find_by_uid(self.uid))
            except FlexMapsError as error:
                self._refusal = str(error)
            spent = time.perf_counter() - now
            self._next_read, self._next_look = now + spent / READ_SHARE, now + IDLE_INTERVAL
        self._update_picture()

    def _read(self, obj: bpy.types.Object) -> None:
        from ..store import equilibrium, live_input, mesh, states

        scene = bpy.context.scene
        state = live_input.read(obj, scene)
        self._refusal = ""
        known = self._input
        if known is None or state.changes(known):
            start = equilibrium.read_rest_pose(obj, scene, mesh.read_in_any_mode(obj, scene)) if known is None else None
            self._input = state
            self._get_process().follow(state, start)
        block = stored_report.read(obj.data).get("equilibrium")
        self.is_final = block is not None and not states.is_stale(obj, scene, "equilibrium")

    def _get_process(self) -> LiveProcess:
        from .live_process import LiveProcess

        if self._process is None:
            from ..view.live_mode_shape import LiveModeShape

            unit = bpy.context.scene.unit_settings.scale_length
            self._process = LiveProcess(lambda shape: LiveModeShape.from_shape(shape, unit))
        return self._process

    def _update_picture(self) -> None:
        """Show the process's latest shape; show none if the object is gone or has its own final result."""
        process = self._process
        hidden = process is None or process.error or self._is_gone or (self.is_final and process.is_resting)
        latest = None if hidden or process is None else process.latest
        self.picture = None if latest is None else latest[1]

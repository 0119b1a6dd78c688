"""Live mode: watch a piece for changes, and show the shape that it takes.

Live mode writes nothing to the file, so undo, saving and modes are unaffected: the shape is drawn over the 3D view.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import bpy

from ...engine.errors import FlexMapsError
from ..store import notes
from . import background

if TYPE_CHECKING:
    from ...engine.extras.live.given import LiveInput
    from ...engine.extras.live.live_piece import LiveEquilibrium
    from ..view.followed import Followed
    from .companion import Companion

SELDOM = 0.2  # seconds between two looks without a reported change, because scripts change data silently
SHARE = 0.2  # largest share of the window's time spent on reading; a drag reports a change at every tick

_running: list[ObjectWatcher] = []


def current() -> ObjectWatcher | None:
    """Return the running follower; None while Live is off."""
    return _running[0] if _running else None


def shape_of(obj: bpy.types.Object) -> LiveEquilibrium | None:
    """Return the live shape of an object, if one is drawn."""
    following = current()
    return following.shape if following is not None and following.uid == obj.session_uid and following.shown else None


def shown() -> Followed | None:
    """Return the shape drawn over the 3D view, if any."""
    return _running[0].shown if _running else None


def start(obj: bpy.types.Object) -> ObjectWatcher:
    """Follow this object from now on, and no other."""
    stop()
    _running.append(ObjectWatcher(obj.session_uid))
    return _running[0]


@bpy.app.handlers.persistent
def stop(*_: object) -> None:
    """Switch Live off: before another file is loaded, and when the extension is disabled."""
    while _running:
        _running.pop().close()


@bpy.app.handlers.persistent
def changed(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Note that Blender reports a change.

    Parameters
    ----------
    scene : scene that was updated
    depsgraph : dependency graph, with what was updated
    """
    if _running and any(
        isinstance(update.id, bpy.types.Mesh | bpy.types.Object | bpy.types.Key | bpy.types.Scene)
        for update in depsgraph.updates
    ):
        _running[0].touched = True


@bpy.app.handlers.persistent
def stepped(*_: object) -> None:
    """Note that undo or redo has replaced Blender's data."""
    if _running:
        _running[0].touched = True


class ObjectWatcher:
    """Watches one object.

    uid : Blender's id of the object
    touched : Blender has reported a change
    shown : what is drawn
    final : whether the object itself shows an up-to-date simulation
    slowest : processor seconds of the slowest tick on this thread
    """

    def __init__(self, uid: int):
        self.uid, self.touched = uid, True
        self.shown: Followed | None = None
        self.slowest = 0.0
        self.final = False
        self._companion: Companion | None = None
        self._given: LiveInput | None = None
        self._next, self._look = 0.0, 0.0
        self._gone = False
        self._refused = ""  # reason why the object cannot be read

    @property
    def problem(self) -> str:
        """Return why the last change is not followed; "" where it is."""
        if self._refused or self._companion is None:
            return self._refused
        return self._companion.error or (self.shape.problem if self.shape is not None else "")

    @property
    def shape(self) -> LiveEquilibrium | None:
        """Return the latest shape, if there is one."""
        latest = None if self._companion is None else self._companion.latest
        return None if latest is None else latest[0]

    @property
    def resting(self) -> bool:
        """Return whether the newest state has come to rest."""
        return self._companion is None or self._companion.resting

    def close(self) -> None:
        if self._companion is not None:
            self._companion.close()
        self._companion = self.shown = None

    def tick(self) -> bool:
        """Look for changes; return whether there is something new to draw."""
        began, before = time.thread_time(), (self.shown, self.problem)
        try:
            self._tick(time.perf_counter())
        finally:
            self.slowest = max(self.slowest, time.thread_time() - began)
        return before != (self.shown, self.problem)

    def _tick(self, now: float) -> None:
        from ..store.objects import find

        if background.current() is not None:  # the job needs the processor, and its result will be a change
            self.touched = True
            return
        self._gone = not any(obj.session_uid == self.uid for obj in bpy.context.scene.objects)
        # report a deleted object at once, and changes as often as time allows
        if (self._gone and not self._refused) or (now >= self._next and (self.touched or now >= self._look)):
            self.touched = False
            try:
                self._read(find(self.uid))
            except FlexMapsError as error:
                self._refused = str(error)
            spent = time.perf_counter() - now
            self._next, self._look = now + spent / SHARE, now + SELDOM
        self._take()

    def _read(self, obj: bpy.types.Object) -> None:
        from ..store import equilibrium, given, mesh, states

        scene = bpy.context.scene
        state = given.read(obj, scene)
        self._refused = ""
        known = self._given
        if known is None or state.changes(known):
            start = equilibrium.resting(obj, scene, mesh.read_anyhow(obj, scene)) if known is None else None
            self._given = state
            self._beside().follow(state, start)
        block = notes.read(obj.data).get("equilibrium")
        self.final = block is not None and not states.is_old(obj, scene, "equilibrium")

    def _beside(self) -> Companion:
        from .companion import Companion

        if self._companion is None:
            from ..view.followed import Followed

            unit = bpy.context.scene.unit_settings.scale_length
            self._companion = Companion(lambda shape: Followed.from_shape(shape, unit))
        return self._companion

    def _take(self) -> None:
        """Take the companion's latest shape; none where the object is gone or shows its own result."""
        companion = self._companion
        hidden = companion is None or companion.error or self._gone or (self.final and companion.resting)
        latest = None if hidden or companion is None else companion.latest
        self.shown = None if latest is None else latest[1]

"""What all stages have in common: read the mesh, run the engine beside Blender, write the mesh.

With a window the engine runs in the background job: a timer polls, draws the progress, and writes at the end; ESC stops.
Called from a script, or in Blender without a window, the same engine call runs at once and prints its progress.
An error of the user's selects the culprits, is reported, and leaves the mesh as it was.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import bpy

from ..bridge.hosts import background, preload
from ..bridge.store.i18n import button_name, translate
from ..bridge.view import framing, progress, tab
from ..bridge.view.progress import redraw
from ..engine.errors import Cancelled, FlexMapsError
from ..engine.params import ObjectSettings
from ..engine.progress import Progress

if TYPE_CHECKING:
    from ..bridge.store.surface import Surface

Work = Callable[[Progress], Any]

TICK = 0.02  # seconds between two looks at the job


class Polled:
    """Base of what is grey where it cannot run, and says why."""

    @classmethod
    def problem(cls, context: bpy.types.Context) -> str | None:
        """Why it cannot run now, as a sentence; asked at every redraw, so it must be cheap."""
        return None

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = cls.problem(context)
        if problem is not None:
            cls.poll_message_set(translate(problem))  # type: ignore[attr-defined]
        return problem is None


class OnObject(Polled):
    """Base of small operators on the active object, which is at least one that FlexMaps can work on."""

    @classmethod
    def problem(cls, context: bpy.types.Context) -> str | None:
        from ..bridge.store.objects import unusable

        return unusable(context.object)


class AnyMesh(OnObject):
    """Base of what takes a mesh with modifiers too, while no other job runs; of stages, before ``StageOperator``."""

    @classmethod
    def problem(cls, context: bpy.types.Context) -> str | None:
        running = background.current()
        return super().problem(context) if running is None else still_running(running)


class AtOnce:
    """Base of small operators, which need no job: mixed in before what says where they can run."""

    bl_options = {"REGISTER", "UNDO"}
    level = "INFO"  # of the line that ``act`` returns; it may set "WARNING"
    report: Any

    def act(self, context: bpy.types.Context) -> str | None:
        """Do it, and return the line that the user reads; an error of the user's is reported, and leaves all as it was."""
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        preload.wait()
        try:
            text = self.act(context)
        except FlexMapsError as error:
            return self._refused(context, error)
        redraw(context)
        if text:
            self.report({self.level}, text)
        return {"FINISHED"}

    def _refused(self, context: bpy.types.Context, error: FlexMapsError) -> set[str]:
        self.report({"ERROR"}, str(error))
        return {"CANCELLED"}


class NewObject(Polled):
    """Base of what adds an object of its own, while no job runs."""

    @classmethod
    def problem(cls, context: bpy.types.Context) -> str | None:
        running = background.current()
        if running is not None:
            return still_running(running)
        return None if context.mode == "OBJECT" else "Go to Object Mode: a new object is made"


class StageOperator(Polled):
    """Base of the operators of one stage each; ``bpy.types.Operator`` is mixed in where they are registered.

    A stage gives ``prepare``, which returns the engine work as a function of a ``Progress``, and ``finish``, which writes
    the result into the object and returns the line that the user reads.
    """

    bl_options = {"REGISTER", "UNDO"}
    bl_label = ""
    report: Any
    shows = ""  # the overlay that is switched on afterwards, where none is
    on_stop = "nothing is changed then"  # what becomes of the work when it is stopped
    level = "INFO"  # of the line that ``finish`` returns; it may set "WARNING"

    _job: background.Job | None = None
    _timer: Any = None
    _pace: Any = None  # a ``progress.Pace``
    _helped = False  # whether ``meanwhile`` was called
    _writing: Any = None  # the pieces that are still to be written
    _made_from: Any = None  # checksums of the settings that the work began with
    _scene = 0  # Blender's id of the scene that the work began in
    _surface: Any = None  # bridge.store.surface.Surface; Blender evaluates annotations, so only names that are there

    @property
    def uid(self) -> int:
        """Blender's id of the object that it works on; 0 before that is read."""
        return 0 if self._surface is None else self._surface.uid

    # -- what a stage says ---------------------------------------------------------------------------------------------

    @classmethod
    def obstacle(cls, obj: bpy.types.Object) -> str | None:
        """Why this stage cannot run on a usable object, as a sentence; asked at every redraw, so it must be cheap."""
        return None

    def prepare(self, surface: Surface, settings: ObjectSettings) -> Work:
        """The engine work; the returned function must not touch Blender's data."""
        raise NotImplementedError

    def meanwhile(self) -> None:
        """Make on the main thread what the work waits for and what takes a moment; called once, after the progress was drawn."""

    def finish(self, context: bpy.types.Context, obj: bpy.types.Object, surface: Surface, result: Any) -> str:
        """Write the result, on the main thread; everything that can fail comes before the first write."""
        raise NotImplementedError

    def after(self, context: bpy.types.Context, obj: bpy.types.Object, result: Any) -> Iterator[None]:
        """Draw what stands beside the model, after the result was written; between its pieces the window is drawn."""
        return iter(())

    # -- how it runs -----------------------------------------------------------------------------------------------------

    @classmethod
    def problem(cls, context: bpy.types.Context) -> str | None:
        return why_not(cls, context.object)

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            work = self._read(context)
            self.meanwhile()
            for _ in self._write(context, background.run_here(self.bl_label, work)):
                pass
            return {"FINISHED"}
        except Cancelled:
            return self._cancelled()
        except FlexMapsError as error:
            return self._refused(context, error)

    def invoke(self, context: bpy.types.Context, event: Any) -> set[str]:
        if bpy.app.background:
            return self.execute(context)
        try:
            work = self._read(context)
        except FlexMapsError as error:
            return self._refused(context, error)
        tab.pressed()
        self._job = background.Job(self.bl_label, work, self.on_stop)
        self._job.start()
        manager = context.window_manager
        self._timer = manager.event_timer_add(TICK, window=context.window)
        manager.progress_begin(0, 100)
        manager.modal_handler_add(self)
        self._pace = progress.Pace()
        self._pace.due(time.perf_counter())
        progress.show(context, self._job)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: Any) -> set[str]:
        assert self._job is not None
        if event.type == "ESC" and event.value == "PRESS" and self._writing is None:
            self._job.stop()
            progress.show(context, self._job)
            return {"RUNNING_MODAL"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        if not self._helped:
            self._helped = True
            self.meanwhile()
        if not self._job.finished:
            if self._pace.due(time.perf_counter()):
                progress.show(context, self._job)
            return {"PASS_THROUGH"}
        going_on = False
        try:
            going_on = self._go_on(context)
        except Cancelled:
            return self._cancelled()
        except FlexMapsError as error:
            return self._refused(context, error)
        finally:
            if not going_on:
                self._clear(context)
                tab.follow(context)
        return {"PASS_THROUGH"} if going_on else {"FINISHED"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Called by Blender when a file is loaded or the window closes while the job runs."""
        self._clear(context)

    def _go_on(self, context: bpy.types.Context) -> bool:
        """Take the finished job's result, then write one piece at a time; False after the last."""
        assert self._job is not None
        if self._job.error is not None:
            raise self._job.error
        if self._writing is None:
            self._job.shown = None  # from now on the mesh itself is to be seen
            self._writing = self._write(context, self._job.result)
        with framing.in_scene(context, self._scene):
            return next(self._writing, self) is None

    # -- the steps ---------------------------------------------------------------------------------------------------------

    def _read(self, context: bpy.types.Context) -> Work:
        preload.wait()
        from ..bridge.store import mesh, settings, states

        obj = context.object
        if obj is None:
            raise FlexMapsError("Select a mesh object")
        self._scene = context.scene.session_uid
        self._surface = mesh.read_surface(obj, context.scene)
        self._made_from = states.settings_now(obj, context.scene)
        return self.prepare(self._surface, settings.read(obj.flexmaps, ObjectSettings))

    def _write(self, context: bpy.types.Context, result: Any) -> Iterator[None]:
        from ..bridge.store import failures, mesh, states
        from ..bridge.store.objects import find
        from ..bridge.view import overlay

        assert self._surface is not None
        obj = find(self._surface.uid)
        if not mesh.read_surface(obj, context.scene).same_as(self._surface):
            raise FlexMapsError(
                f"'{obj.name}' was changed while {self.bl_label} ran; nothing was written, run it again"
            )
        try:
            message = self.finish(context, obj, self._surface, result)
        finally:  # a check writes what it found, then complains
            states.stamp(obj, context.scene, self._made_from)
        failures.clear(obj, idname_of(self))
        overlay.renew(obj, self.shows)
        redraw(context)
        yield
        with suppress(FlexMapsError):  # where the object is gone there is nothing more to draw
            for _ in self.after(context, find(self._surface.uid), result):
                yield
        redraw(context)
        # the status bar has room for one sentence; the tab tells the others
        self.report({self.level}, message if bpy.app.background else message.partition(". ")[0])

    def _clear(self, context: bpy.types.Context) -> None:
        if self._job is None:
            return
        self._job.end()
        self._job = self._writing = None
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None
        context.window_manager.progress_end()
        if context.workspace is not None:
            context.workspace.status_text_set(None)
        redraw(context)

    def _cancelled(self) -> set[str]:
        self.report({"WARNING"}, translate("{} was stopped; nothing was changed", button_name(self.bl_label)))
        return {"CANCELLED"}

    def _refused(self, context: bpy.types.Context, error: FlexMapsError) -> set[str]:
        from ..bridge.store.objects import find

        if self._surface is not None and (error.faces or error.edges):
            with suppress(FlexMapsError):  # where the object is gone there is nothing to select
                framing.reveal(context, find(self._surface.uid), self._surface, error.faces, error.edges)
                framing.frame(context)
        with suppress(FlexMapsError):  # where it is gone there is nothing to note
            self._note(context, find(self.uid), error)
        redraw(context)
        self.report({"ERROR"}, str(error))
        return {"CANCELLED"}

    def _note(self, context: bpy.types.Context, obj: bpy.types.Object, error: FlexMapsError) -> None:
        """Keep why it failed, so that *Next* offers a cure."""
        from ..bridge.store import failures

        failures.write(obj, context.scene, idname_of(self), error)


def idname_of(operator: Any) -> str:
    """Its name as scripts call it: "flexmaps.check"."""
    group, _, name = operator.bl_idname.partition("_OT_")
    return f"{group.lower()}.{name}" if name else str(operator.bl_idname)


def why_not(stage: Any, obj: bpy.types.Object | None) -> str | None:
    """Why a stage, which has an ``obstacle``, cannot run on the object now, as a sentence; ``None`` if it can."""
    from ..bridge.store.objects import changed_by_modifiers, unusable

    running = background.current()
    if running is not None:
        return still_running(running)
    problem = unusable(obj)
    if problem is None and obj is not None:
        problem = changed_by_modifiers(obj) or stage.obstacle(obj)
    return problem


def still_running(running: background.Job) -> str:
    return translate("{} is running; wait for it, or stop it with ESC", button_name(running.title))

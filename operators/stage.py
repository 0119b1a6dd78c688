"""Base of all stage operators: read the mesh, run the engine outside the main thread, write the mesh.

With a window, the engine runs as a background job: a timer polls it, draws the progress, and writes the result; ESC
cancels. From a script, or in Blender without a window, the engine runs at once and prints its progress. A
``FlexMapsError`` is reported, the faces and edges it names are selected, and the mesh stays as it was.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, Any, TypeVar

import bpy

from ..bridge.hosts import background, preload
from ..bridge.hosts.background import POLL_INTERVAL
from ..bridge.store.i18n import button_name, translate
from ..bridge.view import framing, progress, tab
from ..bridge.view.progress import redraw
from ..engine.errors import Cancelled, FlexMapsError
from ..engine.params import ObjectSettings
from ..engine.progress import Progress

if TYPE_CHECKING:
    from ..bridge.store.surface import ObjectSurface

Made = TypeVar("Made")  # result type of a stage's work, passed to ``finish``
Work = Callable[[Progress], Made]


class PolledOperator:
    """Base of operators that are greyed out, with a reason as tooltip, while they cannot run."""

    @classmethod
    def problem(cls, context: bpy.types.Context) -> str | None:
        """Return a sentence why the operator cannot run now, or None; must be fast, as every redraw calls it."""
        return None

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = cls.problem(context)
        if problem is not None:
            cls.poll_message_set(translate(problem))  # type: ignore[attr-defined]
        return problem is None


class ObjectOperator(PolledOperator):
    """Base of operators on the active object; they need an object that FlexMaps can work on."""

    @classmethod
    def problem(cls, context: bpy.types.Context) -> str | None:
        from ..bridge.store.objects import usage_problem

        return usage_problem(context.object)


class AnyMeshOperator(ObjectOperator):
    """Base of operators that accept a mesh with modifiers, while no job runs; list it before ``StageOperator``."""

    @classmethod
    def problem(cls, context: bpy.types.Context) -> str | None:
        running = background.current_job()
        return super().problem(context) if running is None else running_message(running)


def error_message(error: RuntimeError) -> str:
    """Return the message that an operator called through ``bpy.ops`` reported as an error, or why it cannot run now.

    Raise the error again if it contains a traceback, which is a fault of the program.

    Parameters
    ----------
    error : error raised by ``bpy.ops``
    """
    text = str(error).strip()
    if "Traceback" in text:
        raise error
    return re.sub(r"^Operator bpy\.ops\.[\w.]+\.poll\(\) ", "", text.removeprefix("Error: "))


class ImmediateOperator:
    """Base of operators that run at once, without a background job; list it before bases with a ``poll``."""

    bl_options = {"REGISTER", "UNDO"}
    level = "INFO"  # report level of the line that ``run`` returns; ``run`` may set "WARNING"
    report: Any

    def run(self, context: bpy.types.Context) -> str | None:
        """Do the work and return a line for the user, or None.

        A ``FlexMapsError`` is reported; it must leave everything as it was.
        """
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        preload.wait()
        try:
            text = self.run(context)
        except FlexMapsError as error:
            return self._report_error(context, error)
        redraw(context)
        if text:
            self.report({self.level}, text)
        return {"FINISHED"}

    def _report_error(self, context: bpy.types.Context, error: FlexMapsError) -> set[str]:
        self.report({"ERROR"}, str(error))
        return {"CANCELLED"}


class AddObjectOperator(PolledOperator):
    """Base of operators that add a new object; they need object mode and that no job runs."""

    @classmethod
    def problem(cls, context: bpy.types.Context) -> str | None:
        running = background.current_job()
        if running is not None:
            return running_message(running)
        return None if context.mode == "OBJECT" else "Go to Object Mode: a new object is made"


if TYPE_CHECKING:
    from typing import Generic as HandsOver
else:

    class HandsOver:
        """Replacement for ``Generic``, whose caches would keep Blender's classes alive and hang the process at exit."""

        def __class_getitem__(cls, kind: object) -> type:
            return cls


class StageOperator(PolledOperator, HandsOver[Made]):
    """Base of the stages' operators; subclasses list ``bpy.types.Operator`` as their last base.

    A stage implements ``prepare``, which returns the engine's work as a function of ``Progress``, and ``finish``, which
    writes the result into the object and returns a line for the user.
    """

    bl_options = {"REGISTER", "UNDO"}
    bl_label = ""
    report: Any
    overlay_kind = ""  # kind of overlay to switch on after the stage if none is on
    on_stop = "nothing is changed then"  # text of the progress display: the effect of a cancel
    level = "INFO"  # report level of the line that ``finish`` returns; ``finish`` may set "WARNING"

    _job: background.Job | None = None
    _timer: Any = None
    _pacer: Any = None  # a ``progress.RedrawPacer``, which limits redraws
    _has_called_back = False  # whether ``while_running`` was called
    _write_steps: Any = None  # iterator over the remaining steps of writing the result
    _settings_checksums: Any = None  # checksums of the settings when the work began
    _scene = 0  # Blender's id of the scene in which the work began
    _surface: Any = None  # an ``ObjectSurface``; Any, as Blender evaluates annotations before the import

    @property
    def uid(self) -> int:
        """Return Blender's id of the stage's object; 0 before the object is read."""
        return 0 if self._surface is None else self._surface.uid

    # -- methods that stages override ----------------------------------------------------------------------------------

    @classmethod
    def obstacle(cls, obj: bpy.types.Object) -> str | None:
        """Return a sentence why the stage cannot run on a usable object, or None; every redraw calls it."""
        return None

    def prepare(self, surface: ObjectSurface, settings: ObjectSettings) -> Work[Made]:
        """Return the engine's work as a function of ``Progress``, which must not touch Blender's data."""
        raise NotImplementedError

    def while_running(self) -> None:
        """Prepare on the main thread something that the running work waits for; called once."""

    def finish(self, context: bpy.types.Context, obj: bpy.types.Object, surface: ObjectSurface, result: Made) -> str:
        """Write the result on the main thread and return a line for the user; steps that can fail must come first."""
        raise NotImplementedError

    def after_write(self, context: bpy.types.Context, obj: bpy.types.Object, result: Made) -> Iterator[None]:
        """Draw objects beside the model after the result was written; the window is redrawn at every ``yield``."""
        return iter(())

    # -- running ---------------------------------------------------------------------------------------------------------

    @classmethod
    def problem(cls, context: bpy.types.Context) -> str | None:
        return reason_unavailable(cls.obstacle, context.object)

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            work = self._read(context)
            self.while_running()
            for _ in self._write(context, background.run_blocking(self.bl_label, work)):
                pass
            return {"FINISHED"}
        except Cancelled:
            return self._report_cancelled()
        except FlexMapsError as error:
            return self._report_error(context, error)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if bpy.app.background:
            return self.execute(context)
        try:
            work = self._read(context)
        except FlexMapsError as error:
            return self._report_error(context, error)
        tab.on_stage_start()
        self._job = background.Job(self.bl_label, work, self.on_stop)
        self._job.start()
        manager = context.window_manager
        self._timer = manager.event_timer_add(POLL_INTERVAL, window=context.window)
        manager.progress_begin(0, 100)
        manager.modal_handler_add(self)
        self._pacer = progress.RedrawPacer()
        self._pacer.is_due(time.perf_counter())
        progress.show_progress(context, self._job)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        assert self._job is not None
        if event.type == "ESC" and event.value == "PRESS" and self._write_steps is None:
            self._job.stop()
            progress.show_progress(context, self._job)
            return {"RUNNING_MODAL"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        if not self._has_called_back:
            self._has_called_back = True
            self.while_running()
        if not self._job.is_finished:
            if self._pacer.is_due(time.perf_counter()):
                progress.show_progress(context, self._job)
            return {"PASS_THROUGH"}
        going_on = False
        try:
            going_on = self._do_write_step(context)
        except Cancelled:
            return self._report_cancelled()
        except FlexMapsError as error:
            return self._report_error(context, error)
        finally:
            if not going_on:
                self._clear(context)
                tab.open_next_section(context)
        return {"PASS_THROUGH"} if going_on else {"FINISHED"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Clean up when Blender loads a file or closes the window while the job runs."""
        self._clear(context)

    def _do_write_step(self, context: bpy.types.Context) -> bool:
        """Take the finished job's result and do one step of writing it; return False after the last step."""
        assert self._job is not None
        if self._job.error is not None:
            raise self._job.error
        if self._write_steps is None:
            self._job.intermediate = None  # stop drawing the job's shape over the mesh
            self._write_steps = self._write(context, self._job.result)
        with framing.in_scene(context, self._scene):
            return next(self._write_steps, self) is None

    # -- steps -----------------------------------------------------------------------------------------------------------

    def _read(self, context: bpy.types.Context) -> Work[Made]:
        preload.wait()
        from ..bridge.store import mesh, settings, states

        obj = context.object
        if obj is None:
            raise FlexMapsError("Select a mesh object")
        self._scene = context.scene.session_uid
        self._surface = mesh.read_surface(obj, context.scene)
        self._settings_checksums = states.read_settings_checksums(obj, context.scene)
        return self.prepare(self._surface, settings.read(obj.flexmaps, ObjectSettings))

    def _write(self, context: bpy.types.Context, result: Made) -> Iterator[None]:
        from ..bridge.store import failures, mesh, states
        from ..bridge.store.objects import find_by_uid
        from ..bridge.view import overlay

        assert self._surface is not None
        obj = find_by_uid(self._surface.uid)
        if not mesh.read_surface(obj, context.scene).is_same_mesh(self._surface):
            raise FlexMapsError(
                f"'{obj.name}' was changed while {self.bl_label} ran; nothing was written, run it again"
            )
        try:
            message = self.finish(context, obj, self._surface, result)
        finally:  # also after an error, because the mesh check writes its findings before it raises
            states.stamp(obj, context.scene, self._settings_checksums)
        failures.clear(obj, idname_of(self))
        overlay.update_after_stage(obj, self.overlay_kind)
        redraw(context)
        yield
        with suppress(FlexMapsError):  # if the object was deleted, there is nothing to draw
            for _ in self.after_write(context, find_by_uid(self._surface.uid), result):
                yield
        redraw(context)
        level, text = self.level, message
        # the status bar has room for the first sentence only, which tells what was done and is not a warning
        if not bpy.app.background:
            text, _, others = message.partition(". ")
            level = "INFO" if others else level
        self.report({level}, text)

    def _clear(self, context: bpy.types.Context) -> None:
        if self._job is None:
            return
        self._job.end()
        self._job = self._write_steps = None
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None
        context.window_manager.progress_end()
        if context.workspace is not None:
            context.workspace.status_text_set(None)
        redraw(context)

    def _report_cancelled(self) -> set[str]:
        self.report({"WARNING"}, translate("{} was stopped; nothing was changed", button_name(self.bl_label)))
        return {"CANCELLED"}

    def _report_error(self, context: bpy.types.Context, error: FlexMapsError) -> set[str]:
        from ..bridge.store.objects import find_by_uid

        if self._surface is not None and (error.faces or error.edges):
            with suppress(FlexMapsError):  # if the object was deleted, there is nothing to select
                framing.select_places(context, find_by_uid(self._surface.uid), self._surface, error.faces, error.edges)
                framing.frame_views(context)
        with suppress(FlexMapsError):  # if the object was deleted, there is nowhere to store it
            self._store_failure(context, find_by_uid(self.uid), error)
        redraw(context)
        self.report({"ERROR"}, str(error))
        return {"CANCELLED"}

    def _store_failure(self, context: bpy.types.Context, obj: bpy.types.Object, error: FlexMapsError) -> None:
        """Store the failure, so that *Next* offers a cure instead of the same action."""
        from ..bridge.store import failures

        failures.write(obj, context.scene, idname_of(self), error)


def idname_of(operator: bpy.types.Operator) -> str:
    """Return an operator's name as in ``bpy.ops``, such as "flexmaps.check"."""
    group, _, name = operator.bl_idname.partition("_OT_")
    return f"{group.lower()}.{name}" if name else str(operator.bl_idname)


def reason_unavailable(obstacle: Callable[[bpy.types.Object], str | None], obj: bpy.types.Object | None) -> str | None:
    """Return a sentence why an operator cannot run on the object now; None if it can.

    Parameters
    ----------
    obstacle : returns a sentence why the operator cannot run on a usable mesh, or None
    obj : the active object
    """
    from ..bridge.store.objects import modifier_problem, usage_problem

    running = background.current_job()
    if running is not None:
        return running_message(running)
    problem = usage_problem(obj)
    if problem is None and obj is not None:
        problem = modifier_problem(obj) or obstacle(obj)
    return problem


def running_message(running: background.Job) -> str:
    return translate("{} is running; wait for it, or stop it with ESC", button_name(running.title))

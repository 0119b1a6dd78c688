"""The background job, driven by hand: a window's events are played to the operators."""

from __future__ import annotations

import sys
import threading
import time
from types import SimpleNamespace
from typing import Any

import bpy
import pytest
from flexmaps.bridge.hosts import background
from flexmaps.engine.errors import Cancelled, FlexMapsError
from flexmaps.engine.surface import shapes
from flexmaps.operators import stage

TIMER = SimpleNamespace(type="TIMER", value="NOTHING")
ESCAPE = SimpleNamespace(type="ESC", value="PRESS")
MOUSE = SimpleNamespace(type="MOUSEMOVE", value="NOTHING")


class Manager:
    """A window manager that notes what is asked of it."""

    def __init__(self) -> None:
        self.timers: list[Any] = []
        self.handlers: list[Any] = []
        self.cursor: list[float] = []
        self.windows: list[Any] = []

    def event_timer_add(self, step: float, window: Any) -> Any:
        self.timers.append(object())
        return self.timers[-1]

    def event_timer_remove(self, timer: Any) -> None:
        self.timers.remove(timer)

    def modal_handler_add(self, operator: Any) -> None:
        self.handlers.append(operator)

    def progress_begin(self, low: float, high: float) -> None:
        self.cursor = [low]

    def progress_update(self, value: float) -> None:
        self.cursor.append(value)

    def progress_end(self) -> None:
        self.cursor = []


class Window:
    """A context as a window has it, around Blender's own data."""

    def __init__(self) -> None:
        self.window_manager = Manager()
        self.window = None
        self.status: list[str | None] = []
        self.workspace = SimpleNamespace(status_text_set=self.status.append)

    def __getattr__(self, name: str) -> Any:
        return getattr(bpy.context, name)


class Move(stage.StageOperator):
    """A stage that takes as long as the test wants, and marks the first edge."""

    bl_label = "Move"

    def __init__(self) -> None:
        self.go = threading.Event()
        self.begun = threading.Event()
        self.said: list[tuple[str, str]] = []
        self.error: Exception | None = None

    def report(self, kind: set[str], text: str) -> None:
        self.said.append((*kind, text))

    def prepare(self, surface: Any, settings: Any) -> stage.Work:
        def work(progress: Any) -> Any:
            self.begun.set()
            for k in range(1000):
                progress(k / 1000, f"step: {k}")
                if self.go.wait(0.01):
                    break
            if self.error is not None:
                raise self.error
            return 7

        return work

    def finish(self, context: Any, obj: Any, surface: Any, result: Any) -> str:
        obj.data.edges[0].use_seam = True
        return f"got {result}"


@pytest.fixture
def window(monkeypatch: pytest.MonkeyPatch) -> Window:
    monkeypatch.setattr(
        stage, "bpy", SimpleNamespace(app=SimpleNamespace(background=False), ops=bpy.ops, types=bpy.types)
    )
    return Window()


@pytest.fixture
def move(dome: Any) -> Any:
    operator = Move()
    yield operator
    operator.go.set()
    background.stop_current()


def drive(operator: Any, window: Window) -> set[str]:
    """Timer ticks until the operator ends."""
    for _ in range(500):
        result = operator.modal(window, TIMER)
        if result != {"PASS_THROUGH"}:
            return result
        time.sleep(0.01)
    raise AssertionError("the job does not end")


def clean(window: Window) -> bool:
    return not window.window_manager.timers and not window.window_manager.cursor and window.status[-1] is None


def test_a_job_that_ends_writes_the_mesh(move: Any, window: Window, dome: Any) -> None:
    assert move.invoke(window, None) == {"RUNNING_MODAL"}
    assert background.current() is not None and window.window_manager.handlers == [move]
    assert "ESC" in (window.status[-1] or "")
    move.begun.wait(5)
    assert move.modal(window, TIMER) == {"PASS_THROUGH"}
    assert move.modal(window, MOUSE) == {"PASS_THROUGH"}  # the user goes on working
    assert not dome.data.edges[0].use_seam
    move.go.set()
    assert drive(move, window) == {"FINISHED"}
    assert dome.data.edges[0].use_seam
    assert move.said == [("INFO", "got 7")]
    assert clean(window) and background.current() is None


def test_escape_stops_and_changes_nothing(move: Any, window: Window, dome: Any, content: Any) -> None:
    before = content(dome)
    move.invoke(window, None)
    move.begun.wait(5)
    assert move.modal(window, ESCAPE) == {"RUNNING_MODAL"}
    assert drive(move, window) == {"CANCELLED"}
    assert content(dome) == before
    assert move.said[0][0] == "WARNING"
    assert clean(window) and background.current() is None


def test_an_error_of_the_engine_is_reported(move: Any, window: Window, dome: Any, content: Any) -> None:
    move.error = FlexMapsError("Face 3 is wrong; mend it", faces=[3])
    before = content(dome)
    move.go.set()
    move.invoke(window, None)
    assert drive(move, window) == {"CANCELLED"}
    assert move.said == [("ERROR", "Face 3 is wrong; mend it")]
    assert clean(window) and background.current() is None
    assert dome.mode == "EDIT"  # where the culprits are seen
    dome.update_from_editmode()
    assert [f.index for f in dome.data.polygons if f.select] == [3]
    assert content(dome) == before


def test_a_bug_propagates_and_leaves_nothing_running(move: Any, window: Window) -> None:
    move.error = ZeroDivisionError("a bug")
    move.go.set()
    move.invoke(window, None)
    with pytest.raises(ZeroDivisionError):
        drive(move, window)
    assert clean(window) and background.current() is None


def test_the_object_may_be_renamed_meanwhile(move: Any, window: Window, dome: Any) -> None:
    move.invoke(window, None)
    dome.name = "something else"
    move.go.set()
    assert drive(move, window) == {"FINISHED"}
    assert dome.data.edges[0].use_seam


def test_the_object_may_be_deleted_meanwhile(move: Any, window: Window, dome: Any) -> None:
    move.invoke(window, None)
    bpy.data.objects.remove(dome)
    move.go.set()
    assert drive(move, window) == {"CANCELLED"}
    assert "deleted" in move.said[0][1]
    assert clean(window) and background.current() is None


@pytest.mark.parametrize("change", ["vertex", "scale", "seam", "face"])
def test_a_mesh_changed_meanwhile_is_not_overwritten(
    move: Any, window: Window, dome: Any, content: Any, change: str
) -> None:
    move.invoke(window, None)
    if change == "vertex":
        dome.data.vertices[5].co.z += 0.01
    elif change == "scale":
        dome.scale = (2, 2, 2)
        bpy.context.view_layer.update()
    elif change == "seam":
        dome.data.edges[9].use_seam = True
    else:
        import bmesh

        bm = bmesh.new()
        bm.from_mesh(dome.data)
        bm.faces.ensure_lookup_table()
        bmesh.ops.delete(bm, geom=[bm.faces[0]], context="FACES")
        bm.to_mesh(dome.data)
        bm.free()
    before = content(dome)
    move.go.set()
    assert drive(move, window) == {"CANCELLED"}
    assert "was changed" in move.said[0][1]
    assert content(dome) == before


def test_another_file_is_loaded_meanwhile(move: Any, window: Window) -> None:
    move.invoke(window, None)
    move.begun.wait(5)
    running = background.current()
    assert running is not None
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)  # load_pre stops the job and waits for it
    assert running.finished and background.current() is None
    move.cancel(window)  # what Blender then calls
    assert clean(window)


def test_only_one_job_at_a_time(move: Any, window: Window, dome: Any) -> None:
    move.invoke(window, None)
    assert "is running" in (stage.why_not(Move, dome) or "")
    with pytest.raises(RuntimeError):
        background.Job("Other", lambda progress: None).start()


def test_a_failing_read_starts_nothing(window: Window, dome: Any) -> None:
    dome.modifiers.new("Fine", "SUBSURF")
    operator = Move()
    assert operator.invoke(window, None) == {"CANCELLED"}
    assert "Fine" in operator.said[0][1]
    assert background.current() is None and not window.window_manager.timers


def test_real_merge_in_the_background(window: Window, add: Any, seams_of: Any) -> None:
    """The same result as at once."""
    from flexmaps.operators import layout
    from flexmaps.operators.continued import ContinuedStage

    class Merge(layout.Merge.__mro__[1], Move):  # type: ignore[misc]  # LayoutStage without bpy.types.Operator
        bl_label = "Merge"
        loaded = layout.Merge.loaded
        prepare = ContinuedStage.prepare
        continuation = layout.Merge.continuation
        finish = layout.LayoutStage.finish

    here = add(shapes.make("cubesphere"), "here")
    bpy.ops.flexmaps.merge()
    there = add(shapes.make("cubesphere"), "there")
    operator = Merge()
    assert operator.invoke(window, None) == {"RUNNING_MODAL"}
    assert drive(operator, window) == {"FINISHED"}
    assert (seams_of(here) == seams_of(there)).all()


def test_ticks_are_one_line_a_step(capsys: pytest.CaptureFixture[str]) -> None:
    def work(progress: Any) -> int:
        for k in range(50):
            progress(k / 100, f"first: {k}")
        progress(0.9, "second")
        return 3

    assert background.run_here("Merge", work) == 3
    assert [line.split("% ")[1] for line in capsys.readouterr().out.splitlines()] == ["first: 0", "second"]


def test_control_c_becomes_cancelled() -> None:
    def work(progress: Any) -> None:
        raise KeyboardInterrupt

    with pytest.raises(Cancelled):
        background.run_here("Merge", work)


# -- quad remesh ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def remesh(add: Any, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Quad remesh as a window runs it, on a dome of triangles."""
    from flexmaps.operators import remesh as module

    mesh = shapes.make("dome")
    obj = add((mesh.vertices, [face for q in mesh.quads.tolist() for face in (q[:3], [q[0], q[2], q[3]])]))
    obj.flexmaps.remesh.quads = 150
    monkeypatch.setattr(module, "bpy", stage.bpy, raising=False)
    body = {k: v for base in (stage.StageOperator, module.QuadRemesh) for k, v in vars(base).items()}
    hidden = {"__dict__", "__weakref__", "bl_rna"}
    operator = type("QuadRemesh", (), {k: v for k, v in body.items() if k not in hidden})()
    operator.said = []
    operator.report = lambda kind, text: operator.said.append((*kind, text))
    yield operator
    background.stop_current()


def test_a_remesh_runs_beside_the_window(remesh: Any, window: Window) -> None:
    objects = len(bpy.data.objects)
    assert remesh.invoke(window, None) == {"RUNNING_MODAL"}
    assert background.current() is not None and "ESC" in (window.status[-1] or "") and len(bpy.data.objects) == objects
    assert not bpy.ops.flexmaps.check.poll()
    assert remesh.modal(window, MOUSE) == {"PASS_THROUGH"}  # the user goes on working
    remesh._job._thread.join()
    assert drive(remesh, window) == {"FINISHED"}
    assert remesh.said[0][0] == "INFO" and bpy.context.object.name == "piece quads"
    assert clean(window) and background.current() is None


def test_a_remesh_that_is_stopped_leaves_nothing(remesh: Any, window: Window, monkeypatch: pytest.MonkeyPatch) -> None:
    """Though QuadriFlow itself cannot be stopped, and here never comes back."""
    from flexmaps.bridge.hosts import second_blender

    started, start = [], second_blender._started
    monkeypatch.setattr(second_blender, "_started", lambda folder: started.append(start(folder)) or started[-1])
    monkeypatch.setattr(
        second_blender.json, "dumps", lambda wanted: "["
    )  # nothing is ever asked: Blender waits for the rest
    monkeypatch.setattr(second_blender, "LIMIT", 1e6)
    before = {o.name for o in bpy.data.objects}, {m.name for m in bpy.data.meshes}
    remesh.invoke(window, None)
    while not started:
        assert not remesh._job.finished
        remesh.modal(window, TIMER)
    remesh.modal(window, ESCAPE)
    assert drive(remesh, window) == {"CANCELLED"}
    assert ({o.name for o in bpy.data.objects}, {m.name for m in bpy.data.meshes}) == before
    assert remesh.said == [("WARNING", "Quad remesh was stopped; nothing was changed")]
    assert bpy.context.object.name == "piece" and clean(window) and background.current() is None
    assert all(process.poll() is not None for process in started)


def test_another_file_is_loaded_during_a_remesh(remesh: Any, window: Window) -> None:
    remesh.invoke(window, None)
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    assert background.current() is None
    remesh.cancel(window)
    assert clean(window)


def test_the_numerics_are_imported_once_and_only_with_a_window(monkeypatch: pytest.MonkeyPatch) -> None:
    from flexmaps.bridge.hosts import preload

    monkeypatch.setattr(preload, "_begun", [])
    preload.start()
    assert not preload._begun  # this Blender has no window
    monkeypatch.setattr(preload, "bpy", SimpleNamespace(app=SimpleNamespace(background=False)))
    preload.start()
    preload.start()
    preload.wait()
    assert len(preload._begun) == 1 and not preload._begun[0].is_alive()
    assert {f"flexmaps.{name}" for name in preload.MODULES} <= set(sys.modules)


# -- what is made for a job that goes on ---------------------------------------------------------------------------------


@pytest.fixture
def report(dome: Any) -> Any:
    """Report as a window runs it, on a dome with patches."""
    from flexmaps.operators import report as module
    from flexmaps.operators.continued import ContinuedStage

    assert bpy.ops.flexmaps.trace() == {"FINISHED"}
    dome.flexmaps.export.folder = "//"
    body = {k: v for base in (stage.StageOperator, ContinuedStage, module.Report) for k, v in vars(base).items()}
    hidden = {"__dict__", "__weakref__", "bl_rna", "__annotations__"}
    operator = type("Report", (), {k: v for k, v in body.items() if k not in hidden} | {"files": False})()
    operator.said = []
    operator.report = lambda kind, text: operator.said.append((*kind, text))
    yield operator
    background.stop_current()


def test_a_report_is_seen_before_its_letters_are_made(
    report: Any, window: Window, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Making them draws every window anew."""
    from flexmaps.bridge.view import raster

    made, glyphs = [], raster.glyphs
    monkeypatch.setattr(raster, "glyphs", lambda: made.append(1) or glyphs())
    assert report.invoke(window, None) == {"RUNNING_MODAL"}
    assert not made and "ESC" in (window.status[-1] or "")
    assert drive(report, window) == {"FINISHED"} and len(made) == 1
    assert "pictures" in report.said[0][1] and clean(window)


def test_a_report_that_waits_for_letters_can_be_stopped(report: Any, window: Window) -> None:
    report.invoke(window, None)
    background.stop_current()  # as when another file is loaded: the letters never come
    assert background.current() is None


def test_while_a_job_runs_the_window_need_not_wait_long_for_python(move: Any, window: Window) -> None:
    before = sys.getswitchinterval()
    move.invoke(window, None)
    assert sys.getswitchinterval() < before / 5
    move.go.set()
    drive(move, window)
    assert sys.getswitchinterval() == before


def test_what_is_changed_while_a_job_runs_is_no_part_of_its_result(
    move: Any, window: Window, spiralled: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A result is made from the settings that its stage began with: with another material it is out of date at once."""
    from flexmaps.bridge.store import notes, states

    def finish(context: Any, obj: Any, surface: Any, result: Any) -> str:
        notes.write(obj.data, "equilibrium", {})
        return "done"

    monkeypatch.setattr(move, "finish", finish)
    move.invoke(window, None)
    spiralled.flexmaps.simulate.gravity = not spiralled.flexmaps.simulate.gravity
    move.go.set()
    assert drive(move, window) == {"FINISHED"}
    state = states.of(spiralled, bpy.context.scene)["equilibrium"]
    assert (state.kind, state.part) == (states.OLD, "simulate")
    spiralled.flexmaps.simulate.gravity = not spiralled.flexmaps.simulate.gravity
    assert states.of(spiralled, bpy.context.scene)["equilibrium"].kind == states.DONE


@pytest.mark.parametrize("frame", [0.0, 0.015, 0.09, 0.4, 3.0])
def test_drawing_takes_a_tenth_of_the_time(frame: float) -> None:
    """However long one drawing takes; a clock stands for the window."""
    pace, now, drawn = stage.Pace(), 0.0, []
    while now < 120.0:
        if pace.due(now):
            drawn.append(now)
            now += frame
        now += stage.TICK
    assert len(drawn) * frame <= stage.SHARE * now + frame
    longest = max(stage.LEAST, (frame + stage.TICK) / stage.SHARE) + 2 * stage.TICK
    assert len(drawn) >= now / longest - 1  # and yet as often as that allows

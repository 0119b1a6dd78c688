"""The background job, driven by hand: a window's events are played to the operators."""

from __future__ import annotations

import sys
import threading
from types import SimpleNamespace
from typing import Any

import bpy
import pytest
from flexmaps.bridge.hosts import background
from flexmaps.bridge.view import framing, progress
from flexmaps.engine.errors import Cancelled, FlexMapsError
from flexmaps.engine.surface import shapes
from flexmaps.operators import stage
from support.window import ESCAPE, MOUSE, TIMER, Window, clean, drive


class Move(stage.StageOperator):
    """A stage that takes as long as the test wants, and marks the first edge."""

    bl_idname = "flexmaps.move"
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
    played = SimpleNamespace(app=SimpleNamespace(background=False), ops=bpy.ops, types=bpy.types)
    for module in (stage, framing):
        monkeypatch.setattr(module, "bpy", played)
    return Window()


@pytest.fixture
def move(dome: Any) -> Any:
    operator = Move()
    yield operator
    operator.go.set()
    background.stop_current()


def test_a_job_that_ends_writes_the_mesh(move: Any, window: Window, dome: Any) -> None:
    assert move.invoke(window, None) == {"RUNNING_MODAL"}
    assert background.current_job() is not None and window.window_manager.handlers == [move]
    assert "ESC" in (window.status[-1] or "")
    move.begun.wait(5)
    assert move.modal(window, TIMER) == {"PASS_THROUGH"}
    assert move.modal(window, MOUSE) == {"PASS_THROUGH"}  # the user goes on working
    assert not dome.data.edges[0].use_seam
    move.go.set()
    assert drive(move, window) == {"FINISHED"}
    assert dome.data.edges[0].use_seam
    assert move.said == [("INFO", "got 7")]
    assert clean(window) and background.current_job() is None


def test_escape_stops_and_changes_nothing(move: Any, window: Window, dome: Any, content: Any) -> None:
    before = content(dome)
    move.invoke(window, None)
    move.begun.wait(5)
    assert move.modal(window, ESCAPE) == {"RUNNING_MODAL"}
    assert drive(move, window) == {"CANCELLED"}
    assert content(dome) == before
    assert move.said[0][0] == "WARNING"
    assert clean(window) and background.current_job() is None


def test_an_error_of_the_engine_is_reported(move: Any, window: Window, dome: Any, content: Any) -> None:
    move.error = FlexMapsError("Face 3 is wrong; mend it", faces=[3])
    before = content(dome)
    move.go.set()
    move.invoke(window, None)
    assert drive(move, window) == {"CANCELLED"}
    assert move.said == [("ERROR", "Face 3 is wrong; mend it")]
    assert clean(window) and background.current_job() is None
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
    assert clean(window) and background.current_job() is None


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
    assert clean(window) and background.current_job() is None


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
    running = background.current_job()
    assert running is not None
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)  # load_pre stops the job and waits for it
    assert running.is_finished and background.current_job() is None
    move.cancel(window)  # what Blender then calls
    assert clean(window)


def test_only_one_job_at_a_time(move: Any, window: Window, dome: Any) -> None:
    move.invoke(window, None)
    assert "is running" in (stage.reason_unavailable(Move.obstacle, dome) or "")
    with pytest.raises(RuntimeError):
        background.Job("Other", lambda progress: None).start()


def test_a_failing_read_starts_nothing(window: Window, dome: Any) -> None:
    dome.modifiers.new("Fine", "SUBSURF")
    operator = Move()
    assert operator.invoke(window, None) == {"CANCELLED"}
    assert "Fine" in operator.said[0][1]
    assert background.current_job() is None and not window.window_manager.timers


def test_real_merge_in_the_background(window: Window, add: Any, seams_of: Any) -> None:
    """The same result as at once."""
    from flexmaps.operators import layout
    from flexmaps.operators.continued_stage import ContinuedStage

    class Merge(layout.Merge.__mro__[1], Move):  # type: ignore[misc]  # LayoutStage without bpy.types.Operator
        bl_idname = "flexmaps.merge"
        bl_label = "Merge"
        reads_loads = layout.Merge.reads_loads
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

    assert background.run_blocking("Merge", work) == 3
    assert [line.split("% ")[1] for line in capsys.readouterr().out.splitlines()] == ["First: 0", "Second"]


def test_control_c_becomes_cancelled() -> None:
    def work(progress: Any) -> None:
        raise KeyboardInterrupt

    with pytest.raises(Cancelled):
        background.run_blocking("Merge", work)


def test_the_numerics_are_imported_once_and_only_with_a_window(monkeypatch: pytest.MonkeyPatch) -> None:
    from flexmaps.bridge.hosts import preload

    monkeypatch.setattr(preload, "_threads", [])
    preload.start()
    assert not preload._threads  # this Blender has no window
    monkeypatch.setattr(preload, "bpy", SimpleNamespace(app=SimpleNamespace(background=False)))
    preload.start()
    preload.start()
    preload.wait()
    assert len(preload._threads) == 1 and not preload._threads[0].is_alive()
    assert {f"flexmaps.{name}" for name in preload.MODULES} <= set(sys.modules)


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
    from flexmaps.bridge.store import states, stored_report

    def finish(context: Any, obj: Any, surface: Any, result: Any) -> str:
        stored_report.write(obj.data, "equilibrium", {})
        return "done"

    monkeypatch.setattr(move, "finish", finish)
    move.invoke(window, None)
    spiralled.flexmaps.simulate.gravity = not spiralled.flexmaps.simulate.gravity
    move.go.set()
    assert drive(move, window) == {"FINISHED"}
    state = states.read_states(spiralled, bpy.context.scene)["equilibrium"]
    assert (state.kind, state.changed_input) == (states.STALE, "simulate")
    spiralled.flexmaps.simulate.gravity = not spiralled.flexmaps.simulate.gravity
    assert states.read_states(spiralled, bpy.context.scene)["equilibrium"].kind == states.DONE


@pytest.mark.parametrize("frame", [0.0, 0.015, 0.09, 0.4, 3.0])
def test_drawing_takes_a_tenth_of_the_time(frame: float) -> None:
    """However long one drawing takes; a clock stands for the window."""
    pace, now, drawn = progress.RedrawPacer(), 0.0, []
    while now < 120.0:
        if pace.is_due(now):
            drawn.append(now)
            now += frame
        now += stage.POLL_INTERVAL
    assert len(drawn) * frame <= progress.MAX_SHARE * now + frame
    longest = max(progress.MIN_INTERVAL, (frame + stage.POLL_INTERVAL) / progress.MAX_SHARE) + 2 * stage.POLL_INTERVAL
    assert len(drawn) >= now / longest - 1  # and yet as often as that allows

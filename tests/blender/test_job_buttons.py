"""Quad remesh and Report as background jobs: both need Blender while they go on."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import bpy
import pytest
from flexmaps.bridge.hosts import background
from flexmaps.engine.surface import shapes
from flexmaps.operators import stage
from support.window import ESCAPE, MOUSE, TIMER, Window, clean, drive


@pytest.fixture
def window(monkeypatch: pytest.MonkeyPatch) -> Window:
    monkeypatch.setattr(
        stage, "bpy", SimpleNamespace(app=SimpleNamespace(background=False), ops=bpy.ops, types=bpy.types)
    )
    return Window()


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
    operator.said, operator.quads, operator.size = [], 0, 0.0
    operator.report = lambda kind, text: operator.said.append((*kind, text))
    yield operator
    background.stop_current()


def test_a_remesh_runs_beside_the_window(remesh: Any, window: Window) -> None:
    objects = len(bpy.data.objects)
    assert remesh.invoke(window, None) == {"RUNNING_MODAL"}
    assert (
        background.current_job() is not None and "ESC" in (window.status[-1] or "") and len(bpy.data.objects) == objects
    )
    assert not bpy.ops.flexmaps.check.poll()
    assert remesh.modal(window, MOUSE) == {"PASS_THROUGH"}  # the user goes on working
    remesh._job._thread.join()
    assert drive(remesh, window) == {"FINISHED"}
    assert remesh.said[0][0] == "INFO" and bpy.context.object.name == "piece quads"
    assert clean(window) and background.current_job() is None


def test_a_remesh_that_is_stopped_leaves_nothing(remesh: Any, window: Window, monkeypatch: pytest.MonkeyPatch) -> None:
    """Though QuadriFlow itself cannot be stopped, and here never comes back."""
    from flexmaps.bridge.hosts import second_blender

    started, start = [], second_blender.start_blender
    monkeypatch.setattr(second_blender, "start_blender", lambda *given: started.append(start(*given)) or started[-1])
    monkeypatch.setattr(
        second_blender.json, "dumps", lambda wanted: "["
    )  # nothing is ever asked: Blender waits for the rest
    monkeypatch.setattr(second_blender, "TIMEOUT", 1e6)
    before = {o.name for o in bpy.data.objects}, {m.name for m in bpy.data.meshes}
    remesh.invoke(window, None)
    while not started:
        assert not remesh._job.is_finished
        remesh.modal(window, TIMER)
    remesh.modal(window, ESCAPE)
    assert drive(remesh, window) == {"CANCELLED"}
    assert ({o.name for o in bpy.data.objects}, {m.name for m in bpy.data.meshes}) == before
    assert remesh.said == [("WARNING", "Quad remesh was stopped; nothing was changed")]
    assert bpy.context.object.name == "piece" and clean(window) and background.current_job() is None
    assert all(process.poll() is not None for process in started)


def test_another_file_is_loaded_during_a_remesh(remesh: Any, window: Window) -> None:
    remesh.invoke(window, None)
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    assert background.current_job() is None
    remesh.cancel(window)
    assert clean(window)


@pytest.fixture
def report(dome: Any) -> Any:
    """Report as a window runs it, on a dome with patches."""
    from flexmaps.operators import report as module
    from flexmaps.operators.continued_stage import ContinuedStage

    assert bpy.ops.flexmaps.trace() == {"FINISHED"}
    dome.flexmaps.export.folder = "//"
    body = {k: v for base in (stage.StageOperator, ContinuedStage, module.Report) for k, v in vars(base).items()}
    hidden = {"__dict__", "__weakref__", "bl_rna", "__annotations__"}
    operator = type("Report", (), {k: v for k, v in body.items() if k not in hidden} | {"files": False})()
    operator.said, operator.quads, operator.size = [], 0, 0.0
    operator.report = lambda kind, text: operator.said.append((*kind, text))
    yield operator
    background.stop_current()


def test_a_report_is_seen_before_its_letters_are_made(
    report: Any, window: Window, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Making them draws every window anew."""
    from flexmaps.bridge.view import images

    made, glyphs = [], images.glyphs
    monkeypatch.setattr(images, "glyphs", lambda: made.append(1) or glyphs())
    assert report.invoke(window, None) == {"RUNNING_MODAL"}
    assert not made and "ESC" in (window.status[-1] or "")
    assert drive(report, window) == {"FINISHED"} and len(made) == 1
    assert "pictures" in report.said[0][1] and clean(window)


def test_a_report_that_waits_for_letters_can_be_stopped(report: Any, window: Window) -> None:
    report.invoke(window, None)
    background.stop_current()  # as when another file is loaded: the letters never come
    assert background.current_job() is None

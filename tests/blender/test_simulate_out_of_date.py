"""A simulation on the mesh when something is changed, and one that is stopped or finds nothing."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps.bridge.hosts import background
from flexmaps.bridge.store import equilibrium, mesh, settings, shape_keys, states, stored_report
from flexmaps.bridge.view import live_shape
from flexmaps.engine.errors import Cancelled
from flexmaps.engine.params import ObjectSettings
from flexmaps.engine.simulation import simulate as engine
from flexmaps.operators import simulate as operators
from support.arch import LENGTH, WIDTH, basis, ends, group, key_of, spiralled
from support.buttons import press


@pytest.fixture
def piece(add: Any) -> Any:
    """An arch with its spirals, ready to be simulated."""
    return spiralled(add)


class Button(operators.Simulate.__mro__[1]):  # type: ignore[misc, name-defined]  # ContinuedStage without bpy.types.Operator
    """The operator without Blender's part of it."""

    bl_idname = "flexmaps.simulate"
    bl_label = "Simulate"
    required_output, reads_loads = operators.Simulate.required_output, operators.Simulate.reads_loads
    continuation, finish = operators.Simulate.continuation, operators.Simulate.finish


# -- out of date -------------------------------------------------------------------------------------------------------


def shake(obj: Any) -> None:
    obj.data.vertices[5].co.z += 0.001


def slide(obj: Any) -> None:
    """Move every other vertex along the arch."""
    for block in (obj.data.vertices, obj.data.shape_keys.key_blocks[0].data):
        for vertex in list(block)[::2]:
            vertex.co.y += 0.004


def remove_face(obj: Any) -> None:
    import bmesh

    bm = bmesh.new()
    bm.from_mesh(obj.data)
    bm.faces.ensure_lookup_table()
    bmesh.ops.delete(bm, geom=[bm.faces[0]], context="FACES")
    bm.to_mesh(obj.data)
    bm.free()


CHANGES: dict[str, Callable[[Any], None]] = {
    "vertex": shake,
    "face": remove_face,
    "material": lambda obj: setattr(obj.flexmaps.material, "material", "birch"),
    "thickness": lambda obj: setattr(obj.flexmaps.spiral, "thickness", 1.5),
    "model": lambda obj: setattr(obj.flexmaps.simulate, "model", "rod"),
    "supports": lambda obj: setattr(obj.flexmaps.loads, "supports", "any"),
    "size": lambda obj: setattr(obj, "scale", (2.0, 2.0, 2.0)),
    "twist": lambda obj: setattr(obj.data.attributes["flexmaps_twist"].data[0], "value", 7.0),
}


@pytest.mark.parametrize("change", CHANGES)
def test_what_was_changed_since_is_not_shown_as_current(piece: Any, change: str) -> None:
    press("simulate")
    press("overlay", kind="DISTANCE")
    CHANGES[change](piece)
    bpy.context.view_layer.update()
    assert states.is_stale(piece, bpy.context.scene, "equilibrium")
    with pytest.raises(RuntimeError):
        bpy.ops.flexmaps.overlay(kind="SAFETY")


def test_what_does_not_matter_leaves_it_current(piece: Any) -> None:
    press("simulate")
    piece.location, piece.rotation_euler, piece.name = (1.0, 2.0, 3.0), (0.3, 0.2, 0.1), "renamed"
    piece.flexmaps.sheet.margin = 7.0
    piece.data.shape_keys.key_blocks[equilibrium.EQUILIBRIUM_KEY].value = 0.3
    bpy.context.view_layer.update()
    assert not states.is_stale(piece, bpy.context.scene, "equilibrium")


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
@pytest.mark.parametrize("button", ["regularise", "flatten", "spirals"])
def test_an_earlier_stage_takes_the_result_away(piece: Any, button: str, mode: str) -> None:
    target = basis(piece)
    press("simulate")
    if button == "regularise":  # which moves nothing where quads are square
        slide(piece)
    bpy.ops.object.mode_set(mode=mode)
    press(button)
    bpy.ops.object.mode_set(mode="OBJECT")
    assert "equilibrium" not in stored_report.read(piece.data)
    assert shape_keys.equilibrium_key(piece.data) is None
    assert not {f"flexmaps_{name}" for name in equilibrium.NAMES} & {a.name for a in piece.data.attributes}
    if button != "regularise":
        assert basis(piece) == pytest.approx(target, abs=1e-7)


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
def test_a_simulated_shape_without_a_basis_becomes_the_surface(piece: Any, mode: str) -> None:
    """Where the user deletes the basis in the list of shape keys."""
    press("simulate")
    shape = key_of(piece)
    piece.shape_key_remove(piece.data.shape_keys.key_blocks[0])
    bpy.ops.object.mode_set(mode=mode)
    press("spirals")
    bpy.ops.object.mode_set(mode="OBJECT")
    assert not equilibrium.simulated_keys(piece.data)
    assert basis(piece) == pytest.approx(shape, abs=1e-6)


def test_keys_of_the_user_are_left_alone(piece: Any, all_of: Any) -> None:
    piece.shape_key_add(name="Basis")
    piece.shape_key_add(name="mine")
    before = all_of(piece)
    press("simulate")
    assert [b.name for b in piece.data.shape_keys.key_blocks] == ["Basis", "mine", equilibrium.EQUILIBRIUM_KEY]
    press("spirals")
    assert {k: v for k, v in all_of(piece).items() if k.startswith("key")} == {
        k: v for k, v in before.items() if k.startswith("key")
    }


# -- stopped, and not found --------------------------------------------------------------------------------------------


def test_a_running_simulation_shows_its_shape_and_touches_nothing(
    piece: Any, all_of: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the background, up to the moment of ESC; what a window adds to it is the same for every stage."""
    real = engine.simulate

    def endless(*args: Any, progress: Any, **named: Any) -> Any:
        while True:
            real(*args, progress=progress, **named)

    monkeypatch.setattr(engine, "simulate", endless)
    before = all_of(piece)
    surface = mesh.read_surface(piece, bpy.context.scene)
    work = Button().prepare(surface, settings.read(piece.flexmaps, ObjectSettings))
    running = background.Job("Simulate", work)
    running.start()
    try:
        until, said = time.monotonic() + 20.0, ""
        while (running.intermediate is None or "Coming to rest" not in said) and time.monotonic() < until:
            said = running.text
            time.sleep(0.001)
        assert isinstance(running.intermediate, live_shape.LiveShape)
        points, rgba, lines = running.intermediate.faces_and_lines(1.0)
        assert points.shape == (12 * LENGTH * WIDTH, 3) and len(lines) == 8 * LENGTH * WIDTH
        assert np.isfinite(points).all() and ((rgba >= 0) & (rgba <= 1)).all()
        assert "Coming to rest" in said
    finally:
        running.end()
    assert isinstance(running.error, Cancelled)
    assert all_of(piece) == before


def test_stopped_from_the_keyboard(piece: Any, all_of: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    real = engine.solve

    def interrupted(*args: Any, **options: Any) -> Any:
        real(*args, **options)
        raise KeyboardInterrupt

    monkeypatch.setattr(engine, "solve", interrupted)
    before = all_of(piece)
    assert bpy.ops.flexmaps.simulate() == {"CANCELLED"}
    assert all_of(piece) == before


def test_not_found_is_a_warning_not_a_success(piece: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[tuple[str, str]] = []

    class Simulate(Button):
        def report(self, kind: set[str], text: str) -> None:
            said.append((*kind, text))

    piece.flexmaps.simulate.iterations = 1
    Simulate().execute(bpy.context)
    block = stored_report.read(piece.data)["equilibrium"]
    assert not block["converged"] and not equilibrium.is_reliable(block)
    assert said[-1][0] == "WARNING" and block["status"] in said[-1][1]
    piece.flexmaps.simulate.iterations = 200
    Simulate().execute(bpy.context)  # a seamless strip that nothing holds
    assert said[-1][0] == "WARNING" and "stays flat" in said[-1][1]
    group(piece, "ends", ends(piece))
    piece.flexmaps.loads.supports = "ends"
    Simulate().execute(bpy.context)
    assert said[-1][0] == "INFO"
    piece.flexmaps.material.material, piece.flexmaps.material.strain_limit = "custom", 0.0001
    Simulate().execute(bpy.context)
    assert said[-1][0] == "WARNING" and "of what the material bears" in said[-1][1]

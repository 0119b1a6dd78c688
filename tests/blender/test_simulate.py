"""The Simulate button: what it writes, what it refuses, when its result is out of date, and how it is stopped."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps.bridge.hosts import background
from flexmaps.bridge.store import equilibrium, mesh, notes, settings
from flexmaps.bridge.view import live_shape, scene
from flexmaps.command import main as command
from flexmaps.engine.assembling import check as assembly_check
from flexmaps.engine.assembling import sheet as assembly_sheet
from flexmaps.engine.errors import Cancelled
from flexmaps.engine.params import LoadParams, MaterialParams, ObjectSettings
from flexmaps.engine.simulation import simulate as engine
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import QuadMesh
from flexmaps.operators import simulate as operators

LENGTH, WIDTH, EDGE = 8, 3, 0.02


def arch() -> QuadMesh:
    """A third of a tube, its ends at the lowest z: it unrolls into one flat panel."""
    u, v = np.meshgrid(np.arange(LENGTH + 1), np.arange(WIDTH + 1), indexing="ij")
    index = np.arange(u.size).reshape(u.shape)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1, 4)
    radius = LENGTH * EDGE / (2 * np.pi / 3)
    angle = (u.ravel() / LENGTH - 0.5) * 2 * np.pi / 3
    return QuadMesh(np.stack([radius * np.sin(angle), EDGE * v.ravel(), radius * np.cos(angle)], axis=1), quads)


def press(name: str, **properties: Any) -> None:
    assert getattr(bpy.ops.flexmaps, name)(**properties) == {"FINISHED"}


class Button(operators.Simulate.__mro__[1]):  # type: ignore[misc, name-defined]  # ContinuedStage without bpy.types.Operator
    """The operator without Blender's part of it."""

    bl_label = "Simulate"
    needs, loaded = operators.Simulate.needs, operators.Simulate.loaded
    continuation, finish = operators.Simulate.continuation, operators.Simulate.finish


@pytest.fixture
def piece(add: Any) -> Any:
    """An arch with its spirals, ready to be simulated."""
    obj = add(arch())
    obj.flexmaps.material.material = "vero"
    press("flatten")
    press("spirals")
    return obj


def group(obj: Any, name: str, vertices: Any) -> None:
    obj.vertex_groups.new(name=name).add([int(v) for v in vertices], 1.0, "REPLACE")


def ends(obj: Any) -> np.ndarray:
    """Vertices of the border at both ends: two corners of every quad there."""
    low = np.array([v.co.z for v in obj.data.vertices])
    return np.flatnonzero(low < low.min() + 1e-5)


def key_of(obj: Any, name: str = equilibrium.KEY) -> np.ndarray:
    """(V, 3) a shape key, in the object's frame."""
    block = obj.data.shape_keys.key_blocks[name]
    found = np.empty(3 * len(block.data), np.float32)
    block.data.foreach_get("co", found)
    return found.reshape(-1, 3).astype(float)


def basis(obj: Any) -> np.ndarray:
    return np.array([v.co[:] for v in obj.data.vertices])


def planar(points: np.ndarray) -> float:
    """How far points stray from their best plane."""
    return float(np.linalg.svd(points - points.mean(axis=0))[1][2] / np.sqrt(len(points)))


@pytest.fixture
def all_of(content: Callable[[Any], dict[str, bytes]]) -> Callable[[Any], dict[str, bytes]]:
    """What the mesh holds, shape keys included."""

    def found(obj: Any) -> dict[str, bytes]:
        keys = obj.data.shape_keys
        blocks = () if keys is None else keys.key_blocks
        return content(obj) | {f"key {b.name}": np.array([p.co[:] for p in b.data]).tobytes() for b in blocks}

    return found


# -- what is written ---------------------------------------------------------------------------------------------------


def test_a_free_arch_springs_flat(piece: Any, attribute: Any) -> None:
    """Nothing holds what was cut from a flat sheet: it is flat again, however the target was bent."""
    before = basis(piece)
    press("simulate")
    assert basis(piece) == pytest.approx(before, abs=0)
    found = key_of(piece)
    assert planar(before) > 0.1 * EDGE and planar(found) < 1e-3 * EDGE
    assert np.ptp(found, axis=0).max() == pytest.approx(LENGTH * EDGE, rel=0.01)
    key = piece.data.shape_keys.key_blocks[equilibrium.KEY]
    assert key.value == 1.0 and piece.active_shape_key_index == 0
    block = notes.read(piece.data)["equilibrium"]
    assert block["converged"] and block["negative_eigenvalues"] == 0 and block["model"] == "arm"
    distance = attribute(piece, "flexmaps_distance")
    assert block["rms_mm"] == pytest.approx(np.sqrt((distance**2).mean()), rel=1e-4)
    assert block["max_mm"] == pytest.approx(distance.max(), rel=1e-4)
    assert attribute(piece, "flexmaps_strain").max() == pytest.approx(block["strain_share_max"], abs=1e-6)
    # distances are those between the middles of the quads
    quads = np.array([p.vertices[:] for p in piece.data.polygons])
    moved = np.linalg.norm(found[quads].mean(axis=1) - before[quads].mean(axis=1), axis=1) * 1e3
    assert moved == pytest.approx(distance, abs=0.02 * EDGE * 1e3)


def test_what_is_seen_slides_from_target_to_result(piece: Any) -> None:
    press("simulate")
    key, target, result = piece.data.shape_keys.key_blocks[equilibrium.KEY], basis(piece), key_of(piece)
    for share in (0.0, 0.5, 1.0):
        key.value = share
        seen = piece.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        wanted = target + share * (result - target)
        assert np.array([v.co[:] for v in seen.vertices]) == pytest.approx(wanted, abs=1e-6)
        assert equilibrium.shown_positions(piece.data) == pytest.approx(wanted, abs=1e-6)  # where colours are drawn


def test_supports_stay_where_they_are(piece: Any, attribute: Any) -> None:
    group(piece, "ends", ends(piece))
    piece.flexmaps.loads.supports = "ends"
    press("simulate")
    held = [p.index for p in piece.data.polygons if set(p.vertices) & set(ends(piece).tolist())]
    assert len(held) == 2 * WIDTH
    distance = attribute(piece, "flexmaps_distance")
    assert distance[held] == pytest.approx(np.zeros(len(held)), abs=1e-4)
    assert planar(key_of(piece)) > 0.1 * EDGE  # it remains an arch
    assert attribute(piece, "flexmaps_strain_energy").max() > 0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_force_moves_what_it_pulls_at(piece: Any, sign: float) -> None:
    middle = np.flatnonzero(basis(piece)[:, 2] > basis(piece)[:, 2].max() - 0.1 * EDGE)
    group(piece, "ends", ends(piece))
    group(piece, "top", middle)
    piece.flexmaps.loads.supports = "ends"
    press("simulate")
    rest = key_of(piece)[middle, 2].mean()
    piece.flexmaps.loads.pulled, piece.flexmaps.loads.force_z = "top", 0.02 * sign
    press("simulate")
    assert sign * (key_of(piece)[middle, 2].mean() - rest) > 1e-4 * EDGE


def test_weight_pulls_down(piece: Any) -> None:
    group(piece, "ends", ends(piece))
    piece.flexmaps.loads.supports = "ends"
    press("simulate")
    rest = key_of(piece)[:, 2].mean()
    piece.flexmaps.simulate.gravity = True
    press("simulate")
    assert key_of(piece)[:, 2].mean() < rest


@pytest.mark.parametrize("unit, scale", [(0.001, (1000, 1000, 1000)), (1.0, (-1, 1, 1)), (0.1, (2, 2, 2))])
def test_the_same_shape_in_any_unit_and_frame(add: Any, attribute: Any, unit: float, scale: Any) -> None:
    plain = add(arch(), "plain")
    for button in ("flatten", "spirals", "simulate"):
        press(button)
    quads = arch().quads if min(scale) > 0 else arch().quads[:, ::-1]
    other = add((arch().vertices / np.array(scale) / unit, quads), "other")
    bpy.context.scene.unit_settings.scale_length = unit
    other.scale, other.location = scale, (3.0, -1.0, 2.0)
    bpy.context.view_layer.update()
    for button in ("flatten", "spirals", "simulate"):
        press(button)
    assert attribute(other, "flexmaps_distance") == pytest.approx(attribute(plain, "flexmaps_distance"), abs=0.05)
    world = key_of(other) * np.array(scale) * unit
    assert world == pytest.approx(key_of(plain), abs=0.01 * EDGE)


def test_in_edit_mode(piece: Any) -> None:
    bpy.ops.object.mode_set(mode="EDIT")
    press("simulate")
    assert piece.mode == "OBJECT"  # shape keys are seen there
    assert planar(key_of(piece)) < 1e-3 * EDGE


def test_two_objects_may_share_the_mesh(piece: Any) -> None:
    twin = piece.copy()
    bpy.context.scene.collection.objects.link(twin)
    press("simulate")
    assert twin.data == piece.data and not equilibrium.out_of_date(twin, bpy.context.scene)
    press("spirals")
    assert piece.data.shape_keys is None


def test_the_target_is_what_is_read(piece: Any, tmp_path: Path) -> None:
    """Whichever key is shown or edited, the stages and the main job go on with the target."""
    press("simulate")
    target = basis(piece)
    for active in (0, 1):
        piece.active_shape_key_index = active
        for mode in ("OBJECT", "EDIT"):
            bpy.ops.object.mode_set(mode=mode)
            surface = mesh.read_surface(piece, bpy.context.scene)
            assert surface.positions == pytest.approx(target, abs=1e-7)
        bpy.ops.object.mode_set(mode="OBJECT")
    piece.flexmaps.remesh.quads = 60
    press("quad_remesh")
    assert bpy.context.object != piece
    assert tuple(bpy.context.object.dimensions) == pytest.approx(tuple(np.ptp(target, axis=0)), abs=0.3 * EDGE)
    bpy.context.view_layer.objects.active = piece
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "piece.blend"))
    assert scene.read_blend(tmp_path / "piece.blend").vertices == pytest.approx(target, abs=1e-7)


def test_another_shape_gets_its_own_key(piece: Any) -> None:
    """Between hinged ends that are closer than it is long, the arch rests above and, snapped through, as well below."""
    group(piece, "ends", ends(piece))
    piece.flexmaps.loads.supports, piece.flexmaps.simulate.clamped = "ends", False
    piece.flexmaps.simulate.restarts = 2
    press("simulate")
    block = notes.read(piece.data)["equilibrium"]
    assert block["other_energies"][0] == pytest.approx(block["energy"], rel=1e-6)
    top, height = np.argmax(basis(piece)[:, 2]), basis(piece)[ends(piece), 2].mean()
    assert key_of(piece)[top, 2] > height + EDGE
    assert key_of(piece, f"{equilibrium.OTHER} 1")[top, 2] < height - 0.5 * EDGE
    keys = equilibrium.keys_of(piece.data)
    assert [k.name for k in keys] == [equilibrium.KEY, *(f"{equilibrium.OTHER} {i + 1}" for i in range(len(keys) - 1))]
    assert len(keys) == 1 + len(block["other_energies"]) and [k.value for k in keys] == [1.0] + [0.0] * (len(keys) - 1)
    piece.flexmaps.simulate.restarts = 0
    press("simulate")
    assert [k.name for k in equilibrium.keys_of(piece.data)] == [equilibrium.KEY]
    piece.flexmaps.simulate.restarts = 2
    press("simulate")
    press("spirals")
    assert piece.data.shape_keys is None


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
def test_undo_and_redo(piece: Any, all_of: Any, mode: str) -> None:
    name = piece.name
    bpy.ops.object.mode_set(mode=mode)
    bpy.ops.ed.undo_push(message="before")
    before = all_of(piece)
    press("simulate")
    bpy.ops.ed.undo_push(message="simulate")
    after = all_of(bpy.data.objects[name])
    bpy.ops.ed.undo()
    assert all_of(bpy.data.objects[name]) == before
    assert bpy.data.objects[name].data.shape_keys is None
    bpy.ops.ed.redo()
    assert all_of(bpy.data.objects[name]) == after


def test_saved_and_opened_again(piece: Any, all_of: Any, tmp_path: Path) -> None:
    press("simulate")
    before = all_of(piece)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "piece.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "piece.blend"))
    piece = bpy.data.objects["piece"]
    assert all_of(piece) == before
    assert not equilibrium.out_of_date(piece, bpy.context.scene)


def test_the_published_model_knows_no_strain(piece: Any) -> None:
    press("simulate")
    piece.flexmaps.simulate.model = "rod"
    press("simulate")
    assert notes.read(piece.data)["equilibrium"]["model"] == "rod"
    assert "flexmaps_strain" not in piece.data.attributes
    with pytest.raises(RuntimeError, match="nothing to show"):
        bpy.ops.flexmaps.overlay(kind="SAFETY")


# -- out of date -------------------------------------------------------------------------------------------------------


def shake(obj: Any) -> None:
    obj.data.vertices[5].co.z += 0.001


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
    assert equilibrium.out_of_date(piece, bpy.context.scene)
    with pytest.raises(RuntimeError):
        bpy.ops.flexmaps.overlay(kind="SAFETY")


def test_what_does_not_matter_leaves_it_current(piece: Any) -> None:
    press("simulate")
    piece.location, piece.rotation_euler, piece.name = (1.0, 2.0, 3.0), (0.3, 0.2, 0.1), "renamed"
    piece.flexmaps.sheet.margin = 7.0
    piece.data.shape_keys.key_blocks[equilibrium.KEY].value = 0.3
    bpy.context.view_layer.update()
    assert not equilibrium.out_of_date(piece, bpy.context.scene)


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
@pytest.mark.parametrize("button", ["regularise", "flatten", "spirals"])
def test_an_earlier_stage_takes_the_result_away(piece: Any, button: str, mode: str) -> None:
    target = basis(piece)
    press("simulate")
    bpy.ops.object.mode_set(mode=mode)
    press(button)
    bpy.ops.object.mode_set(mode="OBJECT")
    assert "equilibrium" not in notes.read(piece.data)
    assert equilibrium.key_of(piece.data) is None
    assert not {f"flexmaps_{name}" for name in equilibrium.NAMES} & {a.name for a in piece.data.attributes}
    if button != "regularise":
        assert basis(piece) == pytest.approx(target, abs=1e-7)


def test_keys_of_the_user_are_left_alone(piece: Any, all_of: Any) -> None:
    piece.shape_key_add(name="Basis")
    piece.shape_key_add(name="mine")
    before = all_of(piece)
    press("simulate")
    assert [b.name for b in piece.data.shape_keys.key_blocks] == ["Basis", "mine", equilibrium.KEY]
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
        while (running.shown is None or "residual" not in said) and time.monotonic() < until:
            said = running.text
            time.sleep(0.001)
        assert isinstance(running.shown, live_shape.LiveShape)
        points, rgba, lines = running.shown.drawn(1.0)
        assert points.shape == (12 * LENGTH * WIDTH, 3) and len(lines) == 8 * LENGTH * WIDTH
        assert np.isfinite(points).all() and ((rgba >= 0) & (rgba <= 1)).all()
        assert "residual" in said
    finally:
        running.end()
    assert isinstance(running.error, Cancelled)
    assert all_of(piece) == before


def test_stopped_from_the_keyboard(piece: Any, all_of: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    real = engine.solve

    def interrupted(*args: Any) -> Any:
        real(*args)
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
    block = notes.read(piece.data)["equilibrium"]
    assert not block["converged"] and not equilibrium.sound(block)
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


# -- refused -----------------------------------------------------------------------------------------------------------


def missing_group(obj: Any) -> None:
    obj.flexmaps.loads.supports = "gone"


def empty_group(obj: Any) -> None:
    obj.vertex_groups.new(name="none")
    obj.flexmaps.loads.supports = "none"


def single_corner(obj: Any) -> None:
    group(obj, "one", [0])
    obj.flexmaps.loads.supports = "one"


def force_on_nothing(obj: Any) -> None:
    group(obj, "ends", ends(obj))
    obj.flexmaps.loads.supports, obj.flexmaps.loads.force_x = "ends", 1.0


def falling(obj: Any) -> None:
    obj.flexmaps.simulate.gravity = True


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
@pytest.mark.parametrize(
    "mistake, says, culprits",
    [
        (missing_group, "no vertex group 'gone'.*Supports", 0),
        (empty_group, "'none' under Supports is empty", 0),
        (single_corner, "No quad has 2 corners.*'one'", 0),
        (force_on_nothing, "nothing that it pulls at", 0),
        (falling, "nothing holds", LENGTH * WIDTH),
    ],
    ids=lambda x: getattr(x, "__name__", ""),
)
def test_a_mistake_is_named_and_nothing_changes(
    piece: Any, all_of: Any, mistake: Callable[[Any], None], says: str, culprits: int, mode: str
) -> None:
    mistake(piece)
    bpy.ops.object.mode_set(mode=mode)
    bpy.ops.mesh.select_all(action="DESELECT") if mode == "EDIT" else piece.data.polygons.foreach_set(
        "select", np.zeros(len(piece.data.polygons), bool)
    )
    before = all_of(piece)
    with pytest.raises(RuntimeError, match=says):
        bpy.ops.flexmaps.simulate()
    assert all_of(piece) == before and piece.data.shape_keys is None
    piece.update_from_editmode()
    assert sum(p.select for p in piece.data.polygons) == culprits


def test_a_quad_joined_to_nothing_is_told_and_the_rest_simulated(add: Any) -> None:
    whole = arch()
    lonely = np.array([[0, 0, 0], [EDGE, 0, 0], [EDGE, EDGE, 0], [0, EDGE, 0]]) + np.array([0, 0, 0.2])
    obj = add((np.concatenate([whole.vertices, lonely]), [*whole.quads.tolist(), [36, 37, 38, 39]]))
    press("flatten")
    press("spirals")
    press("simulate")
    block = notes.read(obj.data)["equilibrium"]
    assert block["converged"]
    (found,) = [f for f in block["findings"] if f["code"] == "joined-to-nothing"]
    assert found["faces"] == [LENGTH * WIDTH] and found["message"] in equilibrium.sentences(block)[0]


def test_spirals_come_first(dome: Any) -> None:
    assert not bpy.ops.flexmaps.simulate.poll()


# -- settings, colours, main job -----------------------------------------------------------------------------------------


def test_settings_there_and_back(dome: Any) -> None:
    wanted = replace(
        ObjectSettings(),
        material=MaterialParams(material="custom", youngs=1.23e9, poisson=0.41, density=900.0, strain_limit=0.033),
        loads=LoadParams(supports="feet", pulled="top", force_x=-0.25, force_z=1.5),
    )
    settings.write(dome.flexmaps, wanted)
    assert dome.flexmaps.material.youngs == pytest.approx(1.23)  # gigapascals
    found = settings.read(dome.flexmaps, ObjectSettings)
    assert found.loads == wanted.loads and found.loads.force == (-0.25, 0.0, 1.5)
    assert found.material.chosen.youngs == pytest.approx(1.23e9)
    assert found.material.chosen.strain_limit == pytest.approx(0.033)


@pytest.mark.parametrize("kind", ["DISTANCE", "STRAIN_ENERGY", "SAFETY"])
def test_colours(piece: Any, attribute: Any, kind: str) -> None:
    with pytest.raises(RuntimeError, match="press Simulate first"):
        bpy.ops.flexmaps.overlay(kind=kind)
    press("simulate")
    press("overlay", kind=kind)
    name = {"DISTANCE": "distance", "STRAIN_ENERGY": "strain_energy", "SAFETY": "strain"}[kind]
    values = attribute(piece, f"flexmaps_{name}")
    rgb = attribute(piece, "flexmaps_colour", "color", 4)[::4, :3]
    # the larger the number, the darker the colour
    light = rgb @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(light[np.argsort(values, kind="stable")]) < 1e-5).all()


def run(*arguments: object) -> int:
    return command.main(["run", *(str(a) for a in arguments)])


def test_main_job_up_to_simulate(tmp_path: Path) -> None:
    rc = run("shape:saddle", "--edge", 20, "--out", tmp_path, "--stop-after", "simulate", "--no-pictures",
             "--material", "birch", "--model", "rod")  # fmt: skip
    assert rc == 0
    report = json.loads((tmp_path / "report.json").read_text())
    block = report["equilibrium"]
    assert block["converged"] and block["model"] == "rod" and block["material"] == "Birch plywood"
    assert {"residual", "negative_eigenvalues", "twist_max", "rms_mm", "rms_percent", "max_percent"} <= set(block)
    assert "sheets" not in report and "simulate" in report["seconds"]
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "model.blend"))
    obj = bpy.data.objects["saddle"]
    assert equilibrium.key_of(obj.data) is not None
    assert not equilibrium.out_of_date(obj, bpy.context.scene)


def test_main_job_goes_on_where_it_cannot_simulate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Weight without supports: the files are there, the exit status and the report say what is missing."""
    arguments = ("shape:saddle", "--edge", 20, "--gravity", "--out", tmp_path, "--no-pictures", "--nesting", "FAST")
    assert run(*arguments) == command.UNDONE == 3
    report = json.loads((tmp_path / "report.json").read_text())
    assert "equilibrium" not in report and report["sheets"]["sheets"] >= 1 and report["undone"] == ["simulate"]
    warning = next(c for c in report["checks"] if c["code"] == "not-simulated")
    assert warning["severity"] == "warning" and "supports" in warning["message"] and warning["faces"]
    assert list(tmp_path.glob("sheet-01.*")) and (tmp_path / "model.blend").is_file()
    assert "Not simulated" in capsys.readouterr().out
    assert run(*arguments, "--stop-after", "simulate") == 2


def test_main_job_says_that_it_found_no_equilibrium(tmp_path: Path) -> None:
    given = ("shape:saddle", "--edge", 20, "--out", tmp_path, "--no-pictures", "--stop-after", "simulate")
    assert run(*given, "--set", "simulate.iterations=1") == command.UNDONE
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["undone"] == ["simulate"] and not report["equilibrium"]["converged"]
    assert [f["code"] for f in report["equilibrium"]["findings"]] == ["no-equilibrium"]


def test_main_job_tells_what_is_outside_the_model(tmp_path: Path) -> None:
    size = ("--edge", 20, "--thickness", 0.2)
    assert run("shape:saddle", *size, "--out", tmp_path, "--no-pictures", "--stop-after", "simulate") == 0
    block = json.loads((tmp_path / "report.json").read_text())["equilibrium"]
    (found,) = [f for f in block["findings"] if f["code"] == "beyond-model"]
    assert "width / thickness" in found["message"] and found["faces"]
    assert found["message"] in equilibrium.remarks(block) and equilibrium.sentences(block)[1]
    assert found["message"].replace("'", "&#x27;") in (tmp_path / "report.html").read_text()


def test_default_shapes_simulate_without_a_warning(add: Any) -> None:
    add(shapes.make("saddle"))
    for button in ("merge", "spirals", "simulate"):
        press(button)
    assert equilibrium.sound(notes.read(bpy.context.object.data)["equilibrium"])


def test_the_assembly_sheet_tells_the_forces_at_rest(
    spiralled: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only where the piece was simulated and nothing has changed since."""
    told: list[Any] = []

    def write(
        design: Any, sheets: Any, figures: Any, target: Path, title: str, new: Any, checked: Any, *_: Any
    ) -> Path:
        told.append(checked)
        new(target).write_bytes(b"")
        return target

    monkeypatch.setattr(assembly_sheet, "write", write)
    spiralled.flexmaps.export.folder, spiralled.flexmaps.export.dxf = str(tmp_path), "NONE"

    assert bpy.ops.flexmaps.export() == {"FINISHED"}
    assert bpy.ops.flexmaps.simulate() == {"FINISHED"}
    monkeypatch.setattr(assembly_check, "HAND", 0.0)  # newtons, so that every joint pulls too hard
    assert bpy.ops.flexmaps.export() == {"FINISHED"}
    spiralled.flexmaps.material.material = "custom"
    assert bpy.ops.flexmaps.export() == {"FINISHED"}

    assert [any(seam.force is not None for seam in checked.seams) for checked in told] == [False, True, False]
    assert "pulls with more than" in told[1].warnings[-1]

"""The Simulate button: what it writes and what it refuses."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps.bridge.store import equilibrium, mesh, shape_keys, states, stored_report
from flexmaps.bridge.view import scene
from support.arch import EDGE, LENGTH, WIDTH, arch, basis, ends, group, key_of, planar, spiralled
from support.buttons import press


@pytest.fixture
def piece(add: Any) -> Any:
    """An arch with its spirals, ready to be simulated."""
    return spiralled(add)


# -- what is written ---------------------------------------------------------------------------------------------------


def test_a_free_arch_springs_flat(piece: Any, attribute: Any) -> None:
    """Nothing holds what was cut from a flat sheet: it is flat again, however the target was bent."""
    before = basis(piece)
    press("simulate")
    assert basis(piece) == pytest.approx(before, abs=0)
    found = key_of(piece)
    assert planar(before) > 0.1 * EDGE and planar(found) < 1e-3 * EDGE
    assert np.ptp(found, axis=0).max() == pytest.approx(LENGTH * EDGE, rel=0.01)
    key = piece.data.shape_keys.key_blocks[equilibrium.EQUILIBRIUM_KEY]
    assert key.value == 1.0 and piece.active_shape_key_index == 0
    block = stored_report.read(piece.data)["equilibrium"]
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
    key, target, result = piece.data.shape_keys.key_blocks[equilibrium.EQUILIBRIUM_KEY], basis(piece), key_of(piece)
    for share in (0.0, 0.5, 1.0):
        key.value = share
        seen = piece.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        wanted = target + share * (result - target)
        assert np.array([v.co[:] for v in seen.vertices]) == pytest.approx(wanted, abs=1e-6)
        assert shape_keys.simulated_positions(piece.data) == pytest.approx(wanted, abs=1e-6)  # where colours are drawn


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
    assert twin.data == piece.data and not states.is_stale(twin, bpy.context.scene, "equilibrium")
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
    assert mesh.read_evaluated(scene.open_blend(tmp_path / "piece.blend"), bpy.context.scene).vertices == pytest.approx(
        target, abs=1e-7
    )


def test_another_shape_gets_its_own_key(piece: Any) -> None:
    """Between hinged ends that are closer than it is long, the arch rests above and, snapped through, as well below."""
    group(piece, "ends", ends(piece))
    piece.flexmaps.loads.supports, piece.flexmaps.simulate.clamped = "ends", False
    piece.flexmaps.simulate.restarts = 2
    press("simulate")
    block = stored_report.read(piece.data)["equilibrium"]
    assert block["other_energies"][0] == pytest.approx(block["energy"], rel=1e-6)
    top, height = np.argmax(basis(piece)[:, 2]), basis(piece)[ends(piece), 2].mean()
    assert key_of(piece)[top, 2] > height + EDGE
    assert key_of(piece, f"{equilibrium.OTHER_KEY} 1")[top, 2] < height - 0.5 * EDGE
    shape_keys = equilibrium.simulated_keys(piece.data)
    assert [k.name for k in shape_keys] == [
        equilibrium.EQUILIBRIUM_KEY,
        *(f"{equilibrium.OTHER_KEY} {i + 1}" for i in range(len(shape_keys) - 1)),
    ]
    assert len(shape_keys) == 1 + len(block["other_energies"]) and [k.value for k in shape_keys] == [1.0] + [0.0] * (
        len(shape_keys) - 1
    )
    piece.flexmaps.simulate.restarts = 0
    press("simulate")
    assert [k.name for k in equilibrium.simulated_keys(piece.data)] == [equilibrium.EQUILIBRIUM_KEY]
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
    assert not states.is_stale(piece, bpy.context.scene, "equilibrium")


def test_the_published_model_knows_no_strain(piece: Any) -> None:
    press("simulate")
    piece.flexmaps.simulate.model = "rod"
    press("simulate")
    assert stored_report.read(piece.data)["equilibrium"]["model"] == "rod"
    assert "flexmaps_strain" not in piece.data.attributes
    with pytest.raises(RuntimeError, match="nothing to show"):
        bpy.ops.flexmaps.overlay(kind="SAFETY")


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
    block = stored_report.read(obj.data)["equilibrium"]
    assert block["converged"]
    (found,) = [f for f in block["findings"] if f["code"] == "joined-to-nothing"]
    assert found["faces"] == [LENGTH * WIDTH] and found["message"] in equilibrium.describe_result(block)[0]


def test_findings_on_one_line_end_in_full_stops() -> None:
    block = {"status": "It rests.", "converged": True, "rms_mm": 1.0, "rms_percent": 2.0}
    block["findings"] = [{"code": "one", "message": "One thing is so"}, {"code": "two", "message": "Another is not."}]
    text, warning = equilibrium.describe_result(block)
    assert warning and text == "It rests. Distance to the target: RMS 1 mm, 2 %. One thing is so. Another is not."


def test_spirals_come_first(dome: Any) -> None:
    assert not bpy.ops.flexmaps.simulate.poll()

"""Handles: single spirals held, pulled and wished somewhere, by operators, by scripts, and through files."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps import api
from flexmaps.bridge.store import handles, states
from flexmaps.bridge.view import picking
from flexmaps.command.main import main
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.mechanics.loads import parse_supports


def test_a_held_spiral_is_a_support_and_undo_is_one_step(simulated: Any) -> None:
    assert states.read_states(simulated, bpy.context.scene)["equilibrium"].kind == states.DONE
    bpy.ops.ed.undo_push(message="begin")
    assert bpy.ops.flexmaps.hold_spiral(quad=5) == {"FINISHED"}
    assert bpy.ops.flexmaps.hold_spiral(quad=9) == {"FINISHED"}
    obj = bpy.context.object
    assert api.load(obj).result.supports.tolist() == [5, 9]  # type: ignore[union-attr]
    assert states.read_states(obj, bpy.context.scene)["equilibrium"].kind == states.STALE
    assert bpy.ops.flexmaps.hold_spiral(quad=5) == {"FINISHED"}
    assert api.load(obj).result.supports.tolist() == [9]  # type: ignore[union-attr]
    assert bpy.ops.flexmaps.clear_handles() == {"FINISHED"}
    assert api.load(obj).result.supports is None
    assert states.read_states(obj, bpy.context.scene)["equilibrium"].kind == states.DONE
    assert bpy.ops.flexmaps.hold_spiral(quad=10**6) == {"CANCELLED"}


def test_a_pull_adds_up_with_the_force_of_the_group(simulated: Any) -> None:
    loads = simulated.flexmaps.loads
    group = simulated.vertex_groups.new(name="edge")
    group.add(list(simulated.data.polygons[0].vertices), 1.0, "REPLACE")
    loads.pulled, loads.force_z = "edge", -1.0
    alone = api.load(simulated).result.force
    assert bpy.ops.flexmaps.drag_spiral(quad=30, kind="PULL", by=(0.0, 0.5, 2.0)) == {"FINISHED"}
    both = api.load(simulated).result.force
    assert both[30] - alone[30] == pytest.approx([0.0, 0.5, 2.0])  # type: ignore[index]
    assert both.sum(axis=0) == pytest.approx([0.0, 0.5, 1.0])  # type: ignore[union-attr]


def test_a_wish_turns_with_the_object_and_selected_quads_go_together(simulated: Any) -> None:
    assert bpy.ops.flexmaps.drag_spiral(quad=4, kind="WISH", by=(10.0, 0.0, 0.0)) == {"FINISHED"}
    simulated.rotation_euler.z = np.pi / 2
    bpy.context.view_layer.update()
    wishes = api.load(simulated).result.wishes
    assert wishes is not None and wishes.quads.tolist() == [4]
    mesh = api.load(simulated).mesh
    assert wishes.places[0] - mesh.centroids[4] == pytest.approx([0.0, 0.01, 0.0], abs=1e-7)
    # a wish says what to look for: what was found stays true
    assert states.read_states(simulated, bpy.context.scene)["equilibrium"].kind == states.DONE
    for k, face in enumerate(simulated.data.polygons):
        face.select = k in {4, 7, 8}
    bpy.context.tool_settings.mesh_select_mode = (False, False, True)
    bpy.ops.object.mode_set(mode="EDIT")
    assert bpy.ops.flexmaps.drag_spiral(quad=7, kind="WISH", by=(0.0, 0.0, 5.0)) == {"FINISHED"}
    bpy.ops.object.mode_set(mode="OBJECT")
    offsets = handles.read(simulated, handles.WISH)
    assert np.flatnonzero(offsets.any(axis=1)).tolist() == [4, 7, 8]


def test_scripts_pull_and_wish_and_files_keep_it(spiralled: Any, tmp_path: Any) -> None:
    piece = api.wish(api.pull(api.load(spiralled), [3], (0.0, 0.0, 1.5)), "12,13", (0.0, 4.0, 0.0))
    piece = api.change(piece, supports=[0, 20])
    shown = api.show(piece)
    again = api.load(shown).result
    assert again.force[3] == pytest.approx([0.0, 0.0, 1.5])  # type: ignore[index]
    assert again.wishes is not None and again.wishes.quads.tolist() == [12, 13]
    assert again.wishes.places - again.mesh.centroids[[12, 13]] == pytest.approx(
        np.array(2 * [[0.0, 0.004, 0.0]]), abs=1e-7
    )
    assert again.supports is not None and again.supports.tolist() == [0, 20]
    assert api.wish(piece, [12, 13], (0.0, 0.0, 0.0)).result.wishes is None
    for wrong in ((1.0, 2.0), "up", (np.nan, 0.0, 0.0)):
        with pytest.raises(FlexMapsError, match="three finite numbers"):
            api.wish(piece, [3], wrong)  # type: ignore[arg-type]


def test_the_spiral_under_the_mouse_is_that_of_the_shown_shape(simulated: Any, content: Callable[[Any], Any]) -> None:
    before = content(simulated)
    points, quads = picking.visible_surface(simulated)
    middle = points[quads[17]].mean(axis=0)
    normal = np.cross(*(points[quads[17]][k] - points[quads[17]][0] for k in (1, 2)))
    normal /= np.linalg.norm(normal)
    assert picking.hit_quad(points, quads, middle + 0.05 * normal, -normal) == 17
    assert picking.hit_quad(points, quads, middle + 10.0 * normal, normal) is None
    assert content(simulated) == before
    assert np.abs(points - picking.target_vertices(simulated)).max() > 1e-4  # the simulated one, not the target


def test_the_commands_pull_and_wish(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pulled, wished = tmp_path / "pulled.blend", tmp_path / "wished.blend"
    assert (
        main(["pull", "shape:dome", "--edge", "30", "--at", "0,3", "--force", "0", "-0.5", "2", "--out", str(pulled)])
        == 0
    )
    assert main(["wish", str(pulled), "--at", "lowest", "--by", "0", "0", "-5", "--out", str(wished)]) == 0
    again = tmp_path / "again.blend"  # what is read is not written over
    assert main(["wish", str(wished), "--at", "0", "--by", "0", "0", "0", "--out", str(again)]) == 0
    made = api.load(again).result
    assert np.flatnonzero(made.force.any(axis=1)).tolist() == [0, 3]
    np.testing.assert_allclose(made.force[3], [0.0, -0.5, 2.0], atol=1e-6)
    low = set(parse_supports(made.mesh, "lowest").tolist()) - {0}
    assert low and set(made.wishes.quads.tolist()) == low
    np.testing.assert_allclose(made.wishes.offsets(made.mesh)[min(low)], [0.0, 0.0, -0.005], atol=1e-6)
    for wrong in (
        ["--at", "many", "--by", "0", "0", "1"],
        ["--at", "1", "--by", "0", "nan", "1"],
        ["--at", "1", "--by", "0"],
    ):
        with suppress(SystemExit):
            assert main(["wish", "shape:dome", "--edge", "30", *wrong]) == 2
        assert "flexmaps" in capsys.readouterr().err

"""*Next*: what is mended, what is let go, what holds after new quads, and that a failure is never pressed again."""

from __future__ import annotations

import itertools
import json
from contextlib import suppress
from pathlib import Path
from typing import Any

import bmesh
import bpy
import numpy as np
import pytest
from flexmaps import api
from flexmaps.bridge.store import (
    cures,
    failures,
    fields,
    guidance,
    mark_transfer,
    notices,
    remesh_source,
    shape_notices,
    states,
)
from flexmaps.bridge.store.finding_words import INFORMATION, STOPS, WORSE
from flexmaps.command.main import main
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import QuadMesh


def seen(obj: Any) -> guidance.Guidance:
    bpy.context.view_layer.update()
    return guidance.read_guidance(obj, bpy.context.scene)


def _zero_edge(bm: Any) -> None:
    one, two = bm.edges[40].verts
    one.co = two.co


def _turned(bm: Any) -> None:
    bmesh.ops.reverse_faces(bm, faces=bm.faces[10:13])


def _doubled(bm: Any) -> None:
    bmesh.ops.split_edges(
        bm, edges=[edge for edge in bm.edges if edge.verts[0].co.x * edge.verts[1].co.x <= 0 < len(edge.link_faces) - 1]
    )


def _loose(bm: Any) -> None:
    bm.verts.new((0.0, 0.0, 1.0))


FAULTS = {
    "zero-edge": _zero_edge,
    "inconsistent-orientation": _turned,
    "doubled-vertices": _doubled,
    "loose-vertices": _loose,
}


def _large() -> QuadMesh:
    """A dome of 192 quads: of few, fewer are not offered."""
    mesh = shapes.dome(8)
    return mesh.with_vertices(mesh.vertices * (0.02 / mesh.median_edge))


@pytest.mark.parametrize("code", FAULTS)
def test_what_a_machine_can_mend_is_mended_in_one_press_on_a_copy_where_the_mesh_is_shared(add: Any, code: str) -> None:
    piece = add(_large())
    bm = bmesh.new()
    bm.from_mesh(piece.data)
    for elements in (bm.verts, bm.edges, bm.faces):
        elements.ensure_lookup_table()
    FAULTS[code](bm)
    bm.to_mesh(piece.data)
    bm.free()
    twin = bpy.data.objects.new("twin", piece.data)
    shared = piece.data
    with suppress(RuntimeError):  # its report is an error
        bpy.ops.flexmaps.check()
    (found,) = [notice for notice in seen(piece).notices if notice.key == f"checks/{code}"]
    (cure,) = [way for way in found.cures if way.idname == "flexmaps.mend"]
    assert bpy.ops.flexmaps.mend(**cure.properties) == {"FINISHED"}
    assert not [notice for notice in seen(piece).notices if notice.key == f"checks/{code}"]
    assert twin.data == shared != piece.data, "the other object keeps its mesh"


def test_folds_are_counted_and_rounded_in_one_press(add: Any) -> None:
    """Two flat halves of 20 mm quads that meet at a right angle, in an object of another scale."""
    x = np.abs(np.arange(-4, 5)) * np.sqrt(0.5)
    across = np.sign(np.arange(-4, 5)) * x
    points = [(float(across[i]), float(j), float(-x[i])) for i in range(9) for j in range(6)]
    quads = [(6 * i + j, 6 * i + j + 6, 6 * i + j + 7, 6 * i + j + 1) for i in range(8) for j in range(5)]
    piece = add((points, quads), "roof")
    piece.scale = (0.02, 0.02, 0.02)
    twin = bpy.data.objects.new("twin", piece.data)
    bpy.ops.flexmaps.check()
    (found,) = [notice for notice in seen(piece).notices if notice.key == "checks/sharp-folds"]
    assert found.severity == INFORMATION and len(found.edges) == 5 and "5" in found.label
    assert [cure.label for cure in found.cures] == ["Round to 26 mm"]
    assert "Press Round to ... mm" in found.sentence
    told = api.press(piece, cure="mend-round")
    assert told is not None and not told["error"]
    assert not [notice for notice in seen(piece).notices if notice.key == "checks/sharp-folds"]
    bm = bmesh.new()
    bm.from_mesh(piece.data)
    turned = [edge.calc_face_angle() for edge in bm.edges if len(edge.link_faces) == 2]
    bm.free()
    assert 0.5 < max(turned) <= np.radians(45.001)
    assert max(v.co.z for v in twin.data.vertices) == 0.0 and twin.data != piece.data, "the other object keeps its mesh"


def test_a_cure_that_cannot_help_leaves_the_mesh_as_it_was(add: Any) -> None:
    piece = add(shapes.make("dome"))
    before = piece.data
    with pytest.raises(RuntimeError, match="nothing of this kind"):
        bpy.ops.flexmaps.mend(what="normals")
    assert piece.data == before


def test_a_refusal_is_told_without_a_traceback() -> None:
    bpy.ops.mesh.primitive_monkey_add()
    bpy.context.object.scale.z = 0.0
    bpy.context.view_layer.update()
    with pytest.raises(RuntimeError, match="squeezed flat") as told:
        bpy.ops.flexmaps.next()
    assert "Traceback" not in str(told.value)


def test_after_a_failure_the_same_is_never_offered_and_no_state_comes_twice(add: Any) -> None:
    """Every stage fails, whatever is pressed: what is offered comes to an end, and says where."""
    piece = add(shapes.make("dome"))
    scene, offered = bpy.context.scene, []
    for _ in range(api.pressing.MAX_PRESSES):
        act = seen(piece).action
        if act is None or act.idname == "wm.path_open":
            break
        offered.append((act.idname, tuple(act.properties.items()), piece.data.name, piece.flexmaps.remesh.edge))
        if act.cure is not None:
            failures.count_press(piece.data, act.cure.call)
        if act.idname == "flexmaps.let_go":
            bpy.ops.flexmaps.let_go(**act.properties)
        else:
            failures.write(piece, scene, act.idname, FlexMapsError("There is no room", faces=[1, 2]))
    else:
        pytest.fail(f"it goes on for ever: {offered}")
    assert len(set(offered)) == len(offered), "never the same act with the same input"
    assert seen(piece).status.icon == guidance.STOPPED and seen(piece).notices[0].faces == (1, 2)


def test_a_failure_is_forgotten_once_its_input_has_changed(add: Any) -> None:
    piece = add(shapes.make("dome"))
    failures.write(piece, bpy.context.scene, "flexmaps.spirals", FlexMapsError("There is no room", faces=[3]))
    assert any(notice.severity == STOPS for notice in seen(piece).notices)
    piece.flexmaps.export.labels = (
        not getattr(piece.flexmaps.export, "labels", True) if hasattr(piece.flexmaps.export, "labels") else False
    )
    assert any(notice.severity == STOPS for notice in seen(piece).notices)
    piece.flexmaps.spiral.width_min *= 0.9
    assert not any(notice.severity == STOPS for notice in seen(piece).notices)


def test_status_names_what_was_made_anew_or_which_setting_was_changed(add: Any) -> None:
    piece = add(shapes.make("dome"))
    bpy.ops.flexmaps.merge()
    bpy.ops.flexmaps.spirals()
    piece.flexmaps.spiral.width_min *= 0.9
    assert seen(piece).status == guidance.Status("Settings changed: 1 step to redo", guidance.REDO)
    bpy.ops.flexmaps.spirals()
    piece.flexmaps.layout.distortion_limit *= 0.5
    bpy.ops.flexmaps.merge()
    assert seen(piece).status == guidance.Status("New panels: 1 step to redo", guidance.REDO)


def test_labels_and_status_are_short_enough(add: Any) -> None:
    piece = add(shapes.make("dome"))
    said = seen(piece)
    assert said.action is not None and len(said.action.label) <= 28 and len(said.status.text) <= 34
    assert set(states.INPUTS) >= set(guidance.STEPS)


def test_groups_and_seams_hold_for_new_quads(add: Any) -> None:
    def grid(n: int, name: str) -> Any:
        x = np.linspace(0.0, 1.0, n + 1)
        points = [(float(a), float(b), 0.0) for a, b in itertools.product(x, x)]
        quads = [(i * (n + 1) + j, (i + 1) * (n + 1) + j, (i + 1) * (n + 1) + j + 1, i * (n + 1) + j + 1)
                 for i in range(n) for j in range(n)]  # fmt: skip
        return add((points, quads), name)

    old, new = grid(4, "old"), grid(10, "new")
    group = old.vertex_groups.new(name="feet")
    group.add([v.index for v in old.data.vertices if v.co.x < 0.01], 1.0, "REPLACE")
    for edge in old.data.edges:
        edge.use_seam = all(abs(old.data.vertices[k].co.y - 0.5) < 0.01 for k in edge.vertices)
    fields.write_protected(old, np.array([0, 5]))
    mark_transfer.transfer_marks(old, new)
    inside = {v.index for v in new.data.vertices if any(g.weight > 0 for g in v.groups)}
    assert {v.index for v in new.data.vertices if v.co.x < 0.01} <= inside
    assert all(new.data.vertices[k].co.x < 0.15 for k in inside)
    cut = [edge for edge in new.data.edges if edge.use_seam]
    marks = np.array([item.value for item in new.data.attributes[fields.PROTECT].data])
    middles = np.array([face.center[:2] for face in new.data.polygons])
    first, sixth = (middles < 0.25).all(axis=1), ((middles > 0.25) & (middles < 0.5)).all(axis=1)  # of sixteen
    apart = np.abs((middles % 0.25) - 0.25 * (middles % 0.25 > 0.125)).min(axis=1) > 1e-6  # not between two of them
    assert (marks[apart] == (first | sixth)[apart]).all() and marks.any()
    assert len(cut) == 10 and all(abs(new.data.vertices[k].co.y - 0.5) < 0.01 for edge in cut for k in edge.vertices)


@pytest.mark.parametrize("stage", ["set_size", "regularise"])
def test_protected_spirals_stay_so_where_quads_are_moved(add: Any, stage: str) -> None:
    piece = add(shapes.make("dome"))
    fields.write_protected(piece, np.array([3, 7]))
    assert getattr(bpy.ops.flexmaps, stage)() == {"FINISHED"}
    marks = [item.value for item in piece.data.attributes[fields.PROTECT].data]
    assert np.flatnonzero(marks).tolist() == [3, 7]


@pytest.mark.parametrize("stage", ["check", "set_size"])
def test_the_whole_mesh_is_checked_where_it_is_scaled_too(add: Any, stage: str) -> None:
    """Else *Next*, which scales many a mesh first and checks only what was not checked yet, never says that bodies cross."""
    mesh = shapes.make("dome")
    aside = mesh.vertices + 0.3 * np.ptp(mesh.vertices, axis=0)
    quads = np.concatenate([mesh.quads, mesh.quads + len(mesh.vertices)])
    piece = add((np.concatenate([mesh.vertices, aside]), quads))
    assert getattr(bpy.ops.flexmaps, stage)() == {"FINISHED"}
    assert "checks/bodies-cross" in [notice.key for notice in seen(piece).notices]


def test_a_group_that_is_gone_has_a_button(add: Any) -> None:
    piece = add(shapes.make("dome"))
    piece.flexmaps.loads.supports = "feet"
    act = seen(piece).action
    assert act is not None and act.idname == "flexmaps.stand_on"
    assert bpy.ops.flexmaps.next() == {"FINISHED"}
    assert piece.flexmaps.loads.supports and piece.flexmaps.loads.supports in piece.vertex_groups


def test_seams_that_are_there_are_offered_as_the_layout(add: Any) -> None:
    piece = add(shapes.make("dome"))
    piece.data.edges[5].use_seam = True
    found = seen(piece)
    assert found.action is not None and found.action.idname == "flexmaps.flatten"
    (notice,) = [one for one in found.notices if one.key == "layout/seams"]
    assert [cure.idname for cure in notice.cures] == ["flexmaps.flatten", "flexmaps.merge"]


def test_next_on_the_command_line_tells_every_press_and_saves(add: Any, tmp_path: Path, capsys: Any) -> None:
    x = np.linspace(0.0, 0.2, 11)
    quads = [(i * 11 + j, (i + 1) * 11 + j, (i + 1) * 11 + j + 1, i * 11 + j + 1) for i in range(10) for j in range(10)]
    add(([(float(a), float(b), 0.0) for a, b in itertools.product(x, x)], quads), "flat")
    file = tmp_path / "piece.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(file))
    assert main(["next", str(file), "--json"]) == 0
    told = [json.loads(line) for line in capsys.readouterr().out.splitlines() if line.startswith("{")]
    assert [press["call"] for press in told] == [
        f"bpy.ops.flexmaps.{name}()" for name in ("merge", "spirals", "export")
    ]
    assert told[-1]["figures"]["sheets"] == 1 and told[-1]["status"]["sign"] == "tick"
    bpy.ops.wm.open_mainfile(filepath=str(file))
    assert seen(bpy.context.object).action.idname == "wm.path_open"  # type: ignore[union-attr]


def test_what_brings_a_piece_nearer_is_offered_with_its_figure(add: Any) -> None:
    piece = add(shapes.make("dome"))
    block = {"rms_percent": 1.6, "converged": True, "findings": []}
    reach = {"advice": "", "remedies": {}, "prospects": {"border": 0.25, "cut": 0.9, "lowest": 0.4, "round": 0.7}}
    blocks = {"equilibrium": block, "reach": reach}
    found = shape_notices._poor_match(piece, blocks, {})
    assert [(cure.idname, cure.properties.get("where")) for cure in found[0].cures] == [
        ("flexmaps.stand_on", "border"),
        ("flexmaps.stand_on", "lowest"),
        ("flexmaps.mend", None),
        ("flexmaps.cut_there", None),
        ("flexmaps.let_go", None),
    ]
    assert found[0].cures[2].properties == {"what": "round"} and found[0].cures[2].label.endswith("0.7 %")
    assert found[0].severity == WORSE and found[0].cures[0].label.endswith("0.25 %")
    assert not shape_notices._poor_match(piece, blocks | {"equilibrium": block | {"rms_percent": 0.9}}, {})
    piece.flexmaps.choose.match = 0.8  # "Within" under Layout
    assert shape_notices._poor_match(piece, blocks | {"equilibrium": block | {"rms_percent": 0.9}}, {})
    piece.flexmaps.choose.match = 2.0
    assert not shape_notices._poor_match(piece, blocks, {})
    piece.flexmaps.choose.goal = "panels"
    assert shape_notices._poor_match(piece, blocks, {})
    piece.flexmaps.choose.goal = "match"
    bpy.ops.flexmaps.stand_on(**found[0].cures[0].properties)
    (group,) = piece.vertex_groups
    held = {v.index for v in piece.data.vertices if any(g.group == group.index and g.weight > 0 for g in v.groups)}
    uses: dict[int, int] = {}
    for face in piece.data.polygons:
        for loop in face.loop_indices:
            edge = piece.data.loops[loop].edge_index
            uses[edge] = uses.get(edge, 0) + 1
    assert held == {k for edge, count in uses.items() if count == 1 for k in piece.data.edges[edge].vertices}


def test_a_profile_that_a_modifier_turns_into_a_surface_is_applied(add: Any) -> None:
    """A lathed lamp has no faces of its own, and its few quads are not what is seen."""
    profile = add((np.array([(0.05, 0, 0), (0.08, 0, 0.04), (0.06, 0, 0.09)]), []))
    bm = bmesh.new()
    bm.from_mesh(profile.data)
    for pair in itertools.pairwise(list(bm.verts)):
        bm.edges.new(pair)
    bm.to_mesh(profile.data)
    bm.free()
    assert seen(profile).action is None
    profile.modifiers.new("Lathe", "SCREW").steps = 16
    assert not seen(profile).notices
    bpy.ops.flexmaps.next()
    obj = bpy.context.object
    assert not obj.modifiers and len(obj.data.polygons) == 32
    assert profile.modifiers and profile.hide_get() and obj != profile


def test_as_few_quads_as_somebody_asked_for_are_not_remeshed_again(add: Any) -> None:
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.02)
    bpy.context.object.flexmaps.remesh.quads = 30
    bpy.ops.flexmaps.quad_remesh()
    made = bpy.context.object
    assert len(made.data.polygons) < cures.MIN_QUADS
    act = seen(made).action
    assert act is not None and act.idname != "flexmaps.quad_remesh"
    assert states.is_side_result_current(
        made, bpy.context.scene, "regularise"
    )  # what a remesh gives is not made squarer once more


def test_a_cure_is_pressed_by_its_name(add: Any) -> None:
    piece = add(shapes.make("dome"))
    _faulty(piece, "loose-vertices")
    with pytest.raises(FlexMapsError, match="mend-loose"):
        api.press(piece, cure="mend-normals")
    told = api.press(piece, cure="mend-loose")
    assert told is not None and told["call"] == "bpy.ops.flexmaps.mend(what='loose')" and not told["error"]
    assert len(piece.data.vertices) == len(shapes.make("dome").vertices)


def _faulty(piece: Any, code: str) -> None:
    """Put one fault into a piece and check it."""
    bm = bmesh.new()
    bm.from_mesh(piece.data)
    FAULTS[code](bm)
    bm.to_mesh(piece.data)
    bm.free()
    with suppress(RuntimeError):
        bpy.ops.flexmaps.check()


@pytest.mark.parametrize(
    "larger, offered", [(1.15, ["set_size", "quad_remesh", "let_go"]), (3.0, ["quad_remesh", "let_go"])]
)
def test_quads_that_are_too_small_are_made_larger_or_fewer(add: Any, larger: float, offered: list[str]) -> None:
    piece = add(_large())
    row = {
        "code": "small-quads",
        "severity": "warning",
        "message": "Small",
        "faces": [3],
        "edges": [],
        "larger": larger,
    }
    (notice,) = notices._from_checks(piece, bpy.context.scene, [row])
    assert [cure.name for cure in notice.cures] == offered
    if larger < 2.0:
        assert notice.cures[0].properties == {"times": larger}


def test_t_junctions_are_remeshed_unless_a_remesh_made_them(add: Any) -> None:
    piece = add(shapes.make("dome"))
    row = {"code": "t-junction", "severity": "error", "message": "1 T-junction", "faces": [0], "edges": [0]}
    (notice,) = notices._from_checks(piece, bpy.context.scene, [row])
    assert [cure.idname for cure in notice.cures] == ["flexmaps.quad_remesh"]
    assert notice.cures[0].properties == {"quads": piece.flexmaps.remesh.quads}
    piece[remesh_source.SOURCE] = piece
    (notice,) = notices._from_checks(piece, bpy.context.scene, [row])
    assert not notice.cures


@pytest.mark.parametrize("quads", [True, False])
def test_points_of_no_face_have_no_part_in_the_size(add: Any, quads: bool) -> None:
    piece = add(shapes.dome(8))
    if not quads:
        piece.modifiers.new("Triangles", "TRIANGULATE")
        bpy.ops.object.convert(target="MESH")
    bpy.context.view_layer.update()
    before, size = seen(piece).action, tuple(piece.flexmaps_size)
    piece.data.vertices.add(1)
    piece.data.vertices[-1].co = (0.0, 0.0, 50.0)
    piece.data.update()
    bpy.context.view_layer.update()
    assert max(piece.dimensions) > 40.0
    assert seen(piece).action == before and tuple(piece.flexmaps_size) == pytest.approx(size, rel=1e-5)

"""What the sidebar says of every stage, and which button it offers: played through as a person would."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bmesh
import bpy
import numpy as np
import pytest
from flexmaps.bridge.store import attributes, guidance, next_button, states, stored_report
from flexmaps.bridge.store.settings import is_relative_to_unsaved
from flexmaps.bridge.store.states import DONE, STALE, TODO
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking import check
from flexmaps.engine.surface.mesh import QuadMesh
from support.buttons import press


def kinds(obj: Any) -> dict[str, str]:
    bpy.context.view_layer.update()
    return {stage: state.kind for stage, state in states.read_states(obj, bpy.context.scene).items()}


def why(obj: Any, stage: str) -> str:
    bpy.context.view_layer.update()
    return states.read_states(obj, bpy.context.scene)[stage].changed_input


def offered(obj: Any) -> str:
    bpy.context.view_layer.update()
    return next_button.next_idname(obj, bpy.context.scene, states.read_states(obj, bpy.context.scene)).removeprefix(
        "flexmaps."
    )


def scaled(mesh: QuadMesh, edge: float = 0.02) -> QuadMesh:
    return QuadMesh(mesh.vertices * (edge / mesh.median_edge), mesh.quads)


@pytest.fixture
def piece(add: Any) -> Any:
    """A dome of 75 quads, for what has to be computed."""
    return add(scaled(shapes.dome(5)))


@pytest.fixture
def made(piece: Any) -> Any:
    """The same with everything done, as far as notes and attributes tell."""
    for edge in list(piece.data.edges)[3:60:7]:
        edge.use_seam = True
    attributes.write(piece, "flexmaps_width", "FACE", "FLOAT", np.full(len(piece.data.polygons), 1.5))
    attributes.write(piece, "flexmaps_twist", "FACE", "FLOAT", np.full(len(piece.data.polygons), 90.0))
    for stage in ("layout", "spirals", "equilibrium", "reach", "optimise", "sheets"):
        stored_report.write(piece.data, stage, {"made": True})
    stored_report.write_checks(piece.data, [])
    states.stamp(piece, bpy.context.scene)
    return piece


def test_following_the_offers_leads_to_the_sheets(piece: Any, tmp_path: Path) -> None:
    piece.flexmaps.export.folder, piece.flexmaps.sheet.nesting = str(tmp_path), "FAST"
    piece.flexmaps.optimise.iterations, piece.flexmaps.optimise.restart = 1, False
    piece.flexmaps.optimise.codesign = False
    assert set(kinds(piece).values()) == {TODO}
    pressed = []
    while offered(piece):
        if offered(piece) in {"cut_there", "choose"}:  # would take a minute: somebody goes on as it is
            for notice in guidance.read_guidance(piece, bpy.context.scene).notices:
                if any(cure.idname.endswith(offered(piece)) for cure in notice.cures):
                    assert bpy.ops.flexmaps.let_go(key=notice.key) == {"FINISHED"}
                    break
            continue
        pressed.append(offered(piece))
        press("next")
        assert len(pressed) < 10
    assert pressed == ["merge", "fit", "export"]
    asked = {"choose", "scan", "structure"}
    assert {stage for stage, kind in kinds(piece).items() if kind != DONE} == asked, "done only when asked for"
    assert list(tmp_path.glob("*.svg"))


@pytest.mark.thorough
@pytest.mark.parametrize("shape", ["text", "monkey", "cylinder"])
def test_next_leads_from_blenders_own_shapes_to_the_sheets(shape: str, tmp_path: Path) -> None:
    if shape == "text":
        bpy.ops.object.text_add()
        bpy.context.object.data.body = "Hi"
        bpy.ops.object.convert(target="MESH")
    else:
        getattr(bpy.ops.mesh, f"primitive_{shape}_add")()
    given = bpy.context.object.flexmaps
    given.remesh.quads, given.optimise.iterations, given.optimise.restart = 120, 1, False
    given.optimise.codesign = False
    given.export.folder, given.sheet.nesting = str(tmp_path), "FAST"
    pressed: list[str] = []
    while offered(bpy.context.object):
        pressed.append(offered(bpy.context.object))
        press("next")
        assert len(pressed) < 14, pressed
    assert "quad_remesh" in pressed and pressed[-1] == "export", pressed
    assert list(tmp_path.glob("*.svg"))


def test_traced_patches_are_to_be_joined_before_they_get_spirals(add: Any) -> None:
    ball = add(scaled(shapes.cubesphere(3)))
    press("check")
    press("trace")
    assert stored_report.read(ball.data)["layout"]["patches"] > 1
    assert offered(ball) == "merge"
    press("merge")
    assert offered(ball) == "fit"
    press("trace")
    press("spirals")  # whoever wants many patches is not asked again
    assert offered(ball) == "fit"


def test_an_unsaved_file_asks_once_for_a_folder(made: Any, tmp_path: Path) -> None:
    made.flexmaps.sheet.margin = 7.0
    assert is_relative_to_unsaved(made.flexmaps.export.folder)
    assert offered(made) == "export"  # no file is to be saved first
    with pytest.raises(RuntimeError, match="no spirals yet"):  # of the stage that begins at once
        press("choose_folder", directory=str(tmp_path))
    assert not is_relative_to_unsaved(made.flexmaps.export.folder)


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
def test_done_in_either_mode_and_after_leaving_it(piece: Any, mode: str) -> None:
    bpy.ops.object.mode_set(mode=mode)
    for button in ("check", "merge", "spirals"):
        press(button)
        assert set(kinds(piece).values()) <= {DONE, TODO}
    bpy.ops.object.mode_set(mode="OBJECT")
    found = kinds(piece)
    assert [found[stage] for stage in ("checks", "layout", "spirals", "sheets")] == [DONE, DONE, DONE, TODO]


def test_a_mesh_of_triangles_is_to_be_remeshed(add: Any) -> None:
    mesh = shapes.make("dome")
    obj = add((mesh.vertices, np.concatenate([mesh.quads[:, [0, 1, 2]], mesh.quads[:, [0, 2, 3]]])))
    assert offered(obj) == "quad_remesh"


def test_a_model_of_another_size_is_to_be_scaled(dome: Any) -> None:
    dome.scale = (20, 20, 20)
    assert offered(dome) == "set_size"
    press("set_size")
    assert offered(dome) == "merge"  # scaling has checked it too
    dome.flexmaps.remesh.edge = 100.0  # who wants large quads says so
    assert offered(dome) == "set_size"


def test_poor_quads_are_to_be_made_squarer_once(piece: Any) -> None:
    def found() -> None:
        stored_report.write_checks(
            piece.data, [check.Finding("concave", "warning", "A corner beyond 180 degrees", faces=(1,))]
        )
        states.stamp(piece, bpy.context.scene)

    found()
    assert offered(piece) == "regularise"
    press("regularise")
    found()  # whatever it made of them, it is not offered again
    assert offered(piece) == "merge"
    seen = guidance.read_guidance(piece, bpy.context.scene).notices
    assert "flexmaps.regularise" not in {cure.idname for notice in seen for cure in notice.cures}
    piece.data.vertices[0].co.x += 1e-4  # another mesh may become squarer
    found()
    assert offered(piece) == "regularise"


# change -> stages that it leaves behind, and the part that the first depends on
CHANGES: dict[str, tuple[Any, set[str], str]] = {
    "limit": (
        lambda o: setattr(o.flexmaps.layout, "distortion_limit", 0.02),
        {"layout", "spirals", "equilibrium", "reach", "optimise", "sheets"},
        "layout",
    ),
    "thickness": (
        lambda o: setattr(o.flexmaps.spiral, "thickness", 3.0),
        {"equilibrium", "reach", "optimise", "sheets"},  # no outline of a spiral depends on it
        "spiral",
    ),
    "material": (
        lambda o: setattr(o.flexmaps.material, "material", "pla"),
        {"equilibrium", "reach", "optimise", "sheets"},
        "material",
    ),
    "kerf": (lambda o: setattr(o.flexmaps.cut, "kerf_outline", 0.1), {"sheets"}, "cut"),
    "folder": (lambda o: setattr(o.flexmaps.export, "folder", "/tmp/elsewhere"), {"sheets"}, "export"),
    "optimiser": (lambda o: setattr(o.flexmaps.optimise, "smoothness", 0.5), set(), ""),
    "vertex": (
        lambda o: setattr(o.data.vertices[40], "co", o.data.vertices[40].co * 1.01),
        {"checks", "layout", "spirals", "equilibrium", "reach", "optimise", "sheets"},
        "shape",
    ),
    "scale": (
        lambda o: setattr(o, "scale", (1, 1, 1.1)),
        {"checks", "layout", "spirals", "equilibrium", "reach", "optimise", "sheets"},
        "shape",
    ),
    "place": (lambda o: setattr(o, "location", (3, 4, 5)), set(), ""),
    "turn": (lambda o: setattr(o, "rotation_euler", (0.4, 0.5, 0.6)), set(), ""),
    "name": (lambda o: setattr(o, "name", "other"), set(), ""),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_change_leaves_behind_what_was_made_from_it(made: Any, change: str) -> None:
    do, expected, part = CHANGES[change]
    assert STALE not in kinds(made).values()
    do(made)
    found = kinds(made)
    assert {stage for stage, kind in found.items() if kind == STALE} == expected
    if expected:
        first = next(stage for stage in states.INPUTS if stage in expected)
        assert why(made, first).startswith(part)


def test_taken_back_a_change_never_was(made: Any) -> None:
    made.flexmaps.spiral.blend = 0.2
    assert kinds(made)["spirals"] == STALE
    made.flexmaps.spiral.blend = 0.15
    assert kinds(made)["spirals"] == DONE


def test_files_that_are_not_in_the_folder_are_written_again(made: Any, tmp_path: Path) -> None:
    """As after the .blend file was saved elsewhere, or the piece was appended to another one."""
    stored_report.write(made.data, "sheets", {"files": ["a.svg", "a.pdf"]})
    states.stamp(made, bpy.context.scene)
    assert offered(made) == "export" and why(made, "sheets") == states.FILES  # beside a .blend file that has no place
    made.flexmaps.export.folder = str(tmp_path)
    (tmp_path / "a.svg").touch()
    stored_report.write(made.data, "sheets", {"files": ["a.svg", "a.pdf"]})
    states.stamp(made, bpy.context.scene)
    assert kinds(made)["sheets"] == DONE
    (tmp_path / "a.svg").unlink()
    assert offered(made) == "export" and why(made, "sheets") == states.FILES


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
def test_a_mesh_with_other_vertices_is_laid_out_anew(made: Any, mode: str) -> None:
    """Its seams are others too, but belong to other panels."""
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.subdivide()
    bpy.ops.object.mode_set(mode=mode)
    assert why(made, "layout") == "shape" and offered(made) != "update_from_seams"


def test_edited_seams_ask_for_an_update(made: Any) -> None:
    edge = next(e.index for e in made.data.edges if e.use_seam)
    made.data.edges[edge].use_seam = False
    assert offered(made) == "update_from_seams" and why(made, "layout") == "seams"
    made.data.edges[edge].use_seam = True
    assert kinds(made)["layout"] == DONE


def test_seams_marked_in_edit_mode_are_seen_at_once(made: Any) -> None:
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    assert kinds(made)["layout"] == DONE
    bpy.ops.mesh.mark_seam(clear=False)
    assert offered(made) == "update_from_seams"
    bpy.ops.object.mode_set(mode="OBJECT")
    assert offered(made) == "update_from_seams"


def test_every_button_says_why_it_is_grey(piece: Any) -> None:
    """Where poll fails there is a sentence: in an empty scene, on a camera, and before anything was done."""

    def silent() -> list[str]:
        found = []
        for name in dir(bpy.ops.flexmaps):
            operator = getattr(bpy.ops.flexmaps, name)
            if not operator.poll():
                with pytest.raises(RuntimeError) as refusal:
                    operator()
                if "context is incorrect" in str(refusal.value):  # Blender's own words where there are none
                    found.append(name)
        return found

    assert silent() == []
    bpy.ops.object.camera_add()
    assert silent() == []
    bpy.context.view_layer.objects.active = None
    assert silent() == []


def test_a_later_stage_is_out_of_date_when_an_earlier_one_runs_again(piece: Any) -> None:
    press("merge")
    press("spirals")
    press("simulate")
    press("merge")
    found = kinds(piece)
    assert [found[s] for s in ("layout", "spirals", "equilibrium")] == [DONE, STALE, STALE]
    assert "equilibrium" not in stored_report.read(piece.data) and why(piece, "equilibrium") == ""
    assert found["optimise"] == found["sheets"] == TODO  # they never ran
    press("spirals")
    assert kinds(piece)["spirals"] == DONE and kinds(piece)["equilibrium"] == STALE


def test_weight_makes_the_turn_matter(made: Any) -> None:
    made.flexmaps.simulate.gravity = True
    stored_report.write(made.data, "equilibrium", {})
    states.stamp(made, bpy.context.scene)
    assert kinds(made)["equilibrium"] == DONE
    made.rotation_euler = (0.4, 0.0, 0.0)
    assert kinds(made)["equilibrium"] == STALE and why(made, "equilibrium") == "down"


def test_undo_brings_the_states_back(piece: Any) -> None:
    press("merge")
    press("spirals")
    bpy.ops.ed.undo_push(message="spirals")
    name, before = piece.name, kinds(piece)
    press("merge")
    bpy.ops.ed.undo_push(message="merge")
    assert kinds(bpy.data.objects[name]) != before
    bpy.ops.ed.undo()
    assert kinds(bpy.data.objects[name]) == before


def test_asking_changes_nothing(made: Any, content: Any) -> None:
    before = content(made)
    made.flexmaps.spiral.thickness = 3.0
    kinds(made), offered(made)
    assert content(made) == before
    assert not [key for key in made.data.keys() if "fresh" in key]  # noqa: SIM118


def test_what_is_edited_is_noticed_before_edit_mode_is_left(made: Any) -> None:
    """As soon as it is moved, and no longer once it is back; seams by themselves leave the check alone."""
    bpy.ops.object.mode_set(mode="EDIT")
    bm = bmesh.from_edit_mesh(made.data)
    bm.verts.ensure_lookup_table()
    before = bm.verts[40].co.copy()
    assert STALE not in kinds(made).values()
    bm.verts[40].co.z += 0.01
    assert kinds(made)["checks"] == STALE and why(made, "layout") == "shape"
    bm.verts[40].co = before
    assert STALE not in kinds(made).values()
    next(edge for edge in bm.edges if not edge.seam).seam = True
    assert kinds(made)["layout"] == STALE and kinds(made)["checks"] == DONE
    bm.faces.remove(next(iter(bm.faces)))
    assert kinds(made)["checks"] == STALE
    bpy.ops.object.mode_set(mode="OBJECT")
    assert kinds(made)["checks"] == STALE

"""Modifiers that are left out where the surface is read: those that give it a thickness, or only divide its faces."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import bmesh
import bpy
import numpy as np
import pytest
from flexmaps import api
from flexmaps.bridge.store import guidance, mesh, modifiers, stored_report
from flexmaps.engine.surface import shapes
from support.buttons import press


@pytest.fixture
def bowl(add: Any) -> Any:
    return add(shapes.dome(4))


def faces_read(obj: Any) -> int:
    bpy.context.view_layer.update()
    return len(mesh.read_evaluated(obj, bpy.context.scene).sizes)


def offered(obj: Any) -> str:
    bpy.context.view_layer.update()
    act = guidance.read_guidance(obj, bpy.context.scene).action
    return "" if act is None else act.label


def thick(obj: Any, *rest: str, share: float = 0.05) -> None:
    obj.modifiers.new("Solidify", "SOLIDIFY").thickness = share * max(obj.dimensions)
    for kind in rest:
        obj.modifiers.new(kind.title(), kind)


def end_split(obj: Any) -> None:
    obj.modifiers.new("Split", "EDGE_SPLIT").split_angle = 0.01
    obj.modifiers.new("Triangulate", "TRIANGULATE")


def passing(obj: Any) -> None:
    """Geometry nodes that only set shading, as Blender's own *Smooth by Angle* does."""
    nodes(obj, "GeometryNodeSetShadeSmooth")


def nodes(obj: Any, kind: str) -> None:
    tree = bpy.data.node_groups.new("nodes", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    begin, step, end = (tree.nodes.new(name) for name in ("NodeGroupInput", kind, "NodeGroupOutput"))
    tree.links.new(begin.outputs[0], step.inputs[0])
    tree.links.new(step.outputs[0], end.inputs[0])
    obj.modifiers.new("Nodes", "NODES").node_group = tree


@pytest.mark.parametrize("changed", [thick, end_split], ids=["Solidify", "divided at the end"])
def test_the_surface_is_read_without_thickness_and_divisions(bowl: Any, changed: Callable[[Any], None]) -> None:
    count = len(bowl.data.polygons)
    changed(bowl)
    assert faces_read(bowl) == count
    assert all(modifier.show_viewport for modifier in bowl.modifiers)
    press("next")
    made = bpy.context.object
    assert made != bowl and not made.modifiers and len(made.data.polygons) == count
    assert bowl.modifiers and all(modifier.show_viewport for modifier in bowl.modifiers) and not bowl.visible_get()
    notice = next(one for one in guidance.read_guidance(made, bpy.context.scene).notices if one.key == "left-out")
    assert "left out" in notice.sentence and notice.severity == "information"


def test_other_modifiers_of_the_stack_are_applied(bowl: Any) -> None:
    count = len(bowl.data.polygons)
    thick(bowl, "SUBSURF")
    assert faces_read(bowl) == 4 * count
    bowl.modifiers["Solidify"].show_viewport = False
    assert not modifiers.list_ignored(bowl) and faces_read(bowl) == 4 * count


def test_divisions_within_the_stack_shape_what_follows(bowl: Any) -> None:
    bowl.modifiers.new("Split", "EDGE_SPLIT").split_angle = 0.01
    bowl.modifiers.new("Subsurf", "SUBSURF")
    assert not modifiers.list_ignored(bowl)


def test_voxels_need_the_thickness(bowl: Any) -> None:
    thick(bowl, "REMESH")
    assert not modifiers.list_ignored(bowl)


@pytest.mark.parametrize(("share", "is_body"), [(0.4, True), (0.005, False)])
def test_solidify_makes_a_body_of_something_flat(share: float, is_body: bool) -> None:
    bpy.ops.mesh.primitive_grid_add()
    sheet = bpy.context.object
    bpy.context.view_layer.update()
    thick(sheet, share=share)
    bpy.context.view_layer.update()
    assert (not modifiers.list_ignored(sheet)) == is_body


def test_nodes_that_only_shade_need_no_press(bowl: Any) -> None:
    before = offered(bowl)
    passing(bowl)
    assert offered(bowl) == before and not modifiers.list_changing(bowl)
    nodes(bowl, "GeometryNodeFlipFaces")
    assert modifiers.list_changing(bowl)


def test_new_quads_and_the_job_tell_what_was_left_out(bowl: Any) -> None:
    thick(bowl)
    assert any("Solidify" in text for text in api.load(bowl).source.left_out)
    bowl.flexmaps.remesh.quads = 60
    press("quad_remesh")
    made = bpy.context.object
    assert "Solidify" in modifiers.read_note(made.data)
    assert "double-skin" not in {
        one.key.partition("/")[2] for one in guidance.read_guidance(made, bpy.context.scene).notices
    }


def test_a_text_is_turned_into_a_mesh_without_its_thickness() -> None:
    bpy.ops.object.text_add()
    thick(bpy.context.object, share=0.001)
    bpy.context.view_layer.update()
    press("to_mesh")
    made = bpy.context.object
    assert made.type == "MESH" and made.dimensions.z == pytest.approx(0.0, abs=1e-6)
    assert "Solidify" in modifiers.read_note(made.data)


def test_what_has_no_faces_as_a_mesh_is_refused() -> None:
    bpy.ops.curve.primitive_bezier_curve_add()
    with pytest.raises(RuntimeError, match="has no faces"):
        bpy.ops.flexmaps.to_mesh()
    assert bpy.context.object.type == "CURVE"


# -- shells that are there already -----------------------------------------------------------------------------------------


def applied(obj: Any) -> set[str]:
    """Apply Solidify as Blender does, check the shell, and return the names of the cures of its two skins."""
    thick(obj, share=0.03)
    bpy.ops.object.convert(target="MESH")
    with suppress(RuntimeError):  # its report may be an error
        bpy.ops.flexmaps.check()
    skins = [one for one in guidance.read_guidance(obj, bpy.context.scene).notices if one.key == "checks/double-skin"]
    return {cure.name for one in skins for cure in one.cures}


def test_the_outer_skin_of_a_shell_is_kept(bowl: Any) -> None:
    before = sorted(tuple(vertex.co) for vertex in bowl.data.vertices)  # Solidify goes inwards from there
    assert "mend-skins" in applied(bowl)
    press("mend", what="skins")
    assert sorted(tuple(vertex.co) for vertex in bowl.data.vertices) == pytest.approx(np.array(before), abs=1e-6)
    assert not codes(bowl) & {"double-skin", "loose-vertices"}


def codes(obj: Any) -> set[str]:
    return {row["code"] for row in stored_report.read(obj.data).get("checks", ())}


def test_a_shell_whose_skins_are_divided_by_folds_stays_as_it_is() -> None:
    bpy.ops.mesh.primitive_cube_add()
    box = bpy.context.object
    bm = bmesh.new()
    bm.from_mesh(box.data)
    bmesh.ops.delete(bm, geom=[max(bm.faces, key=lambda face: face.calc_center_median().z)], context="FACES_ONLY")
    bmesh.ops.subdivide_edges(bm, edges=bm.edges, cuts=3, use_grid_fill=True)
    bm.to_mesh(box.data)
    bm.free()
    assert "mend-skins" in applied(box)
    count = len(box.data.polygons)
    with pytest.raises(RuntimeError, match="could not be mended"):
        bpy.ops.flexmaps.mend(what="skins")
    assert len(box.data.polygons) == count


def test_a_metaball_becomes_a_mesh() -> None:
    bpy.ops.object.metaball_add(type="BALL")
    press("to_mesh")
    assert bpy.context.object.type == "MESH" and len(bpy.context.object.data.polygons)

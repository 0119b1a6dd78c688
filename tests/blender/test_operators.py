"""Every button, without a window: what it writes, what it refuses, and what undo and saving make of it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps.bridge.view import collection
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking import check
from support.buttons import faces_of, press, report

BUTTONS = ("check", "regularise", "trace", "merge", "flatten", "update_from_seams", "spirals", "export")


@pytest.fixture
def sphere(add: Any) -> Any:
    return add(shapes.make("cubesphere"))


# -- the walk ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["OBJECT", pytest.param("EDIT", marks=pytest.mark.thorough)])
def test_the_whole_walk(dome: Any, tmp_path: Path, mode: str, attribute: Any) -> None:
    bpy.ops.object.mode_set(mode=mode)
    dome.flexmaps.export.folder = str(tmp_path)
    dome.flexmaps.export.dxf = "BOTH"
    for name in BUTTONS:
        press(name)
        assert dome.mode == mode
        assert bpy.context.view_layer.objects.active == dome
    found = report(dome)
    assert set(found) == {"checks", "layout", "spirals", "sheets", "assembly"}
    assert found["layout"]["energy_max"] <= dome.flexmaps.layout.distortion_limit
    bpy.ops.object.mode_set(mode="OBJECT")
    width, twist = attribute(dome, "flexmaps_width"), attribute(dome, "flexmaps_twist")
    assert found["spirals"]["width_mm"] == pytest.approx([width.min(), width.mean(), width.max()], abs=1e-3)
    assert found["spirals"]["twist_deg"] == pytest.approx([twist.min(), twist.mean(), twist.max()], abs=1e-2)
    assert len(np.unique(attribute(dome, "flexmaps_patch").astype(int))) >= found["layout"]["patches"] - 1
    assert {p.name for p in tmp_path.glob("[!.]*")} == set(found["sheets"]["files"])
    assert {p.suffix for p in tmp_path.glob("[!.]*")} == {".svg", ".dxf", ".pdf", ".csv"}


def test_merge_traces_first_where_there_are_no_seams(sphere: Any, seams_of: Any) -> None:
    press("merge")
    assert seams_of(sphere).any()
    traced = sphere.copy()
    traced.data = sphere.data.copy()
    bpy.context.scene.collection.objects.link(traced)
    bpy.context.view_layer.objects.active = traced
    press("trace")
    assert report(traced)["layout"]["patches"] >= report(sphere)["layout"]["patches"]


def test_regularise_moves_vertices_and_drops_what_is_out_of_date(dome: Any, content: Any) -> None:
    for vertex in dome.data.vertices[10:30]:
        vertex.co.x += 0.003
    press("merge")
    before = content(dome)
    press("regularise")
    after = content(dome)
    assert after["position"] != before["position"]
    assert "flexmaps_flat" not in after and "flexmaps_energy" not in after
    assert "layout" not in report(dome)
    assert not [o for o in bpy.data.objects if o.get("flexmaps_kind")]


def test_size(dome: Any) -> None:
    dome.scale = (3.0, 3.0, 3.0)
    bpy.context.view_layer.update()
    bpy.context.scene.unit_settings.scale_length = 0.1
    dome.flexmaps.remesh.edge = 25.0
    press("set_size")
    bpy.context.view_layer.update()
    lengths = [(dome.matrix_world @ dome.data.vertices[e.vertices[0]].co
                - dome.matrix_world @ dome.data.vertices[e.vertices[1]].co).length for e in dome.data.edges]  # fmt: skip
    assert np.median(lengths) * 0.1 == pytest.approx(0.025, rel=1e-5)


@pytest.mark.parametrize("unit, scale", [(0.001, (1000, 1000, 1000)), (1.0, (-1, 1, 1)), (1.0, (0.5, 0.5, 0.5))])
def test_the_same_piece_in_any_unit_and_frame(add: Any, unit: float, scale: Any) -> None:
    """Scene units, mirroring and the object's scale change numbers in Blender, not the piece."""
    plain = add(shapes.make("cubesphere"), "plain")
    press("trace")
    mesh = shapes.make("cubesphere")
    other = add(
        (mesh.vertices / np.array(scale) / unit, mesh.quads if min(scale) > 0 else mesh.quads[:, ::-1]), "other"
    )
    bpy.context.scene.unit_settings.scale_length = unit
    other.scale = scale
    bpy.context.view_layer.update()
    press("trace")
    a, b = report(plain)["layout"], report(other)["layout"]
    assert a["patches"] == b["patches"]
    assert a["energy_max"] == pytest.approx(b["energy_max"], abs=2e-3)
    panels = next(o for o in bpy.data.objects if o.name == "other panels")
    size = np.array(panels.dimensions) * unit
    assert size.max() == pytest.approx(
        max(next(o for o in bpy.data.objects if o.name == "plain panels").dimensions), rel=0.02
    )


# -- undo, saving, names -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", [pytest.param("OBJECT", marks=pytest.mark.thorough), "EDIT"])
def test_undo_and_redo(dome: Any, mode: str, content: Any) -> None:
    bpy.ops.object.mode_set(mode=mode)
    name = dome.name
    for button in ("trace", "merge", "spirals"):
        bpy.ops.ed.undo_push(message="before")
        before, objects = content(bpy.data.objects[name]), {o.name for o in bpy.data.objects}
        press(button)
        bpy.ops.ed.undo_push(message=button)
        after, shown = content(bpy.data.objects[name]), {o.name for o in bpy.data.objects}
        bpy.ops.ed.undo()
        undone = content(bpy.data.objects[name])
        if mode == "EDIT":  # Blender's edit mode undo leaves attributes of the mesh as a whole alone
            undone["report"], before["report"] = b"", b""
        assert undone == before
        assert {o.name for o in bpy.data.objects} == objects
        bpy.ops.ed.redo()
        assert content(bpy.data.objects[name]) == after
        assert {o.name for o in bpy.data.objects} == shown


def test_saved_and_opened_again(dome: Any, tmp_path: Path, content: Any) -> None:
    dome.flexmaps.spiral.thickness = 3.0
    press("merge")
    press("spirals")
    before = content(dome)
    path = tmp_path / "piece.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(path))
    dome = bpy.data.objects["piece"]
    assert content(dome) == before
    assert dome.flexmaps.spiral.thickness == pytest.approx(3.0)
    press("export")  # into //flexmaps, beside the file
    assert {p.suffix for p in (tmp_path / "flexmaps").glob("[!.]*")} == {".svg", ".dxf", ".pdf", ".csv"}


def test_what_lies_beside_is_replaced_follows_the_name_and_is_not_shared(dome: Any) -> None:
    press("merge")
    press("merge")
    mine = [o for o in bpy.data.objects if o.get("flexmaps_kind")]
    assert sorted(o["flexmaps_kind"] for o in mine) == ["panels", "seams"]
    dome.name = "renamed"
    press("spirals")
    assert [c.name for c in bpy.data.collections] == ["FlexMaps renamed"]
    assert {o["flexmaps_kind"] for o in bpy.data.objects if o.get("flexmaps_kind")} == {"panels", "backs", "outlines"}
    copy = dome.copy()
    copy.data = dome.data.copy()
    bpy.context.scene.collection.objects.link(copy)
    bpy.context.view_layer.objects.active = copy
    press("merge")
    assert len(bpy.data.collections) == 2
    kinds = {c.name: {o["flexmaps_kind"] for o in c.objects} for c in bpy.data.collections}
    assert kinds == {"FlexMaps renamed": {"panels", "backs", "outlines"}, f"FlexMaps {copy.name}": {"panels", "seams"}}


def test_outlines_beside_are_the_true_ones(dome: Any) -> None:
    """Length of Blender's curves against the sheets' outlines, which the engine measures as arcs."""
    press("merge")
    press("spirals")
    found = [o for o in bpy.data.objects if o.get("flexmaps_kind") == "outlines"]
    measured = 0.0
    for obj in found:
        obj.data.resolution_u = 24
        mesh = obj.to_mesh()
        points = np.array([v.co[:] for v in mesh.vertices])
        measured += sum(float(np.linalg.norm(points[e.vertices[0]] - points[e.vertices[1]])) for e in mesh.edges)
        obj.to_mesh_clear()
    from flexmaps.bridge.store import mesh as bridge
    from flexmaps.engine.fabrication import sheets
    from flexmaps.engine.params import SheetParams, SpiralParams

    assert dome.flexmaps.spiral.border == "left_out"  # of a layout for which nobody has chosen
    surface = bridge.read_surface(dome, bpy.context.scene)
    flat = bridge.require_current_flat(surface, check.as_quad_mesh(surface.polygons))
    design = bridge.read_design(surface, flat, SpiralParams(border="left_out"))
    assert design is not None
    cut = sheets.make_sheets(design, SheetParams(labels=False, nesting="FAST"))
    assert measured == pytest.approx(cut.cut_length, rel=2e-3)


# -- refusals ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
@pytest.mark.parametrize("button", ["regularise", "trace", "merge", "flatten"])
def test_an_error_selects_the_culprits_and_changes_nothing(add: Any, content: Any, button: str, mode: str) -> None:
    mesh = shapes.make("dome")
    faces = [*mesh.quads[:-1].tolist(), mesh.quads[-1][:3].tolist()]
    obj = add((mesh.vertices, faces))
    bpy.ops.object.mode_set(mode=mode)
    bpy.ops.ed.undo_push(message="before")
    before = content(obj)
    with pytest.raises(RuntimeError, match="remesh"):
        getattr(bpy.ops.flexmaps, button)()
    assert content(obj) == before
    assert not [o for o in bpy.data.objects if o.get("flexmaps_kind")]
    obj.update_from_editmode()
    assert [f.index for f in obj.data.polygons if f.select] == [len(faces) - 1]


def test_later_stages_select_the_culprits_too(add: Any, tmp_path: Path) -> None:
    """Two corners that came to lie on one another after the spirals were made: every stage shows the faces around it."""
    mesh = shapes.dome(3)
    obj = add((mesh.vertices * (0.02 / mesh.median_edge), mesh.quads))
    obj.flexmaps.export.folder = str(tmp_path)
    press("flatten")
    press("spirals")
    edge = next(e for e in obj.data.edges if len(faces_of(obj, e.index)) == 2)
    one, other = edge.vertices
    around = {f.index for f in obj.data.polygons if {one, other} & set(f.vertices)}
    obj.data.vertices[one].co = obj.data.vertices[other].co
    for button in ("regularise", "merge", "update_from_seams", "spirals", "simulate", "optimise", "export", "preview"):
        obj.data.polygons.foreach_set("select", np.zeros(len(obj.data.polygons), bool))
        with pytest.raises(RuntimeError) as refusal:
            getattr(bpy.ops.flexmaps, button)()
        assert "Traceback" not in str(refusal.value), button
        selected = {f.index for f in obj.data.polygons if f.select}
        assert selected and selected <= around, button
    assert not any(tmp_path.iterdir())


def test_check_lists_what_is_wrong_and_shows_it(add: Any) -> None:
    mesh = shapes.make("dome")
    obj = add((mesh.vertices, [*mesh.quads[:-1].tolist(), mesh.quads[-1][:3].tolist()]))
    with pytest.raises(RuntimeError, match="remesh"):
        bpy.ops.flexmaps.check()
    codes = [finding["code"] for finding in report(obj)["checks"]]
    assert "non-quad" in codes
    obj.data.polygons.foreach_set("select", np.zeros(len(obj.data.polygons), bool))
    press("show_finding", index=codes.index("non-quad"))
    assert [f.index for f in obj.data.polygons if f.select] == [len(mesh.quads) - 1]


def test_modifiers_shape_keys_and_other_objects_are_refused_by_name(dome: Any) -> None:
    dome.modifiers.new("Fine", "SUBSURF")
    assert not bpy.ops.flexmaps.merge.poll()
    dome.modifiers.clear()
    assert bpy.ops.flexmaps.merge.poll()
    dome.shape_key_add(name="Basis")
    dome.shape_key_add(name="mine")
    assert bpy.ops.flexmaps.merge.poll() and not bpy.ops.flexmaps.regularise.poll()
    assert not bpy.ops.flexmaps.spirals.poll()  # nothing is flat yet
    bpy.context.view_layer.objects.active = None
    assert not bpy.ops.flexmaps.merge.poll()
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.view_layer.objects.active = camera
    assert not bpy.ops.flexmaps.merge.poll()


def test_export_says_what_is_missing(dome: Any, tmp_path: Path) -> None:
    press("merge")
    press("spirals")
    with pytest.raises(RuntimeError, match="file first, or choose a folder"):
        bpy.ops.flexmaps.export()
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    dome.flexmaps.export.folder = str(blocked / "folder")
    with pytest.raises(RuntimeError, match="Cannot write"):
        bpy.ops.flexmaps.export()
    assert blocked.read_text() == "in the way"
    dome.flexmaps.export.svg, dome.flexmaps.export.dxf, dome.flexmaps.export.pdf = False, "NONE", False
    with pytest.raises(RuntimeError, match="switch SVG, DXF or PDF on"):
        bpy.ops.flexmaps.export()
    assert "sheets" not in report(dome)


def test_export_follows_the_connectors_and_the_kerf(dome: Any, tmp_path: Path) -> None:
    press("merge")
    press("spirals")
    dome.flexmaps.export.folder, dome.flexmaps.export.dxf = str(tmp_path), "NONE"
    kinds = ("panels", "outlines")
    stood = [o for o in bpy.data.objects if o.get("flexmaps_kind") in kinds]
    press("export")
    # nothing has changed, so nothing is drawn anew
    assert [o for o in bpy.data.objects if o.get("flexmaps_kind") in kinds] == stood
    vertices = len(stood[[o["flexmaps_kind"] for o in stood].index("panels")].data.vertices)
    dome.flexmaps.connect.connector, dome.flexmaps.connect.clearance = "tab", 0.1
    dome.flexmaps.cut.kerf_outline, dome.flexmaps.cut.kerf_holes = 0.2, 0.1
    press("export")
    panels = next(o for o in bpy.data.objects if o.get("flexmaps_kind") == "panels")
    assert len(panels.data.vertices) < vertices  # plain ends have fewer corners than dovetails
    found = report(dome)["sheets"]
    assert found["connector_kinds"] == {"tab": found["connectors"]}
    assert found["connectors"] + len(found["unsolved"]) == found["joints"]
    assert found["connector_clearance_mm"] == pytest.approx(0.1)
    assert found["kerf_mm"] == pytest.approx([0.2, 0.1])
    dome.flexmaps.connect.connector = "none"
    press("export")
    assert report(dome)["sheets"]["connectors"] == 0


def test_the_report_on_the_mesh_is_plain_json(dome: Any) -> None:
    press("merge")
    assert json.loads(dome.data["flexmaps_report"])["layout"]["patches"] >= 1
    assert collection.find(dome) is not None


def test_merge_cuts_what_is_larger_than_the_sheet(dome: Any) -> None:
    press("merge")
    before = report(dome)["layout"]["patches"]
    dome.flexmaps.sheet.sheet_width, dome.flexmaps.sheet.sheet_height = 160.0, 120.0
    press("merge")
    found = report(dome)["layout"]
    assert found["patches"] > before
    assert "160 x 120 mm" in found["split"]
    # the cuts are the mesh's seams, as all others
    assert sum(edge.use_seam for edge in dome.data.edges) == found["cut_edges"]

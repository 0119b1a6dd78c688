"""Every button, without a window: what it writes, what it refuses, and what undo and saving make of it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps import panels
from flexmaps.bridge.store import notes
from flexmaps.bridge.view import collection
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking import check

BUTTONS = ("check", "regularise", "trace", "merge", "flatten", "update_from_seams", "spirals", "export")


def press(name: str, **properties: Any) -> None:
    assert getattr(bpy.ops.flexmaps, name)(**properties) == {"FINISHED"}


def report(obj: Any) -> dict[str, Any]:
    return notes.read(obj.data)


@pytest.fixture
def sphere(add: Any) -> Any:
    return add(shapes.make("cubesphere"))


# -- the walk ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
def test_the_whole_walk(dome: Any, tmp_path: Path, mode: str, attribute: Any) -> None:
    bpy.ops.object.mode_set(mode=mode)
    dome.flexmaps.export.folder = str(tmp_path)
    dome.flexmaps.export.dxf = "BOTH"
    for name in BUTTONS:
        press(name)
        assert dome.mode == mode
        assert bpy.context.view_layer.objects.active == dome
    found = report(dome)
    assert set(found) == {"checks", "layout", "spirals", "sheets"}
    assert found["layout"]["energy_max"] <= dome.flexmaps.layout.distortion_limit
    bpy.ops.object.mode_set(mode="OBJECT")
    width, twist = attribute(dome, "flexmaps_width"), attribute(dome, "flexmaps_twist")
    assert found["spirals"]["width_mm"] == pytest.approx([width.min(), width.mean(), width.max()], abs=1e-3)
    assert found["spirals"]["twist_deg"] == pytest.approx([twist.min(), twist.mean(), twist.max()], abs=1e-2)
    assert len(np.unique(attribute(dome, "flexmaps_patch").astype(int))) >= found["layout"]["patches"] - 1
    assert {p.name for p in tmp_path.iterdir()} == set(found["sheets"]["files"])
    assert {p.suffix for p in tmp_path.iterdir()} == {".svg", ".dxf", ".pdf"}


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


# -- seams edited by hand ----------------------------------------------------------------------------------------------


def line_across(obj: Any) -> list[int]:
    """Edges of a straight line of a grid-like patch, found by their positions: those nearest to the plane x = 0."""
    middles = np.array(
        [(obj.data.vertices[e.vertices[0]].co + obj.data.vertices[e.vertices[1]].co) / 2 for e in obj.data.edges]
    )
    along = np.array(
        [
            abs((obj.data.vertices[e.vertices[0]].co - obj.data.vertices[e.vertices[1]].co).normalized().x)
            for e in obj.data.edges
        ]
    )
    steep = along < 0.3
    nearest = np.abs(middles[steep, 0]).min()
    return np.flatnonzero(steep & (np.abs(middles[:, 0]) < nearest + 1e-4)).tolist()


def test_update_from_seams_flattens_what_changed_and_nothing_else(sphere: Any, attribute: Any, seams_of: Any) -> None:
    press("trace")
    patches = report(sphere)["layout"]["patches"]
    flat = attribute(sphere, "flexmaps_flat", "vector", 2).reshape(-1, 4, 2)
    patch = attribute(sphere, "flexmaps_patch").astype(int)
    seam = next(e for e in np.flatnonzero(seams_of(sphere)) if _between_two(sphere, patch, e))
    joined = set(_faces_of(sphere, seam))
    pair = {patch[f] for f in joined}
    for edge in np.flatnonzero(seams_of(sphere)):  # clear the whole seam between these two
        if {patch[f] for f in _faces_of(sphere, edge)} == pair:
            sphere.data.edges[int(edge)].use_seam = False
    press("update_from_seams")
    assert report(sphere)["layout"]["patches"] == patches - 1
    again = attribute(sphere, "flexmaps_flat", "vector", 2).reshape(-1, 4, 2)
    for other in set(patch.tolist()) - pair:
        faces = patch == other
        shape, before = again[faces] - again[faces].mean(axis=(0, 1)), flat[faces] - flat[faces].mean(axis=(0, 1))
        assert shape == pytest.approx(before, abs=1e-2)  # only laid elsewhere


def _faces_of(obj: Any, edge: int) -> list[int]:
    pair = set(obj.data.edges[int(edge)].vertices)
    return [f.index for f in obj.data.polygons if pair <= set(f.vertices)]


def _between_two(obj: Any, patch: np.ndarray, edge: int) -> bool:
    return len({patch[f] for f in _faces_of(obj, edge)}) == 2


def test_a_seam_marked_in_edit_mode(dome: Any, seams_of: Any) -> None:
    press("merge")
    patches = report(dome)["layout"]["patches"]
    before = seams_of(dome)
    wanted = [e for e in line_across(dome) if not before[e]]
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_mode(type="EDGE")
    bpy.ops.mesh.select_all(action="DESELECT")
    bpy.ops.object.mode_set(mode="OBJECT")
    for edge in wanted:
        dome.data.edges[edge].select = True
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.mark_seam(clear=False)
    press("update_from_seams")
    assert dome.mode == "EDIT"
    assert report(dome)["layout"]["patches"] > patches
    assert seams_of(dome)[wanted].all()


def test_spirals_ask_for_an_update_after_an_edit(dome: Any, content: Any) -> None:
    press("merge")
    inner = next(e.index for e in dome.data.edges if not e.use_seam and len(_faces_of(dome, e.index)) == 2)
    dome.data.edges[inner].use_seam = True
    before = content(dome)
    with pytest.raises(RuntimeError, match="Update from seams"):
        bpy.ops.flexmaps.spirals()
    assert content(dome) == before
    assert [e.index for e in dome.data.edges if e.select] == [inner]


# -- undo, saving, names -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
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
    assert {p.suffix for p in (tmp_path / "flexmaps").iterdir()} == {".svg", ".dxf", ".pdf"}


def test_what_lies_beside_is_replaced_follows_the_name_and_is_not_shared(dome: Any) -> None:
    press("merge")
    press("merge")
    mine = [o for o in bpy.data.objects if o.get("flexmaps_kind")]
    assert sorted(o["flexmaps_kind"] for o in mine) == ["panels", "seams"]
    dome.name = "renamed"
    press("spirals")
    assert [c.name for c in bpy.data.collections] == ["FlexMaps renamed"]
    assert {o["flexmaps_kind"] for o in bpy.data.objects if o.get("flexmaps_kind")} == {"panels", "outlines"}
    copy = dome.copy()
    copy.data = dome.data.copy()
    bpy.context.scene.collection.objects.link(copy)
    bpy.context.view_layer.objects.active = copy
    press("merge")
    assert len(bpy.data.collections) == 2
    kinds = {c.name: {o["flexmaps_kind"] for o in c.objects} for c in bpy.data.collections}
    assert kinds == {"FlexMaps renamed": {"panels", "outlines"}, f"FlexMaps {copy.name}": {"panels", "seams"}}


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

    surface = bridge.read_surface(dome, bpy.context.scene)
    flat = bridge.current_flat(surface, check.as_quad_mesh(surface.polygons))
    design = bridge.design_of(surface, flat, SpiralParams())
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
    edge = next(e for e in obj.data.edges if len(_faces_of(obj, e.index)) == 2)
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


# -- overlay -----------------------------------------------------------------------------------------------------------


def test_overlay_shows_and_hides(dome: Any, attribute: Any) -> None:
    manager = bpy.context.window_manager
    with pytest.raises(RuntimeError, match="Merge first"):
        bpy.ops.flexmaps.overlay(kind="ENERGY")
    press("merge")
    for kind in ("ENERGY", "SQUARE", "PATCH"):
        press("overlay", kind=kind)
        assert manager.flexmaps_overlay == kind
    with pytest.raises(RuntimeError, match="Spirals first"):
        bpy.ops.flexmaps.overlay(kind="TWIST")
    assert manager.flexmaps_overlay == "PATCH"
    colours = attribute(dome, "flexmaps_colour", "color", 4).reshape(-1, 4, 4)
    assert dome.data.attributes.active_color_name == "flexmaps_colour"
    patch = attribute(dome, "flexmaps_patch").astype(int)
    assert len(np.unique(colours[:, 0, :3].round(5), axis=0)) == len(np.unique(patch))
    assert (colours == colours[:, :1]).all()
    press("overlay", kind="PATCH")
    assert manager.flexmaps_overlay == "PATCH", "a script that asks for colours has them"
    press("overlay", kind="NONE")
    assert manager.flexmaps_overlay == "NONE"


def _shown_patches(obj: Any, attribute: Any) -> bool:
    """Whether the colours on the mesh tell its patches of now apart."""
    rgb = attribute(obj, "flexmaps_colour", "color", 4)[::4, :3].round(5)
    both = np.c_[rgb, attribute(obj, "flexmaps_patch")]
    return len(np.unique(rgb, axis=0)) == len(np.unique(both, axis=0)) == len(np.unique(both[:, 3]))


def test_the_layout_is_seen_at_once(dome: Any, attribute: Any) -> None:
    manager = bpy.context.window_manager
    press("trace")
    assert manager.flexmaps_overlay == "PATCH" and _shown_patches(dome, attribute)
    press("merge")
    assert manager.flexmaps_overlay == "PATCH" and _shown_patches(dome, attribute)
    press("spirals")
    press("overlay", kind="TWIST")
    press("spirals")
    assert manager.flexmaps_overlay == "TWIST", "what was chosen stays"
    press("flatten")
    assert manager.flexmaps_overlay == "PATCH", "there are no twists to be seen any more"


def test_who_took_the_colours_away_has_none(dome: Any) -> None:
    manager = bpy.context.window_manager
    press("trace")
    press("overlay", kind="NONE")
    press("merge")
    assert manager.flexmaps_overlay == "NONE"
    press("overlay", kind="ENERGY")
    press("overlay", kind="PATCH")
    press("flatten")
    assert manager.flexmaps_overlay == "PATCH"


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
def test_colours_lie_closely_on_the_surface(dome: Any, mode: str) -> None:
    """Neighbours share their corners, or the mesh would shine through between them."""
    from flexmaps.bridge.view import overlay

    press("trace")
    bpy.ops.object.mode_set(mode=mode)
    quads = overlay._quads(dome, "flexmaps_patch")
    bpy.ops.object.mode_set(mode="OBJECT")
    assert quads is not None
    assert np.array_equal(quads.positions, [v.co for v in dome.data.vertices])
    assert np.array_equal(quads.corners, [f.vertices[:] for f in dome.data.polygons])
    up, _ = overlay._normals(quads)
    assert len(up) == len(dome.data.vertices)
    assert up == pytest.approx(np.array([n.vector for n in dome.data.vertex_normals]), abs=0.1)


# -- quad remesh -------------------------------------------------------------------------------------------------------


def test_suzanne_becomes_an_accepted_quad_mesh() -> None:
    bpy.ops.mesh.primitive_monkey_add()
    monkey = bpy.context.object
    monkey.flexmaps.spiral.thickness = 3.0
    monkey.modifiers.new("Fine", "SUBSURF")
    press("quad_remesh")
    made = bpy.context.object
    assert made != monkey and monkey.hide_get() and len(monkey.data.polygons) == 500
    assert made.flexmaps.spiral.thickness == pytest.approx(3.0)
    assert 1000 < len(made.data.polygons) < 2000
    press("check")
    assert not [f for f in report(made)["checks"] if f["severity"] == "error"]
    press("set_size")
    press("trace")


def test_an_open_surface_stays_open(add: Any) -> None:
    mesh = shapes.make("dome")
    triangles = np.concatenate([mesh.quads[:, [0, 1, 2]], mesh.quads[:, [0, 2, 3]]])
    obj = add((mesh.vertices, triangles))
    obj.flexmaps.remesh.quads = 150
    press("quad_remesh")
    made = bpy.context.object
    uses = np.zeros(len(made.data.edges), int)
    for loop in made.data.loops:
        uses[loop.edge_index] += 1
    assert (uses == 1).any() and (uses <= 2).all()
    assert tuple(made.dimensions) == pytest.approx(tuple(obj.dimensions), rel=0.15)


def test_what_cannot_be_remeshed_leaves_nothing_behind(add: Any) -> None:
    turns = 2 * np.pi * np.arange(12) / 12
    across = np.stack([np.cos(turns / 2) * np.cos(turns), np.cos(turns / 2) * np.sin(turns), np.sin(turns / 2)], axis=1)
    circle = np.stack([np.cos(turns), np.sin(turns), 0 * turns], axis=1)
    strip = np.stack([circle - 0.3 * across, circle + 0.3 * across], axis=1).reshape(-1, 3)
    faces = [(2 * k, 2 * k + 1, 2 * k + 3, 2 * k + 2) for k in range(11)] + [(22, 23, 0, 1)]
    add((strip, faces))
    objects, meshes = len(bpy.data.objects), len(bpy.data.meshes)
    with pytest.raises(RuntimeError, match="only one side") as error:
        bpy.ops.flexmaps.quad_remesh()
    assert "remesh" not in str(error.value)  # no advice to do what was just done
    assert (len(bpy.data.objects), len(bpy.data.meshes)) == (objects, meshes)


def bodies_of(obj: Any) -> int:
    from flexmaps.bridge.store import mesh
    from flexmaps.engine.surface.checking import topology as check_topology

    found = mesh.read_surface(obj, bpy.context.scene).polygons
    return int(check_topology.bodies(check_topology.sides_of(found), len(found.sizes)).max()) + 1


def test_no_body_is_lost() -> None:
    """A letter with its dot: H, the stem and the dot of i, flat and open."""
    bpy.ops.object.text_add()
    bpy.context.object.data.body = "Hi"
    bpy.ops.object.convert(target="MESH")
    text = bpy.context.object
    text.flexmaps.remesh.quads = 250
    press("quad_remesh")
    made = bpy.context.object
    assert made != text and bodies_of(made) == 3
    area = [sum(face.area for face in obj.data.polygons) for obj in (text, made)]
    assert area[1] == pytest.approx(area[0], rel=0.05)  # neither left out nor covered on both sides


def test_bodies_that_cut_each_other_become_one() -> None:
    bpy.ops.mesh.primitive_uv_sphere_add(segments=16, ring_count=8)
    first = bpy.context.object
    bpy.ops.mesh.primitive_uv_sphere_add(segments=16, ring_count=8, location=(1.2, 0.0, 0.0))
    first.select_set(True)
    bpy.ops.object.join()
    bpy.context.object.flexmaps.remesh.quads = 200
    press("quad_remesh")
    assert bodies_of(bpy.context.object) == 1
    assert bpy.context.object.dimensions.x == pytest.approx(3.2, rel=0.1)


@pytest.mark.parametrize("size", [1e-3, 1e3])
def test_the_size_of_a_surface_does_not_matter(size: float) -> None:
    """QuadriFlow itself works in single precision with bounds of its own."""
    bpy.ops.mesh.primitive_monkey_add(size=size)
    monkey = bpy.context.object
    monkey.flexmaps.remesh.quads = 300
    press("quad_remesh")
    made = bpy.context.object
    assert made != monkey and bodies_of(made) == bodies_of(monkey) == 3
    press("check")


# -- sidebar -----------------------------------------------------------------------------------------------------------


class Drawn:
    """Stands for a layout and notes what is drawn; every property and operator must be there."""

    def __init__(self, lines: list[str] | None = None):
        self.lines = [] if lines is None else lines
        self.alert = False

    def prop(self, owner: Any, name: str, **_: Any) -> None:
        assert name in owner.bl_rna.properties, name

    def prop_search(self, owner: Any, name: str, where: Any, collection: str, **_: Any) -> None:
        assert name in owner.bl_rna.properties and collection in where.bl_rna.properties, name

    def operator(self, idname: str, text: str = "", **_: Any) -> Any:
        group, name = idname.split(".")
        self.lines.append(text or getattr(getattr(bpy.ops, group), name).get_rna_type().name)
        return SimpleNamespace()

    def label(self, text: str = "", **_: Any) -> None:
        self.lines.append(("! " if self.alert else "") + text)

    def progress(self, text: str = "", **_: Any) -> None:
        self.lines.append(text)

    def template_icon(self, icon_value: int, **_: Any) -> None:
        assert icon_value >= 0

    def separator(self, **_: Any) -> None:
        pass

    def panel(self, idname: str, default_closed: bool = False) -> Any:
        return self._inner(), self._inner()

    def _inner(self, **_: Any) -> Drawn:
        inner = Drawn(self.lines)
        inner.alert = self.alert
        return inner

    row = column = box = _inner


def draw(panel: Any) -> list[str]:
    drawn = Drawn()
    shown = SimpleNamespace(layout=drawn, stage=getattr(panel, "stage", ""))
    if hasattr(panel, "draw_header"):
        panel.draw_header(shown, bpy.context)
    panel.draw(shown, bpy.context)
    return drawn.lines


@pytest.fixture
def sides() -> Callable[[], list[str]]:
    ours = [
        panel for panel in panels.CLASSES if panel.bl_region_type == "UI"
    ]  # the list of presets is drawn by Blender
    return lambda: [line for panel in ours if getattr(panel, "poll", bool)(bpy.context) for line in draw(panel)]


def test_the_sidebar_shows_the_numbers_of_every_stage(dome: Any, tmp_path: Path, sides: Any, content: Any) -> None:
    dome.flexmaps.export.folder = str(tmp_path)
    assert "Largest distortion" not in sides()
    for button in ("check", "merge", "spirals", "export"):
        press(button)
        before = content(dome)
        sides()
        assert content(dome) == before
    lines = sides()
    for wanted in ("Patches", "Largest distortion", "Seam mismatch", "Spirals", "Twist", "Sheets", "Cut length"):
        assert wanted in lines
    assert "-" not in lines and "None" not in " ".join(lines)


def test_the_sidebar_tells_a_simulation_as_it_is(dome: Any, sides: Any) -> None:
    for button in ("flatten", "spirals", "simulate"):
        press(button)
    lines = sides()
    assert {"RMS distance", "Largest distance", "Largest strain"} <= set(lines)
    dome.flexmaps.simulate.iterations = 1
    assert "A setting was changed since" in sides()
    press("simulate")
    status = report(dome)["equilibrium"]["status"]
    assert "No equilibrium" in status and status[:20] in " ".join(sides())
    assert "! Iterations" in sides()  # in red
    dome.flexmaps.material.material = "custom"
    sides()


def test_the_sidebar_shows_a_running_job_and_warnings(add: Any, sides: Any) -> None:
    from flexmaps.bridge.hosts import background

    obj = add(shapes.make("dome"))
    notes.write_checks(obj.data, [check.Finding("x", "warning", "Quads are small", faces=(1,))])
    assert {"Quads are small", "Show faces"} <= set(sides())
    running = background.Job("Merge", lambda progress: None)
    running.text = "Merging: 12 patches"
    running.start()
    try:
        assert any("12 patches" in line for line in sides())
        assert not bpy.ops.flexmaps.trace.poll()
    finally:
        running.end()
    assert bpy.ops.flexmaps.trace.poll()


def test_the_sidebar_shows_the_first_remark_on_a_layout(dome: Any, sides: Any) -> None:
    press("flatten")
    quiet = sides()
    found = report(dome)["layout"]
    notes.write(
        dome.data, "layout", found | {"remarks": ["Panel 3 is one quad", "Panel 4 is another", "So is panel 5"]}
    )
    said = [line for line in sides() if line not in quiet]
    assert said[0] == "Panel 3 is one quad" and "and 2 more" in said[1]
    assert not any("another" in line or "So is" in line for line in said)
    notes.write(dome.data, "layout", found | {"remarks": ["Panel 3 is one quad"]})
    assert "more; Report" not in " ".join(sides())


def test_the_report_on_the_mesh_is_plain_json(dome: Any) -> None:
    press("merge")
    assert json.loads(dome.data["flexmaps_report"])["layout"]["patches"] >= 1
    assert collection.existing(dome) is not None


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


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
def test_seams_have_the_colours_of_the_assembly_sheet(dome: Any, mode: str) -> None:
    from flexmaps.bridge.store import mesh as bridge
    from flexmaps.bridge.view import overlay
    from flexmaps.engine import colours

    press("merge")
    surface = bridge.read_surface(dome, bpy.context.scene)
    flat = bridge.current_flat(surface, check.as_quad_mesh(surface.polygons))
    bpy.ops.object.mode_set(mode=mode)
    quads = overlay._quads(dome, "flexmaps_patch")
    assert quads is not None
    seams = quads.seams
    bpy.ops.object.mode_set(mode="OBJECT")
    wanted = flat.layout.seam_of[flat.layout.mesh.quad_edges]
    assert (np.where(seams == overlay.NO_SEAM, -1, seams) == wanted).all() and wanted.max() >= 0
    drawn = overlay._seam_colours(np.array([wanted.max(), -1]), "PATCH")
    assert np.abs(colours.linear(drawn[0, :3]) - colours.of_seams(int(wanted.max()) + 1)[-1]).max() < 0.01
    assert drawn[1, :3] == pytest.approx(colours.SEAM)
    assert overlay._seam_colours(np.array([0]), "ENERGY")[0, :3] == pytest.approx(colours.SEAM)

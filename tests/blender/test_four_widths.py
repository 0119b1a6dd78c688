"""Four arms of four widths: what is stored, what is read of older files, what is said of what cannot be."""

from __future__ import annotations

from typing import Any

import bmesh
import bpy
import numpy as np
import pytest
from flexmaps import api
from flexmaps.bridge.store import attributes, checksums, mesh, stored_report
from flexmaps.bridge.view import overlay
from flexmaps.engine.params import SpiralParams
from flexmaps.engine.spirals.design import SpiralDesign
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking import check
from support.buttons import press


def _unlike(obj: Any) -> tuple[SpiralDesign, Any]:
    """Spirals of four different widths, written to the object."""
    surface = mesh.read_surface(obj, bpy.context.scene)
    quads = check.as_quad_mesh(surface.polygons)
    flat = mesh.require_current_flat(surface, quads)
    width = 1e-3 * np.random.default_rng(0).uniform(1.0, 1.4, (len(quads.quads), 4)).astype(np.float32).astype(float)
    made = SpiralDesign(flat, SpiralParams(), width, np.radians(np.full(len(width), 90.0)))
    mesh.write_design(obj, surface, made)
    return made, surface


def _by_edge(obj: Any) -> dict[tuple[int, frozenset[int]], float]:
    """The width at every side, by its face's vertices: read from Blender's own loops, whichever way the object is mirrored."""
    values = attributes.read(obj.data, "flexmaps_width")
    assert values is not None
    mirrored = obj.matrix_world.determinant() < 0
    found = {}
    for face in obj.data.polygons:
        loops = list(face.loop_indices)
        for k, loop in enumerate(loops):
            other = loops[(k - 1 if mirrored else k + 1) % len(loops)]
            ends = frozenset(obj.data.loops[i].vertex_index for i in (loop, other))
            found[face.index, ends] = float(values[loop])
    return found


@pytest.mark.parametrize("scale", [(1, 1, 1), (-1, 1, 1)])
@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
def test_each_width_lies_at_its_side(add: Any, scale: Any, mode: str) -> None:
    obj = add(shapes.make("cubesphere"))
    obj.scale = scale
    bpy.context.view_layer.update()
    bpy.ops.object.mode_set(mode=mode)
    press("flatten")
    made, _ = _unlike(obj)
    surface = mesh.read_surface(obj, bpy.context.scene)
    again = mesh.read_design(surface, made.flat, SpiralParams())
    assert again is not None
    assert again.width == pytest.approx(made.width, rel=1e-6)
    bpy.ops.object.mode_set(mode="OBJECT")
    found = _by_edge(obj)
    quads = made.flat.layout.mesh.quads  # every vertex of the mesh is used: the engine's numbers are Blender's
    for face, k in np.ndindex(*quads.shape):
        ends = frozenset((int(quads[face, k]), int(quads[face, (k + 1) % 4])))
        assert found[face, ends] == pytest.approx(1e3 * made.width[face, k], rel=1e-6)


def test_a_mirroring_that_is_applied_keeps_the_widths_at_their_sides(add: Any) -> None:
    obj = add(shapes.make("cubesphere"))
    obj.scale = (-1, 1, 1)
    bpy.context.view_layer.update()
    press("flatten")
    _unlike(obj)
    before = _by_edge(obj)
    bpy.ops.object.transform_apply(scale=True)
    face = obj.data.polygons[0]
    if face.normal.dot(face.center) < 0:  # older Blenders leave them inwards
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.ops.mesh.select_all(action="SELECT")
        bpy.ops.mesh.flip_normals()
        bpy.ops.object.mode_set(mode="OBJECT")
    assert _by_edge(obj) == before


def test_a_face_whose_corners_begin_elsewhere_keeps_its_widths(dome: Any) -> None:
    """As in Blender's own rotation of a face: values of corners go with them."""
    press("flatten")
    _unlike(dome)
    before = _by_edge(dome)
    bm = bmesh.new()
    bm.from_mesh(dome.data)
    layer = bm.loops.layers.float["flexmaps_width"]
    bm.faces.ensure_lookup_table()
    face = bm.faces[3]
    old = frozenset(v.index for v in face.verts)
    kept, around = {loop.vert: loop[layer] for loop in face.loops}, list(face.verts)
    bm.faces.remove(face)
    for loop in bm.faces.new([*around[1:], around[0]]).loops:
        loop[layer] = kept[loop.vert]
    bm.to_mesh(dome.data)
    bm.free()
    faces = {frozenset(face.vertices): face.index for face in dome.data.polygons}
    after = {ends: width for (index, ends), width in _by_edge(dome).items() if index == faces[old]}
    assert after == {ends: width for (index, ends), width in before.items() if index == 3}


def _as_older_files(obj: Any, names: tuple[str, ...] = ("flexmaps_width",)) -> np.ndarray:
    """Widths as they were written before: one a face."""
    one = np.linspace(1.0, 1.4, len(obj.data.polygons))
    for name in names:
        obj.data.attributes.remove(obj.data.attributes[name])
        obj.data.attributes.new(name, "FLOAT", "FACE").data.foreach_set("value", one.astype(np.float32))
    return one


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
def test_one_width_a_face_of_an_older_file(dome: Any, mode: str) -> None:
    press("flatten")
    press("spirals")
    one = _as_older_files(dome)
    before = checksums.Checksums(dome, bpy.context.scene)["design"]
    bpy.ops.object.mode_set(mode=mode)
    assert checksums.Checksums(dome, bpy.context.scene)["design"] == before
    piece = api.load(dome)
    assert not [f for f in api.check(piece) if f.code == "left-out"]
    assert piece.result.design is not None
    assert piece.result.design.width == pytest.approx(1e-3 * np.repeat(one[:, None], 4, axis=1), rel=1e-6)
    press("overlay", kind="WIDTH")
    quads = overlay._read_quads(dome, "WIDTH")
    assert quads is not None and quads.values == pytest.approx(one, rel=1e-6)
    press("spirals")
    bpy.ops.object.mode_set(mode="OBJECT")
    assert dome.data.attributes["flexmaps_width"].domain == "CORNER"


def test_older_widths_are_shelved_as_four(dome: Any) -> None:
    press("flatten")
    press("spirals")
    one = _as_older_files(dome)
    press("flatten")
    last = dome.data.attributes["flexmaps_last_width"]
    assert last.domain == "CORNER" and len(last.data) == 4 * len(one)
    values = attributes.read(dome.data, "flexmaps_last_width")
    assert values is not None and values == pytest.approx(np.repeat(one, 4), rel=1e-6)


@pytest.mark.parametrize(("value", "button"), [(np.nan, "simulate"), (-1.0, "simulate"), (15.0, "optimise")])
def test_widths_that_cannot_be_name_their_face(dome: Any, value: float, button: str) -> None:
    press("flatten")
    press("spirals")
    kept = attributes.read(dome.data, "flexmaps_width")
    dome.data.attributes["flexmaps_width"].data[4 * 7 + 2].value = value
    with pytest.raises(RuntimeError, match="spirals were changed by hand"):
        press(button)
    named = [face.index for face in dome.data.polygons if face.select]
    assert 7 in named and len(named) == (2 if value == 15.0 else 1)  # so wide an arm closes its neighbour's slot too
    found = dome.data.attributes["flexmaps_width"].data
    assert len(found) == len(kept)  # nothing is lost
    assert stored_report.read(dome.data)["spirals"]


@pytest.mark.parametrize(
    ("button", "said"), [("optimise", "spirals were changed by hand"), ("export", "1 spiral does not fit its quad")]
)
def test_a_design_whose_slots_close_names_its_faces(dome: Any, button: str, said: str, tmp_path: Any) -> None:
    """Each number for itself could be: it is the wide arms of a strongly wound spiral that touch."""
    dome.flexmaps.export.folder = str(tmp_path)
    press("flatten")
    press("spirals")
    width, twist = (dome.data.attributes[f"flexmaps_{name}"].data for name in ("width", "twist"))
    for loop in dome.data.polygons[7].loop_indices:
        width[loop].value = 2.0
    twist[7].value = 355.0
    before = attributes.read(dome.data, "flexmaps_width"), attributes.read(dome.data, "flexmaps_twist")
    with pytest.raises(RuntimeError, match=said):
        press(button)
    named = [face.index for face in dome.data.polygons if face.select]
    assert 7 in named and len(named) <= 5  # and those beside it whose slots it closes
    after = attributes.read(dome.data, "flexmaps_width"), attributes.read(dome.data, "flexmaps_twist")
    assert all(np.array_equal(a, b) for a, b in zip(after, before, strict=True))
    assert not list(tmp_path.iterdir())


def test_overlay_of_anisotropy(dome: Any) -> None:
    press("flatten")
    made, _ = _unlike(dome)
    press("overlay", kind="ANISOTROPY")
    quads = overlay._read_quads(dome, "ANISOTROPY")
    assert quads is not None and quads.width is not None
    w = 1e3 * made.width
    assert quads.values == pytest.approx(100 * abs(w[:, 0] + w[:, 2] - w[:, 1] - w[:, 3]) / w.sum(axis=1), abs=1e-3)
    bars = overlay.width_bars(quads.positions[quads.corners], quads.width).reshape(len(w), 2, 2, 3)
    long = np.linalg.norm(bars[:, :, 1] - bars[:, :, 0], axis=2)
    p = quads.positions[quads.corners]
    middle = 0.5 * (p + np.roll(p, -1, axis=1))
    across = np.linalg.norm(middle[:, :2] - middle[:, 2:], axis=2)
    assert (long / across) / (w[:, :2] + w[:, 2:]) == pytest.approx(
        overlay.BAR_LENGTH / (w[:, :2] + w[:, 2:]).max(), rel=1e-4
    )

"""Size and quad edge of a surface: with the user's shape keys, as scaled in the world, of faces alone, and as promised."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps.bridge.store import dimensions, guidance, mark_transfer, mesh
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking import check

Add = Callable[..., Any]


def _update() -> None:
    bpy.context.view_layer.update()


def _key(obj: Any, height: float = 2.0) -> None:
    """Give the object a shape key of its user that makes it so many times as high."""
    obj.shape_key_add(name="Basis")
    key = obj.shape_key_add(name="higher")
    for point in key.data:
        point.co.z *= height
    key.value = 1.0
    _update()


def _parent(obj: Any, *scale: float) -> None:
    obj.parent = bpy.data.objects.new("parent", None)
    bpy.context.scene.collection.objects.link(obj.parent)
    obj.parent.scale = scale
    _update()


def _loose_edge(obj: Any) -> None:
    vertices, edges = len(obj.data.vertices), len(obj.data.edges)
    obj.data.vertices.add(2)
    obj.data.edges.add(1)
    obj.data.vertices[vertices + 1].co.z = 50.0
    obj.data.edges[edges].vertices = (vertices, vertices + 1)
    obj.data.update()
    _update()


def _sheet(quads: int) -> Any:
    """Add a flat sheet with this number of quads along a side."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=quads, y_subdivisions=quads, size=0.2)
    return bpy.context.object


def _read(obj: Any) -> Any:
    """Return the polygons that a stage reads."""
    return mesh.read_surface(obj, bpy.context.scene).polygons


def _assert_as_read(obj: Any) -> None:
    """Assert that size and quad edge are those of the surface that a stage reads, of an object that is not turned."""
    polygons = _read(obj)
    assert tuple(obj.flexmaps_size) == pytest.approx(
        1e3 * np.ptp(polygons.vertices[polygons.corners], axis=0), rel=1e-5
    )
    edge = dimensions.quad_edge(obj, bpy.context.scene)
    assert edge == pytest.approx(check.median_edge(polygons), rel=1e-5)


@pytest.mark.parametrize("change", [_key, lambda obj: _parent(obj, 2, 3, 1), _loose_edge, lambda obj: None])
@pytest.mark.parametrize("simulated", [False, True])
def test_size_and_edge_are_those_of_the_surface_that_a_stage_reads(dome: Any, change: Any, simulated: bool) -> None:
    change(dome)
    if simulated:
        if dome.data.shape_keys is None:
            dome.shape_key_add(name="Basis")
        key = dome.shape_key_add(name="FlexMaps equilibrium", from_mix=False)
        for point in key.data:
            point.co *= 3.0
        key.value = 1.0
    _update()
    _assert_as_read(dome)


def test_a_typed_size_is_reached_below_a_scaled_parent(dome: Any) -> None:
    _parent(dome, 2.0, 2.0, 2.0)
    _key(dome)
    before = tuple(dome.flexmaps_size)
    dome.flexmaps_size = before
    _update()
    assert tuple(dome.flexmaps_size) == pytest.approx(before, rel=1e-5)
    dome.flexmaps_size = tuple(1.5 * length for length in before)
    _update()
    assert tuple(dome.flexmaps_size) == pytest.approx([1.5 * length for length in before], rel=1e-5)
    _assert_as_read(dome)


def test_a_keyed_piece_stands_on_what_is_seen_to_be_lowest() -> None:
    sheet = _sheet(6)
    _loose_edge(sheet)
    _key(sheet)
    for point in sheet.data.shape_keys.key_blocks["higher"].data:
        point.co.z -= 10.0 * point.co.x**2
    _update()
    sheet.flexmaps_rests = "STANDS"
    held = [v.index for v in sheet.data.vertices if v.groups]
    vertices = _read(sheet).vertices
    assert 0 < len(held) < len(vertices) / 2
    assert vertices[held, 2].max() < np.median(vertices[:-2, 2])


def _unlike_lengths(mesh: Any) -> Any:
    """Stretch every second row of vertices, so that edges of one direction or row have other lengths."""
    vertices = mesh.vertices.copy()
    vertices[:, 0] *= 1.7
    vertices[::2] *= (1.0, 1.0, 1.1)
    return mesh.with_vertices(vertices)


@pytest.mark.parametrize("name", ["dome", "torus", "vault", "saddle"])
@pytest.mark.parametrize("keyed", [False, True])
def test_next_gives_the_size_that_it_promises(add: Add, name: str, keyed: bool) -> None:
    surface = _unlike_lengths(shapes.make(name))
    piece = add(surface.with_vertices(10.0 * surface.vertices))
    if keyed:
        _key(piece)
    action = guidance.read_guidance(piece, bpy.context.scene).action
    assert action is not None and action.idname == "flexmaps.set_size"
    assert bpy.ops.flexmaps.next() == {"FINISHED"}
    assert f"Scale to {max(piece.flexmaps_size):.3g} mm" in action.label
    assert dimensions.quad_edge(piece, bpy.context.scene) == pytest.approx(1e-3 * piece.flexmaps.remesh.edge, rel=1e-5)
    _assert_as_read(piece)


def test_the_edge_follows_every_change() -> None:
    piece, scene = _sheet(4), bpy.context.scene
    edge = dimensions.quad_edge(piece, scene)
    assert dimensions.quad_edge(piece, scene) == edge
    piece.scale = (2.0, 2.0, 2.0)
    _update()
    assert dimensions.quad_edge(piece, scene) == pytest.approx(2.0 * edge)
    scene.unit_settings.scale_length = 0.5
    assert dimensions.quad_edge(piece, scene) == pytest.approx(edge)
    for vertex in piece.data.vertices:
        vertex.co *= 3.0
    assert dimensions.quad_edge(piece, scene) == pytest.approx(3.0 * edge)


def test_marks_stay_where_they_are_seen_on_a_keyed_mesh() -> None:
    old = _sheet(8)
    left = [vertex.index for vertex in old.data.vertices if vertex.co.x < 0.001]
    old.vertex_groups.new(name="left").add(left, 1.0, "REPLACE")
    for edge in old.data.edges:
        edge.use_seam = all(abs(old.data.vertices[k].co.x) < 0.001 for k in edge.vertices)
    _key(old)
    for point in old.data.shape_keys.key_blocks["higher"].data:
        point.co.x += 0.15
    seams = [edge.use_seam for edge in old.data.edges]
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=8, y_subdivisions=8, size=0.2)
    made = bpy.context.object
    for vertex in made.data.vertices:
        vertex.co.x += 0.15
    mark_transfer.transfer_marks(old, made)
    assert [vertex.index for vertex in made.data.vertices if vertex.groups] == left
    assert [edge.use_seam for edge in made.data.edges] == seams


def test_the_estimate_for_other_polygons_follows_shape_keys() -> None:
    """The same shape gives the same estimate, whether its shape key is applied or not."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=8, ring_count=5)
    piece, scene = bpy.context.object, bpy.context.scene
    _key(piece, 3.0)
    keyed = dimensions.estimate_quad_edge(piece, scene)
    bpy.ops.object.convert(target="MESH")
    assert keyed == pytest.approx(dimensions.estimate_quad_edge(bpy.context.object, scene), rel=1e-3)

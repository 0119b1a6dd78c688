"""Meshes between Blender and the engine: frames, numbering, and Blender's mesh as the only store."""

from __future__ import annotations

from math import pi
from typing import Any

import bmesh
import bpy
import numpy as np
import pytest
from flexmaps.bridge.store import mesh
from flexmaps.bridge.store.surface import ObjectSurface
from flexmaps.engine.display import arrange
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.params import LayoutParams, SpiralParams
from flexmaps.engine.patches.flattening import flatten
from flexmaps.engine.patches.flattening.flatten import FlatPatches
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.spirals import fabricable
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking import check
from flexmaps.engine.surface.mesh import QuadMesh


def read(obj: Any) -> tuple[ObjectSurface, QuadMesh]:
    bpy.context.view_layer.update()
    surface = mesh.read_surface(obj, bpy.context.scene)
    return surface, check.as_quad_mesh(surface.polygons)


def flat_of(quads: QuadMesh) -> FlatPatches:
    return flatten.flatten(trace.trace_layout(quads, LayoutParams()), LayoutParams())


@pytest.fixture
def sphere(add: Any) -> Any:
    return add(shapes.make("cubesphere"))


def test_metres_and_world_axes(dome: Any) -> None:
    original = shapes.make("dome").vertices
    dome.location, dome.rotation_euler, dome.scale = (3.0, -2.0, 1.0), (0.0, 0.0, pi / 2), (2.0, 2.0, 2.0)
    bpy.context.scene.unit_settings.scale_length = 0.01
    _, quads = read(dome)
    turned = np.stack([-original[:, 1], original[:, 0], original[:, 2]], axis=1)
    assert quads.vertices == pytest.approx(0.01 * (2.0 * turned + [3.0, -2.0, 1.0]), abs=1e-7)


def test_vertices_come_back_where_they_were(dome: Any) -> None:
    dome.location, dome.rotation_euler, dome.scale = (3.0, -2.0, 1.0), (0.3, 0.2, 0.1), (2.0, 0.5, 1.0)
    bpy.context.scene.unit_settings.scale_length = 0.001
    surface, quads = read(dome)
    raised = quads.vertices + np.array([0.0, 0.0, 0.001])
    mesh.write_vertices(dome, surface, quads.with_vertices(raised))
    _, again = read(dome)
    assert again.vertices == pytest.approx(raised, abs=1e-9)


@pytest.mark.parametrize("scale", [(1, 1, 1), (-1, 1, 1), (-2, -1, -1), (1, -1, -1)])
def test_outside_is_what_is_seen_as_outside(sphere: Any, scale: tuple[float, float, float]) -> None:
    """The signed volume of a closed body is positive, mirrored or not."""
    sphere.scale = scale
    _, quads = read(sphere)
    assert (quads.centroids * quads.area_vectors).sum() > 0


def loose(obj: Any) -> None:
    """Add what belongs to no face, first in Blender's numbering."""
    bm = bmesh.new()
    for co in ((9, 9, 9), (9, 9, 8)):
        bm.verts.new(co)
    bm.verts.ensure_lookup_table()
    bm.edges.new(bm.verts[:2])
    bm.from_mesh(obj.data)
    bm.to_mesh(obj.data)
    bm.free()


@pytest.mark.parametrize("with_loose", [False, True])
@pytest.mark.parametrize("scale", [(1, 1, 1), (-1, 1, 1)])
@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
def test_seams_patches_and_spirals_are_read_as_written(sphere: Any, with_loose: bool, scale: Any, mode: str) -> None:
    sphere.scale = scale
    if with_loose:
        loose(sphere)
    bpy.ops.object.mode_set(mode=mode)
    surface, quads = read(sphere)
    flat = flat_of(quads)
    mesh.write_flat(sphere, surface, flat, arrange.arrange_patches(flat))
    made = fabricable.uniform_design(flat, SpiralParams())
    mesh.write_design(sphere, surface, made)
    assert sphere.mode == mode

    surface, quads = read(sphere)
    assert (mesh.read_layout(surface, quads).cut == flat.layout.cut).all()
    again = mesh.require_current_flat(surface, quads)
    assert (again.layout.cut == flat.layout.cut).all()
    assert again.corners == pytest.approx(flat.corners, abs=1e-7)
    assert again.energy == pytest.approx(flat.energy, abs=1e-5)
    spirals = mesh.read_design(surface, again, SpiralParams())
    assert spirals is not None
    assert spirals.width == pytest.approx(made.width, rel=1e-6)
    assert spirals.twist == pytest.approx(made.twist, rel=1e-6)


def test_seams_lie_on_the_edges_that_are_cut(sphere: Any) -> None:
    """Checked by vertex positions, independently of any numbering."""
    sphere.scale = (-1, 1, 1)
    surface, quads = read(sphere)
    flat = flat_of(quads)
    mesh.write_flat(sphere, surface, flat, arrange.arrange_patches(flat))

    def middles(points: np.ndarray, pairs: np.ndarray) -> set[tuple[int, ...]]:
        return {tuple(x) for x in np.round(points[pairs].mean(axis=1) * 1e5).astype(int).tolist()}

    world = np.array([sphere.matrix_world @ v.co for v in sphere.data.vertices])
    marked = np.array([edge.vertices[:] for edge in sphere.data.edges if edge.use_seam])
    assert middles(world, marked) == middles(quads.vertices, quads.edges[flat.layout.cut])


def test_uv_map_is_the_flat_patches_in_millimetres(dome: Any) -> None:
    """Every edge's length in the UV map is close to its length on the surface, in millimetres."""
    surface, quads = read(dome)
    flat = flat_of(quads)
    mesh.write_flat(dome, surface, flat, arrange.arrange_patches(flat))
    uv = np.empty(2 * len(dome.data.loops), np.float32)
    dome.data.uv_layers["flexmaps_flat"].uv.foreach_get("vector", uv)
    corners = uv.reshape(-1, 4, 2)
    length = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    surface_length = quads.edge_lengths[quads.quad_edges] * 1e3
    assert np.abs(length / surface_length - 1).max() < 0.35
    assert np.median(np.abs(length / surface_length - 1)) < 0.05
    area = 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    assert (area > 0).all()


def test_patches_lie_beside_each_other(sphere: Any) -> None:
    from shapely import Polygon
    from shapely.ops import unary_union

    _, quads = read(sphere)
    flat = flat_of(quads)
    corners = flat.corners + arrange.arrange_patches(flat)[flat.layout.patch_of][:, None]
    patches = [unary_union([Polygon(c).buffer(1e-6) for c in corners[q]]) for q in flat.layout.patches]
    assert len(patches) > 1
    for i, one in enumerate(patches):
        for other in patches[:i]:
            assert one.distance(other) > 0.001


def test_a_uv_map_edited_by_hand_is_noticed(dome: Any) -> None:
    surface, quads = read(dome)
    flat = flat_of(quads)
    mesh.write_flat(dome, surface, flat, arrange.arrange_patches(flat))
    dome.data.uv_layers["flexmaps_flat"].uv[7].vector.x += 5.0
    with pytest.raises(FlexMapsError, match="flexmaps_flat"):
        mesh.require_current_flat(*read(dome))


def test_a_surface_changed_since_is_noticed(dome: Any) -> None:
    surface, quads = read(dome)
    flat = flat_of(quads)
    mesh.write_flat(dome, surface, flat, arrange.arrange_patches(flat))
    dome.data.vertices[40].co.z += 0.01
    with pytest.raises(FlexMapsError, match="changed after"):
        mesh.require_current_flat(*read(dome))


def test_seams_edited_since_are_noticed(dome: Any) -> None:
    surface, quads = read(dome)
    flat = flat_of(quads)
    mesh.write_flat(dome, surface, flat, arrange.arrange_patches(flat))
    inner = np.flatnonzero(~quads.border & ~flat.layout.cut)[0]
    dome.data.edges[int(surface.edge_of[inner])].use_seam = True
    with pytest.raises(FlexMapsError, match="Update from seams") as caught:
        mesh.require_current_flat(*read(dome))
    assert caught.value.edges == [inner]


def test_too_many_uv_maps_are_refused_and_nothing_is_written(dome: Any, content: Any) -> None:
    for k in range(8):
        dome.data.uv_layers.new(name=f"map {k}")
    surface, quads = read(dome)
    flat = flat_of(quads)
    before = content(dome)
    with pytest.raises(FlexMapsError, match="UV map"):
        mesh.write_flat(dome, surface, flat, arrange.arrange_patches(flat))
    assert content(dome) == before


def test_a_foreign_attribute_of_that_name_is_replaced(dome: Any) -> None:
    dome.data.attributes.new("flexmaps_energy", "FLOAT_VECTOR", "POINT")
    surface, quads = read(dome)
    flat = flat_of(quads)
    mesh.write_flat(dome, surface, flat, arrange.arrange_patches(flat))
    assert mesh.require_current_flat(*read(dome)).energy == pytest.approx(flat.energy, abs=1e-5)


def test_no_faces(add: Any) -> None:
    obj = add(([(0, 0, 0), (1, 0, 0)], []))
    with pytest.raises(FlexMapsError, match="no faces"):
        read(obj)


def test_modifiers_that_change_the_surface_are_named(dome: Any) -> None:
    dome.modifiers.new("Fine", "SUBSURF")
    with pytest.raises(FlexMapsError, match="'Fine'"):
        read(dome)
    dome.modifiers["Fine"].show_viewport = False
    read(dome)


def test_folded_quads_leave_the_mesh_valid(add: Any) -> None:
    """Two closed bodies flattened without a layout: quads fold over, and their measures have no bound."""
    mesh = shapes.two_bodies()
    obj = add((mesh.vertices * (0.02 / mesh.median_edge), mesh.quads))
    assert bpy.ops.flexmaps.flatten() == {"FINISHED"}
    for name in ("flexmaps_energy", "flexmaps_square"):
        values = np.empty(len(obj.data.polygons), np.float32)
        obj.data.attributes[name].data.foreach_get("value", values)
        assert np.isfinite(values).all()
    assert not obj.data.validate()

"""The Quad remesh button: quads of any mesh."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps.bridge.store import guidance
from flexmaps.engine.surface import shapes
from support.buttons import press, report


@pytest.mark.thorough
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


@pytest.mark.parametrize(
    "corners",
    [pytest.param(((0, 0), (6, 0), (1, 1.5)), marks=pytest.mark.thorough), ((0, 0), (2, 1), (0, 2), (0.7, 1))],
    ids=["obtuse", "arrow"],
)
def test_a_face_with_sharp_corners_is_covered_whole(add: Any, corners: tuple[tuple[float, float], ...]) -> None:
    obj = add((np.array([(x, y, 0) for x, y in corners], float), [tuple(range(len(corners)))]))
    obj.flexmaps.remesh.quads = 60
    area = obj.data.polygons[0].area
    press("quad_remesh")
    made = bpy.context.object
    assert sum(face.area for face in made.data.polygons) == pytest.approx(area, rel=0.02)


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


def test_a_cylinder_keeps_its_sharp_rims() -> None:
    """Two circles of radius 1 at a height of 1 and -1: their length is known, and quads that follow them have sides along it."""
    bpy.ops.mesh.primitive_cylinder_add(vertices=32)
    bpy.context.object.flexmaps.remesh.quads = 300
    press("quad_remesh")
    mesh = bpy.context.object.data
    places = np.array([vertex.co for vertex in mesh.vertices])
    on_rim = (np.abs(np.hypot(*places[:, :2].T) - 1) < 0.03) & (np.abs(np.abs(places[:, 2]) - 1) < 1e-3)
    ends = np.array([edge.vertices for edge in mesh.edges])
    ends = ends[on_rim[ends].all(axis=1)]
    along = np.linalg.norm(places[ends[:, 0]] - places[ends[:, 1]], axis=1).sum()
    assert along == pytest.approx(4 * np.pi, rel=0.05)


def bodies_of(obj: Any) -> int:
    from flexmaps.bridge.store import mesh
    from flexmaps.engine.surface.checking import topology as check_topology

    found = mesh.read_surface(obj, bpy.context.scene).polygons
    return int(check_topology.bodies(check_topology.sides_of(found), len(found.sizes)).max()) + 1


@pytest.mark.thorough
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
    made = bpy.context.object
    assert made.dimensions.x == pytest.approx(3.2, rel=0.1)
    for name in ("regularise", "check"):
        press(name)
        assert "bodies-joined" in {row["code"] for row in report(made)["checks"]}


def test_the_button_asks_for_as_many_quads_as_the_warning(add: Any) -> None:
    """Half of a ball's quads miss the other half."""
    from flexmaps.bridge.store import guidance, stored_report
    from flexmaps.engine.surface.mesh import PolygonMesh
    from flexmaps.engine.surface.remeshing.bodies import target_surface
    from flexmaps.engine.surface.remeshing.coverage import warn_of_gaps

    ball = shapes.make("cubesphere")
    half = PolygonMesh.from_quads(ball).subset(ball.centroids[:, 2] > ball.centroids[:, 2].mean())
    obj = add((half.vertices, half.corners.reshape(-1, 4)))
    (found,) = warn_of_gaps(
        half, target_surface(half), target_surface(PolygonMesh.from_quads(ball)), len(half.sizes), 0
    )
    stored_report.write_checks(obj.data, [found])
    (notice,) = (
        one for one in guidance.read_guidance(obj, bpy.context.scene).notices if one.key == "checks/surface-missed"
    )
    wanted = [cure.properties["quads"] for cure in notice.cures if cure.idname == "flexmaps.quad_remesh"]
    assert f"{wanted[-1]} quads" in notice.sentence


@pytest.mark.parametrize("size", [1e-3, 1e3])
@pytest.mark.thorough
def test_the_size_of_a_surface_does_not_matter(size: float) -> None:
    """QuadriFlow itself works in single precision with bounds of its own."""
    bpy.ops.mesh.primitive_monkey_add(size=size)
    monkey = bpy.context.object
    monkey.flexmaps.remesh.quads = 300
    press("quad_remesh")
    made = bpy.context.object
    assert made != monkey and bodies_of(made) == bodies_of(monkey) == 3
    press("check")


def test_pressed_in_edit_mode_it_goes_to_object_mode(add: Any) -> None:
    """Check shows what is wrong in edit mode, and this is what it advises."""
    good = shapes.make("dome")
    obj = add((good.vertices, np.concatenate([good.quads[:, :3], good.quads[:, [0, 2, 3]]])))
    obj.flexmaps.remesh.quads = 60
    bpy.ops.object.mode_set(mode="EDIT")
    press("quad_remesh")
    assert bpy.context.object != obj and bpy.context.object.mode == "OBJECT" and obj.hide_get()


def test_quads_are_made_again_from_what_the_first_ones_were_made_from_until_they_are_changed() -> None:
    """Of a ball of radius 1 the middles of 60 quads lie well inside, and so would the corners of quads made from these."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32)
    ball = bpy.context.object
    bpy.ops.flexmaps.quad_remesh(quads=60)
    coarse = bpy.context.object
    coarse.scale = (2.0, 2.0, 2.0)
    bpy.context.view_layer.update()
    bpy.ops.flexmaps.quad_remesh(quads=400)
    fine = bpy.context.object
    assert len({ball, coarse, fine}) == 3 and len(fine.data.polygons) > 200
    radii = [(fine.matrix_world @ vertex.co).length for vertex in fine.data.vertices]
    assert min(radii) > 1.98 and coarse.hide_get()
    bpy.context.view_layer.objects.active = coarse
    coarse.hide_set(False)
    for vertex in coarse.data.vertices:
        vertex.co.z *= 0.5
    bpy.ops.flexmaps.quad_remesh(quads=100)
    heights = [abs(vertex.co.z) for vertex in bpy.context.object.data.vertices]
    assert max(heights) < 0.6
    assert [one.name for one in (coarse, fine, bpy.context.object)] == [
        f"Sphere quads{k}" for k in ("", ".001", ".002")
    ]


def test_plates_that_meet_at_an_edge_can_be_laid_out(add: Any) -> None:
    """The remesh cuts three plates apart where they meet; none of the cuts is taken for T-junctions."""
    ends = [(0, 0, 0), (0.2, 0, 0), (-0.2, 0, 0), (0, 0, 0.2)]
    points = np.array([(x, y, z) for x, _, z in ends for y in (0.0, 0.2)])
    triangles = [face for k in (2, 4, 6) for face in ((0, k, k + 1), (0, k + 1, 1))]
    obj = add((points, triangles))
    obj.flexmaps.remesh.quads = 350
    press("quad_remesh")
    made = bpy.context.object
    assert not [row for row in report(made)["checks"] if row["severity"] == "error"]
    assert guidance.read_guidance(made, bpy.context.scene).action is not None

"""The assembled preview: what its button makes, replaces, colours and refuses."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps.bridge.store import attributes, mesh, pose, states, stored_report, vertex_positions
from flexmaps.bridge.view import materials, preview
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking import check
from support.buttons import press


@pytest.fixture
def piece(spiralled: Any) -> Any:
    return spiralled


def points_of(obj: Any) -> np.ndarray:
    found = np.empty(3 * len(obj.data.vertices), np.float32)
    obj.data.vertices.foreach_get("co", found)
    matrix = np.array(obj.matrix_world)
    return found.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]


def test_needs_spirals(add: Any) -> None:
    add(shapes.make("dome"))
    assert not bpy.ops.flexmaps.preview.poll()


def test_before_a_simulation_it_lies_on_the_target(piece: Any) -> None:
    piece.flexmaps.preview.place = "ON"
    press("preview")
    made = preview.find_piece(piece)
    assert made.name == "piece Assembled" and made.type == "MESH"
    assert not preview.read_figures(piece)["simulated"]
    bpy.context.view_layer.update()
    size = np.linalg.norm(np.ptp(points_of(piece), axis=0))
    assert points_of(made).min(axis=0) == pytest.approx(points_of(piece).min(axis=0), abs=0.03 * size)
    assert points_of(made).max(axis=0) == pytest.approx(points_of(piece).max(axis=0), abs=0.03 * size)


def test_after_a_simulation_it_follows_the_hubs(piece: Any) -> None:
    press("simulate")
    piece.flexmaps.preview.place = "ON"
    piece.flexmaps.preview.detail = "COARSE"
    press("preview")
    made, figures = preview.find_piece(piece), preview.read_figures(piece)
    assert figures["simulated"] and figures["spirals"] == len(piece.data.polygons)
    assert figures["triangles"] == sum(len(p.vertices) - 2 for p in made.data.polygons)
    surface = mesh.read_surface(piece, bpy.context.scene)
    hubs = pose.read(piece, surface.to_metres)
    assert hubs is not None
    # the two plates of a hub are its largest faces; between their middles lies its centre
    quad = np.empty(len(made.data.polygons), np.int32)
    made.data.attributes["flexmaps_quad"].data.foreach_get("value", quad)
    bpy.context.view_layer.update()
    points = points_of(made)
    for k in (0, len(hubs.centres) // 2):
        plates = [p for p in made.data.polygons if quad[p.index] == k and len(p.vertices) == 8]
        assert len(plates) == 2
        normal = np.array(plates[0].normal)
        assert abs(normal @ hubs.rotations[k, :, 2]) == pytest.approx(1.0, abs=1e-4)
        away = points[list(plates[0].vertices)] - hubs.centres[k]
        assert np.abs(away @ hubs.rotations[k, :, 2]) == pytest.approx(
            0.5e-3 * piece.flexmaps.spiral.thickness, abs=1e-7
        )


def test_the_pose_moves_with_the_object(piece: Any) -> None:
    press("simulate")
    scene = bpy.context.scene
    before = pose.read(piece, vertex_positions.to_metres(piece, scene))
    piece.rotation_euler, piece.location = (0.3, -0.2, 1.0), (1.0, 2.0, 3.0)
    bpy.context.view_layer.update()
    after = pose.read(piece, vertex_positions.to_metres(piece, scene))
    turn, shift = np.array(piece.matrix_world)[:3, :3], np.array(piece.matrix_world)[:3, 3]
    assert before is not None and after is not None
    assert after.centres == pytest.approx(before.centres @ turn.T + shift, abs=1e-6)
    assert after.rotations == pytest.approx(turn @ before.rotations, abs=1e-5)


def test_pressed_again_it_is_replaced(piece: Any) -> None:
    counts = []
    for detail, colour in (("COARSE", "PATCH"), ("FINE", "MATERIAL"), ("LINES", "PATCH"), ("COARSE", "PATCH")):
        piece.flexmaps.preview.detail, piece.flexmaps.preview.colour = detail, colour
        press("preview")
        counts.append((len(bpy.data.objects), len(bpy.data.meshes), len(bpy.data.curves)))
    assert counts[0] == counts[1] == counts[3]
    assert len([o for o in bpy.data.objects if o.name.startswith("piece Assembled")]) == 1
    assert {o.name for o in bpy.data.objects} == {o.name for o in bpy.data.objects if ".0" not in o.name}


def test_it_says_when_it_is_old(piece: Any) -> None:
    def old() -> bool:
        return states.is_side_result_stale(piece, bpy.context.scene, "preview")

    press("preview")
    assert not old()
    press("simulate")
    assert old(), "the hubs stand elsewhere now"
    press("preview")
    piece.location = (1.0, 2.0, 3.0)
    piece.flexmaps.cut.kerf_outline = 0.1
    bpy.context.view_layer.update()
    assert not old()
    piece.flexmaps.spiral.thickness = 1.5
    assert old()


def test_wires_have_the_colours_of_their_patches(piece: Any) -> None:
    piece.flexmaps.preview.detail = "LINES"
    press("preview")
    made = preview.find_piece(piece).data
    patches = attributes.read(piece.data, "flexmaps_patch")
    worn = np.array([spline.material_index for spline in made.splines]).reshape(-1, 4)
    assert (worn == worn[:, :1]).all() and len(made.materials) == len(np.unique(patches))
    assert len(np.unique(np.c_[worn[:, 0], patches], axis=0)) == len(made.materials)
    press("simulate")
    piece.flexmaps.preview.colour = "DISTANCE"
    press("preview")
    made = preview.find_piece(piece).data
    assert 3 < len(made.materials) <= materials.MAX_MATERIALS


def test_colours_that_are_not_there_are_refused(piece: Any) -> None:
    piece.flexmaps.preview.colour = "SAFETY"
    with pytest.raises(RuntimeError, match="press Simulate first"):
        bpy.ops.flexmaps.preview()
    assert preview.find_piece(piece) is None
    press("simulate")
    press("preview")
    made = preview.find_piece(piece)
    assert len(set(np.round([c.color[0] for c in made.data.attributes["flexmaps_colour"].data], 4))) > 3


def test_patches_are_told_apart_in_solid_view(piece: Any) -> None:
    """There a face has its material's colour, which must be that of the renders."""
    press("preview")
    made = preview.find_piece(piece).data
    slots = np.array([m.diffuse_color[:3] for m in made.materials])
    patches = np.array([value.value for value in piece.data.attributes["flexmaps_patch"].data])
    assert len(slots) == len(np.unique(patches)) > 1
    of_face = slots[[p.material_index for p in made.polygons]]
    drawn = np.array([value.color[:3] for value in made.attributes["flexmaps_colour"].data])
    assert of_face == pytest.approx(drawn[[p.vertices[0] for p in made.polygons]], abs=1e-3)


def test_connectors_are_drawn_on_request(piece: Any) -> None:
    press("simulate")
    piece.flexmaps.connect.connector = "dovetail"
    piece.flexmaps.preview.detail = "COARSE"
    counts = []
    for joined in (False, True):
        piece.flexmaps.preview.joined = joined
        press("preview")
        counts.append(preview.read_figures(piece)["triangles"])
    joints = sum(edge.use_seam for edge in piece.data.edges)
    assert counts[1] - counts[0] > 20 * joints  # rounded heads and sockets on both sides of every joint


def test_scene_units_and_a_mirrored_object(add: Any) -> None:
    """A piece of the same size in other units, mirrored: the preview has its true size and place all the same."""
    obj = add(shapes.make("dome"))
    bpy.context.scene.unit_settings.scale_length = 0.001
    obj.scale = (-1000.0, 1000.0, 1000.0)
    bpy.context.view_layer.update()
    for stage in ("trace", "spirals", "simulate"):
        press(stage)
    obj.flexmaps.preview.place = "ON"
    press("preview")
    made = preview.find_piece(obj)
    bpy.context.view_layer.update()
    # the shape that was simulated, as the shape key has it
    key = np.array(
        [tuple(obj.matrix_world @ p.co) for p in obj.data.shape_keys.key_blocks["FlexMaps equilibrium"].data]
    )
    assert points_of(made).mean(axis=0) == pytest.approx(key.mean(axis=0), abs=0.05 * np.ptp(key, axis=0).max())
    assert np.ptp(points_of(made), axis=0) == pytest.approx(np.ptp(key, axis=0), rel=0.1)
    assert stored_report.read(obj.data)["equilibrium"]["converged"]
    assert check.as_quad_mesh(mesh.read_surface(obj, bpy.context.scene).polygons).median_edge == pytest.approx(
        0.02, rel=0.1
    )

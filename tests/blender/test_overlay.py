"""Colours on the model: what they show, and who took them away has none."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps.bridge.view import overlay
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking import check
from support.buttons import press


@pytest.fixture
def sphere(add: Any) -> Any:
    return add(shapes.make("cubesphere"))


def test_overlay_shows_and_hides(dome: Any, attribute: Any) -> None:
    manager = bpy.context.window_manager
    with pytest.raises(RuntimeError, match="press Lay out the panels first"):
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
    quads = overlay._read_quads(dome, "PATCH")
    bpy.ops.object.mode_set(mode="OBJECT")
    assert quads is not None
    assert np.array_equal(quads.positions, [v.co for v in dome.data.vertices])
    assert np.array_equal(quads.corners, [f.vertices[:] for f in dome.data.polygons])
    up, _ = overlay._normals(quads)
    assert len(up) == len(dome.data.vertices)
    assert up == pytest.approx(np.array([n.vector for n in dome.data.vertex_normals]), abs=0.1)


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
def test_seams_have_the_colours_of_the_assembly_sheet(dome: Any, mode: str) -> None:
    from flexmaps.bridge.store import mesh as bridge
    from flexmaps.bridge.view import overlay
    from flexmaps.engine import colours

    press("merge")
    surface = bridge.read_surface(dome, bpy.context.scene)
    flat = bridge.require_current_flat(surface, check.as_quad_mesh(surface.polygons))
    bpy.ops.object.mode_set(mode=mode)
    quads = overlay._read_quads(dome, "PATCH")
    assert quads is not None
    seams = quads.seams
    bpy.ops.object.mode_set(mode="OBJECT")
    wanted = flat.layout.seam_of[flat.layout.mesh.quad_edges]
    assert (np.where(seams == overlay.NO_SEAM, -1, seams) == wanted).all() and wanted.max() >= 0
    drawn = overlay._seam_colours(np.array([wanted.max(), -1]), "PATCH")
    assert np.abs(colours.srgb_to_linear(drawn[0, :3]) - colours.seam_colours(int(wanted.max()) + 1)[-1]).max() < 0.01
    assert drawn[1, :3] == pytest.approx(colours.SEAM)
    assert overlay._seam_colours(np.array([0]), "ENERGY")[0, :3] == pytest.approx(colours.SEAM)


def test_colours_follow_the_stages_until_somebody_chooses(dome: Any) -> None:
    manager = bpy.context.window_manager
    for button in ("merge", "spirals", "simulate"):
        press(button)
    assert manager.flexmaps_overlay == "DISTANCE", "what was found last is what is seen"
    press("overlay", kind="TWIST")
    press("simulate")
    assert manager.flexmaps_overlay == "TWIST"


def test_one_panel_is_one(dome: Any) -> None:
    from flexmaps.bridge.view import colouring

    assert colouring.colours_and_legend(dome, "PATCH", np.zeros(5))[1].title == "1 panel"
    assert colouring.colours_and_legend(dome, "PATCH", np.arange(2.0))[1].title == "2 panels"


def test_colours_outlive_the_file_and_an_undo(spiralled: Any, tmp_path: Any) -> None:
    manager = bpy.context.window_manager
    press("overlay", kind="TWIST")
    path = tmp_path / "kept.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    manager = bpy.context.window_manager
    manager.flexmaps_overlay = "NONE"
    bpy.ops.wm.open_mainfile(filepath=str(path))
    assert bpy.context.window_manager.flexmaps_overlay == "TWIST"
    obj = bpy.context.view_layer.objects.active
    for name in [a.name for a in obj.data.attributes if a.name in {"flexmaps_twist", "flexmaps_width"}]:
        obj.data.attributes.remove(obj.data.attributes[name])
    overlay._on_undo()  # as after an undo of Spirals
    assert bpy.context.window_manager.flexmaps_overlay == "PATCH"


def test_colours_lie_on_both_sides_of_a_surface() -> None:
    """A surface whose normals point inwards shows them on its outside too."""
    square = np.array([[[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]]], float)
    made = overlay.on_both_sides(square, np.tile([0.0, 0.0, 1.0], (1, 4, 1)))
    assert made.shape == (2, 4, 3)
    assert (made[0, :, 2] > 0).all() and (made[1, :, 2] < 0).all()
    assert made[:, :, :2] == pytest.approx(np.tile(square[:, :, :2], (2, 1, 1)))


def test_each_side_is_drawn_only_from_its_side() -> None:
    """Both lie so close to each other that a view of a large piece would show a mixture of them."""
    corners = np.array([[[0, 0, 0], [2, 0, 0.1], [2, 2, 0], [0, 2, 0.2]]], float)
    lifted = overlay.on_both_sides(corners, np.tile([0.0, 0.0, 1.0], (1, 4, 1)))
    drawn = overlay.outward_triangles(lifted).reshape(2, 2, 3, 3)
    normals = np.cross(drawn[:, :, 1] - drawn[:, :, 0], drawn[:, :, 2] - drawn[:, :, 0])
    assert (normals[0, :, 2] > 0).all() and (normals[1, :, 2] < 0).all()
    assert np.array_equal(np.unique(drawn[0].reshape(-1, 3), axis=0), np.unique(lifted[0], axis=0))
    assert np.array_equal(np.unique(drawn[1].reshape(-1, 3), axis=0), np.unique(lifted[1], axis=0))

"""Views turned to objects, beside the bars that cover a view."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps.bridge.store import attributes
from flexmaps.bridge.view import collection, framing
from flexmaps.engine.surface import shapes
from mathutils import Matrix, Vector
from support.buttons import press


@pytest.fixture
def area() -> Any:
    """The 3D view of Blender's start screen, with its toolbar on the left."""
    return next(area for _, area in framing._view_areas(bpy.context))


def at(area: Any, points: np.ndarray) -> np.ndarray:
    """Return where points are in a view in perspective, pixels from its lower left corner."""
    space, region = area.spaces.active, next(region for region in area.regions if region.type == "WINDOW")
    view = space.region_3d
    to_eye = Matrix.Translation((0, 0, -view.view_distance)) @ view.view_rotation.to_matrix().to_4x4().inverted()
    seen = np.array([to_eye @ (Vector(point) - view.view_location) for point in points])
    size = np.array([region.width, region.height])
    half = 36.0 / space.lens * size / size.max()
    return (seen[:, :2] / (-seen[:, 2:] * half) + 1.0) / 2.0 * size


def world(obj: Any) -> np.ndarray:
    return np.array([obj.matrix_world @ v.co for v in obj.data.vertices])


def free_size(area: Any) -> tuple[float, np.ndarray]:
    """Return how far the toolbar reaches into the view, and the width and height beside it."""
    region = {region.type: region for region in area.regions}
    window, tools = region["WINDOW"], region["TOOLS"]
    assert tools.width > 1 and region["UI"].width == 1
    top = min(region["TOOL_HEADER"].y, window.y + window.height)
    return tools.width, np.array([window.width - tools.width, top - window.y])


def test_objects_fill_the_part_beside_the_toolbar(add: Any, area: Any) -> None:
    dome, other = add(shapes.make("dome"), "dome"), add(shapes.make("dome"), "other")
    other.location = (0.3, 2.5, 0.0)
    framing.select_only(bpy.context, dome, bpy.context.view_layer)
    framing.frame_views(bpy.context, other)
    assert dome.select_get() and not other.select_get()
    left, size = free_size(area)
    seen = (at(area, np.concatenate([world(dome), world(other)])) - [left, 0]) / size
    assert seen.min() > 0.05 and seen.max() < 0.95
    assert np.ptp(seen, axis=0).max() == pytest.approx(0.88, abs=0.01)
    assert seen.min(axis=0) + seen.max(axis=0) == pytest.approx(1.0, abs=0.01)


def test_selected_faces_are_in_the_middle(add: Any, area: Any) -> None:
    dome = add(shapes.make("dome"), "dome")
    attributes.select(dome, np.array([3]), np.array([], dtype=int))
    corners = np.array([dome.matrix_world @ dome.data.vertices[v].co for v in dome.data.polygons[3].vertices])
    bpy.ops.object.mode_set(mode="EDIT")
    framing.frame_views(bpy.context)
    left, size = free_size(area)
    seen = (at(area, corners) - [left, 0]) / size
    assert np.ptp(seen, axis=0).max() == pytest.approx(0.88, abs=0.01)
    bpy.ops.object.mode_set(mode="OBJECT")


def test_nothing_selected_moves_no_view(add: Any, area: Any) -> None:
    add(shapes.make("dome"), "dome")
    bpy.ops.object.select_all(action="DESELECT")
    view = area.spaces.active.region_3d
    before = (*view.view_location, view.view_distance)
    framing.frame_views(bpy.context)
    assert (*view.view_location, view.view_distance) == before


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
def test_the_first_layout_shows_all_panels(add: Any, area: Any, mode: str) -> None:
    dome = add(shapes.make("dome"), "dome")
    attributes.select(dome, np.array([3]), np.array([], dtype=int))
    bpy.ops.object.mode_set(mode=mode)
    press("merge")
    bpy.ops.object.mode_set(mode="OBJECT")
    panels = collection.objects_of_kinds(dome, "panels")
    left, size = free_size(area)
    seen = (at(area, np.concatenate([world(dome), *map(world, panels)])) - [left, 0]) / size
    assert panels and seen.min() > 0.05 and seen.max() < 0.95
    assert np.ptp(seen, axis=0).max() > 0.6


def pixels(area: Any, obj: Any) -> float:
    """Return how large an object looks."""
    return float(np.ptp(at(area, world(obj)), axis=0).max())


def test_a_mesh_that_was_a_dot_is_seen_once_it_is_scaled(add: Any, area: Any) -> None:
    dome = add(shapes.make("dome"), "dome")
    dome.scale = (1e-4,) * 3
    framing.select_only(bpy.context, dome, bpy.context.view_layer)
    area.spaces.active.region_3d.view_distance = 0.2  # about as near as Blender comes
    press("set_size")
    left, size = free_size(area)
    seen = (at(area, world(dome)) - [left, 0]) / size
    assert seen.min() > 0.0 and seen.max() < 1.0
    assert np.ptp(seen, axis=0).max() > 0.5


def test_undo_and_redo_of_a_scaling_take_the_view_with_them(add: Any, area: Any) -> None:
    dome = add(shapes.make("dome"), "dome")
    dome.scale = (10.0,) * 3
    framing.select_only(bpy.context, dome, bpy.context.view_layer)
    view = area.spaces.active.region_3d
    bpy.ops.ed.undo_push(message="before")
    first, before = view.view_distance, pixels(area, dome)
    press("set_size")
    bpy.ops.ed.undo_push(message="scale")
    second = view.view_distance
    assert second < 0.2 * first
    bpy.ops.ed.undo()
    assert view.view_distance == pytest.approx(first, rel=1e-3)
    assert pixels(area, bpy.context.object) == pytest.approx(before, rel=1e-3)
    bpy.ops.ed.redo()
    assert view.view_distance == pytest.approx(second, rel=1e-3)
    view.view_distance *= 1.1  # as the user does with the wheel
    moved = view.view_distance
    bpy.ops.ed.undo()
    assert view.view_distance == moved


def test_undo_moves_no_view_of_another_object(add: Any, area: Any) -> None:
    dome = add(shapes.make("dome"), "dome")
    framing.select_only(bpy.context, dome, bpy.context.view_layer)
    distance = area.spaces.active.region_3d.view_distance
    other = add(shapes.make("dome"), "other")
    bpy.ops.ed.undo_push(message="before")
    other.scale = (5.0,) * 3
    bpy.ops.ed.undo_push(message="by hand")
    bpy.ops.ed.undo()
    assert area.spaces.active.region_3d.view_distance == distance


def test_the_first_layout_shows_its_panels_alone(add: Any, area: Any) -> None:
    other = add(shapes.make("dome"), "other")
    other.scale = (20.0,) * 3
    dome = add(shapes.make("dome"), "dome")
    assert other.select_get()
    press("merge")
    assert other.select_get() and pixels(area, dome) > 0.2 * free_size(area)[1].max()


def test_views_reach_as_far_as_what_they_turn_to(add: Any, area: Any) -> None:
    """In scenes in millimetres a piece may be further away than the end of the clip range."""
    dome = add(shapes.make("dome"), "dome")
    space = area.spaces.active
    framing.select_only(bpy.context, dome, bpy.context.view_layer)
    small = space.clip_end
    dome.scale = (1e4,) * 3
    framing.select_only(bpy.context, dome, bpy.context.view_layer)

    def farthest() -> float:
        view = space.region_3d
        eye = view.view_location + view.view_rotation @ Vector((0.0, 0.0, view.view_distance))
        return float(np.linalg.norm(world(dome) - np.array(eye), axis=1).max())

    assert small < farthest() < space.clip_end
    dome.scale = (1e5,) * 3
    bpy.context.view_layer.update()
    framing.scale_views(bpy.context, dome, 10.0)
    assert farthest() < space.clip_end

"""*Next: Apply ...* and *Convert to a mesh*: only the active object is converted, whatever is selected, and it is kept."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps.bridge.store import guidance
from flexmaps.bridge.view import head_text
from flexmaps.engine.surface import shapes
from flexmaps.operators.stage import error_message
from support.buttons import press


def finer(obj: Any) -> int:
    """Add a subdivision, and return the number of faces that it gives."""
    obj.modifiers.new("Finer", "SUBSURF").levels = 1
    bpy.context.view_layer.update()
    return 4 * len(obj.data.polygons)


def select(active: Any, *selected: Any) -> None:
    for obj in bpy.context.view_layer.objects:
        obj.select_set(obj in selected)
    bpy.context.view_layer.objects.active = active


def press_next() -> None:
    """Press the button that the head shows for an object that is not a mesh yet."""
    content = head_text.head_content(bpy.context, "", None, None, None)
    press(content.operator.partition(".")[2], **dict(content.properties))


@pytest.mark.parametrize("state", ["unselected", "hidden", "not selectable"])
def test_the_active_object_need_not_be_selected(add: Any, state: str) -> None:
    """A click into empty space deselects it, and it stays active."""
    piece = add(shapes.dome(4))
    count = finer(piece)
    select(piece)
    piece.hide_set(state == "hidden")
    piece.hide_select = state == "not selectable"
    press("next")
    made = bpy.context.object
    assert made != piece and not made.modifiers and len(made.data.polygons) == count
    assert piece.modifiers and piece.hide_get() and not made.hide_get() and made.select_get()
    assert piece.hide_select == (state == "not selectable")


def test_other_selected_objects_stay_as_they_are(add: Any) -> None:
    other, piece = add(shapes.dome(4), "other"), add(shapes.dome(4))
    finer(other)
    count = finer(piece)
    select(piece, other, piece)
    before = set(bpy.data.objects)
    press("next")
    (made,) = set(bpy.data.objects) - before
    assert made == bpy.context.object and len(made.data.polygons) == count
    assert other.modifiers and other.select_get() and not other.hide_get()


def test_a_text_is_converted_alone_and_kept(add: Any) -> None:
    other = add(shapes.dome(4), "other")
    finer(other)
    bpy.ops.object.text_add()
    text = bpy.context.object
    text.data.extrude = 0.1
    select(text, other)
    press_next()
    made = bpy.context.object
    assert made.type == "MESH" and text.type == "FONT" and text.hide_get() and not made.hide_get()
    assert other.modifiers and other.select_get()


@pytest.mark.parametrize(
    "add_object", [bpy.ops.surface.primitive_nurbs_surface_surface_add, bpy.ops.object.metaball_add]
)
def test_surfaces_and_metaballs_are_kept_too(add_object: Any) -> None:
    add_object()
    source = bpy.context.object
    kind = source.type
    press_next()
    assert bpy.context.object.type == "MESH" and len(bpy.context.object.data.polygons)
    assert source.type == kind and source.hide_get()


def test_a_refusal_changes_no_selection(add: Any) -> None:
    other = add(shapes.dome(4), "other")
    bpy.ops.curve.primitive_bezier_curve_add()
    curve = bpy.context.object
    select(curve, other)
    curve.hide_set(True)
    with pytest.raises(RuntimeError, match="has no faces"):
        bpy.ops.flexmaps.to_mesh()
    assert bpy.context.object == curve and curve.hide_get() and bpy.context.selected_objects == [other]


def test_an_object_in_a_hidden_collection_is_refused(add: Any) -> None:
    piece = add(shapes.dome(4))
    finer(piece)
    hidden = bpy.data.collections.new("hidden")
    bpy.context.scene.collection.children.link(hidden)
    hidden.objects.link(piece)
    bpy.context.scene.collection.objects.unlink(piece)
    bpy.context.view_layer.objects.active = piece
    hidden.hide_viewport = True
    bpy.context.view_layer.update()
    with pytest.raises(RuntimeError, match="show it and its collection") as refused:
        bpy.ops.flexmaps.next()
    assert "Traceback" not in str(refused.value)
    assert not piece.hide_get() and list(bpy.context.scene.collection.all_objects) == [piece]


def test_a_parent_that_bends_the_mesh_is_applied_like_a_modifier(add: Any) -> None:
    """Then the copy is no longer bent by it, and stays where it was."""
    piece = add(shapes.dome(4))
    bpy.ops.object.add(type="LATTICE", location=(0.0, 0.0, 0.1))
    lattice = bpy.context.object
    for point in lattice.data.points:
        point.co_deform.z += 0.3 * point.co_deform.x
    piece.parent, piece.parent_type = lattice, "LATTICE"
    piece.location.x = 0.2
    bpy.context.view_layer.update()
    for one in (lattice.data, piece):  # the first evaluation is before the lattice has moved
        one.update_tag()
    select(piece, piece)
    seen = _points_in_world(piece)
    action = guidance.read_guidance(piece, bpy.context.scene).action
    assert action is not None and action.idname == "flexmaps.to_mesh" and "Lattice" in action.label
    press("next")
    made = bpy.context.object
    assert made != piece and made.parent is None and piece.parent == lattice and piece.hide_get()
    assert _points_in_world(made) == pytest.approx(seen, abs=1e-6)
    unbent = np.array([made.matrix_world @ v.co for v in piece.data.vertices])
    assert np.abs(seen - unbent).max() > 0.01
    action = guidance.read_guidance(made, bpy.context.scene).action
    assert action is not None and action.idname != "flexmaps.to_mesh"


def _points_in_world(obj: Any) -> np.ndarray:
    bpy.context.view_layer.update()
    there = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return np.array([there.matrix_world @ v.co for v in there.data.vertices])


def test_why_an_operator_cannot_run_is_said_without_its_call(add: Any) -> None:
    piece = add(shapes.dome(4))
    finer(piece)
    with pytest.raises(RuntimeError) as refused:
        bpy.ops.flexmaps.set_size()
    assert error_message(refused.value).startswith("Apply or remove the modifier 'Finer' first")

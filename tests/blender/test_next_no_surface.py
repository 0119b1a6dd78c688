"""Objects that are no surface yet: *Next* offers nothing that cannot help, and the head says what to do."""

from __future__ import annotations

from typing import Any

import bpy
import pytest
from flexmaps.bridge.store import guidance
from flexmaps.bridge.store.objects import usage_problem
from flexmaps.engine.surface import shapes
from support.drawing import Drawn, draw


def seen(obj: Any) -> guidance.Guidance:
    bpy.context.view_layer.update()
    return guidance.read_guidance(obj, bpy.context.scene)


def wires() -> Any:
    bpy.ops.mesh.primitive_circle_add(fill_type="NOTHING")
    return bpy.context.object


def flattened_triangles() -> Any:
    bpy.ops.mesh.primitive_monkey_add()
    bpy.context.object.scale.z = 0.0
    return bpy.context.object


def flattened_quads() -> Any:
    bpy.ops.mesh.primitive_grid_add()
    bpy.context.object.scale.x = 0.0
    return bpy.context.object


@pytest.mark.parametrize(
    ("make", "label", "advice"),
    [
        (wires, "No faces", "press F"),
        (flattened_triangles, "Squeezed flat", "not 0 along any axis"),
        (flattened_quads, "Squeezed flat", "not 0 along any axis"),
    ],
)
def test_what_cannot_help_is_not_offered(make: Any, label: str, advice: str) -> None:
    obj = make()
    for stage in ("check", "quad_remesh"):  # also after failures, which are stored
        found = seen(obj)
        assert found.action is None and found.status.text == label
        assert [(one.label, one.cures) for one in found.notices] == [(label, ())] and advice in found.explanation
        layout = Drawn()
        assert f"! {label}" in draw("", layout) and layout.operators.count("flexmaps.quad_remesh") == 0
        with pytest.raises(RuntimeError):
            getattr(bpy.ops.flexmaps, stage)()


def test_with_faces_or_a_scale_it_goes_on() -> None:
    obj = wires()
    obj.modifiers.new("Lathe", "SCREW")
    assert seen(obj).action is not None
    obj = flattened_triangles()
    obj.scale.z = 1.0
    assert seen(obj).action is not None and not seen(obj).notices


def test_an_instance_of_a_collection_is_told_how_it_becomes_a_mesh(add: Any) -> None:
    shell = bpy.data.collections.new("Shell")
    shell.objects.link(add(shapes.dome(4)))
    bpy.ops.object.collection_instance_add(collection="Shell")
    assert "Make Instances Real" in str(usage_problem(bpy.context.object))
    bpy.ops.object.camera_add()
    assert str(usage_problem(bpy.context.object)).endswith("is not a mesh; select one")

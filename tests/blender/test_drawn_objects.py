"""Objects that FlexMaps draws beside a model are no models: *Next* selects the model."""

from __future__ import annotations

from typing import Any

import bpy
import pytest
from flexmaps.bridge.store.objects import usage_problem
from support.buttons import press
from support.drawing import Drawn, draw


def select(obj: Any) -> None:
    for other in bpy.context.selected_objects:
        other.select_set(False)
    obj.select_set(True)
    bpy.context.view_layer.objects.active = obj


def drawn_beside(obj: Any) -> list[Any]:
    return [o for o in obj["flexmaps_collection"].objects if "flexmaps_kind" in o]


def test_next_selects_the_model_of_what_was_drawn(spiralled: Any) -> None:
    spiralled.name = "lamp"
    spiralled.hide_set(True)
    kinds = {obj["flexmaps_kind"]: obj for obj in drawn_beside(spiralled)}
    assert {kinds["panels"].type, kinds["outlines"].type} == {"MESH", "CURVE"}
    for obj in kinds.values():
        select(obj)
        layout = Drawn()
        lines = draw("", layout)
        assert "Next: Select 'lamp'" in lines and "flexmaps.select_model" in layout.operators
        assert not bpy.ops.flexmaps.next.poll() and not bpy.ops.flexmaps.to_mesh.poll()
        press("select_model")
        assert bpy.context.object == spiralled and bpy.context.selected_objects == [spiralled]
    assert not bpy.ops.flexmaps.select_model.poll() and usage_problem(spiralled) is None


@pytest.mark.parametrize("name", ["a", "the lamp shade above the long table"])
def test_the_button_names_a_model_whose_name_fits(spiralled: Any, name: str) -> None:
    spiralled.name = name
    select(drawn_beside(spiralled)[0])
    assert f"Next: {'Select the model' if len(name) > 9 else 'Select ' + repr(name)}" in draw()


def test_a_copy_elsewhere_and_the_panels_of_a_deleted_model_are_ordinary_meshes(spiralled: Any) -> None:
    panels = next(obj for obj in drawn_beside(spiralled) if obj["flexmaps_kind"] == "panels")
    copy = panels.copy()
    bpy.context.scene.collection.objects.link(copy)
    assert usage_problem(copy) is None and usage_problem(panels) is not None
    twin = spiralled.copy()
    bpy.context.scene.collection.objects.link(twin)
    assert f"select '{spiralled.name}'" in str(usage_problem(panels)), "not its duplicate"
    for obj in (twin, spiralled):
        bpy.data.objects.remove(obj)
    assert usage_problem(panels) is None

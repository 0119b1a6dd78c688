"""The head of the tab: what it says of a mesh beside the state of its stages."""

from __future__ import annotations

from typing import Any

import bpy
from support.drawing import draw


def test_further_selected_meshes_do_not_hide_the_state(dome: Any) -> None:
    state = f"{len(dome.data.polygons)} quads, spirals of"
    bpy.ops.mesh.primitive_cube_add()
    cube, bpy.context.view_layer.objects.active = bpy.context.object, dome
    cube.select_set(False)
    assert any(line.startswith(state) for line in draw()) and "Only the active mesh" not in draw()
    dome.select_set(True)
    cube.select_set(True)
    assert any(line.startswith(state) for line in draw()) and "Only the active mesh" in draw()


def test_hidden_faces_are_said_to_be_made(dome: Any) -> None:
    assert not any("hidden" in line for line in draw())
    dome.data.polygons[3].hide = True
    assert "1 hidden face" in draw()
    dome.data.polygons[4].hide = True
    assert "2 hidden faces" in draw()
    bpy.ops.object.mode_set(mode="EDIT")
    assert not any("hidden" in line for line in draw())

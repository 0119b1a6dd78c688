"""The tutorial: its file, its button, and the Python of its page and of the quick start."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType

import bpy
import numpy as np
import pytest
from flexmaps import api
from flexmaps.operators import tutorial

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def lamp_shade() -> ModuleType:
    sys.path.append(str(ROOT / "tools"))
    import lamp_shade

    return lamp_shade


def test_the_button_adds_a_scene(lamp_shade: ModuleType) -> None:
    """What is open stays; the file holds what the tool that makes it would make today, and no fault is found in it."""
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    mine, before = bpy.context.scene, {o.name for o in bpy.context.scene.objects}
    assert bpy.ops.flexmaps.tutorial() == {"FINISHED"}
    assert bpy.context.scene.name == tutorial.SCENE
    assert {o.name for o in mine.objects} == before
    obj = bpy.context.view_layer.objects.active
    assert [o.name for o in bpy.context.scene.objects if o.select_get()] == [obj.name]
    wanted = lamp_shade.surface()
    points = np.array([obj.matrix_world @ v.co for v in obj.data.vertices])
    assert points - [0.0, 0.0, lamp_shade.HANGS] == pytest.approx(wanted.vertices, abs=1e-6)
    assert [list(p.vertices) for p in obj.data.polygons] == wanted.quads.tolist()
    assert obj.flexmaps.spiral.border == "left_out"
    assert api.check(api.load(obj)) == []
    assert bpy.context.scene.camera is not None
    assert bpy.ops.flexmaps.tutorial() == {"FINISHED"}  # once more: another scene
    assert bpy.context.view_layer.objects.active != obj


def test_without_its_file(monkeypatch: pytest.MonkeyPatch) -> None:
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    scene = bpy.context.scene
    monkeypatch.setattr(tutorial, "FILE", ROOT / "data" / "nothing.blend")
    with pytest.raises(RuntimeError, match="install FlexMaps again"):
        bpy.ops.flexmaps.tutorial()
    assert bpy.context.scene == scene


def test_small_enough_to_travel() -> None:
    assert tutorial.FILE.stat().st_size < 300_000

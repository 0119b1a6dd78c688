"""Live mode on an object: what is noticed, what is shown and said, and that nothing of it is written."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps.bridge.hosts import live
from flexmaps.bridge.store import attributes, states


@pytest.fixture
def following(spiralled: Any) -> Iterator[live.ObjectWatcher]:
    bpy.ops.ed.undo_push(message="begin")
    assert bpy.ops.flexmaps.live() == {"FINISHED"}
    found = live.current_watcher()
    assert found is not None
    settled(found)
    yield found
    live.stop()


def settled(following: live.ObjectWatcher) -> np.ndarray:
    """Look as the window does, until all is at rest; the vertices then."""
    following.is_dirty, end = True, time.monotonic() + 60.0
    while time.monotonic() < end:
        following.tick()
        if following.shape is not None and following.is_resting and not following.is_dirty:
            assert following.shape.vertices is not None
            return following.shape.vertices
        time.sleep(0.01)
    raise AssertionError(following.problem or "it never rests")


def piece() -> Any:
    return bpy.context.view_layer.objects.active


def test_what_is_changed_is_followed_and_nothing_is_written(
    following: live.ObjectWatcher, all_of: Callable[[Any], dict[str, bytes]]
) -> None:
    obj, before = piece(), settled(following)
    stored = all_of(obj)
    obj.flexmaps.spiral.thickness = 3.0
    thicker = settled(following)
    assert np.abs(thicker - before).max() > 1e-5
    # another program's way: an attribute alone, and no word of ours
    with attributes.readable_mesh(obj) as mesh:
        twist = np.array(attributes.read(mesh, "flexmaps_twist"))
    assert all_of(obj) == stored
    twist[:20] *= 0.5
    obj.data.attributes["flexmaps_twist"].data.foreach_set("value", twist)
    obj.data.update()
    assert np.abs(settled(following) - thicker).max() > 1e-5
    assert following.picture is not None and not following.is_final
    assert following.picture.legend is not None and following.picture.legend.title.startswith("Live")


def test_undo_redo_modes_and_the_end_of_the_object(following: live.ObjectWatcher) -> None:
    first = settled(following)
    piece().flexmaps.spiral.thickness = 3.0
    bpy.ops.ed.undo_push(message="thicker")
    second = settled(following)
    bpy.ops.ed.undo()
    assert np.abs(settled(following) - first).max() < 1e-6
    bpy.ops.ed.redo()
    assert np.abs(settled(following) - second).max() < 1e-6
    for mode in ("EDIT", "WEIGHT_PAINT", "OBJECT"):
        bpy.ops.object.mode_set(mode=mode)
        assert np.abs(settled(following) - second).max() < 1e-6
    bpy.ops.ed.undo_push(message="modes")
    bpy.data.objects.remove(piece())
    bpy.ops.ed.undo_push(message="deleted")
    following.is_dirty = True
    following.tick()
    assert following.picture is None and "deleted" in following.problem
    bpy.ops.ed.undo()
    assert np.abs(settled(following) - second).max() < 1e-6 and following.picture is not None
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    assert live.current_watcher() is None and live.shown_picture() is None


def test_it_stands_back_after_the_final_simulation(following: live.ObjectWatcher) -> None:
    obj = piece()
    assert states.read_states(obj, bpy.context.scene)["equilibrium"].kind == states.TODO
    assert following.picture is not None
    assert bpy.ops.flexmaps.simulate() == {"FINISHED"}
    vertices = settled(following)
    assert following.is_final and following.picture is None
    key = obj.data.shape_keys.key_blocks["FlexMaps equilibrium"]
    simulated = np.array([p.co[:] for p in key.data])
    assert np.abs(simulated - vertices).max() < 1e-5
    obj.flexmaps.spiral.thickness = 3.0
    settled(following)
    assert not following.is_final and following.picture is not None


def test_what_cannot_be_followed_is_said(following: live.ObjectWatcher) -> None:
    obj, before = piece(), settled(following)
    obj.flexmaps.simulate.gravity = True
    assert np.abs(settled(following) - before).max() == 0.0
    assert "supports" in following.problem
    obj.flexmaps.simulate.gravity = False
    settled(following)
    assert following.problem == ""
    assert bpy.ops.flexmaps.live() == {"FINISHED"} and live.current_watcher() is None  # pressed again

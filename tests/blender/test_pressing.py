"""Presses from a script: what FlexMaps cannot work on is refused in words."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import pytest
from flexmaps import api
from flexmaps.api.pressing import describe_object
from flexmaps.engine.errors import FlexMapsError

CALLS: tuple[Callable, ...] = (api.press, lambda obj: next(api.presses(obj)), describe_object)


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("add", ["text_add", "camera_add", "empty_add"])
def test_what_is_not_a_mesh_is_refused(call: Callable, add: str) -> None:
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    getattr(bpy.ops.object, add)()
    with pytest.raises(FlexMapsError, match=f"'{bpy.context.object.name}' is not a mesh"):
        call(bpy.context.object)


@pytest.mark.parametrize("call", CALLS)
def test_nothing_is_refused(call: Callable) -> None:
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with pytest.raises(FlexMapsError, match="Select a mesh"):
        call(None)

"""A flat target, whose panels rest in its shape whatever their spirals are."""

from __future__ import annotations

import bpy

from . import notes

NOTE = "flat_target"  # in the layout's block


def passed_over(obj: bpy.types.Object) -> bool:
    """Whether there is nothing to simulate or search for: the target is flat, and nothing pulls at it."""
    given = obj.flexmaps
    pulled = given.simulate.gravity or any((given.loads.force_x, given.loads.force_y, given.loads.force_z))
    return bool(notes.read(obj.data).get("layout", {}).get(NOTE)) and not pulled

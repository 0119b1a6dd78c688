"""A flat target, whose panels rest in its shape whatever their spirals are."""

from __future__ import annotations

import bpy

from . import notes

NOTE = "flat_target"  # key in the layout's block


def passed_over(obj: bpy.types.Object) -> bool:
    """Return whether simulation and optimisation can be skipped: the target is flat, and no weight or force acts."""
    own = obj.flexmaps
    loaded = own.simulate.gravity or any((own.loads.force_x, own.loads.force_y, own.loads.force_z))
    return bool(notes.read(obj.data).get("layout", {}).get(NOTE)) and not loaded

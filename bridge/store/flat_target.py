"""Flat targets: the panels stay flat, so simulation and optimisation can be skipped."""

from __future__ import annotations

import bpy

from . import stored_report

IS_FLAT = "flat_target"  # key in the report block "layout"


def can_skip_simulation(obj: bpy.types.Object) -> bool:
    """Return whether simulation and optimisation can be skipped: the target is flat, and no weight or force acts."""
    own = obj.flexmaps
    loaded = own.simulate.gravity or any((own.loads.force_x, own.loads.force_y, own.loads.force_z))
    return bool(stored_report.read(obj.data).get("layout", {}).get(IS_FLAT)) and not loaded

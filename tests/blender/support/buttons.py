"""Pressing a button from a script, and what it leaves on the mesh."""

from __future__ import annotations

from typing import Any

import bpy
from flexmaps.bridge.store import stored_report


def press(name: str, **properties: Any) -> None:
    """It has to end well."""
    assert getattr(bpy.ops.flexmaps, name)(**properties) == {"FINISHED"}


def report(obj: Any) -> dict[str, Any]:
    """What the stages have told of the object."""
    return stored_report.read(obj.data)


def faces_of(obj: Any, edge: int) -> list[int]:
    pair = set(obj.data.edges[int(edge)].vertices)
    return [f.index for f in obj.data.polygons if pair <= set(f.vertices)]

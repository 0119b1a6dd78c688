"""The sidebar: draws, never computes. Knows the operators by their names only."""

from __future__ import annotations

import bpy

from ..bridge import plot
from . import preview, sidebar

# in the order in which they are seen
CLASSES = (*sidebar.CLASSES[:-1], *preview.CLASSES, sidebar.CLASSES[-1])


def register() -> None:
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
    plot.unregister()

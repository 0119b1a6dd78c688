"""The sidebar: draws, never computes. Knows the operators by their names only."""

from __future__ import annotations

import bpy

from ..bridge.view import choices, plot
from . import preview, sidebar, translations

# in the order in which they are seen
CLASSES = (*sidebar.CLASSES, *preview.CLASSES)


def register() -> None:
    translations.register()
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
    plot.unregister()
    choices.unregister()
    translations.unregister()

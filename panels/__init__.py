"""The sidebar. It only draws: nothing is computed here, and operators are referred to by their ``bl_idname``."""

from __future__ import annotations

import bpy

from ..bridge.view import history_plot, tab, thumbnails
from . import sidebar, translations

CLASSES = sidebar.CLASSES


def register() -> None:
    translations.register()
    tab.register()
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
    tab.unregister()
    history_plot.unregister()
    thumbnails.unregister()
    translations.unregister()

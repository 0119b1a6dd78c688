"""Blender operators, one module for each stage: read the mesh, run the engine, write the mesh."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import bpy

from ..bridge.hosts import background
from ..engine.extras import registry

# modules in the order of registration
NAMES = (
    "example", "next", "check", "mend", "to_mesh", "remesh", "regularise", "layout", "choose", "spirals", "brush", "painting", "simulate",
    "live", "handles", "handle_tool", "compare", "structure", "optimise", "fit", "advice", "explore", "preview", "animate",
    "render", "export", "together", "remnant", "tutorial", "calibrate", "report", "overlay", "presets", "file_writer", "tab",
)  # fmt: skip
_MISSING = registry.missing_modules("operators")
MODULES: list[Any] = [import_module(f"{__package__}.{name}") for name in NAMES if name not in _MISSING]
CLASSES = [cls for module in MODULES for cls in module.CLASSES]


def register() -> None:
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.app.handlers.load_pre.append(_before_load)
    for module in MODULES:
        if hasattr(module, "register"):  # the module registers more than classes
            module.register()


def unregister() -> None:
    background.stop_current()
    for module in reversed(MODULES):
        if hasattr(module, "unregister"):
            module.unregister()
    bpy.app.handlers.load_pre.remove(_before_load)
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)


@bpy.app.handlers.persistent
def _before_load(*_: object) -> None:
    background.stop_current()

"""The operators: one file a stage. Each reads the mesh, runs the engine, writes the mesh."""

from __future__ import annotations

import bpy

from ..bridge.hosts import background
from . import (
    advice,
    animate,
    calibrate,
    check,
    choose,
    compare,
    example,
    explore,
    export,
    layout,
    optimise,
    overlay,
    presets,
    preview,
    regularise,
    remesh,
    render,
    report,
    simulate,
    spirals,
    structure,
    together,
    tutorial,
)

MODULES = (
    example,
    check,
    remesh,
    regularise,
    layout,
    choose,
    spirals,
    simulate,
    compare,
    structure,
    optimise,
    advice,
    explore,
    preview,
    animate,
    render,
    export,
    together,
    tutorial,
    calibrate,
    report,
    overlay,
    presets,
)
CLASSES = [cls for module in MODULES for cls in module.CLASSES]


def register() -> None:
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.app.handlers.load_pre.append(_before_load)
    overlay.register()
    presets.register()


def unregister() -> None:
    background.stop_current()
    presets.unregister()
    overlay.unregister()
    bpy.app.handlers.load_pre.remove(_before_load)
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)


@bpy.app.handlers.persistent
def _before_load(*_: object) -> None:
    background.stop_current()

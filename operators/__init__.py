"""The operators: one file a stage. Each reads the mesh, runs the engine, writes the mesh."""

from __future__ import annotations

import bpy

from ..bridge.hosts import background
from . import (
    advice,
    animate,
    brush,
    calibrate,
    check,
    choose,
    compare,
    example,
    explore,
    export,
    fit,
    handle_tool,
    handles,
    layout,
    live,
    mend,
    next,
    optimise,
    overlay,
    painting,
    presets,
    preview,
    regularise,
    remesh,
    render,
    report,
    simulate,
    spirals,
    structure,
    tab,
    together,
    tutorial,
    writes,
)

MODULES = (
    example,
    next,
    check,
    mend,
    remesh,
    regularise,
    layout,
    choose,
    spirals,
    brush,
    painting,
    simulate,
    live,
    handles,
    handle_tool,
    compare,
    structure,
    optimise,
    fit,
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
    writes,
    tab,
)
CLASSES = [cls for module in MODULES for cls in module.CLASSES]


def register() -> None:
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.app.handlers.load_pre.append(_before_load)
    overlay.register()
    live.register()
    handle_tool.register()
    presets.register()
    brush.register()


def unregister() -> None:
    background.stop_current()
    brush.unregister()
    presets.unregister()
    handle_tool.unregister()
    live.unregister()
    overlay.unregister()
    bpy.app.handlers.load_pre.remove(_before_load)
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)


@bpy.app.handlers.persistent
def _before_load(*_: object) -> None:
    background.stop_current()

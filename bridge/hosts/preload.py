"""Import scipy and the engine in a thread when the sidebar is first drawn, so that the first button answers at once."""

from __future__ import annotations

import importlib
import threading

import bpy

# modules, relative to the package, that the first buttons need and that import scipy
MODULES = (
    "engine.surface.checking.check",
    "engine.patches.flattening.flatten",
    "engine.spirals.design",
    "engine.surface.remeshing.regularise",
    "engine.patches.merging.merge",
    "bridge.store.mesh",
    "bridge.view.flat_panels",
)
_threads: list[threading.Thread] = []


def start() -> None:
    """Start the import once, if Blender has a window. No daemon thread: Blender could crash if it quit meanwhile."""
    if _threads or bpy.app.background:
        return
    _threads.append(threading.Thread(target=_import, name="FlexMaps warm-up", daemon=False))
    _threads[0].start()


def wait() -> None:
    """Wait until the import ends, because two threads that import the same libraries at once can disturb each other."""
    for thread in _threads:
        thread.join()


def _import() -> None:
    package = __package__.removesuffix(".bridge.hosts")
    for name in MODULES:
        importlib.import_module(f"{package}.{name}")

"""Import of the numerics in a thread when the sidebar is first drawn, so that the first button answers at once."""

from __future__ import annotations

import importlib
import threading

import bpy

# what the first buttons need, with scipy behind it; names below the package
MODULES = (
    "engine.surface.checking.check",
    "engine.patches.flattening.flatten",
    "engine.spirals.design",
    "engine.surface.remeshing.regularise",
    "engine.patches.merging.merge",
    "bridge.store.mesh",
    "bridge.view.flat_panels",
)
_begun: list[threading.Thread] = []


def start() -> None:
    """Begin, once, and only with a window. Not a daemon thread, which could crash Blender when it quits during an import."""
    if _begun or bpy.app.background:
        return
    _begun.append(threading.Thread(target=_import, name="FlexMaps warm-up", daemon=False))
    _begun[0].start()


def wait() -> None:
    """Wait until it is done: two threads that import the same libraries at once can disturb each other."""
    for thread in _begun:
        thread.join()


def _import() -> None:
    package = __package__.removesuffix(".bridge.hosts")
    for name in MODULES:
        importlib.import_module(f"{package}.{name}")

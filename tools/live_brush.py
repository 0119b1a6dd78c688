"""How long painting holds up Blender's window: pieces are painted as the tool does it, in Blender as a module."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import bench_window
import bpy
import numpy as np
from flexmaps.bridge.view import dabs, easel
from flexmaps.engine.surface import shapes
from rows import Row, at_most

DABS = 6  # of a stroke
STROKES = 8  # alternately softer and stiffer
FLOW = 0.2  # of every dab, as of the tool's strength of one half


def timed(action: Callable[..., Any], *given: Any) -> float:
    """Seconds of this thread's processor."""
    began = time.thread_time()
    action(*given)
    return time.thread_time() - began


def painted(count: int, share: float, limit: float) -> Iterator[Row]:
    """Strokes of that share of a dome's spirals, each with an undo and a redo; the slowest of each counts, in seconds of the window's thread."""
    obj = dome(count)
    rng, name = np.random.default_rng(0), f"dome {len(obj.data.polygons)}"
    found: dict[str, list[float]] = {"brush: a dab": [], "brush: writing a stroke": [], "brush: after an undo": []}
    opened = timed(easel.of, obj, bpy.context.scene)
    steps, seen = [], []
    for k in range(STROKES):
        on = easel.of(obj, bpy.context.scene)
        radius = 0.9 * np.sqrt(share * 4.0 * on.ground.reach.mean() ** 2 * len(on.ground.reach) / np.pi)
        work = dabs.Dabs(on, ("softer", "stiffer")[k % 2], False)
        at = rng.integers(len(on.ground.centres))
        for _ in range(DABS):
            began = time.perf_counter()
            found["brush: a dab"].append(timed(_dab, work, on, at, radius))
            while not work.look():
                time.sleep(0.001)
            seen.append(time.perf_counter() - began)
        work.wait()
        work.close()
        found["brush: writing a stroke"].append(timed(on.write, bpy.context.scene))
        steps.append(timed(lambda: bpy.ops.ed.undo_push(message="stroke")))
        bpy.ops.ed.undo()
        obj = bpy.context.object
        found["brush: after an undo"].append(timed(_taken_again, obj))
        bpy.ops.ed.redo()
        obj = bpy.context.object
    for what, seconds in found.items():
        yield at_most(name, f"{what}, main thread, s", limit, float(np.max(seconds)))
    yield at_most(name, "brush: Blender's own undo step, s", None, float(np.max(steps)))
    yield at_most(name, "brush: taken in hand, once, s", None, opened)
    yield at_most(name, "brush: a dab until it can be seen, s by the clock, median", None, float(np.median(seen)))
    easel.forget()


def _taken_again(obj: bpy.types.Object) -> None:
    """What follows an undo: the easel takes the former spirals, and computes how they look, as the next redraw does."""
    easel.of(obj, bpy.context.scene).shape.prepared(bpy.context.scene.unit_settings.scale_length)


def _dab(work: dabs.Dabs, on: easel.Easel, at: int, radius: float) -> None:
    ground = on.ground
    work.add([FLOW * ground.weight(ground.centres[at], ground.normals[at], radius)], np.zeros(3))


def dome(count: int) -> bpy.types.Object:
    """A dome of about so many spirals, with them."""
    obj = bench_window.piece(shapes.dome(2 * round(0.5 * np.sqrt(count / 3.0))))
    bpy.ops.flexmaps.trace()
    bpy.ops.flexmaps.spirals()
    bpy.ops.ed.undo_push(message="begin")
    return obj

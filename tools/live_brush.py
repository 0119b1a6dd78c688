"""Time for which painting blocks Blender's window; pieces are painted as by the brush, in Blender as a module."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import bpy
import numpy as np
import responsiveness
from flexmaps.bridge.view import dab_queue, paint_session
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import QuadMesh
from harness import Row, at_most, measure_time

DABS = 6  # of a stroke
STROKES = 8  # alternately softer and stiffer
FLOW = 0.2  # of every dab, as of the tool's strength of one half


@dataclass
class StrokeTimes:
    """Seconds of the window's thread that every dab, every written stroke and every undo took."""

    dabs: list[float] = field(default_factory=list)
    written: list[float] = field(default_factory=list)
    undone: list[float] = field(default_factory=list)


def _seconds(action: Callable[..., Any], *given: Any) -> float:
    """Return seconds of this thread's processor."""
    return measure_time(partial(action, *given), time.thread_time)[0]


def measure_strokes(count: int, share: float, limit: float) -> Iterator[Row]:
    """Strokes on a dome of about so many spirals; the slowest of each kind of work counts."""
    obj = add_piece(shapes.dome(2 * round(0.5 * np.sqrt(count / 3.0))))
    name = f"dome {len(obj.data.polygons)}"
    held = strokes(obj, share)
    for what, seconds in (("a dab", held.dabs), ("writing a stroke", held.written), ("after an undo", held.undone)):
        yield at_most(name, f"brush: {what}, main thread, s", limit, float(np.max(seconds)))


def strokes(obj: bpy.types.Object, share: float, count: int = STROKES) -> StrokeTimes:
    """Strokes of that share of an object's spirals, each with an undo and a redo."""
    rng = np.random.default_rng(0)
    held = StrokeTimes()
    for k in range(count):
        on = paint_session.get_session(obj, bpy.context.scene)
        radius = 0.9 * np.sqrt(
            share * 4.0 * on.brush_surface.side_distance.mean() ** 2 * len(on.brush_surface.side_distance) / np.pi
        )
        work = dab_queue.DabQueue(on, ("softer", "stiffer")[k % 2], False)
        at = rng.integers(len(on.brush_surface.centres))
        for _ in range(DABS):
            held.dabs.append(_seconds(_dab, work, on, at, radius))
            while not work.poll():
                time.sleep(0.001)
        work.wait()
        work.close()
        held.written.append(_seconds(on.write, bpy.context.scene))
        bpy.ops.ed.undo_push(message="stroke")
        bpy.ops.ed.undo()
        obj = bpy.context.object
        held.undone.append(_seconds(_taken_again, obj))
        bpy.ops.ed.redo()
        obj = bpy.context.object
    paint_session.discard_session()
    return held


def _taken_again(obj: bpy.types.Object) -> None:
    """Measure the work after an undo: the session takes the former spirals and computes their colours, as the next redraw does."""
    paint_session.get_session(obj, bpy.context.scene).shape.prepare(bpy.context.scene.unit_settings.scale_length)


def _dab(work: dab_queue.DabQueue, on: paint_session.PaintSession, at: int, radius: float) -> None:
    ground = on.brush_surface
    work.add([FLOW * ground.dab_weights(ground.centres[at], ground.normals[at], radius)], np.zeros(3))


def add_piece(mesh: QuadMesh, border: str = "stubs") -> bpy.types.Object:
    """A surface with its spirals, as an object in a new file."""
    obj = responsiveness.piece(mesh)
    obj.flexmaps.spiral.border = border
    bpy.ops.flexmaps.trace()
    bpy.ops.flexmaps.spirals()
    bpy.ops.ed.undo_push(message="begin")
    return obj

"""Runs inside a real Blender with its window: paints spirals with the pointer, turns the brush round, smooths, undoes.

What was seen goes to result.json beside this file, the screen after every part to a picture.
"""

import importlib
import sys
import time
import warnings
from pathlib import Path

import bpy
import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))
import hands  # noqa: E402
from presses import FOUND, blocks, expect, installed, picture, press  # noqa: E402

warnings.filterwarnings("default", module=r"bl_ext\.")  # all of ours, also of deprecated things


def spirals(obj):
    """Widths of the arms, mm, and twists, degrees, as the object holds them."""
    width, twist = np.empty(len(obj.data.loops), np.float32), np.empty(len(obj.data.polygons), np.float32)
    obj.data.attributes["flexmaps_width"].data.foreach_get("value", width)
    obj.data.attributes["flexmaps_twist"].data.foreach_get("value", twist)
    return width.reshape(-1, 4), twist


def begin():
    yield from installed()
    module = importlib.import_module("bl_ext.user_default.flexmaps.engine.surface.shapes")
    mesh = module.make("saddle", 0.02)
    data = bpy.data.meshes.new("saddle")
    data.from_pydata(mesh.vertices.tolist(), [], mesh.quads.tolist())
    obj = bpy.data.objects.new("saddle", data)
    bpy.context.scene.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    obj.flexmaps.connect.connector = "none"
    yield from hands.look_at([obj])
    for name in ("merge", "spirals", "simulate"):
        yield from press(name)
    bpy.context.window_manager.flexmaps_tab.open_shape = True
    yield from hands.click("operator", "flexmaps.pick_brush")
    yield 1.0
    yield from picture("brush")
    tool = bpy.context.workspace.tools.from_space_view3d_mode("OBJECT").idname
    expect(tool == "flexmaps.brush", f"the button takes the brush in hand, not {tool}")
    with hands.in_view():
        bpy.ops.view3d.view_axis(type="TOP")
        bpy.ops.view3d.view_selected()
    yield 0.5


def middle():
    """The pixel over the middle of the object's first quads, and the radius that half of it is seen under."""
    from bpy_extras.view3d_utils import location_3d_to_region_2d

    area = hands.view()[1]
    region = next(r for r in area.regions if r.type == "WINDOW")
    obj = bpy.context.object
    places = [
        location_3d_to_region_2d(region, area.spaces.active.region_3d, obj.matrix_world @ v.co)
        for v in obj.data.vertices
    ]
    seen = np.array(places)
    centre, size = seen.mean(axis=0), np.ptp(seen, axis=0).min()
    return (region.x + centre[0], len(hands.pixels()) - region.y - centre[1]), size


def drag(start, end, *held):
    """Paint from pixel to pixel, with keys held."""
    for name in held:
        hands.xdotool("keydown", name)
    hands.xdotool("mousemove", *map(int, start))
    yield 0.2
    hands.xdotool("mousedown", 1)
    yield 0.2
    slowest = 0.0
    for share in np.linspace(0.0, 1.0, 12):
        begun = time.perf_counter()
        hands.xdotool("mousemove", *(np.array(start) + share * (np.array(end) - start)).astype(int))
        yield 0.05
        slowest = max(slowest, time.perf_counter() - begun)
    yield 0.3
    hands.xdotool("mouseup", 1)
    yield 0.5
    for name in held:
        hands.xdotool("keyup", name)
    yield 0.3
    return slowest


def strokes():
    obj, brush = bpy.context.object, bpy.context.window_manager.flexmaps_brush
    centre, size = middle()
    brush.size, brush.strength = int(0.15 * size), 1.0
    left, right = (centre[0] - 0.3 * size, centre[1]), (centre[0] + 0.3 * size, centre[1])
    first = spirals(obj)
    FOUND["slowest_ms"] = 1e3 * (yield from drag(left, right))
    painted = spirals(obj)
    wider = (painted[0].mean(axis=1) > first[0].mean(axis=1) + 0.05).sum()
    expect(10 < wider < len(first[1]) - 40, f"a stroke makes the spirals under it stiffer: {wider} of {len(first[1])}")
    states = hands.module("bridge.store.states").read_states(obj, bpy.context.scene)
    expect(states["spirals"].kind == "DONE", f"Spirals stays done, not {states['spirals']}")
    expect(states["equilibrium"].kind == "STALE", "the simulation of the former spirals is out of date")
    expect(blocks()["spirals"].get("painted"), "it is noted that a hand was at work")
    yield from picture("stiffer")

    yield from hands.key("ctrl+z")
    yield 1.0
    expect(
        all(np.array_equal(a, b) for a, b in zip(spirals(bpy.context.object), first, strict=True)),
        "one undo takes one stroke back",
    )
    yield from hands.key("ctrl+shift+z")
    yield 1.0
    again = spirals(bpy.context.object)
    expect(all(np.array_equal(a, b) for a, b in zip(again, painted, strict=True)), "and redo brings it again")

    yield from drag(left, right, "ctrl")
    softer = spirals(bpy.context.object)
    expect(softer[0].mean() < painted[0].mean() and softer[1].mean() > painted[1].mean(), "Ctrl turns the brush round")
    yield from picture("softer")
    up, down = (centre[0], centre[1] - 0.3 * size), (centre[0], centre[1] + 0.3 * size)
    rough = float(np.ptp(softer[1]))
    for _ in range(3):
        yield from drag(up, down, "shift")
    smooth = spirals(bpy.context.object)
    expect(not np.array_equal(smooth[1], softer[1]), f"Shift smooths: spread {rough} to {np.ptp(smooth[1])}")
    brush.brush = "along"
    yield from drag(left, right)
    unlike = np.ptp(spirals(bpy.context.object)[0], axis=1)
    expect(unlike.max() > 0.3, f"Along makes arms of different widths: {unlike.max():.2f} mm")
    yield from picture("along")


def keys():
    """F drags the size, Shift F the strength, as of Blender's own brushes; Esc in a stroke takes it back."""
    obj, brush = bpy.context.object, bpy.context.window_manager.flexmaps_brush
    centre, size = middle()
    for name, keys in (("size", "f"), ("strength", "shift+f")):
        before = getattr(brush, name)
        hands.xdotool("mousemove", *map(int, centre))
        yield 0.2
        hands.xdotool("key", keys)
        yield 0.3
        hands.xdotool("mousemove", int(centre[0] - 0.04 * size), int(centre[1]))
        yield 0.3
        hands.xdotool("click", 1)
        yield 0.4
        expect(getattr(brush, name) != before, f"{keys} changes the {name}: {before} to {getattr(brush, name)}")
    before = spirals(obj)
    brush.brush, brush.size, brush.strength = "softer", int(0.15 * size), 1.0
    hands.xdotool("mousemove", *map(int, centre))
    yield 0.2
    hands.xdotool("mousedown", 1)
    yield 0.2
    hands.xdotool("mousemove", int(centre[0] + 0.2 * size), int(centre[1]))
    yield 0.3
    hands.xdotool("key", "Escape")
    yield 0.3
    hands.xdotool("mouseup", 1)
    yield 0.5
    expect(all(np.array_equal(a, b) for a, b in zip(spirals(obj), before, strict=True)), "Esc takes the stroke back")


def protects():
    obj, brush = bpy.context.object, bpy.context.window_manager.flexmaps_brush
    centre, size = middle()
    brush.brush, brush.size, brush.strength = "protect", int(0.2 * size), 1.0
    yield from drag(centre, (centre[0] + 0.05 * size, centre[1]))
    marks = np.empty(len(obj.data.polygons), np.int32)
    obj.data.attributes["flexmaps_protect"].data.foreach_get("value", marks)
    expect(4 < marks.sum() < len(marks) // 2, f"Protect marks what is under it: {marks.sum()}")
    yield from picture("protected")
    before = spirals(obj)
    brush.brush = "softer"
    yield from drag((centre[0] - 0.4 * size, centre[1]), (centre[0] + 0.4 * size, centre[1]))
    after = spirals(obj)
    kept = marks == 1
    expect(np.array_equal(after[1][kept], before[1][kept]), "protected spirals are not painted")
    expect(not np.array_equal(after[1], before[1]), "the others are")
    obj.flexmaps.optimise.iterations, obj.flexmaps.optimise.codesign = 1, False
    yield from press("optimise")
    best = spirals(obj)
    expect(np.array_equal(best[0][kept], after[0][kept]), "Optimise leaves protected spirals as they are")
    expect(not np.array_equal(best[0], after[0]), "and changes others")
    yield from picture("optimised")


def held_up(what):
    """From now on the slowest of every event of a stroke, and of every upload of what is drawn, in seconds of this thread's processor."""
    stroke, drawing = (
        hands.module("operators.painting").PaintStroke,
        hands.module("bridge.view.paint_session").PaintedShape,
    )

    def timed(name, action, *given):
        begun = time.thread_time()
        try:
            return action(*given)
        finally:
            what[name] = max(what.get(name, 0.0), time.thread_time() - begun)

    modal, written, batches = stroke.modal, stroke._finish_stroke, drawing.batches
    # Blender looks how many arguments there are
    stroke.modal = lambda self, context, event: timed("an event", modal, self, context, event)
    stroke._finish_stroke = lambda self, context, event: timed("writing a stroke", written, self, context, event)
    drawing.batches = lambda self, unit: timed("drawing, without the card's own", batches, self, unit)


def large():
    """A thousand spirals: what a stroke takes of the window's thread."""
    module = importlib.import_module("bl_ext.user_default.flexmaps.engine.surface.shapes")
    mesh = module.dome(18)
    data = bpy.data.meshes.new("dome")
    data.from_pydata((mesh.vertices * 0.02 / mesh.median_edge).tolist(), [], mesh.quads.tolist())
    obj = bpy.data.objects.new("dome", data)
    for other in bpy.context.scene.objects:
        other.hide_set(True)
        other.select_set(False)
    bpy.context.scene.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    obj.flexmaps.connect.connector = "none"
    for name in ("trace", "spirals"):
        yield from press(name)
    bpy.context.window_manager.flexmaps_tab.open_shape = True
    yield from hands.click("operator", "flexmaps.pick_brush")
    yield 2.0
    with hands.in_view():
        bpy.ops.view3d.view_axis(type="TOP")
        bpy.ops.view3d.view_selected()
    yield 1.0
    brush = bpy.context.window_manager.flexmaps_brush
    centre, size = middle()
    brush.brush, brush.size, brush.strength = "softer", int(0.1 * size), 0.7
    held_up(FOUND.setdefault("held", {}))
    for down in (-0.2, 0.2):
        before = spirals(obj)
        yield from drag(
            (centre[0] - 0.2 * size, centre[1] + down * size), (centre[0] + 0.2 * size, centre[1] + down * size)
        )
        yield 1.0
        expect((spirals(obj)[1] != before[1]).any(), "a stroke is written")
        yield from hands.key("ctrl+z")
        yield 1.0
        expect(np.array_equal(spirals(bpy.context.object)[1], before[1]), "and undone")
        obj = bpy.context.object
        yield from hands.key("ctrl+shift+z")
        yield 1.0
        obj = bpy.context.object
    yield from picture("large")


def walk():
    for part in (begin, strokes, keys, protects, large):
        start = time.perf_counter()
        yield from part()
        FOUND.setdefault("seconds", {})[part.__name__] = round(time.perf_counter() - start, 1)


hands.drive(walk(), FOUND)

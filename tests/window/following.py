"""Runs inside a real Blender with its window: live mode with a hand on the mouse, then handles by the tool.

A number is typed into the sidebar, a spiral is clicked and another one dragged in the 3D view, all is undone and done again by
keys; what was seen goes to result.json, the screens to pictures.
"""

import json
import sys
import time
from pathlib import Path

import bpy
import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))
import hands  # noqa: E402

FOUND = {"errors": [], "wrong": [], "seen": {}, "pictures": 0}
PATIENCE = 120.0  # seconds for what is looked for, on a busy machine


def expect(holds, sentence):
    if not holds:
        FOUND["wrong"].append(sentence)


def following():
    return hands.module("bridge.hosts.live").current_watcher()


def picture(name):
    FOUND["pictures"] += 1
    yield 0.5
    hands.shot(f"{FOUND['pictures']:02d}-{name}")


def moved(name, since, before):
    """Wait until another shape is drawn, note how long that took, and then until it rests; the shape's vertices."""
    ends = since + PATIENCE
    while np.array_equal(following().shape.vertices, before) and time.perf_counter() < ends:
        yield 0.01
    FOUND["seen"][name] = round(time.perf_counter() - since, 3)
    expect(not np.array_equal(following().shape.vertices, before), f"{name}: the shape moves")
    while not following().is_resting and time.perf_counter() < ends:
        yield 0.05
    return following().shape.vertices


def on_screen(quad):
    """Where a quad of the live shape is on the screen."""
    from bpy_extras import view3d_utils

    shape = following().shape
    middle = shape.vertices[shape.quads[quad]].mean(axis=0)
    area = hands.view()[1]
    region = next(r for r in area.regions if r.type == "WINDOW")
    x, y = view3d_utils.location_3d_to_region_2d(region, area.spaces.active.region_3d, middle)
    return int(region.x + x), int(len(hands.pixels()) - region.y - y)


def walk():
    yield from hands.installed()
    from bl_ext.user_default.flexmaps import api

    piece = api.spirals(api.load("shape:dome", edge=20))
    obj = api.show(piece)
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    bpy.ops.ed.undo_push(message="begin")
    with hands.in_view():
        bpy.ops.view3d.view_axis(type="TOP")
    yield from hands.look_at([obj])
    bpy.context.window_manager.flexmaps_tab.open_shape = True
    yield from hands.click("operator", "flexmaps.live")
    began = time.perf_counter()
    while time.perf_counter() - began < PATIENCE and (
        following() is None or following().shape is None or not following().is_resting
    ):
        yield 0.1
    expect(following() is not None and following().picture is not None, "a click on Live shows the shape")
    first = following().shape.vertices
    yield from picture("live")
    since = time.perf_counter()
    bpy.context.window_manager.flexmaps_tab.open_piece = True
    yield from hands.type_in("thickness", "3")
    thicker = yield from moved("a number typed", since, first)
    yield from picture("thicker")
    yield from handled(thicker)
    yield from undone()
    yield from wished()
    FOUND["slowest"] = following().slowest_tick
    hands.module("bridge.hosts.live").stop()


def dragged(place, *held):
    """Drag from a pixel by some 60 to the right and 20 down, with keys held."""
    yield from hands.move(place)
    for name in held:
        hands.xdotool("keydown", name)
    hands.xdotool("mousedown", 1)
    yield 0.3
    for k in range(1, 6):
        yield from hands.move((place[0] + 12 * k, place[1] + 4 * k))
    hands.xdotool("mouseup", 1)
    for name in held:
        hands.xdotool("keyup", name)


def handled(vertices):
    """The tool: a click holds, a drag pulls."""
    with hands.in_view():
        bpy.ops.wm.tool_set_by_id(name="flexmaps.handles")
    yield 0.5
    quad = int(np.argmax(vertices[following().shape.quads].mean(axis=1)[:, 2]))  # on top, under the view from above
    place = on_screen(quad)
    yield from hands.move(place)
    hands.xdotool("click", 1)
    yield 1.0
    obj = bpy.context.object
    held = (
        [k for k, v in enumerate(obj.data.attributes["flexmaps_held"].data) if v.value]
        if "flexmaps_held" in obj.data.attributes
        else []
    )
    expect(held == [quad], f"a click holds the spiral under the pointer: {held}, not {quad}")
    yield from picture("held")
    before, centres = following().shape.vertices, following().shape.centres
    apart = np.linalg.norm(centres - centres[quad], axis=1)
    other = int(np.argmin(np.abs(apart - 0.06)))  # three quads away, where nothing covers it
    place = on_screen(other)
    pixel = np.linalg.norm(centres[other] - centres[quad]) / np.linalg.norm(np.subtract(place, on_screen(quad)))
    wanted = pixel * np.hypot(60, 20) / 0.02
    since = time.perf_counter()
    yield from dragged(place)
    yield from moved("a spiral pulled", since, before)
    stored = bpy.context.object.data.attributes.get("flexmaps_pull")
    expect(stored is not None, "a drag pulls at a spiral")
    if stored is not None:  # as many newtons as edges of 20 mm
        newtons = max(value.vector.length for value in stored.data)
        # but for what the pointer moves until Blender calls it a drag
        expect(0.5 * wanted < newtons < 1.1 * wanted, f"a drag of {wanted:.2f} edges pulls with {newtons:.2f} N")
        FOUND["newtons"] = [wanted, newtons]
    yield from picture("pulled")


def undone():
    for keys, there in ((("ctrl+z",), False), (("ctrl+shift+z",), True)):
        yield from hands.key(*keys)
        yield 1.0
        expect(("flexmaps_pull" in bpy.context.object.data.attributes) == there, f"{keys[0]} is one step")
        expect(following() is not None and following().problem == "", f"{keys[0]} leaves Live on")
    yield from picture("redone")


def wished():
    """With Ctrl a drag wishes the spiral somewhere beside the target, and Optimise brings it nearer to there."""
    obj, shape = bpy.context.object, following().shape
    # on the other side of the top than the pulled one, where nothing covers it
    pulled = int(np.argmax([value.vector.length for value in obj.data.attributes["flexmaps_pull"].data]))
    top = shape.centres[int(np.argmax(shape.centres[:, 2]))]
    quad = int(np.argmin(np.linalg.norm(shape.centres - (2.0 * top - shape.centres[pulled]), axis=1)))
    corners = shape.quads[quad]
    away = shape.vertices[corners].mean(axis=0) - hands.module("bridge.view.picking").target_vertices(obj)[
        corners
    ].mean(axis=0)
    here, there = on_screen(quad), on_screen(pulled)
    pixel = np.linalg.norm(shape.centres[quad] - shape.centres[pulled]) / np.linalg.norm(np.subtract(here, there))
    yield from dragged(here, "ctrl")
    yield 1.0
    obj = bpy.context.object
    stored = obj.data.attributes.get("flexmaps_wish")
    expect(stored is not None, "a drag with Ctrl wishes a spiral somewhere")
    if stored is None:
        return
    found = [k for k, value in enumerate(stored.data) if value.vector.length]
    expect(found == [quad], f"the wish is of the spiral under the pointer: {found}, not {quad}")
    way = np.array(stored.data[quad].vector) - away
    wanted = pixel * np.array([60, -20, 0])  # seen from above, rows go down
    FOUND["wish_mm"] = [(1e3 * wanted).tolist(), (1e3 * way).tolist()]
    # but for what the pointer moves until Blender calls it a drag
    share = way @ wanted / (wanted @ wanted)
    expect(
        0.5 < share < 1.1 and np.linalg.norm(way - share * wanted) < 0.2 * np.linalg.norm(wanted),
        f"the wish lies where the pointer let go: {FOUND['wish_mm']}",
    )
    yield from picture("wished")
    obj.flexmaps.optimise.iterations, obj.flexmaps.optimise.codesign = 1, False
    with hands.in_view():  # it stands in a menu
        bpy.ops.flexmaps.optimise("INVOKE_DEFAULT", True)
    block = yield from optimised()
    FOUND["wished_mm"] = [block.get("wished_mm_before"), block.get("wished_mm")]
    expect(block.get("wishes") == 1, f"Optimise knows of one wish: {block}")
    expect(
        block.get("wished_mm", 1.0) < block.get("wished_mm_before", 0.0), f"and brings it nearer: {FOUND['wished_mm']}"
    )
    yield from picture("optimised")


def optimised():
    """Wait until Optimise has left its block, and give it."""
    job, ends = hands.module("bridge.hosts.background").current_job, time.perf_counter() + PATIENCE
    told = {}
    while ("optimise" not in told or job() is not None) and time.perf_counter() < ends:
        yield 0.2
        told = json.loads(bpy.context.object.data.get("flexmaps_report", "{}"))
    yield from hands.aside()
    yield from hands.still(hands.sidebar())
    return told.get("optimise", {})


hands.drive(walk(), FOUND)

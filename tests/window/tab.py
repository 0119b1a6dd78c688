"""Runs inside a real Blender with a window: how high the tab is and where its rows stand, in every state on the way of *Next*."""

import os
import sys
from pathlib import Path

import bpy
import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))
import hands  # noqa: E402
from presses import BEGUN, FOUND, Held, current, expect, installed, last_operator, picture, until  # noqa: E402

QUADS = 200
REDDER = 60  # of 255: more red than green in what is marked
EDGE = 12  # pixels from the left edge of the sidebar, where a panel shows nothing but its colour
HIGHEST = 900  # pixels: what a full screen of 1920 x 1080 shows of a sidebar
SECTIONS = ("piece", "layout", "shape", "check", "make", "show", "workshop")
FOUND |= {"height": {}, "rows": {}, "presses": []}


def walk():
    yield from installed()
    space = hands.view()[1].spaces.active  # only the sidebar is looked at
    space.shading.type, space.overlay.show_overlays = "WIREFRAME", False
    if os.environ.get("FLEXMAPS_LANGUAGE"):
        view = bpy.context.preferences.view
        view.language = os.environ["FLEXMAPS_LANGUAGE"]
        view.use_translate_interface = view.use_translate_tooltips = True
        yield 0.5
    yield from state("welcome")
    bpy.ops.mesh.primitive_cube_add()
    yield from state("cube")
    bpy.ops.object.delete()
    bpy.ops.mesh.primitive_monkey_add()
    obj = bpy.context.object
    obj.flexmaps.remesh.quads, obj.flexmaps.optimise.iterations = QUADS, 2
    obj.flexmaps.sheet.nesting, obj.flexmaps.export.folder = "FAST", str(HERE / "sheets")
    yield from state("suzanne")
    for number in range(14):
        if not (yield from press(number)):
            break
    yield from sections("done")
    places = [row for name, row in FOUND["rows"].items() if name != "welcome"]
    expect(len({tuple(row["heading"] or ()) for row in places}) == 1, f"the first heading stays: {places}")
    expect(len({(row["next"] or (0, 0))[1] for row in places}) == 1, f"Next stays: {FOUND['rows']}")
    high = {name: pixels for name, pixels in FOUND["height"].items() if pixels > HIGHEST}
    expect(not high, f"nothing is higher than {HIGHEST} pixels: {high}")
    missed = [row for row in FOUND["presses"][:-1] if row[1].split(".")[1] not in row[3]]
    expect(not missed, f"every press at one spot does what the button says: {missed}")
    expect(FOUND["presses"][-1][1] == "wm.path_open", f"Next leads to the folder: {FOUND['presses']}")


def tab():
    return bpy.context.window_manager.flexmaps_tab


def redrawn():
    hands.sidebar().tag_redraw()
    yield 0.1
    yield from hands.still(hands.sidebar())


def state(name):
    """Where Next, the box and the first heading stand, and a picture."""
    yield from hands.aside()
    yield from redrawn()
    place = None if name == "welcome" else (yield from middle("operator", "flexmaps.next"))
    heading = None if name == "welcome" else (yield from middle("panel_prop", "open_piece"))
    FOUND["rows"][name] = {"next": place, "heading": heading}
    yield from redrawn()
    FOUND["height"][name] = yield from height()
    yield from picture(name)


def middle(method, identifier):
    """Pixels of the middle of what a call draws, which is red for a moment, without scrolling."""
    plain = yield from hands._redrawn(None)
    marked = yield from hands._redrawn((method, identifier, None))
    red = marked[:, :, 2].astype(int) - marked[:, :, 1]  # bytes are blue, green, red
    rows, columns = np.nonzero((red > REDDER) & (plain != marked).any(axis=2))
    expect(len(rows), f"{identifier} is seen")
    return [int(columns.min() + columns.max()) // 2, int(rows.min() + rows.max()) // 2] if len(rows) else None


def height():
    """Pixels from the top of the sidebar to the end of its last row: the panel is red for a moment."""
    colours = bpy.context.preferences.themes[0].view_3d.space.panelcolors
    before, plain = tuple(colours.back), hands.part(hands.sidebar())[:, EDGE, :3].astype(int)
    colours.back = (1.0, 0.0, 0.0, 1.0)
    yield from redrawn()
    shown = hands.part(hands.sidebar())[:, EDGE, :3].astype(int)
    colours.back = before
    yield from redrawn()
    rows = np.flatnonzero(shown[:, 2] - plain[:, 2] > REDDER)
    return int(rows.max()) + 1 if len(rows) else 0


def sections(when):
    """Each of them open in turn, with their tabs."""
    for key in SECTIONS:
        setattr(tab(), f"open_{key}", True)
        name = {"check": "check", "workshop": "habits"}.get(key)
        kinds = [i.identifier for i in tab().bl_rna.properties[name].enum_items] if name else [""]
        for kind in kinds:
            if kind:
                setattr(tab(), name, kind)
            yield from redrawn()
            FOUND["height"][f"{when} {key} {kind}".strip()] = yield from height()
            yield from picture(f"{when}-{key}{'-' + kind.lower() if kind else ''}")
    tab().by_hand = False


SPOT = []  # where Next is pressed, always the same


def press(number):
    """Press Next, where it was found the first time; False where it opens the folder."""
    seen = hands.module("bridge.store.guidance").read_guidance(bpy.context.object, bpy.context.scene)
    label = "" if seen.action is None else seen.action.label
    idname = "" if seen.action is None else seen.action.idname
    FOUND["presses"].append([label, idname, seen.status.text])
    if idname in {"", "wm.path_open"}:
        return False
    if not SPOT:
        SPOT.append((yield from hands.find("operator", "flexmaps.next")))
    yield 0.5
    yield from hands.move(SPOT[0])
    begun, before = len(BEGUN), last_operator()
    Held.when = lambda running: running.fraction > 0.1
    hands.xdotool("click", 1)
    yield from until(lambda: (len(BEGUN), last_operator()) != (begun, before))
    if len(BEGUN) > begun:
        yield from until(lambda: current() is None or current().fraction > 0.1)
        if current() is not None and number in {0, 3}:
            yield from running(f"{number}-runs")
    Held.when = None
    while current() is not None:
        yield 0.05
    yield 0.3
    done = bpy.context.window_manager.operators
    FOUND["presses"][-1].append(done[-1].bl_idname if done else "")
    yield from state(f"{number + 1}-{idname.partition('.')[2]}")
    return True


def running(name):
    """The rows while a job runs."""
    yield from hands.aside()
    yield 0.4
    place = yield from middle("operator", "flexmaps.stop")  # beside the progress: where the menu of Next is
    heading = yield from middle("panel_prop", "open_piece")
    FOUND["rows"][name] = {"next": place, "heading": heading}
    yield from redrawn()
    FOUND["height"][name] = yield from height()
    yield from picture(name)


hands.drive(walk(), FOUND)

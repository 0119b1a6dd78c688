"""Runs inside a real Blender with a window: a ring, made from a script, in the views that the guide shows.

Driven by tools/guide_pictures.py, which cuts the pictures to size.
"""

import sys
from pathlib import Path

import bpy

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))
import hands  # noqa: E402

FOUND = {"errors": [], "shots": {}}


def shot(name):
    """The screen as it is, and where the 3D view and the sidebar are in it: left, top, right, bottom."""
    yield from hands.still(hands.view()[1])
    hands.shot(name)
    height = len(hands.pixels())
    rects = {}
    for key, r in (("view", hands.view()[1]), ("sidebar", hands.sidebar())):
        rects[key] = (r.x, height - r.y - r.height, r.x + r.width, height - r.y)
    FOUND["shots"][name] = rects


def brush(obj):
    """Half of a ring painted stiffer, by the brush that is in hand."""
    module, painting = hands.module("bridge.view.paint_session"), hands.module("engine.spirals.painting")
    bpy.context.window_manager.flexmaps_tab.open_shape = True
    yield from hands.click("operator", "flexmaps.pick_brush")
    yield 0.5
    session = module.get_session(obj, bpy.context.scene)
    share = (session.brush_surface.centres[:, 0] > 0.0).astype(float)
    session.paint("stiffer", 0.8 * share, painting.Stroke())
    with hands.in_view():
        session.write(bpy.context.scene)
    yield from hands.aside()
    yield from shot("brush")
    with hands.in_view():
        bpy.ops.wm.tool_set_by_id(name="builtin.select_box")
    bpy.ops.flexmaps.simulate()


def shown(piece):
    """The piece as the only selected object, in the colours of its panels."""
    from bl_ext.user_default.flexmaps import api

    obj = api.show(piece)
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    bpy.ops.flexmaps.overlay(kind="PATCH")
    return obj


def walk():
    yield from hands.installed()
    from bl_ext.user_default.flexmaps import api

    obj = shown(api.optimise(api.load("shape:torus", edge=20)))
    bpy.context.window_manager.flexmaps_tab.open_shape = True
    panels = [other for other in bpy.data.objects if other.get("flexmaps_kind") == "panels"]
    yield 0.5
    with hands.in_view():
        hands.module("bridge.view.framing").frame_views(bpy.context, *panels)
    yield from hands.aside()
    yield from shot("sidebar")
    collection = hands.module("bridge.view.collection")
    collection.remove(collection.find(obj))
    bpy.data.objects.remove(obj)
    bpy.context.window_manager.flexmaps_tab.open_piece = True
    obj = shown(api.simulate(api.load("shape:torus", edge=20)))
    yield from hands.look_at([obj])
    yield from hands.aside()
    yield from hands.click("popover", "FLEXMAPS_PT_presets")
    yield 0.6
    yield from shot("presets")
    yield from hands.aside()
    bpy.ops.flexmaps.overlay(kind="REACH")
    yield from hands.aside()
    yield from shot("limits")
    yield from brush(obj)
    bpy.ops.flexmaps.preview()
    bpy.ops.flexmaps.overlay(kind="NONE")
    made = next(o for o in bpy.data.objects if "Assembled" in o.name)
    hands.view()[1].spaces.active.shading.color_type = "VERTEX"
    bpy.context.window_manager.flexmaps_tab.open_show = True
    yield from hands.aside()
    yield from hands.look_at([obj, made])
    yield from shot("preview")
    bpy.data.objects.remove(made)
    bpy.context.view_layer.objects.active = obj
    bpy.ops.flexmaps.choose()
    bpy.ops.flexmaps.overlay(kind="PATCH")
    yield from hands.look_at([obj])
    bpy.context.window_manager.flexmaps_tab.open_layout = True
    yield from hands.aside()
    yield from shot("choose")


hands.drive(walk(), FOUND)

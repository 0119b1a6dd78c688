"""Runs inside a real Blender: installs the zip and goes through every stage, as a person would.

With a window the stages run as background jobs, and the real pointer and keyboard are used; without one they run at
once. What was seen goes to result.json beside this file.
"""

import json
import shutil
import subprocess
import sys
import traceback
from pathlib import Path

import bpy

HERE = Path(__file__).parent
FOUND = {"stages": {}, "errors": [], "version": bpy.app.version_string, "python": sys.version.split()[0]}
CHECK = (1091, 393)  # where the button is on a screen of 1500 x 1400 before anything was checked
ASIDE = (600, 1150)  # a place in the 3D view that nothing covers
STAGES = ("check", "regularise", "trace", "merge", "spirals", "simulate", "optimise", "export")


def view():
    window = bpy.context.window_manager.windows[0]
    area = next(a for a in window.screen.areas if a.type == "VIEW_3D")
    return window, area


def in_view():
    window, area = view()
    region = next(r for r in area.regions if r.type == "WINDOW")
    return bpy.context.temp_override(window=window, area=area, region=region)


def press(name, **options):
    """Call an operator the way a button does."""
    operator = getattr(bpy.ops.flexmaps, name)
    try:
        if bpy.app.background:
            FOUND["stages"][name] = sorted(operator(**options))
        else:
            with in_view():
                FOUND["stages"][name] = sorted(operator("INVOKE_DEFAULT", **options))
    except RuntimeError as error:
        FOUND["stages"][name] = [str(error).strip()]


def pointer(place, *then):
    """Move the real pointer, and click or type there."""
    if not bpy.app.background:
        x, y = map(str, place)
        subprocess.run(["xdotool", "mousemove", x, y, "sleep", "0.3", *then], check=False)


def until_done():
    from bl_ext.user_default.flexmaps.bridge import job

    while job.current() is not None:
        yield 0.05
    yield 0.6


def shot(name):
    if not bpy.app.background:
        shutil.copy(HERE / "Xvfb_screen0", HERE / f"{name}.xwd")


def state():
    obj = bpy.context.object
    report = json.loads(obj.data.get("flexmaps_report", "{}"))
    return {
        "name": obj.name,
        "blocks": sorted(report),
        "seams": sum(edge.use_seam for edge in obj.data.edges),
        "attributes": sorted(a.name for a in obj.data.attributes if a.name.startswith("flexmaps")),
        "objects": len(bpy.data.objects),
    }


def walk():
    zip_file = str(next(HERE.glob("*.zip")))
    bpy.ops.extensions.package_install_files(filepath=zip_file, repo="user_default", enable_on_install=True)
    yield 1.0
    for obj in list(bpy.data.objects):
        bpy.data.objects.remove(obj)
    if not bpy.app.background:
        _, area = view()
        area.spaces.active.show_region_ui = True
        yield 0.5
        next(r for r in area.regions if r.type == "UI").active_panel_category = "FlexMaps"
        yield 0.5
    bpy.ops.mesh.primitive_monkey_add()
    bpy.context.object.flexmaps.remesh.quads = 1500
    shot("1-start")
    yield 0.5
    if bpy.app.background:
        press("check")
    pointer(CHECK, "click", "1")
    yield 1.0
    yield from until_done()
    FOUND["refused"] = FOUND["stages"].pop("check", None), bpy.context.object.mode, state()["blocks"]
    shot("2-refused")
    pointer(ASIDE)  # the message goes when the pointer leaves it
    yield 0.5
    bpy.ops.object.mode_set(mode="OBJECT")
    press("quad_remesh")
    yield from until_done()
    press("set_size")
    yield from until_done()
    if not bpy.app.background:
        with in_view():
            bpy.ops.view3d.view_selected()
        yield 1.0
    bpy.context.object.flexmaps.export.folder = str(HERE / "sheets")
    bpy.context.object.flexmaps.sheet.nesting = "FAST"
    bpy.context.object.flexmaps.optimise.restart = False
    bpy.context.object.flexmaps.optimise.iterations = 2
    for stage in STAGES:
        press(stage)
        if stage == "merge":
            yield 0.5
            shot("3-merging")
        yield from until_done()
        if stage == "merge":
            bpy.ops.flexmaps.overlay(kind="ENERGY")
            yield 1.0
            shot("4-distortion")
        if stage == "simulate":
            bpy.ops.flexmaps.overlay(kind="DISTANCE")
            yield 1.0
            shot("5-simulated")
        if stage == "optimise":
            bpy.ops.flexmaps.overlay(kind="REACH")
            yield 1.0
            shot("5-limits")
    bpy.ops.flexmaps.overlay(kind="TWIST")
    if not bpy.app.background:
        with in_view():
            bpy.ops.view3d.view_all()
    yield 1.5
    shot("6-spirals")
    FOUND["whole"] = state()
    from_zip = ("scipy", "shapely", "igl", "ezdxf")
    FOUND["places"] = {name: sys.modules[name].__file__ for name in from_zip if name in sys.modules}
    if bpy.app.background:
        return
    before = state()
    press("merge")
    yield 0.4
    pointer(ASIDE, "key", "Escape")
    yield from until_done()
    shot("7-escaped")
    FOUND["escaped"] = state() == before
    with in_view():
        bpy.ops.ed.undo()  # the overlay or the sheets
        bpy.ops.ed.undo()
        bpy.ops.ed.undo()
    yield 1.0
    FOUND["undone"] = state()
    shot("8-undone")


def finish():
    (HERE / "result.json").write_text(json.dumps(FOUND, indent=1))
    bpy.ops.wm.quit_blender()


STEPS = walk()


def tick():
    try:
        return next(STEPS)
    except StopIteration:
        pass
    except Exception:
        FOUND["errors"].append(traceback.format_exc())
    finish()
    return None


bpy.context.preferences.view.show_splash = False
if bpy.app.background:
    try:
        for _ in STEPS:
            pass
    except Exception:
        FOUND["errors"].append(traceback.format_exc())
    finish()
else:
    bpy.app.timers.register(tick, first_interval=1.0, persistent=True)

"""Runs inside a real Blender without a window: installs the zip and calls every stage, as a script would."""

import json
import sys
import traceback
from pathlib import Path

import bpy

HERE = Path(__file__).parent
STAGES = ("set_size", "regularise", "trace", "merge", "spirals", "simulate", "optimise", "explore", "preview", "export")
FOUND = {"stages": {}, "errors": []}


def press(name):
    try:
        FOUND["stages"][name] = sorted(getattr(bpy.ops.flexmaps, name)())
    except RuntimeError as error:
        FOUND["stages"][name] = [str(error).strip()]


def walk():
    zip_file = str(next(HERE.glob("*.zip")))
    bpy.ops.extensions.package_install_files(filepath=zip_file, repo="user_default", enable_on_install=True)
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=3)
    settings = bpy.context.object.flexmaps
    settings.remesh.quads = 100
    settings.optimise.iterations = 2
    settings.explore.candidates = 2
    settings.sheet.nesting = "FAST"
    settings.export.folder = str(HERE / "sheets")
    press("check")
    FOUND["refused"] = FOUND["stages"].pop("check")
    press("quad_remesh")
    for stage in STAGES:
        press(stage)
    FOUND["blocks"] = sorted(json.loads(bpy.context.object.data["flexmaps_report"]))
    FOUND["explored"] = json.loads(bpy.context.object["flexmaps_explored"])
    FOUND["places"] = {n: sys.modules[n].__file__ for n in ("scipy", "shapely", "igl", "ezdxf") if n in sys.modules}


try:
    walk()
except Exception:
    FOUND["errors"].append(traceback.format_exc())
(HERE / "result.json").write_text(json.dumps(FOUND, indent=1))
bpy.ops.wm.quit_blender()

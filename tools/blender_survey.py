"""Survey of the extension in one Blender: seconds to enable it, and whether every operator and panel runs.

Runs as a script with Blender as a module, where the checkout is loaded, or inside a real Blender, where the zip that lies
beside it is installed. The last line printed is ``SURVEY`` and JSON.
"""

import importlib
import json
import os
import sys
import time
import traceback
from pathlib import Path
from types import SimpleNamespace

import bpy

HERE = Path(__file__).resolve().parent
HEAVY = ("numpy", "scipy", "shapely", "igl", "ezdxf", "fontTools", "cvxopt", "spyrrow", "xatlas", "matplotlib", "PIL")
FOUND = {"blender": bpy.app.version_string, "python": sys.version.split()[0], "errors": []}


class Nothing:
    """Stand-in for a Blender layout that accepts all calls."""

    def __getattr__(self, name):
        if name == "panel":
            return lambda *_, **__: (Nothing(), Nothing())
        return lambda *_, **__: Nothing()


def enable():
    """Load and register the extension; returns its package."""
    there = set(sys.modules)
    zips = list(HERE.glob("*.zip"))
    clock, work = time.perf_counter(), time.process_time()
    if zips:
        if not (Path(bpy.utils.user_resource("EXTENSIONS")) / "user_default" / "flexmaps").is_dir():
            bpy.ops.extensions.package_install_files(filepath=str(zips[0]), repo="user_default", enable_on_install=True)
            print(
                "SURVEY installed", flush=True
            )  # unpacking is done once; the next start tells how long enabling takes
            os._exit(0)
        clock, work = time.perf_counter(), time.process_time()
        bpy.ops.preferences.addon_enable(module="bl_ext.user_default.flexmaps")
        package = sys.modules["bl_ext.user_default.flexmaps"]
    else:
        sys.path.insert(0, str(HERE))
        package = importlib.import_module("dev").load_package()
        package.register()
    FOUND["enable_s"] = round(time.perf_counter() - clock, 3)
    FOUND["enable_cpu_s"] = round(time.process_time() - work, 3)
    FOUND["heavy"] = sorted(name for name in HEAVY if name in sys.modules and name not in there)
    FOUND["modules"] = len(set(sys.modules) - there)
    return package


def scenes():
    """Make states of a file one after another, in each of which all operators and panels must work; yield their names."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    yield "empty file"
    bpy.ops.object.camera_add()
    yield "camera"
    bpy.ops.object.select_all(action="DESELECT")
    bpy.ops.mesh.primitive_monkey_add()
    yield "triangles"
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=3, y_subdivisions=3, size=0.06)
    yield "quads"
    bpy.ops.object.mode_set(mode="EDIT")
    yield "edit mode"
    bpy.ops.object.mode_set(mode="OBJECT")
    for name in ("check", "flatten", "spirals"):
        getattr(bpy.ops.flexmaps, name)()
        yield name
    bpy.context.object.flexmaps.simulate.restarts = 1
    bpy.ops.flexmaps.simulate()
    yield "simulate"


def ask(package, state):
    """Poll every operator and draw every panel; record errors."""
    panels = importlib.import_module(package.__name__ + ".panels")
    operators = importlib.import_module(package.__name__ + ".operators")
    for cls in operators.CLASSES:
        try:
            getattr(bpy.ops.flexmaps, cls.bl_idname.split(".")[1]).poll()
        except Exception:
            FOUND["errors"].append(f"{state}: {cls.bl_idname}: {traceback.format_exc(limit=-2)}")
    for cls in panels.CLASSES:
        try:
            if cls.bl_region_type != "UI" or (hasattr(cls, "poll") and not cls.poll(bpy.context)):
                continue
            shown = SimpleNamespace(layout=Nothing(), stage=getattr(cls, "stage", ""))
            for part in ("draw_header", "draw_header_preset", "draw"):
                if hasattr(cls, part):
                    getattr(cls, part)(shown, bpy.context)
        except Exception:
            FOUND["errors"].append(f"{state}: {cls.bl_idname}: {traceback.format_exc(limit=-2)}")
    FOUND["operators"], FOUND["panels"] = len(operators.CLASSES), len(panels.CLASSES)
    FOUND["undescribed"] = [
        c.bl_idname for c in operators.CLASSES if not (c.__doc__ or getattr(c, "bl_description", ""))
    ]


def main():
    try:
        package = enable()
        for state in scenes():
            bpy.context.view_layer.update()
            ask(package, state)
        package.unregister()
        FOUND["left"] = [name for name in dir(bpy.types) if name.startswith("FLEXMAPS_")]
    except Exception:
        FOUND["errors"].append(traceback.format_exc())
    print("SURVEY", json.dumps(FOUND), flush=True)
    os._exit(0)  # Blender as a module complains for pages when the process ends


if __name__ == "__main__":
    main()

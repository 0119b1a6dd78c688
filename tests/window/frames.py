"""Runs inside a real Blender with a window: how long a frame of the 3D view takes with the preview of 2401 spirals in it.

The first run makes the previews and keeps them in frames.blend beside this file; a second one, with other settings of the
graphics driver, draws the same. What was measured goes to result.json.
"""

import sys
import time
from pathlib import Path

import bpy
from mathutils import Quaternion

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))
import hands  # noqa: E402

FILE = HERE / "frames.blend"
DETAILS = ("LINES", "COARSE", "MEDIUM")
FRAMES = 8
FOUND = {"version": bpy.app.version_string, "frames": {}, "errors": []}


def made():
    """The previews as objects by their detail, and nothing else that is drawn."""
    if FILE.is_file():
        bpy.ops.wm.open_mainfile(filepath=str(FILE), load_ui=False)
        return {name: bpy.data.objects[name] for name in DETAILS}
    package = install()
    for obj in list(bpy.data.objects):
        bpy.data.objects.remove(obj)
    shapes = sys.modules[f"{package}.engine.surface.shapes"]
    mesh = shapes.saddle(49)
    data = bpy.data.meshes.new("piece")
    data.from_pydata((mesh.vertices * (0.02 / mesh.median_edge)).tolist(), [], mesh.quads.tolist())
    piece = bpy.data.objects.new("piece", data)
    bpy.context.scene.collection.objects.link(piece)
    bpy.context.view_layer.objects.active = piece
    for stage in ("flatten", "spirals", "simulate"):
        getattr(bpy.ops.flexmaps, stage)()
    found = {}
    for detail in DETAILS:
        piece.flexmaps.preview.detail, piece.flexmaps.preview.joined = detail, False
        bpy.ops.flexmaps.preview()
        shown = next(o for o in bpy.data.objects if o.get("flexmaps_kind") == "assembled")
        found[detail] = bpy.data.objects.new(detail, shown.data.copy())
        found[detail].scale = shown.scale
    for obj in list(bpy.data.objects):
        if obj not in found.values():
            bpy.data.objects.remove(obj)
    for obj in found.values():
        bpy.context.scene.collection.objects.link(obj)
    bpy.ops.wm.save_as_mainfile(filepath=str(FILE))
    return found


def install():
    zip_file = str(next(HERE.glob("*.zip")))
    bpy.ops.extensions.package_install_files(filepath=zip_file, repo="user_default", enable_on_install=True)
    import bl_ext.user_default.flexmaps.engine.surface.shapes  # noqa: F401

    return "bl_ext.user_default.flexmaps"


def walk():
    found = made()
    yield 1.0
    for name in (None, *DETAILS):
        for kind, obj in found.items():
            obj.hide_set(kind != name)
        area = hands.view()[1]
        with hands.in_view():
            if name is not None:
                bpy.ops.object.select_all(action="DESELECT")
                found[name].select_set(True)
                bpy.ops.view3d.view_selected()
                found[name].select_set(False)
        yield 1.5
        with hands.in_view():
            for _ in range(2):  # what is made for the first frame is no part of the others
                frame(area)
            wall, own = time.perf_counter(), time.thread_time()
            for _ in range(FRAMES):
                frame(area)
            wall, own = time.perf_counter() - wall, time.thread_time() - own
        region = next(r for r in area.regions if r.type == "WINDOW")
        row = {"frame_ms": 1e3 * wall / FRAMES, "own_ms": 1e3 * own / FRAMES, "pixels": [region.width, region.height]}
        if name is not None:
            row["triangles"] = triangles(found[name])
        FOUND["frames"][name or "empty"] = row


def triangles(obj):
    """How many are drawn of an object."""
    evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    mesh.calc_loop_triangles()
    count = len(mesh.loop_triangles)
    evaluated.to_mesh_clear()
    return count


def frame(area):
    """Turn the view a little, as with the mouse, and draw it."""
    view = area.spaces.active.region_3d
    view.view_rotation = view.view_rotation @ Quaternion((0, 1, 0), 0.02)
    bpy.ops.wm.redraw_timer(type="DRAW_SWAP", iterations=1)


hands.drive(walk(), FOUND)

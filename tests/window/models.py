"""Runs inside a real Blender with its window: models that stand for many go by *Next* alone to their sheets.

models.json beside this file names them, each with the settings that are not to be the defaults, as {"remesh.quads": 150}.
What came of each goes to result.json, the screen after every stage to a picture.
"""

import json
import sys
import time
from pathlib import Path

import bmesh
import bpy

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))
import hands  # noqa: E402
from presses import FOUND, blocks, expect, installed, picture, press, until  # noqa: E402

STEPS = 14  # no model needs more
FILE = HERE / "bunny.obj"


def text():
    bpy.ops.object.text_add()
    bpy.context.object.data.body = "Hi"
    bpy.ops.object.convert(target="MESH")


def lamp():
    """A shade: a cylinder without ends, half as wide on top."""
    bpy.ops.mesh.primitive_cylinder_add(end_fill_type="NOTHING")
    for vertex in bpy.context.object.data.vertices:
        if vertex.co.z > 0:
            vertex.co.x, vertex.co.y = 0.5 * vertex.co.x, 0.5 * vertex.co.y


def roof():
    """Four hips over a rectangle, of two quads and two triangles."""
    eaves, ridge = [(-2, -1, 0), (2, -1, 0), (2, 1, 0), (-2, 1, 0)], [(-1, 0, 0.8), (1, 0, 0.8)]
    mesh = bpy.data.meshes.new("Roof")
    mesh.from_pydata(eaves + ridge, [], [(0, 1, 5, 4), (2, 3, 4, 5), (1, 2, 5), (3, 0, 4)])
    obj = bpy.data.objects.new("Roof", mesh)
    bpy.context.collection.objects.link(obj)
    obj.select_set(True)


def mask():
    """The front of a head."""
    bpy.ops.mesh.primitive_monkey_add()
    bm = bmesh.new()
    bm.from_mesh(bpy.context.object.data)
    bmesh.ops.delete(bm, geom=[face for face in bm.faces if face.calc_center_median().y > 0], context="FACES")
    bm.to_mesh(bpy.context.object.data)
    bm.free()


MODELS = {
    "lamp": lamp,
    "roof": roof,
    "mask": mask,
    "suzanne": bpy.ops.mesh.primitive_monkey_add,
    "text": text,
    "cylinder": bpy.ops.mesh.primitive_cylinder_add,
    "bunny": lambda: bpy.ops.wm.obj_import(filepath=str(FILE)),
}


def walk():
    yield from installed()
    FOUND["models"] = {}
    for name, settings in json.loads((HERE / "models.json").read_text()).items():
        yield from to_sheets(name, settings)


def to_sheets(name, settings):
    """As somebody does who has read nothing."""
    for obj in list(bpy.data.objects):
        bpy.data.objects.remove(obj)
    MODELS[name]()
    obj = bpy.context.selected_objects[0]
    bpy.context.view_layer.objects.active = obj
    folder = HERE / f"{name}-sheets"
    for path, value in ({"export.folder": str(folder)} | settings).items():
        group, setting = path.split(".")
        setattr(getattr(obj.flexmaps, group), setting, value)
    yield from hands.look_at([obj])
    # in perspective View Selected cuts off a little of the near side
    hands.view()[1].spaces.active.region_3d.view_distance *= 1.2
    states = hands.module("bridge.store.states")
    found = FOUND["models"][name] = {"pressed": [], "seconds": {}, "blocks": {}}
    start = time.perf_counter()
    for _ in range(STEPS):
        obj = bpy.context.object
        if obj.mode == "EDIT":
            yield from hands.key("Tab")
            yield from until(lambda obj=obj: obj.mode == "OBJECT")
        step = (
            hands.module("bridge.store.next_button")
            .next_idname(obj, bpy.context.scene, states.read_states(obj, bpy.context.scene))
            .removeprefix("flexmaps.")
        )
        if not step:
            break
        found["pressed"].append(step)
        measured = yield from press("next")
        found["seconds"][step] = measured["seconds"]
        yield from picture(f"{name}-{step}")
        expect(hands.shown_share(bpy.context.object) > 0.1, f"{name} is in sight after {step}, large enough to be seen")
        if step in {"merge", "make_larger"}:  # the views were turned to the panels
            expect(not covered(), f"all panels of {name} are in sight, but {covered()} vertices")
    found["seconds"]["all"] = round(time.perf_counter() - start, 1)
    found["blocks"] = {k: v for k, v in blocks().items() if k != "checks"}
    expect("sheets" in blocks(), f"Next leads {name} to its sheets: {found['pressed']}")
    missing = [file for file in blocks().get("sheets", {}).get("files", [None]) if not (folder / str(file)).is_file()]
    expect(not missing, f"all files of {name} are there, but {missing}")


def covered():
    """How many vertices of the flat panels are outside the view, or behind its sidebar."""
    count = 0
    for obj in bpy.data.objects:
        if obj.get("flexmaps_kind") == "panels":
            region, places = hands.on_screen(obj)
            right = hands.sidebar().x - region.x
            count += sum(not (at is not None and 0 < at.x < right and 0 < at.y < region.height) for at in places)
    return count


hands.drive(walk(), FOUND)

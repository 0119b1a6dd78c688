"""Runs inside a real Blender with its window: installs the zip and walks from a ball of triangles to the sheets, as a person would.

Every button is pressed with the real pointer. What was seen and measured goes to result.json beside this file, the screen
after every stage to a picture.
"""

import importlib
import sys
import time
import warnings
from pathlib import Path

import bmesh
import bpy
import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))
import hands  # noqa: E402
from meter import Meter  # noqa: E402
from presses import BEGUN, FOUND, blocks, expect, installed, picture, press, press_and_stop, until  # noqa: E402

warnings.filterwarnings("default", module=r"bl_ext\.")  # all of ours, also of deprecated things
QUADS = 250


def coloured():
    """The share of the 3D view's left half that has a colour, neither grey nor dark."""
    area = hands.view()[1]
    shown = hands.part(area)[:, : area.width // 2, :3].astype(int)
    return float(((np.ptp(shown, axis=2) > 40) & (shown.max(axis=2) > 110)).mean())


def redraws():
    """Milliseconds that drawing the sidebar takes here with nothing else to do: half of the times, and the longest."""
    meter = Meter(lambda: False)
    for _ in range(12):
        hands.sidebar().tag_redraw()
        yield 0.1
    meter.stop()
    return [round(1e3 * float(np.percentile(meter.gaps, p)), 1) for p in (50, 90, 100)]


# -- the walk ------------------------------------------------------------------------------------------------------------


def walk():
    yield from install()
    for part in (
        make_quads,
        layout,
        seams,
        spirals,
        simulate,
        stopped,
        optimise,
        export,
        undo,
        preview,
        animate,
        render,
        presets,
    ):
        start = time.perf_counter()
        yield from part()
        FOUND.setdefault("seconds", {})[part.__name__] = round(time.perf_counter() - start, 1)


def install():
    yield from installed()
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=3)
    bpy.context.object.scale = (1.3, 1.0, 0.7)
    bpy.context.object.flexmaps.export.folder = str(HERE / "sheets")
    yield 0.5
    yield from picture("start")


def make_quads():
    yield from press("check")
    yield from picture("refused")
    expect(bpy.context.object.mode == "EDIT", "Check shows the culprits in edit mode")
    found = blocks().get("checks", [])
    expect(any("quads" in f["message"] for f in found), f"Check names faces that are no quads: {found}")
    yield from hands.key("Tab")
    yield from until(lambda: bpy.context.object.mode == "OBJECT")
    expect(bpy.context.object.mode == "OBJECT", "the error goes with the pointer, and Tab leaves edit mode")
    bpy.context.window_manager.flexmaps_tab.open_piece = True
    yield from hands.type_in("quads", QUADS)
    yield from until(lambda: bpy.context.object.flexmaps.remesh.quads == QUADS)
    expect(bpy.context.object.flexmaps.remesh.quads == QUADS, "a typed number is taken over")
    FOUND["redraw_ms"] = yield from redraws()
    ball = bpy.context.object.name
    yield from hands.key("Escape")  # Blender remembers it, and QuadriFlow once took itself for cancelled ever after
    yield from press_and_stop("quad_remesh")
    expect(bpy.context.object.name == ball, "a remesh that was stopped changes nothing")
    yield from press("quad_remesh")
    obj = bpy.context.object
    expect(obj.name != ball and bpy.data.objects[ball].hide_get(), "a new object takes the place of the old one")
    expect({len(f.vertices) for f in obj.data.polygons} == {4}, "Quad remesh makes quads")
    yield from press("set_size")
    places = [obj.matrix_world @ v.co for v in obj.data.vertices]
    size = 1e3 * float(np.median([(places[a] - places[b]).length for a, b in obj.data.edge_keys]))
    expect(abs(size - obj.flexmaps.remesh.edge) < 0.5, f"quads have {obj.flexmaps.remesh.edge} mm, not {size}")
    expect(hands.shown_share(obj) > 0.1, "a piece that was scaled is in sight, large enough to be seen")
    yield from press("regularise")
    yield from picture("quads")


def layout():
    yield from press("trace")
    expect(any(e.use_seam for e in bpy.context.object.data.edges), "Trace draws seams")
    traced = blocks()["layout"]["patches"]
    yield from picture("traced")
    yield from hands.look_at([bpy.context.object])  # the view has shown the panels too
    yield from hands.still(hands.view()[1])
    expect(coloured() > 0.08, f"the patches are seen at once, but {coloured():.1%} of the view has a colour")
    yield from press("overlay", options={"kind": "PATCH"})
    yield from hands.still(hands.view()[1])
    expect(coloured() < 0.02, "pressed again, the colours go")
    yield from press("overlay", options={"kind": "PATCH"})
    yield from press("merge")
    block = blocks()["layout"]
    expect(block["patches"] < traced, f"Merge joins patches: {traced} to {block['patches']}")
    expect(block["flips"] == block["overlaps"] == 0, "no panel overlaps itself")
    expect("flexmaps_flat" in bpy.context.object.data.uv_layers, "there is a flat UV map")
    yield from press("overlay", options={"kind": "ENERGY"})
    yield from picture("merged")


def seams():
    """The way of the guide: edit the seams by hand in edit mode, and let the panels follow."""
    obj = bpy.context.object
    before = blocks()["layout"]["patches"]
    yield from hands.key("Tab")
    yield from until(lambda: obj.mode == "EDIT")
    expect(obj.mode == "EDIT", "Tab goes to edit mode")
    bm = bmesh.from_edit_mesh(obj.data)
    inner = [e for e in bm.edges if e.seam][:1]
    ends = inner[0].verts
    beside = next(e for v in ends for e in v.link_edges if not e.seam)
    for element in (*bm.verts, *bm.edges, *bm.faces):
        element.select = False
    beside.select = True
    bm.select_flush_mode()
    bmesh.update_edit_mesh(obj.data)
    with hands.in_view():
        bpy.ops.mesh.mark_seam()
    yield 0.5
    yield from press("update_from_seams")
    expect(obj.mode == "EDIT", "edit mode is not left")
    block = blocks()["layout"]
    expect(block["patches"] >= before and block["flips"] == 0, f"the panels follow the seams: {before} to {block}")
    yield from picture("seams")
    yield from press("merge")  # in edit mode too
    yield from hands.key("Tab")
    yield from until(lambda: obj.mode == "OBJECT")
    expect(obj.mode == "OBJECT" and "flexmaps_seam" in obj.data.attributes, "what was written in edit mode is there")
    expect(obj.data.validate() is False, "the mesh is whole")


def spirals():
    yield from press("spirals")
    names = {a.name for a in bpy.context.object.data.attributes}
    expect({"flexmaps_width", "flexmaps_twist"} <= names, f"Spirals writes widths and twists, not {names}")
    expect(blocks()["spirals"]["slot_min_mm"] > 0.2, "slots can be cut")
    yield from press("overlay", options={"kind": "TWIST"})
    yield from picture("spirals")


def stopped():
    """Esc in every stage leaves everything as it was, and the next press works."""
    before, there = blocks(), set(bpy.data.objects)
    for name in ("regularise", "trace", "merge", "spirals", "simulate", "preview", "export", "report"):
        yield from press_and_stop(name)
        expect(blocks() == before, f"{name}, stopped, changes nothing")
    expect(set(bpy.data.objects) == there, "a preview that was stopped leaves nothing")
    expect(not (HERE / "sheets").exists() or not list((HERE / "sheets").iterdir()), "nor does an export")


def simulate():
    yield from press("simulate")
    block = blocks()["equilibrium"]
    expect(block["converged"], f"Simulate converges: {block['status']}")
    keys = bpy.context.object.data.shape_keys
    expect(keys is not None and keys.key_blocks[-1].value == 1.0, "the result is a shape key, switched on")
    yield from press("overlay", options={"kind": "DISTANCE"})
    yield from picture("simulated")


def optimise():
    """Stopped in the middle of it: the best so far is kept."""
    before = blocks()["spirals"], blocks()["equilibrium"]["laplacian_rmse_mm"]

    def seen():
        FOUND["distance_on_the_way"] = [1e3 * away for _, away in BEGUN[-1].intermediate.history]
        yield from picture("optimising")

    yield from press_and_stop("optimise", lambda running: len(getattr(running.intermediate, "history", ())) > 3, seen)
    block = blocks()["optimise"]
    FOUND["rmse"] = before[1], block["laplacian_rmse_mm_before"], block["laplacian_rmse_mm"]
    expect(not block["finished"], "Optimise was stopped by Esc")
    expect(block["laplacian_rmse_mm"] < block["laplacian_rmse_mm_before"], f"the best is kept: {FOUND['rmse']}")
    expect(blocks()["spirals"] != before[0], "the spirals are others")
    expect("reach" not in blocks(), "who has stopped it did not wait for the limits of the match")
    yield from press("simulate")
    yield from press("overlay", options={"kind": "REACH"})
    yield from picture("optimised")


def preview():
    settings = bpy.context.object.flexmaps
    settings.preview.detail, settings.preview.place = "COARSE", "BESIDE"
    there = set(bpy.data.objects)
    yield from press("preview")
    made = [o for o in bpy.data.objects if o not in there]
    expect(len(made) == 1 and len(made[0].data.polygons) > 10 * QUADS, f"Preview adds one object of many faces: {made}")
    yield from hands.look_at([bpy.context.object, *made])
    yield from picture("preview")


def animate():
    there = set(bpy.data.objects)
    yield from press("animate")
    made = [o for o in bpy.data.objects if o not in there]
    moving = [o for o in made if o.type == "MESH"]
    expect(len(moving) == blocks()["layout"]["patches"], f"every panel moves, not {moving}")
    bpy.context.scene.frame_set(bpy.context.scene.frame_end // 2)
    yield from hands.look_at([bpy.context.object, *made])
    yield from picture("animation")


def render():
    """A small picture, by Cycles: without a graphics card EEVEE needs minutes."""
    pictures = importlib.import_module("bl_ext.user_default.flexmaps.bridge.view.picture")
    studio = pictures.studio
    pictures.studio = lambda *words, **more: studio(*words, engine="CYCLES", **more)
    settings = bpy.context.object.flexmaps.render
    settings.file, settings.pixels_x, settings.samples = str(HERE / "rendered.png"), 160, 1
    there = len(bpy.data.scenes), len(bpy.data.objects)
    yield from press("render")
    expect((HERE / "rendered.png").is_file(), "Render leaves its picture")
    expect(there == (len(bpy.data.scenes), len(bpy.data.objects)), "and nothing else")


def export():
    yield from press("export")
    block = blocks()["sheets"]
    missing = [name for name in block["files"] if not (HERE / "sheets" / name).is_file()]
    expect(not missing, f"all files are there, but {missing}")
    expect(block["panels"] == blocks()["layout"]["patches"], "every patch is a panel")
    yield from picture("exported")
    yield from press("report")
    expect(list((HERE / "sheets").glob("*-report/*.html")), "Report leaves a page beside the sheets")
    from_zip = ("scipy", "shapely", "igl", "ezdxf")
    FOUND["places"] = {name: sys.modules[name].__file__ for name in from_zip if name in sys.modules}


def undo():
    """One step back takes the sheets' figures away, the next ones the optimised spirals."""
    now, steps = blocks()["spirals"], []
    bpy.app.handlers.undo_post.append(lambda *_: steps.append(1))
    for taken in range(1, 7):
        yield from hands.key("ctrl+z")
        yield from until(lambda taken=taken: len(steps) >= taken)
        yield 0.2
        if blocks().get("spirals") != now:
            break
    expect("sheets" not in blocks(), "undo takes the sheets away")
    expect(blocks().get("spirals") not in (None, now), "undo brings the earlier spirals back")
    yield from picture("undone")


def presets():
    """The menu of presets: its first one, chosen with the keyboard."""
    settings = bpy.context.object.flexmaps
    before = settings_of(settings)
    yield from hands.click("popover", "FLEXMAPS_PT_presets")
    yield 0.6
    yield from picture("presets")
    hands.xdotool("key", "Down", "Return")
    yield from until(lambda: settings_of(settings) != before)
    expect(settings_of(settings) != before, "a preset changes the settings")


def settings_of(group):
    """All values of a group of properties, and of the groups in it."""
    values = {}
    for name, prop in group.bl_rna.properties.items():
        if name != "rna_type":
            values[name] = settings_of(getattr(group, name)) if prop.type == "POINTER" else str(getattr(group, name))
    return values


hands.drive(walk(), FOUND)

"""Runs inside a real Blender with its window: installs the zip and walks from a ball of triangles to the sheets, as a person would.

Every button is pressed with the real pointer. What was seen and measured goes to result.json beside this file, the screen
after every stage to a picture.
"""

import importlib
import json
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

warnings.filterwarnings("default", module=r"bl_ext\.")  # all of ours, also of deprecated things
QUADS = 250
STATUS = 26  # rows of the status bar
FOUND = {"stages": {}, "errors": [], "wrong": [], "version": bpy.app.version_string, "python": sys.version.split()[0]}
BEGUN = []  # all jobs, in their order


def expect(holds, sentence):
    if not holds:
        FOUND["wrong"].append(sentence)


def blocks():
    return json.loads(bpy.context.object.data.get("flexmaps_report", "{}"))


def picture(name):
    """The screen, numbered in the order of the walk, once it holds still."""
    if current() is None:
        yield from hands.still(hands.view()[1])
    FOUND["pictures"] = FOUND.get("pictures", 0) + 1
    hands.shot(f"{FOUND['pictures']:02d}-{name}")


def coloured():
    """The share of the 3D view's left half that has a colour, neither grey nor dark."""
    area = hands.view()[1]
    shown = hands.part(area)[:, : area.width // 2, :3].astype(int)
    return float(((np.ptp(shown, axis=2) > 40) & (shown.max(axis=2) > 110)).mean())


def current():
    return hands.module("bridge.job").current()


def last_operator():
    done = bpy.context.window_manager.operators
    return (len(done), done[-1].as_pointer()) if done else None


def count_jobs():
    """Note every job that begins: a quick one that is refused is over before anybody has looked."""
    kind = hands.module("bridge.job").Job
    start = kind.start

    def noted(self):
        BEGUN.append(self)
        start(self)

    kind.start = noted


def press(name, text=None, meanwhile=None):
    """Click the button of an operator, wait until its work is over, and keep what was measured."""
    place = yield from hands.find("operator", f"flexmaps.{name}", text)
    yield from hands.move(place)
    yield 0.3
    bar, before = hands.pixels()[-STATUS:].copy(), (len(BEGUN), last_operator())
    meter = Meter(lambda: not np.array_equal(hands.pixels()[-STATUS:], bar))
    pressed = time.perf_counter()
    hands.xdotool("click", 1)
    while (len(BEGUN), last_operator()) == before and time.perf_counter() - pressed < 5:
        yield 0.02
    if (len(BEGUN), last_operator()) == before:
        raise LookupError(f"a click on {name} does nothing")
    if meanwhile is not None:
        yield from meanwhile()
    while current() is not None:
        yield 0.05
    FOUND["stages"][name] = {"seconds": round(time.perf_counter() - pressed, 2)}
    meter.stop()
    FOUND["stages"][name] |= meter.figures(pressed)
    yield 0.5


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
        stopped,
        simulate,
        optimise,
        export,
        undo,
        preview,
        animate,
        render,
        presets,
        letters,
    ):
        start = time.perf_counter()
        yield from part()
        FOUND.setdefault("seconds", {})[part.__name__] = round(time.perf_counter() - start, 1)


def install():
    yield from hands.installed()
    count_jobs()
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
    expect(bpy.context.object.mode == "OBJECT", "the error goes with the pointer, and Tab leaves edit mode")
    yield from hands.type_in("quads", QUADS)
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
    yield from hands.look_at([obj])
    yield from press("regularise")
    yield from picture("quads")


def layout():
    yield from press("trace")
    expect(any(e.use_seam for e in bpy.context.object.data.edges), "Trace draws seams")
    traced = blocks()["layout"]["patches"]
    yield from picture("traced")
    expect(coloured() > 0.08, f"the patches are seen at once, but {coloured():.1%} of the view has a colour")
    yield from press("overlay", text="Patches")
    yield from hands.still(hands.view()[1])
    expect(coloured() < 0.02, "pressed again, the colours go")
    yield from press("overlay", text="Patches")
    yield from press("merge")
    block = blocks()["layout"]
    expect(block["patches"] < traced, f"Merge joins patches: {traced} to {block['patches']}")
    expect(block["flips"] == block["overlaps"] == 0, "no panel overlaps itself")
    expect("flexmaps_flat" in bpy.context.object.data.uv_layers, "there is a flat UV map")
    yield from press("overlay", text="Distortion")
    yield from picture("merged")


def seams():
    """The way of the guide: edit the seams by hand in edit mode, and let the panels follow."""
    obj = bpy.context.object
    before = blocks()["layout"]["patches"]
    yield from hands.key("Tab")
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
    expect(obj.mode == "OBJECT" and "flexmaps_seam" in obj.data.attributes, "what was written in edit mode is there")
    expect(obj.data.validate() is False, "the mesh is whole")


def spirals():
    yield from press("spirals")
    names = {a.name for a in bpy.context.object.data.attributes}
    expect({"flexmaps_width", "flexmaps_twist"} <= names, f"Spirals writes widths and twists, not {names}")
    expect(blocks()["spirals"]["slot_min_mm"] > 0.2, "slots can be cut")
    yield from press("overlay", text="Twist")
    yield from picture("spirals")


def press_and_stop(name):
    """Press a button, then Esc at once; how long it takes until the sidebar is free again is kept."""
    stopped = []

    def stop():
        yield from hands.aside()
        if current() is not None:
            stopped.append((time.perf_counter(), time.process_time()))
            hands.xdotool("key", "Escape")

    yield from press(name, meanwhile=stop)
    figures = FOUND["stages"].pop(name)
    if stopped:
        wall, own = time.perf_counter() - stopped[0][0], time.process_time() - stopped[0][1]
        FOUND.setdefault("stopped", {})[name] = {"seconds": round(wall, 2), "of the processor": round(own, 2)} | figures


def stopped():
    """Esc in every stage leaves everything as it was, and the next press works."""
    before = blocks()
    for name in ("merge", "spirals", "simulate", "export"):
        yield from press_and_stop(name)
        expect(current() is None, f"{name} ends after Esc")
        expect(blocks().get("layout") == before["layout"], f"{name}, stopped, changes nothing")
        if name != "merge" and "spirals" not in blocks():  # a Merge that was over before Esc takes the old spirals away
            yield from press("spirals")


def letters():
    """A text from its letters to the sheets with Next alone, as somebody does who has read nothing."""
    for obj in list(bpy.data.objects):
        bpy.data.objects.remove(obj)
    bpy.ops.object.text_add()
    bpy.context.object.data.body = "Hi"
    bpy.ops.object.convert(target="MESH")
    bpy.context.object.flexmaps.remesh.quads = 150
    bpy.context.object.flexmaps.optimise.iterations = 3
    bpy.context.object.flexmaps.export.folder = str(HERE / "letters")
    yield from hands.look_at([bpy.context.object])
    states = hands.module("bridge.states")
    pressed = []
    for _ in range(12):
        obj = bpy.context.object
        if obj.mode == "EDIT":
            yield from hands.key("Tab")
        name = states.next_button(obj, bpy.context.scene, states.of(obj, bpy.context.scene)).removeprefix("flexmaps.")
        if not name:
            break
        pressed.append(name)
        yield from press(name, text=hands.NEXT)
    FOUND["next"] = pressed
    expect("sheets" in blocks(), f"Next leads to the sheets: {pressed}")
    yield from picture("letters")


def simulate():
    yield from press("simulate")
    block = blocks()["equilibrium"]
    expect(block["converged"], f"Simulate converges: {block['status']}")
    keys = bpy.context.object.data.shape_keys
    expect(keys is not None and keys.key_blocks[-1].value == 1.0, "the result is a shape key, switched on")
    yield from press("overlay", text="Distance")
    yield from picture("simulated")


def optimise():
    """Stopped in the middle of it: the best so far is kept."""
    before = blocks()["spirals"], blocks()["equilibrium"]["laplacian_rmse_mm"]

    def stop():
        yield from hands.aside()
        while current() is not None and len(getattr(current().shown, "history", ())) < 4:
            yield 0.02
        expect(current() is not None, "Optimise can be stopped before it ends")
        hands.xdotool("key", "Escape")
        FOUND["rmse_on_the_way"] = [1e3 * r for _, r in current().shown.history]
        yield from picture("optimising")

    yield from press("optimise", meanwhile=stop)
    block = blocks()["optimise"]
    FOUND["rmse"] = before[1], block["laplacian_rmse_mm_before"], block["laplacian_rmse_mm"]
    expect(not block["finished"], "Optimise was stopped by Esc")
    expect(block["laplacian_rmse_mm"] < block["laplacian_rmse_mm_before"], f"the best is kept: {FOUND['rmse']}")
    expect(blocks()["spirals"] != before[0], "the spirals are others")
    expect("reach" not in blocks(), "who has stopped it did not wait for the limits of the match")
    yield from press("simulate")
    yield from press("overlay", text="Limits")
    yield from picture("optimised")


def preview():
    yield from hands.unfold("FLEXMAPS_PT_preview")
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
    pictures = importlib.import_module("bl_ext.user_default.flexmaps.bridge.picture")
    studio = pictures.studio
    pictures.studio = lambda *words: studio(*words, engine="CYCLES")
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
    now = blocks()["spirals"]
    for _ in range(6):
        yield from hands.key("ctrl+z")
        yield 0.4
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
    yield 1.0
    expect(settings_of(settings) != before, "a preset changes the settings")


def settings_of(group):
    """All values of a group of properties, and of the groups in it."""
    values = {}
    for name, prop in group.bl_rna.properties.items():
        if name != "rna_type":
            values[name] = settings_of(getattr(group, name)) if prop.type == "POINTER" else str(getattr(group, name))
    return values


hands.drive(walk(), FOUND)

"""Runs inside a real Blender with a window: finds buttons by what they are, and uses the real pointer and keyboard.

A button is found by marking it: the panels draw through ``Spy``, which draws the wanted one red once; what changes on the
screen is its place. So neither fonts, sizes nor the order of the panels matter. Everything here is a generator that yields
the seconds to wait, for Blender must go on drawing meanwhile.
"""

import json
import subprocess
import sys
import time
import traceback
from pathlib import Path

import bpy
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d

HERE = Path(__file__).parent
NEXT = "Next: "  # the button on top of the tab, which repeats another one
WHEEL = 6  # clicks of the wheel between two looks at the sidebar


def view():
    window = bpy.context.window_manager.windows[0]
    return window, next(a for a in window.screen.areas if a.type == "VIEW_3D")


def in_view():
    window, area = view()
    region = next(r for r in area.regions if r.type == "WINDOW")
    return bpy.context.temp_override(window=window, area=area, region=region)


def sidebar():
    return next(r for r in view()[1].regions if r.type == "UI")


# -- the screen ----------------------------------------------------------------------------------------------------------


def pixels():
    """The screen now, (H, W, 4) bytes, first row on top: the virtual screen's own memory, an xwd file."""
    data = np.memmap(HERE / "Xvfb_screen0", np.uint8, "r")
    header = np.frombuffer(data[:100].tobytes(), ">u4")
    width, height, stride, colours = int(header[4]), int(header[5]), int(header[12]), int(header[19])
    start = int(header[0]) + 12 * colours
    return data[start : start + stride * height].reshape(height, stride // 4, 4)[:, :width]


def part(region):
    """What the screen shows of a region (or an area); Blender counts rows from below."""
    shot = pixels()
    top = len(shot) - region.y - region.height
    return shot[top : top + region.height, region.x : region.x + region.width].copy()


def shot(name):
    """Keep the screen as it is; the test makes a picture of it."""
    if not bpy.app.background:
        (HERE / f"{name}.xwd").write_bytes((HERE / "Xvfb_screen0").read_bytes())


# -- pointer and keyboard ------------------------------------------------------------------------------------------------


def still(region):
    """Wait until a region does not change any more, as after a panel that Blender moves into place; its pixels."""
    last = None
    for _ in range(30):
        now = part(region)
        if last is not None and np.array_equal(now, last):
            break
        last = now
        yield 0.1
    return last


def xdotool(*words):
    """Without waiting for its end, for Blender draws meanwhile; but after the one before, so that all comes in order."""
    if _sent:
        _sent.pop().wait()
    _sent.append(subprocess.Popen(["xdotool", *map(str, words)]))


_sent = []


def move(place):
    xdotool("mousemove", *place)
    yield 0.15


def aside():
    """A place in the 3D view that nothing covers, so that no button is lit."""
    area = view()[1]
    yield from move((area.x + area.width // 3, len(pixels()) - area.y - area.height // 4))
    yield 0.3  # what popped up under the pointer goes


def key(*names):
    """Press keys over the 3D view."""
    yield from aside()
    xdotool("key", *names)
    yield 0.3


def installed():
    """Install the zip, empty the scene, let the 3D view fill the window, and open the tab in its sidebar."""
    zip_file = str(next(HERE.glob("*.zip")))
    bpy.ops.extensions.package_install_files(filepath=zip_file, repo="user_default", enable_on_install=True)
    yield 0.5
    for obj in list(bpy.data.objects):
        bpy.data.objects.remove(obj)
    yield from key("ctrl+space")
    yield 0.5
    yield from key("n")
    yield 0.5
    sidebar().active_panel_category = "FlexMaps"
    spy_on([c for c in bpy.types.Panel.__subclasses__() if "flexmaps" in c.__module__])


def look_at(objects):
    """Turn the view to some objects, as View Selected does."""
    active, selected = bpy.context.object, bpy.context.selected_objects
    bpy.ops.object.select_all(action="DESELECT")
    for obj in objects:
        obj.select_set(True)
    with in_view():
        bpy.ops.view3d.view_selected()
    yield 0.2
    bpy.ops.object.select_all(action="DESELECT")
    for obj in selected:
        obj.select_set(True)
    bpy.context.view_layer.objects.active = active


def on_screen(obj):
    """Where an object's vertices are in the view's main region, a pair of pixels each; None behind the eye."""
    area = view()[1]
    region = next(r for r in area.regions if r.type == "WINDOW")
    places = [obj.matrix_world @ vertex.co for vertex in obj.data.vertices]
    return region, [location_3d_to_region_2d(region, area.spaces.active.region_3d, place) for place in places]


def shown_share(obj):
    """Share of the longer side of the view, with its sidebar, that an object takes; 0 if a vertex is outside the view."""
    region, places = on_screen(obj)
    if not all(at is not None and 0 < at.x < region.width and 0 < at.y < region.height for at in places):
        return 0.0
    wide, high = (max(at[k] for at in places) - min(at[k] for at in places) for k in (0, 1))
    return max(wide, high) / max(region.width, region.height)


# -- finding -------------------------------------------------------------------------------------------------------------


class Spy:
    """Stands for a layout: passes everything on, and marks what is looked for."""

    wanted = None  # (method, first words, text) of what is to be red
    drawn = False
    marked = False  # in this drawing: of several buttons that do the same the first one is red

    def __init__(self, layout):
        object.__setattr__(self, "_layout", layout)

    def __setattr__(self, name, value):
        setattr(self._layout, name, value)

    def __getattr__(self, name):
        value = getattr(self._layout, name)
        if not callable(value):
            return value

        def call(*words, **options):
            layout = self._layout
            if Spy.marked or not Spy.fits(name, words, options):
                return _spied(value(*words, **options))
            Spy.drawn, Spy.marked, before = True, True, layout.alert
            if name == "panel_prop":  # what is drawn on it stays red
                header, body = value(*words, **options)
                header.alert = True
                return _spied((header, body))
            layout.alert = not before
            if name in {"popover", "menu"}:  # without a frame to turn red
                options["icon"] = "ERROR"
            try:
                return _spied(value(*words, **options))
            finally:
                layout.alert = before

        return call

    @staticmethod
    def fits(method, words, options):
        if Spy.wanted is None:
            return False
        wanted_method, identifier, text = Spy.wanted
        names = [w for w in words if isinstance(w, str)] + [options.get(k) for k in ("operator", "property", "panel")]
        written = str(options.get("text", ""))
        fits = text is None or written.startswith(text)
        return method == wanted_method and identifier in names and fits


def _spied(value):
    if isinstance(value, bpy.types.UILayout):
        return Spy(value)
    if isinstance(value, tuple):  # a fold: header and body
        return tuple(map(_spied, value))
    return value


class _Self:
    """A panel whose layout is a ``Spy``."""

    def __init__(self, panel):
        self._panel = panel
        self.layout = Spy(panel.layout)

    def __getattr__(self, name):
        return getattr(self._panel, name)


def spy_on(classes):
    """Let panels draw through ``Spy`` from now on."""
    for cls in classes:
        for name in ("draw", "draw_header", "draw_header_preset"):
            if hasattr(cls, name):
                setattr(cls, name, _through_spy(getattr(cls, name), name))


def _through_spy(draw, name):
    def spied(panel, context):
        Spy.marked = False
        draw(_Self(panel), context)

    return spied


def _redrawn(wanted):
    """Draw the sidebar with a button marked, or none; its pixels when they no longer change."""
    Spy.wanted, Spy.drawn = wanted, False
    sidebar().tag_redraw()
    yield 0.1
    shown = yield from still(sidebar())
    Spy.wanted = None
    return shown


def find(method, identifier, text=None):
    """Where a button is on the screen; scrolls the sidebar to it. Raises ``LookupError`` where no panel draws it."""
    wanted, region = (method, identifier, text), sidebar()
    yield from aside()
    for direction in ("up", "down") if text == NEXT else ("down", "up", "down"):
        before = None
        for _ in range(40):
            plain = yield from _redrawn(None)
            if before is not None and np.array_equal(plain, before):
                break  # the end of the sidebar
            marked = yield from _redrawn(wanted)
            if not Spy.drawn:
                raise LookupError(f"no panel draws {wanted}")
            rows, columns = np.nonzero((plain != marked).any(axis=2))
            if len(rows) and rows.min() > 0 and rows.max() < region.height - 1:
                region.tag_redraw()  # without the mark
                x, y = (columns.min() + columns.max()) // 2, (rows.min() + rows.max()) // 2
                return region.x + int(x), int(len(pixels()) - region.y - region.height + y)
            before = plain
            turns, wheel = (WHEEL, 5) if direction == "down" else (60, 4)
            xdotool("mousemove", *_middle(region), "click", "--repeat", turns, "--delay", 5, wheel)
            yield 0.4
            yield from aside()
    raise LookupError(f"{wanted} is nowhere to be seen")


def _middle(region):
    return region.x + region.width // 2, len(pixels()) - region.y - region.height // 2


def click(method, identifier, text=None, times=1):
    """Press a button with the pointer; returns when it was pressed (``time.perf_counter``)."""
    place = yield from find(method, identifier, text)
    yield from move(place)
    pressed = time.perf_counter()
    xdotool("click", "--repeat", times, "--delay", 60, 1)
    return pressed


def type_in(identifier, value):
    """Type a number into a field of the sidebar."""
    yield from click("prop", identifier, times=2)
    yield 0.3
    xdotool("key", "ctrl+a")
    yield 0.2
    xdotool("type", value)
    yield 0.2
    xdotool("key", "Return")
    yield 0.3


def module(name):
    """A module of the installed extension."""
    return sys.modules[f"bl_ext.user_default.flexmaps.{name}"]


# -- running it ----------------------------------------------------------------------------------------------------------


def drive(steps, found):
    """Take the steps, a generator that yields the seconds to wait, beside Blender's own work; then tell and end Blender.

    ``found`` goes to result.json, with the seconds that it took and, in its list of errors, what went wrong.
    """
    start = time.perf_counter()

    def tick():
        try:
            return next(steps)
        except StopIteration:
            pass
        except Exception:
            found["errors"].append(traceback.format_exc())
            shot("error")
        found.setdefault("seconds", {})["all"] = round(time.perf_counter() - start, 1)
        (HERE / "result.json").write_text(json.dumps(found, indent=1))
        bpy.ops.wm.quit_blender()
        return None

    bpy.context.preferences.view.show_splash = False
    bpy.context.preferences.view.smooth_view = 0
    bpy.app.timers.register(tick, first_interval=1.0, persistent=True)

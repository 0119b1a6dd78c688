"""Runs inside a real Blender with a window: presses the buttons of stages, waits for their work, and keeps what was seen.

Nothing here may depend on how quick the machine is: what is waited for is looked for, and work that is to be stopped half
way is held there until it is.
"""

import json
import sys
import time
from pathlib import Path

import bpy
import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))
import hands  # noqa: E402
from meter import Meter  # noqa: E402

STATUS = 26  # rows of the status bar
PATIENCE = 30.0  # seconds after which what was to be seen is missed
FOUND = {
    "stages": {}, "stopped": {}, "errors": [], "wrong": [], "pictures": 0,
    "version": bpy.app.version_string, "python": sys.version.split()[0],
}  # fmt: skip
BEGUN = []  # all jobs, in their order


def expect(holds, sentence):
    if not holds:
        FOUND["wrong"].append(sentence)


def until(holds):
    """Wait until something holds, but not for ever."""
    ends = time.perf_counter() + PATIENCE
    while not holds() and time.perf_counter() < ends:
        yield 0.05


def blocks():
    return json.loads(bpy.context.object.data.get("flexmaps_report", "{}"))


def picture(name):
    """The screen, numbered in the order of the walk, once it holds still."""
    if current() is None:
        yield from hands.still(hands.view()[1])
    FOUND["pictures"] += 1
    hands.shot(f"{FOUND['pictures']:02d}-{name}")


def current():
    return hands.module("bridge.hosts.background").current_job()


def last_operator():
    done = bpy.context.window_manager.operators
    return (len(done), done[-1].as_pointer()) if done else None


class Held:
    """While ``when`` is set, work waits at the first progress report for which it holds of the job, until it is stopped."""

    when = None

    @classmethod
    def wait(cls, running):
        ends = time.perf_counter() + 4 * PATIENCE
        while cls.when is not None and cls.when(running) and not running.is_stopping and time.perf_counter() < ends:
            time.sleep(0.005)


def installed():
    """As ``hands.installed``; jobs are watched, and what is drawn is drawn once instead of eight times for smooth edges."""
    bpy.context.preferences.system.viewport_aa = "OFF"
    yield from hands.installed()
    _watch_jobs()


def _watch_jobs():
    """Note every job that begins, for a quick one that is refused is over before anybody has looked; hold what is to be held."""
    kind = hands.module("bridge.hosts.background").Job
    start, report = kind.start, kind._report

    def noted(self):
        BEGUN.append(self)
        start(self)

    def held(self, fraction, text):
        report(self, fraction, text)
        Held.wait(self)

    kind.start, kind._report = noted, held


# in which section buttons stand; all others stand in menus
BUTTONS = {
    "quad_remesh": "piece", "choose": "layout", "pick_brush": "shape", "live": "shape", "export": "make", "report": "make",
    "preview": "show", "animate": "show", "render": "show",
}  # fmt: skip


def press(name, text=None, meanwhile=None, options=None):
    """Click the button of an operator, wait until its work is over, and keep what was measured; returns it too."""
    if name in BUTTONS:
        setattr(bpy.context.window_manager.flexmaps_tab, f"open_{BUTTONS[name]}", True)
    direct = name in BUTTONS or name == "next"
    wanted = ("operator", f"flexmaps.{name}", text) if direct else ("menu", "FLEXMAPS_MT_next")
    place = yield from hands.find(*wanted)
    yield from hands.move(place)
    yield 0.5  # Next does nothing for a moment after its words have changed
    bar, before = hands.pixels()[-STATUS:].copy(), (len(BEGUN), last_operator())
    meter = Meter(lambda: not np.array_equal(hands.pixels()[-STATUS:], bar))
    pressed = time.perf_counter()
    if direct:
        hands.xdotool("click", 1)
    else:  # in a menu; with a step to undo, as there
        with hands.in_view():
            getattr(bpy.ops.flexmaps, name)("INVOKE_DEFAULT", True, **(options or {}))
    yield from until(lambda: (len(BEGUN), last_operator()) != before)
    if (len(BEGUN), last_operator()) == before:
        raise LookupError(f"a click on {name} does nothing")
    if meanwhile is not None:
        yield from meanwhile()
    while current() is not None:
        yield 0.05
    seconds = round(time.perf_counter() - pressed, 2)
    meter.stop()
    FOUND["stages"][name] = {"seconds": seconds} | meter.figures(pressed)
    yield 0.2
    return FOUND["stages"][name]


def press_and_stop(name, when=lambda running: running.fraction > 0.0, seen=None):
    """Press a button, then Esc once ``when`` holds of its job; how long it takes until the sidebar is free is kept.

    seen : what is to be done just before Esc, while the work goes on
    """
    figures = {}

    def stop():
        yield from hands.aside()
        while current() is not None and not when(current()):
            yield 0.02
        expect(current() is not None, f"{name} tells how far it is before it ends")
        if current() is not None and seen is not None:
            yield from seen()
        wall, own = time.perf_counter(), time.process_time()
        hands.xdotool("key", "Escape")
        while current() is not None:
            yield 0.02
        own = time.process_time() - own
        figures.update({"seconds": round(time.perf_counter() - wall, 2), "of the processor": round(own, 2)})
        Held.when = None

    Held.when, earlier = when, FOUND["stages"].get(name)
    measured = yield from press(name, meanwhile=stop)
    FOUND["stopped"][name] = measured | figures
    FOUND["stages"].pop(name)
    if earlier is not None:
        FOUND["stages"][name] = earlier

"""Measures the extension inside Blender against what was asked: every Blender there is, how soon things are seen, random calls.

python3 tools/dev.py bench blender [--calls 1000] [--seconds 1500] [--json FILE] [--only survey zips progress panels preview frames next random]

The random calls go on where an interrupted run of the same sources stopped (out/random_calls.json).
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from rows import Row, Table, at_most, row

ROOT = Path(__file__).resolve().parent.parent
TOOLS = ROOT / "tools"
SESSION, BATCH = 20, 5  # calls a file, files a process: a crash of Blender costs one process
WINDOW = ROOT / "out" / "window" / "figures.json"  # left by the window test


def main(arguments: list[str]) -> int:
    """Measure, print the table, write the rows; 0 whatever was measured."""
    parser = argparse.ArgumentParser(prog="dev.py bench blender")
    parser.add_argument("--calls", type=int, default=1000, help="random operator calls")
    parser.add_argument("--seconds", type=float, default=1500.0, help="longest time for the random calls")
    parser.add_argument("--json", type=Path, help="write the rows here too")
    parser.add_argument("--only", nargs="*", choices=[*PARTS], default=[*PARTS])
    options = parser.parse_args(arguments)
    table = Table(44)
    for name in options.only:
        for one in PARTS[name](options):
            table.add(one)
    table.finish(options.json, keep=len(options.only) < len(PARTS))
    return 0


# -- every Blender ---------------------------------------------------------------------------------------------------------


def survey(_: argparse.Namespace) -> Iterator[Row]:
    """Every operator and panel in this Blender, in the other one's environment, and in a real one that is there."""
    yield from _told(_run_survey(sys.executable))
    other = _other_python()
    if other is None:
        yield row("other Blender", "survey", "", "no other environment", None)
    else:
        yield from _told(_run_survey(other))
    yield from _real_blender()


def _run_survey(python: str) -> dict[str, Any]:
    """The third run's answer: the first makes Python's bytecode, and the second warms the disk."""
    for _ in range(3):
        done = subprocess.run(
            [python, str(TOOLS / "blender_survey.py")], capture_output=True, text=True, timeout=300, cwd=ROOT
        )
    return _answer(done.stdout + done.stderr)


def _answer(console: str) -> dict[str, Any]:
    lines = [line for line in console.splitlines() if line.startswith("SURVEY")]
    if not lines:
        return {"blender": "?", "errors": [console[-300:]]}
    found: dict[str, Any] = json.loads(lines[-1].removeprefix("SURVEY"))
    found["complaints"] = len(re.findall(r"Traceback|Warning:.*(?:register|FLEXMAPS)", console))
    return found


def _told(found: dict[str, Any]) -> Iterator[Row]:
    name = f"Blender {found['blender'].split()[0]}"
    for error in found["errors"]:
        print(error, file=sys.stderr)
    yield at_most(name, "errors of operators and panels", 0, len(found["errors"]))
    if "operators" not in found:
        return
    yield row(name, "operators, panels", "", f"{found['operators']}, {found['panels']}", None)
    yield at_most(name, "operators without a tooltip", 0, len(found["undescribed"]))
    peer = {
        "of the processor": found["enable_cpu_s"],
        "modules": found["modules"],
        "heavy ones": " ".join(found["heavy"]) or "none",
    }
    yield at_most(name, "enable, s", 0.3, found["enable_s"], peer)
    yield at_most(name, "heavy modules imported but numpy", 0, len(set(found["heavy"]) - {"numpy"}))
    yield at_most(name, "classes left after disabling", 0, len(found["left"]))


def _other_python() -> str | None:
    named = os.environ.get("FLEXMAPS_OTHER_PYTHON")
    version = "3.13" if sys.version_info[:2] == (3, 11) else "3.11"
    inside = ("Scripts", "python.exe") if os.name == "nt" else ("bin", "python")
    path = Path(named) if named else ROOT.joinpath(f".venv-{version}", *inside)
    return str(path) if path.is_file() else None


def _real_blender() -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        reason = _ready(work)
        if reason is not None:
            yield row("real Blender", "survey", "", reason[:60], None)
            return
        import real_blender

        for _ in range(3):  # the first installs, the second makes Python's bytecode
            done = real_blender.run(TOOLS / "blender_survey.py", work, window=False, timeout=240)
    yield from _told(_answer(done.stdout + done.stderr))


def _ready(work: Path) -> str | None:
    """Put the zip of the real Blender into a folder; why there is none, as a sentence."""
    import real_blender

    if not (real_blender.folder() / "usr" / "bin" / "blender").exists():
        return "none made yet (test window)"
    zips = sorted((ROOT / "dist").glob("*debian*.zip"), key=lambda p: p.stat().st_mtime)
    reason = real_blender.obstacle() or (None if zips else "no zip for it; run test window")
    if reason is None:
        shutil.copy2(zips[-1], work)
    return reason


# -- zips --------------------------------------------------------------------------------------------------------------------


def zips(_: argparse.Namespace) -> Iterator[Row]:
    """Sizes of the zips that were built."""
    found = sorted((ROOT / "dist").glob("*.zip"))
    if not found:
        yield row("zip", "MB", "<= 90", "none built (dev.py build)", None)
    for path in found:
        name = path.stem.removeprefix("flexmaps-").partition("-")[2]
        yield at_most("zip", name, 90, path.stat().st_size / 1e6)


# -- how soon something is seen ------------------------------------------------------------------------------------------------


def progress(_: argparse.Namespace) -> Iterator[Row]:
    """Seconds from a button to its first visible progress: of real clicks, and of the work before the first redraw here."""
    if WINDOW.is_file():
        for name, figures in json.loads(WINDOW.read_text())["stages"].items():
            first = figures.get("first_progress_ms")
            if first is not None:
                yield at_most("real window", f"{name}: click to progress, s", 0.2, 1e-3 * first)
    obj = _piece()
    from flexmaps.operators import layout, optimise, regularise, simulate, spirals

    stages = (regularise.Regularise, layout.Trace, layout.Merge, layout.Flatten)
    for cls in (*stages, spirals.Spirals, simulate.Simulate, optimise.Optimise):
        import bpy

        if cls is spirals.Spirals:
            bpy.ops.flexmaps.flatten()
        if cls is simulate.Simulate:
            bpy.ops.flexmaps.spirals()
        yield at_most(
            f"{len(obj.data.polygons)} quads", f"{cls.bl_label}: button to progress, s", 0.2, _first_sight(cls)
        )


def _first_sight(cls: type) -> float:
    """Seconds from ``invoke`` to the job that the sidebar shows, as with a window."""
    import bpy
    from flexmaps.bridge.hosts import background
    from flexmaps.operators import stage

    body = {
        k: v for base in reversed(cls.__mro__) if issubclass(base, stage.StageOperator) for k, v in vars(base).items()
    }
    plain = type(cls.__name__, (), {k: v for k, v in body.items() if k not in {"__dict__", "__weakref__"}})
    manager = SimpleNamespace(windows=[], event_timer_add=lambda *_, **__: 0, modal_handler_add=lambda *_: None)
    for name in ("event_timer_remove", "progress_begin", "progress_update", "progress_end"):
        setattr(manager, name, lambda *_: None)
    context = SimpleNamespace(
        window_manager=manager, window=None, workspace=None, object=bpy.context.object, scene=bpy.context.scene
    )
    kept, stage.bpy = stage.bpy, SimpleNamespace(app=SimpleNamespace(background=False), ops=bpy.ops, types=bpy.types)
    operator = plain()
    operator.report = lambda kind, text: print(text)
    started = time.perf_counter()
    try:
        operator.invoke(context, None)
        return time.perf_counter() - started
    finally:
        stage.bpy = kept
        background.stop_current()


def _piece() -> Any:
    """A saddle of 2401 quads in a new file, the active object."""
    import bpy

    _enable()
    from flexmaps.engine.surface import shapes

    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    mesh = shapes.saddle(49)
    data = bpy.data.meshes.new("piece")
    data.from_pydata((mesh.vertices * (0.02 / mesh.median_edge)).tolist(), [], mesh.quads.tolist())
    obj = bpy.data.objects.new("piece", data)
    bpy.context.scene.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    bpy.context.view_layer.update()
    return obj


def _enable() -> None:
    import bpy
    import dev

    if not hasattr(bpy.types.Object, "flexmaps"):
        dev.load_package().register()


# -- panels ----------------------------------------------------------------------------------------------------------------------


def panels(_: argparse.Namespace) -> Iterator[Row]:
    """Milliseconds of the processor that the sidebar's own code takes to draw with everything done on 2400 quads."""
    import bpy
    from random_calls import Nothing

    obj = _piece()
    for button in ("check", "flatten", "spirals", "simulate"):
        getattr(bpy.ops.flexmaps, button)()
    from flexmaps import panels
    from flexmaps.bridge.store import states

    def drawing(panel: Any) -> Callable[[], None]:
        shown = SimpleNamespace(layout=Nothing(), stage=getattr(panel, "stage", ""))

        def draw() -> None:
            if hasattr(panel, "draw_header"):
                panel.draw_header(shown, bpy.context)
            panel.draw(shown, bpy.context)

        return draw

    mesh = f"{len(obj.data.polygons)} quads"
    total = 0.0
    for panel in panels.CLASSES:
        if panel.bl_region_type == "UI":
            spent = _milliseconds(drawing(panel))
            total += spent
            yield at_most(mesh, f"{panel.bl_label}: one redraw, ms", 5.0, spent)
    yield at_most(mesh, "the whole sidebar: one redraw, ms", 10.0, total)
    yield row(
        mesh, "of it the states of all stages, ms", "", _milliseconds(lambda: states.of(obj, bpy.context.scene)), None
    )


def _milliseconds(call: Callable[[], Any], times: int = 40) -> float:
    call()
    started = time.process_time()
    for _ in range(times):
        call()
    return float(f"{1e3 * (time.process_time() - started) / times:.3g}")


# -- preview ---------------------------------------------------------------------------------------------------------------------


def preview(_: argparse.Namespace) -> Iterator[Row]:
    """Seconds to build the assembled preview of 2400 spirals, in every detail."""
    import bpy

    _enable()
    if not hasattr(bpy.types, "FLEXMAPS_OT_preview"):
        yield row("2400 spirals", "preview", "", "there is no preview", None)
        return
    obj = _piece()
    bpy.ops.flexmaps.flatten()
    bpy.ops.flexmaps.spirals()
    bpy.ops.flexmaps.simulate()
    for item in obj.flexmaps.preview.bl_rna.properties["detail"].enum_items:
        obj.flexmaps.preview.detail = item.identifier
        started, work = time.perf_counter(), time.process_time()
        bpy.ops.flexmaps.preview()
        spent, worked = time.perf_counter() - started, time.process_time() - work
        limit = 2.0 if item.identifier in {"COARSE", "LINES"} else None
        peer = {"by the clock": round(spent, 2)}  # which other programs on the machine prolong
        yield at_most("2400 spirals", f"preview, {item.name}: s of the processor", limit, worked, peer)


# -- frames ----------------------------------------------------------------------------------------------------------------------

# Mesa's driver that draws nothing: what is left of a frame is Blender's own work, as beside an endlessly fast graphics card
NOTHING_DRAWN = "GALLIUM_NOOP=1"
FPS = 20.0


def frames(_: argparse.Namespace) -> Iterator[Row]:
    """Milliseconds a frame of the 3D view takes in a real window while it turns, with the preview of 2401 spirals in it.

    Without a graphics card only Blender's own part can be held against the wanted 20 frames a second; beside it stand the
    triangles that a card would have to draw then, and what drawing them by software takes here.
    """
    found = []
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        reason = _ready(work)
        for variables in () if reason else ("", NOTHING_DRAWN):
            import real_blender

            for old in ("display", "result.json"):
                (work / old).unlink(missing_ok=True)
            script = ROOT / "tests" / "window" / "frames.py"
            done = real_blender.run(script, work, window=True, timeout=500, variables=variables)
            if not (work / "result.json").is_file():
                reason = f"no answer: {(done.stdout + done.stderr)[-200:]}"
                break
            found.append(json.loads((work / "result.json").read_text()))
            print("\n".join(found[-1]["errors"]), file=sys.stderr)
    if reason is not None or len(found) < 2:
        yield row("2401 spirals", "frames", "", str(reason)[:60], None)
        return
    software, own = (one["frames"] for one in found)
    for name, drawn in software.items():
        peer = {"by software": f"{1e3 / drawn['frame_ms']:.2g} fps"}
        if "triangles" in drawn:
            peer["triangles"] = drawn["triangles"]
            peer[f"at {FPS:g} fps"] = f"{1e-6 * FPS * drawn['triangles']:.0f} million triangles/s"
        label = f"frame of the 3D view, {name.lower()}: own ms"
        yield at_most("2401 spirals", label, 1e3 / FPS, own[name]["frame_ms"], peer)


# -- Next ------------------------------------------------------------------------------------------------------------------------

MODELS = ("suzanne", "text", "cylinder", "bunny")
BUNNY = ROOT.parent / "shared" / "meshes" / "stanford-bunny.obj"


def next_button(_: argparse.Namespace) -> Iterator[Row]:
    """Models by *Next* alone to their sheets in a real window, with the default settings; pictures in out/next/."""
    import real_blender

    pictures = ROOT / "out" / "next"
    shutil.rmtree(pictures, ignore_errors=True)
    pictures.mkdir(parents=True)
    for name in MODELS:
        if name == "bunny" and not BUNNY.is_file():
            yield row(name, "sheets by Next", "yes", f"{BUNNY} is not there", None)
            continue
        with tempfile.TemporaryDirectory() as folder:
            work = Path(folder)
            reason = _ready(work)
            if reason is not None:
                yield row(name, "sheets by Next", "yes", reason[:60], None)
                return
            (work / "models.json").write_text(json.dumps({name: {}}))
            if name == "bunny":
                shutil.copyfile(BUNNY, work / "bunny.obj")
            real_blender.run(ROOT / "tests" / "window" / "models.py", work, window=True, timeout=3000)
            for shot in sorted(work.glob("*.xwd")):
                real_blender.picture(shot, pictures / f"{shot.stem}.png")
            answer = work / "result.json"
            found = json.loads(answer.read_text()) if answer.is_file() else {"errors": ["no answer"]}
        yield from _by_next(name, found)


def _by_next(name: str, found: dict[str, Any]) -> Iterator[Row]:
    """What came of one model: whether it has sheets, how well the piece keeps its shape, and the seconds of its stages."""
    for wrong in (*found["errors"], *found.get("wrong", ())):
        print(wrong, file=sys.stderr)
    model = found.get("models", {}).get(name, {"blocks": {}, "seconds": {}})
    blocks = model["blocks"]
    yield row(
        name, "sheets by Next", "yes", "yes" if "sheets" in blocks else "no", "sheets" in blocks, model["seconds"]
    )
    if "sheets" in blocks:
        yield row(name, "quads, patches", "", f"{blocks['spirals']['count']}, {blocks['layout']['patches']}", None)
        shape, searched = blocks["equilibrium"], blocks["optimise"]
        rmse = f"{searched['laplacian_rmse_mm_before']:.3g} -> {searched['laplacian_rmse_mm']:.3g}"
        peer = {"RMS": f"{shape['rms_percent']:.2g} %", "strain": f"{100 * shape.get('strain_share_max', 0.0):.0f} %"}
        yield row(name, "RMSE, mm", "", rmse, None, peer)


# -- random calls ----------------------------------------------------------------------------------------------------------------


def random(options: argparse.Namespace) -> Iterator[Row]:
    """So many random calls, in processes of their own; an interrupted run is gone on with."""
    kept = ROOT / "out" / "random_calls.json"
    kept.parent.mkdir(exist_ok=True)
    sources = _sources()
    done: dict[str, Any] = json.loads(kept.read_text()) if kept.is_file() else {}
    if done.get("sources") != sources:
        done = {"sources": sources, "batches": {}}
    batches, ends = done["batches"], time.monotonic() + options.seconds
    for batch in range(-(-options.calls // (SESSION * BATCH))):
        if str(batch) not in batches and time.monotonic() < ends:
            batches[str(batch)] = _batch(batch)
            kept.write_text(json.dumps(done))
    outcomes: Counter = Counter()
    for one in batches.values():
        outcomes.update(one["outcomes"])
    for fault in [fault for one in batches.values() for fault in one["faults"]]:
        print(fault, file=sys.stderr)
    calls = sum(outcomes.values())
    yield row(
        "random meshes", "random calls", f">= {options.calls}", calls, calls >= options.calls, {"": dict(outcomes)}
    )
    yield at_most("random meshes", "crashes of Blender", 0, sum(one["crashed"] for one in batches.values()))
    yield at_most(
        "random meshes", "tracebacks, meshes not valid, panels", 0, sum(len(one["faults"]) for one in batches.values())
    )


BATCH_SCRIPT = """
import json, os, random, sys, tempfile
from pathlib import Path
sys.path.insert(0, sys.argv[1])
import dev
dev.load_package().register()
import random_calls
log = random_calls.Log()
with tempfile.TemporaryDirectory() as folder:
    for seed in range(int(sys.argv[2]), int(sys.argv[3])):
        print("SEED", seed, flush=True)
        random_calls.session(random.Random(seed), int(sys.argv[4]), Path(folder), log)
outcomes = {}
for (_, outcome), count in log.outcomes.items():
    outcomes[outcome] = outcomes.get(outcome, 0) + count
print("BATCH", json.dumps({"outcomes": outcomes, "faults": log.faults, "crashed": 0}), flush=True)
os._exit(0)
"""


def _batch(batch: int) -> dict[str, Any]:
    seeds = batch * BATCH, (batch + 1) * BATCH
    command = [sys.executable, "-c", BATCH_SCRIPT, str(TOOLS), *map(str, seeds), str(SESSION)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=900)
        console, status = done.stdout + done.stderr, str(done.returncode)
    except subprocess.TimeoutExpired as expired:
        console, status = str(expired.stdout), "no answer in 900 s"
    lines = [line for line in console.splitlines() if line.startswith("BATCH")]
    if lines:
        found: dict[str, Any] = json.loads(lines[-1].removeprefix("BATCH"))
        return found
    return {"outcomes": {}, "faults": [f"ended with {status}: {console[-1500:]}"], "crashed": 1}


def _sources() -> str:
    """A text that changes with whatever the calls depend on."""
    found = hashlib.sha256(sys.version.encode())
    for folder in ("engine", "bridge", "operators", "panels", "tools/random_calls.py"):
        path = ROOT / folder
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            found.update(file.read_bytes())
    return found.hexdigest()[:16]


PARTS: dict[str, Callable[[argparse.Namespace], Iterator[Row]]] = {
    "survey": survey,
    "zips": zips,
    "progress": progress,
    "panels": panels,
    "preview": preview,
    "frames": frames,
    "next": next_button,
    "random": random,
}

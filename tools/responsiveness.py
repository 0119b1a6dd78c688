"""Parts of ``bench blender`` on responsiveness: sidebar, preview, frames, and whole runs by *Next*."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from harness import Row, at_most, note, row

if TYPE_CHECKING:
    from flexmaps.engine.surface.mesh import QuadMesh

ROOT = Path(__file__).resolve().parent.parent
# Mesa's driver that draws nothing: what is left of a frame is Blender's own work, as beside an endlessly fast graphics card
NOTHING_DRAWN = "GALLIUM_NOOP=1"
FPS = 20.0  # frames a second that are wanted
MODELS = ("suzanne", "text", "cylinder", "bunny")
BUNNY = ROOT.parent / "shared" / "meshes" / "stanford-bunny.obj"


def saddle() -> Any:
    """A saddle of 2401 quads in a new file, the active object."""
    from flexmaps.engine.surface import shapes

    return piece(shapes.saddle(49))


def piece(mesh: QuadMesh) -> Any:
    """A mesh in a new file, quads of 20 mm, the active object."""
    import bpy

    _enable()
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
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


def panels(_: argparse.Namespace) -> Iterator[Row]:
    """Milliseconds of the processor that the sidebar's own code takes to draw with everything done on 2400 quads."""
    import bpy
    from random_calls import Nothing

    obj = saddle()
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
        if getattr(panel, "bl_region_type", "") == "UI":  # no menu
            spent = _milliseconds(drawing(panel))
            total += spent
            yield at_most(mesh, f"{panel.bl_label}: one redraw, ms", 5.0, spent)
    yield at_most(mesh, "the whole sidebar: one redraw, ms", 10.0, total)
    yield note(
        mesh, "of it the states of all stages, ms", _milliseconds(lambda: states.read_states(obj, bpy.context.scene))
    )


def _milliseconds(call: Callable[[], Any], times: int = 40) -> float:
    call()
    started = time.process_time()
    for _ in range(times):
        call()
    return float(f"{1e3 * (time.process_time() - started) / times:.3g}")


def preview(_: argparse.Namespace) -> Iterator[Row]:
    """Seconds to build the assembled preview of 2400 spirals, in every detail."""
    import bpy

    _enable()
    if not hasattr(bpy.types, "FLEXMAPS_OT_preview"):
        yield note("2400 spirals", "preview", "there is no preview")
        return
    obj = saddle()
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


def frames(_: argparse.Namespace) -> Iterator[Row]:
    """Milliseconds a frame of the 3D view takes in a real window while it turns, with the preview of 2401 spirals in it.

    Without a graphics card only Blender's own part can be held against the wanted 20 frames a second; beside it stand the
    triangles that a card would have to draw then, and what drawing them by software takes here.
    """
    found = []
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        reason = place_zip(work)
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
        yield note("2401 spirals", "frames", str(reason)[:60])
        return
    software, own = (one["frames"] for one in found)
    for name, drawn in software.items():
        peer = {"by software": f"{1e3 / drawn['frame_ms']:.2g} fps"}
        if "triangles" in drawn:
            peer["triangles"] = drawn["triangles"]
            peer[f"at {FPS:g} fps"] = f"{1e-6 * FPS * drawn['triangles']:.0f} million triangles/s"
        label = f"frame of the 3D view, {name.lower()}: own ms"
        yield at_most("2401 spirals", label, 1e3 / FPS, own[name]["frame_ms"], peer)


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
            reason = place_zip(work)
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
    """Return the result of one model: whether it has sheets, its match, and the seconds of its stages."""
    for wrong in (*found["errors"], *found.get("wrong", ())):
        print(wrong, file=sys.stderr)
    model = found.get("models", {}).get(name, {"blocks": {}, "seconds": {}})
    blocks = model["blocks"]
    yield row(
        name, "sheets by Next", "yes", "yes" if "sheets" in blocks else "no", "sheets" in blocks, model["seconds"]
    )
    if "sheets" in blocks:
        yield note(name, "quads, patches", f"{blocks['spirals']['count']}, {blocks['layout']['patches']}")
        shape, searched = blocks["equilibrium"], blocks["optimise"]
        rmse = f"{searched['laplacian_rmse_mm_before']:.3g} -> {searched['laplacian_rmse_mm']:.3g}"
        peer = {"RMS": f"{shape['rms_percent']:.2g} %", "strain": f"{100 * shape.get('strain_share_max', 0.0):.0f} %"}
        yield note(name, "RMSE, mm", rmse, peer)


def place_zip(work: Path) -> str | None:
    """Put the zip of the real Blender into a folder; why there is none, as a sentence."""
    import real_blender

    if not (real_blender.folder() / "usr" / "bin" / "blender").exists():
        return "none made yet (test window)"
    zips = sorted((ROOT / "dist").glob("*debian*.zip"), key=lambda p: p.stat().st_mtime)
    reason = real_blender.obstacle() or (None if zips else "no zip for it; run test window")
    if reason is None:
        shutil.copy2(zips[-1], work)
    return reason

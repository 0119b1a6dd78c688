"""Random operator calls in random order, with random settings, on random small meshes, and a check for faults after each.

Used by tests/blender/test_random.py for a few calls and by ``bench blender`` for a thousand. After every call: no traceback,
no temporary thing left, every mesh valid, every panel can be drawn.
"""

from __future__ import annotations

import contextlib
import io
import math
import random
import time
from collections import Counter
from dataclasses import dataclass, field, fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
from flexmaps.bridge.hosts import background
from flexmaps.bridge.store import next_button, states, stored_report
from flexmaps.engine.errors import Cancelled
from flexmaps.engine.params import SHOWN, ObjectSettings
from flexmaps.engine.progress import Progress
from flexmaps.engine.surface import shapes

PRESETS = sorted((Path(__file__).resolve().parent.parent / "presets" / "flexmaps").glob("*.py"))
PATIENCE = 6.0  # seconds after which a stage is stopped, as with ESC
# settings whose upper end only means waiting, or a folder on the disk: their ranges here
TAMED: dict[str, tuple[float, float] | None] = {
    "remesh.quads": (50, 400),
    "sheet.nesting_seconds": (0, 0.5),
    "simulate.iterations": (1, 200),
    "simulate.restarts": (0, 2),
    "optimise.iterations": (1, 4),
    "regularise.iterations": (0, 60),
    "export.folder": None,
    "render.file": None,
    "render.pixels_x": (16, 64),
    "render.pixels_y": (0, 48),
    "render.samples": (1, 2),
    "film.seconds": (1, 1.5),
}
STEPS = (
    "check",
    "regularise",
    "trace",
    "merge",
    "flatten",
    "update_from_seams",
    "spirals",
    "simulate",
    "optimise",
    "export",
)


@dataclass
class Log:
    """Record of calls and their results."""

    outcomes: Counter = field(default_factory=Counter)  # (operator, outcome) -> times
    faults: list[str] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)  # of the session that runs, to be played again by hand

    @property
    def calls(self) -> int:
        return sum(self.outcomes.values())


def session(rng: random.Random, calls: int, folder: Path, log: Log) -> None:
    """Make a random mesh in an empty file and call random functions on it; faults go to ``log.faults``."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    log.lines = []
    _start(rng, log)
    for _ in range(calls):
        obj = bpy.context.object
        if obj is not None and obj.type == "MESH":
            _modest(rng, obj, folder)
            for _ in range(rng.choice((0, 0, 1, 3))):
                _setting(rng, obj, log)
            if rng.random() < 0.3:
                _meddle(rng, obj, log)
        name = _choose(rng)
        outcome = _call(rng, name, log)
        log.outcomes[name, outcome] += 1
        for fault in _faults():
            log.faults.append(f"{fault}\n    after " + "; ".join(log.lines))


def _modest(rng: random.Random, obj: Any, folder: Path) -> None:
    """Files go to the folder, and pictures are small."""
    bpy.context.scene.render.fps = 4
    given = obj.flexmaps
    given.export.folder = str(folder)
    given.render.file = str(folder / rng.choice(("picture.png", "film.mp4", "no ending", "picture.jpg")))
    given.render.pixels_x, given.render.samples = min(given.render.pixels_x, 64), min(given.render.samples, 2)
    given.film.seconds = min(given.film.seconds, 1.5)


# -- what is called ------------------------------------------------------------------------------------------------------


def operators() -> list[str]:
    """All that there are, but for the one that stores presets among the user's own."""
    return [name for name in dir(bpy.ops.flexmaps) if name != "preset"]


def _choose(rng: random.Random) -> str:
    """Half of the calls take the next step, or else most would only be refused."""
    obj = bpy.context.object
    if obj is not None and obj.type == "MESH" and rng.random() < 0.5:
        offered = next_button.next_idname(obj, bpy.context.scene, states.read_states(obj, bpy.context.scene))
        if offered.startswith("flexmaps."):
            return offered.removeprefix("flexmaps.")
    if rng.random() < 0.3:
        return rng.choice(STEPS)
    return rng.choice(operators())


def _call(rng: random.Random, name: str, log: Log) -> str:
    """Call an operator with random options; returns what came of it."""
    operator = getattr(bpy.ops.flexmaps, name)
    options = _options(rng, operator)
    log.lines.append(f"bpy.ops.flexmaps.{name}({', '.join(f'{k}={v!r}' for k, v in options.items())})")
    began = time.monotonic()
    kept, background.run_blocking = background.run_blocking, _impatient(began)
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            result = operator(**options)
    except RuntimeError as error:
        text = str(error)
        if "poll()" in text:
            return "greyed"
        if "Traceback" in text or not text.strip().startswith("Error:"):
            log.faults.append(f"{text.strip()}\n    after " + "; ".join(log.lines))
            return "fault"
        return "refused"
    finally:
        background.run_blocking = kept
    return "stopped" if result == {"CANCELLED"} else "done"


def _impatient(began: float) -> Any:
    """``background.run_blocking`` with somebody who presses ESC."""

    def run_here(title: str, work: Any) -> Any:
        return work(Progress(lambda fraction, text: None, lambda: time.monotonic() - began > PATIENCE))

    return run_here


def _options(rng: random.Random, operator: Any) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for prop in operator.get_rna_type().properties:
        if prop.identifier in {"rna_type", "browse"} or rng.random() < 0.2:  # no web browsers are opened
            continue
        if prop.type == "ENUM":
            found[prop.identifier] = rng.choice([item.identifier for item in prop.enum_items])
        elif prop.type == "BOOLEAN":
            found[prop.identifier] = rng.random() < 0.5
        elif prop.type == "INT":
            found[prop.identifier] = rng.choice((max(prop.hard_min, 0), 1, 5, min(prop.hard_max, 1000)))
        elif prop.identifier == "filepath":
            found[prop.identifier] = str(rng.choice([*PRESETS, Path("nowhere.py")]))
        elif prop.type == "FLOAT":
            value = rng.choice((prop.soft_min, prop.soft_max, prop.default))
            found[prop.identifier] = [value] * prop.array_length if prop.is_array else value
    return found


# -- settings --------------------------------------------------------------------------------------------------------------


def _setting(rng: random.Random, obj: Any, log: Log) -> None:
    """Give one setting a value of its range, often one of its ends."""
    block = rng.choice(fields(ObjectSettings))
    f = rng.choice(fields(block.default_factory))  # type: ignore[arg-type]
    name = f"{block.name}.{f.name}"
    if name in TAMED and TAMED[name] is None:
        return
    value = _value(rng, obj, f, TAMED.get(name))
    setattr(getattr(obj.flexmaps, block.name), f.name, value)
    log.lines.append(f"o.flexmaps.{name} = {value!r}")


def _value(rng: random.Random, obj: Any, f: Any, tamed: tuple[float, float] | None) -> Any:
    meta, default = f.metadata, f.default
    if meta["choices"]:
        return rng.choice([choice[0] for choice in meta["choices"]])
    if isinstance(default, bool):
        return rng.random() < 0.5
    if isinstance(default, str):
        return rng.choice(["", "nothing of that name", *(group.name for group in obj.vertex_groups)])
    factor = SHOWN[meta["unit"]][0]
    low, high = meta["low"], meta["high"]
    low, high = (-5.0 if low is None else low) * factor, (5.0 if high is None else high) * factor
    if tamed is not None:
        low, high = tamed
    usual = min(max(default * factor, low), high)
    value = rng.choice([low, high, usual, rng.uniform(low, high), usual * math.exp(rng.uniform(-1, 1))])
    value = min(max(value, low), high)
    return int(value) if isinstance(default, int) else value


# -- meshes ----------------------------------------------------------------------------------------------------------------


def _start(rng: random.Random, log: Log) -> None:
    vertices, faces, name = _mesh(rng)
    vertices = np.asarray(vertices, float) * rng.choice((1.0, 1.0, 1.0, 1e-3, 100.0))
    mesh = bpy.data.meshes.new("piece")
    mesh.from_pydata(vertices.tolist(), [], [list(map(int, face)) for face in faces])
    mesh.validate()
    obj = bpy.data.objects.new(rng.choice(("piece", "a/b: *?", "Stück", "x" * 60)), mesh)
    bpy.context.scene.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    obj.scale = rng.choice(((1, 1, 1), (1, 1, 1), (-1, 1, 1), (1, 2, 0.5), (0, 1, 1)))
    bpy.context.scene.unit_settings.scale_length = rng.choice((1.0, 1.0, 0.001, 0.3048))
    group = obj.vertex_groups.new(name="held")
    group.add(list(range(min(4, len(mesh.vertices)))), 1.0, "ADD")
    bpy.context.view_layer.update()
    log.lines.append(f"{name}, scale {tuple(obj.scale)}, unit {bpy.context.scene.unit_settings.scale_length:g}")


def _mesh(rng: random.Random) -> tuple[Any, Any, str]:
    """Vertices and faces of a small mesh, mostly a good one, and what it is."""
    kind = rng.choice(
        ("dome", "dome", "cube", "torus", "strip", "two", "quad", "spoilt", "spoilt", "triangles", "none")
    )
    if kind == "none":
        return [], [], kind
    if kind in {"dome", "spoilt"}:
        mesh = shapes.dome(rng.choice((2, 3, 4)))
    elif kind == "torus":
        mesh = shapes.torus(rng.choice((8, 12)), rng.choice((4, 6)))
    elif kind == "strip":
        mesh = shapes.strip(rng.choice((6, 14)), rng.choice((1, 2)))
    else:
        mesh = {
            "cube": shapes.cubesphere(rng.choice((1, 2, 3))),
            "two": shapes.two_bodies(),
            "quad": shapes.quad(),
        }.get(kind, shapes.dome(3))
    vertices, faces = mesh.vertices * (0.02 / mesh.median_edge), mesh.quads.tolist()
    if kind == "triangles":
        faces = [f for q in faces for f in (q[:3], [q[0], q[2], q[3]])]
    if kind == "spoilt":
        vertices, faces = _spoil(rng, vertices, faces)
    return vertices, faces, f"{kind} of {len(faces)}"


def _spoil(rng: random.Random, vertices: np.ndarray, faces: list[list[int]]) -> tuple[np.ndarray, list[list[int]]]:
    """One or two of the faults that meshes have."""
    vertices, faces = vertices.copy(), [list(face) for face in faces]
    for _ in range(rng.choice((1, 2))):
        k = rng.randrange(len(faces))
        fault = rng.choice(("hole", "flip", "triangle", "pinch", "fold", "flat", "rough", "far"))
        if fault == "hole":
            del faces[k]
        elif fault == "flip":
            faces[k].reverse()
        elif fault == "triangle":
            faces[k] = faces[k][:3]
        elif fault == "pinch":
            vertices[faces[k][0]] = vertices[faces[k][1]]
        elif fault == "fold":
            vertices[faces[k][0]] = 2 * vertices[faces[k][2]] - vertices[faces[k][0]]
        elif fault == "flat":
            vertices[:, 2] = 0.0
        elif fault == "rough":
            vertices += np.random.default_rng(rng.randrange(2**31)).normal(0, 0.003, vertices.shape)
        else:
            vertices += 1e4
    return vertices, faces


def _meddle(rng: random.Random, obj: Any, log: Log) -> None:
    """Change something as a user may between two buttons."""
    what = rng.choice(("mode", "seams", "vertex", "undo", "redo", "twin", "scale", "key", "modifier", "rename", "lose"))
    log.lines.append(what)
    if what == "mode":
        bpy.ops.object.mode_set(mode="OBJECT" if obj.mode == "EDIT" else "EDIT")
    elif what == "undo":
        bpy.ops.ed.undo_push(message="random")
        with contextlib.suppress(RuntimeError):
            bpy.ops.ed.undo()
    elif what == "redo":
        with contextlib.suppress(RuntimeError):
            bpy.ops.ed.redo()
    elif what == "rename":
        obj.name = rng.choice(("piece", "other", "..", "%20"))
    elif what == "scale":
        obj.scale = [s * rng.choice((0.5, 1.0, 2.0)) for s in obj.scale]
    elif obj.mode == "OBJECT":
        _meddle_in_object_mode(rng, obj, what)
    bpy.context.view_layer.update()


def _meddle_in_object_mode(rng: random.Random, obj: Any, what: str) -> None:
    mesh = obj.data
    if what == "seams" and len(mesh.edges):
        for _ in range(rng.choice((1, 8))):
            edge = mesh.edges[rng.randrange(len(mesh.edges))]
            edge.use_seam = not edge.use_seam
    elif what == "vertex" and len(mesh.vertices):
        mesh.vertices[rng.randrange(len(mesh.vertices))].co.z += rng.uniform(-0.02, 0.02)
    elif what == "twin":
        twin = obj.copy()
        bpy.context.scene.collection.objects.link(twin)
        bpy.context.view_layer.objects.active = rng.choice((obj, twin))
    elif what == "key" and rng.random() < 0.5:
        obj.shape_key_add(name="mine")
    elif what == "modifier" and rng.random() < 0.5:
        obj.modifiers.new("mine", "SUBSURF").levels = 1
        if rng.random() < 0.7:
            bpy.ops.object.convert(target="MESH")
    elif what == "lose" and rng.random() < 0.3:
        bpy.data.objects.remove(obj)


# -- what must never be ------------------------------------------------------------------------------------------------------


def _faults() -> list[str]:
    found = []
    if background.current_job() is not None:
        found.append("a job is left running")
    if (
        sum(not scene.name.startswith("Lamp shade") for scene in bpy.data.scenes) > 1
    ):  # the tutorial adds one of its own
        found.append("the scene of a picture is left")
    for obj in bpy.data.objects:
        if obj.type == "MESH" and obj.mode == "EDIT":
            obj.update_from_editmode()
    for mesh in bpy.data.meshes:
        if mesh.name.startswith(".flexmaps"):
            found.append(f"the temporary mesh {mesh.name} is left")
        if not mesh.is_editmode and mesh.validate(verbose=False):
            found.append(f"the mesh {mesh.name} was not valid")
        found += [f"{mesh.name}: {name} is not finite" for name in _not_finite(mesh)]
        if "flexmaps_fresh" in mesh:
            found.append("a stage wrote notes without a stamp")
        if stored_report.is_damaged(mesh):
            found.append(f"the notes on {mesh.name} are not sound")
    return found + undrawn()


def _not_finite(mesh: Any) -> list[str]:
    """Attributes of ours with values that a newer Blender calls not valid."""
    found = []
    for attribute in mesh.attributes:
        if attribute.name.startswith("flexmaps") and attribute.data_type == "FLOAT" and not mesh.is_editmode:
            values = np.empty(len(attribute.data), np.float32)
            attribute.data.foreach_get("value", values)
            if not np.isfinite(values).all():
                found.append(attribute.name)
    return found


def undrawn() -> list[str]:
    """Panels that cannot be drawn."""
    from flexmaps import panels
    from flexmaps.bridge.store.objects import usage_problem

    found = []
    for panel in panels.CLASSES:
        if getattr(panel, "bl_region_type", "") not in {"UI", "HEADER"} or "draw" not in vars(panel):
            continue
        if panel.bl_region_type == "HEADER" and usage_problem(bpy.context.object) is not None:
            continue  # popovers stand in sections, which need a mesh
        try:
            panel.draw(SimpleNamespace(layout=Nothing(), bl_ui_units_x=15), bpy.context)
        except Exception as error:  # whatever it is, it is a fault
            found.append(f"{panel.bl_idname} cannot be drawn: {type(error).__name__}: {error}")
    return found


class Nothing:
    """Stands for a layout and takes whatever is drawn."""

    def __getattr__(self, name: str) -> Any:
        if name == "panel_prop":  # every section is open
            return lambda *_, **__: (Nothing(), Nothing())
        return lambda *_, **__: Nothing()


__all__ = ["Cancelled", "Log", "Nothing", "operators", "session", "undrawn"]

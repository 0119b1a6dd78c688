"""Benchmark for newcomers: objects made with Blender, from the object to its sheets by *Next* alone, with the default settings.

``findings_apart.py`` finds faults that no finding mentions. ``--thorough`` takes all objects, with 500 quads and with 1,500.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from typing import Any

import bpy
import flexmaps
import numpy as np
from findings_apart import unreported_faults
from flexmaps import api
from harness import Bench, Cases, Options, Row, Rows, at_least, at_most, note, temporary_folder

USUAL, MANY, FEW = 500, 1500, 100  # quads: the default, the former default, and few enough for rows that take seconds
LARGER = 2.0  # largest factor by which *Next* offers to enlarge a piece
PRESSES, SECONDS, RMS = 14, 60.0, 1.0  # required: most presses, most processor seconds, largest RMS distance in percent
SHEETS, FAR, LEFT, YEARS = "sheets", "RMS, %", "warnings left", "times larger to last for years"  # names of rows
Add = Callable[[], Any]  # adds an object to the file


def _primitive(name: str, **options: Any) -> Add:
    return lambda: getattr(bpy.ops.mesh, f"primitive_{name}_add")(**options)


def _then(add: Add, *changes: Callable[[bpy.types.Object], Any]) -> Add:
    """Add an object and change it."""

    def made() -> None:
        add()
        for change in changes:
            change(bpy.context.object)

    return made


def _set(owner: Any, values: dict[str, Any]) -> None:
    for name, value in values.items():
        setattr(owner, name, value)


def _convert(add: Add, **settings: Any) -> Add:
    """Add an object that is no mesh, with settings of its data, and make it one."""
    return _then(add, lambda obj: _set(obj.data, settings), lambda _: bpy.ops.object.convert(target="MESH"))


def _modify(kind: str, add: Add, **settings: Any) -> Add:
    """Add an object with a modifier."""
    return _then(add, lambda obj: _set(obj.modifiers.new(kind, kind), settings))


def _raise_hill(obj: bpy.types.Object) -> None:
    for vertex in obj.data.vertices:
        vertex.co.z = 0.5 * max(0.0, 1.0 - vertex.co.x**2 - vertex.co.y**2)


def _narrow_top(obj: bpy.types.Object) -> None:
    for vertex in obj.data.vertices:
        if vertex.co.z > 0:
            vertex.co.x, vertex.co.y = 0.5 * vertex.co.x, 0.5 * vertex.co.y


def _cut_back(obj: bpy.types.Object) -> None:
    import bmesh  # found once Blender is there

    bm = bmesh.new()
    bm.from_mesh(obj.data)
    bmesh.ops.delete(bm, geom=[face for face in bm.faces if face.calc_center_median().y > 0], context="FACES")
    bm.to_mesh(obj.data)


def _turn_faces(obj: bpy.types.Object) -> None:
    for polygon in list(obj.data.polygons)[:200:3]:
        polygon.flip()


def _cut_out(cutter: bpy.types.Object) -> None:
    _modify("BOOLEAN", _primitive("uv_sphere", radius=1.2), object=cutter)()
    cutter.hide_set(True)


MONKEY = _primitive("monkey")
QUICK = ("plane", "grid", "cube", "text", "hill")  # together under a minute
# objects that beginners may start with, by name
OBJECTS: dict[str, Add] = {
    "plane": _primitive("plane"),
    "grid": _primitive("grid"),
    "cube": _primitive("cube"),
    "circle": _primitive("circle", fill_type="NGON"),
    "text": _convert(bpy.ops.object.text_add, body="Hi"),
    "hill": _then(_primitive("grid", x_subdivisions=20, y_subdivisions=20), _raise_hill),
    "uv sphere": _primitive("uv_sphere"),
    "ico sphere": _primitive("ico_sphere"),
    "torus": _primitive("torus"),
    "cone": _primitive("cone"),
    "cylinder": _primitive("cylinder"),
    "lamp": _then(_primitive("cylinder", vertices=32, end_fill_type="NOTHING"), _narrow_top),
    "mask": _then(MONKEY, _cut_back),
    "monkey": MONKEY,
    "nurbs sphere": _convert(bpy.ops.surface.primitive_nurbs_surface_sphere_add),
    "nurbs torus": _convert(bpy.ops.surface.primitive_nurbs_surface_torus_add),
    "nurbs patch": _convert(bpy.ops.surface.primitive_nurbs_surface_surface_add),
    "curve": _convert(bpy.ops.curve.primitive_bezier_circle_add, bevel_depth=0.3),
    "metaball": _convert(lambda: bpy.ops.object.metaball_add(type="ELLIPSOID")),
    "boolean": _then(_primitive("cube"), _cut_out),
    "subdivided monkey": _modify("SUBSURF", MONKEY),
    "thick monkey": _modify("SOLIDIFY", MONKEY, thickness=0.1),
    "remeshed monkey": _modify("REMESH", MONKEY),
    "decimated monkey": _modify("DECIMATE", MONKEY, ratio=0.5),
    "subdivided cube": _modify("SUBSURF", _primitive("cube"), levels=3),
    "turned faces": _then(_primitive("uv_sphere"), _turn_faces),
    "shared mesh": _then(_primitive("torus"), lambda _: bpy.ops.object.duplicate(linked=True)),
}


def cases(options: Options) -> Cases:
    flexmaps.register()
    counts = [options.quads] if options.quads else [USUAL, MANY] if options.thorough else [FEW]
    pairs = {f"{name} {quads}": (add, quads) for name, add in OBJECTS.items() for quads in counts}
    return {name: partial(measure, name, add, quads) for name, (add, quads) in pairs.items()}


def measure(name: str, add: Add, quads: int, _: Options) -> Rows:
    """Take one object to its sheets and return its rows."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    add()
    source = bpy.context.object
    source.flexmaps.remesh.quads = quads
    with temporary_folder() as folder:
        source.flexmaps.export.folder = str(folder)
        presses = list(api.presses(source, most=PRESSES))
    findings, figures = presses[-1]["findings"], presses[-1]["figures"]
    left = [finding for finding in findings if finding["kind"] != "information"]
    without_cure = [finding["words"] for finding in left if not finding["cures"]]
    missed = unreported_faults(bpy.context.object, source, presses[-1])
    how = {key: [press[key] for press in presses if press[key]] for key in ("pressed", "error")}
    yield at_least(name, SHEETS, 1, figures["sheets"] or 0, {"quads": figures["quads"], **how})
    yield at_most(name, "processor seconds", SECONDS, sum(press["seconds"] for press in presses))
    if figures["rms_percent"] is not None:
        yield at_most(name, FAR, RMS, figures["rms_percent"])
    if figures["sheets"]:  # an object that ends before has not been spared its warnings
        yield note(name, LEFT, len(left), {"left": [finding["words"] for finding in left]})
    yield at_most(name, "warnings without a cure", 0, len(without_cure), {"words": without_cure})
    yield at_most(name, "told by no finding", 0, len(missed), {"faults": missed})
    for finding in findings:
        if finding["key"] == "equilibrium/years":
            told = re.search(r"([\d.e+]+) times larger|lasts for years too", finding["text"])
            assert told is not None, finding["text"]
            yield note(name, YEARS, float(told[1] or 1.0))


def sum_up(rows: list[Row], _: Options) -> Rows:
    """Return totals over all objects; the required numbers are for a run of 25 objects."""

    def count(name: str, limit: float) -> int:
        return sum(one["measured"] <= limit for one in rows if one["row"] == name)

    lasting = f"{count(YEARS, 1.0)}, {count(YEARS, LARGER)} when up to {LARGER:g} times as large"
    return [
        note("all", "no warning at all (asked: 18 of 25)", count(LEFT, 0)),
        note("all", f"RMS over {RMS:g} % (asked: 3 of 25)", count(FAR, np.inf) - count(FAR, RMS)),
        note("all", "last for years (asked: 18 then)", lasting),
    ]


main = Bench(
    "first", cases, summary=sum_up, quick=QUICK, must=SHEETS, quads=(0, "so many instead"),
)  # fmt: skip

"""Benchmark for newcomers: objects made with Blender, from the object to its sheets by *Next* alone, with the default settings.

python3 tools/dev.py bench first [--thorough] [--only PATTERNS] [--quads N] [--cure] [--json FILE]

Faults that no finding mentions are found by independent checks (``findings_apart.py``). By default it takes a few objects with few quads;
``--thorough`` takes all objects with the default number of quads and with 1,500.
"""

from __future__ import annotations

import re
import tempfile
import time
from collections.abc import Callable, Iterator
from typing import Any

import bpy
import flexmaps
import numpy as np
from findings_apart import unsaid
from flexmaps import api
from harness import Bench
from rows import Row, at_least, at_most, note

USUAL, MANY, FEW = 500, 1500, 100  # quads: the default, the former default, and few enough for rows that take seconds
LARGER = 2.0  # largest factor by which *Next* offers to enlarge a piece
PRESSES, SECONDS, RMS = 14, 60.0, 1.0  # required: most presses, most processor seconds, largest RMS distance in percent
SHEETS, FAR, LEFT, YEARS = "sheets", "RMS, %", "warnings left", "times larger to last for years"  # names of rows


def _primitive(name: str, **options: Any) -> Callable[[], None]:
    return lambda: getattr(bpy.ops.mesh, f"primitive_{name}_add")(**options)


def _convert(add: Callable[[], Any]) -> Callable[[], None]:
    def made() -> None:
        add()
        bpy.ops.object.convert(target="MESH")

    return made


def _modify(kind: str, base: str = "monkey", **settings: Any) -> Callable[[], None]:
    def made() -> None:
        _primitive(base)()
        modifier = bpy.context.object.modifiers.new(kind, kind)
        for name, value in settings.items():
            setattr(modifier, name, value)

    return made


def _text() -> None:
    bpy.ops.object.text_add()
    bpy.context.object.data.body = "Hi"
    bpy.ops.object.convert(target="MESH")


def _curve() -> None:
    bpy.ops.curve.primitive_bezier_circle_add()
    bpy.context.object.data.bevel_depth = 0.3
    bpy.ops.object.convert(target="MESH")


def _hill() -> None:
    _primitive("grid", x_subdivisions=20, y_subdivisions=20)()
    for vertex in bpy.context.object.data.vertices:
        vertex.co.z = 0.5 * max(0.0, 1.0 - vertex.co.x**2 - vertex.co.y**2)


def _lamp() -> None:
    _primitive("cylinder", vertices=32, end_fill_type="NOTHING")()
    for vertex in bpy.context.object.data.vertices:
        if vertex.co.z > 0:
            vertex.co.x, vertex.co.y = 0.5 * vertex.co.x, 0.5 * vertex.co.y


def _mask() -> None:
    _primitive("monkey")()
    mesh = bpy.context.object.data
    import bmesh

    bm = bmesh.new()
    bm.from_mesh(mesh)
    bmesh.ops.delete(bm, geom=[face for face in bm.faces if face.calc_center_median().y > 0], context="FACES")
    bm.to_mesh(mesh)
    bm.free()


def _turn_faces() -> None:
    _primitive("uv_sphere")()
    for polygon in list(bpy.context.object.data.polygons)[:200:3]:
        polygon.flip()


def _share_mesh() -> None:
    _primitive("torus")()
    bpy.ops.object.duplicate(linked=True)


def _boolean() -> None:
    _primitive("cube")()
    cutter = bpy.context.object
    _primitive("uv_sphere", radius=1.2)()
    modifier = bpy.context.object.modifiers.new("cut", "BOOLEAN")
    modifier.object = cutter
    cutter.hide_set(True)


QUICK = ("plane", "grid", "cube", "text", "hill")  # together under a minute
# objects that beginners may start with, by name
OBJECTS: dict[str, Callable[[], None]] = {
    "plane": _primitive("plane"),
    "grid": _primitive("grid"),
    "cube": _primitive("cube"),
    "circle": _primitive("circle", fill_type="NGON"),
    "text": _text,
    "hill": _hill,
    "uv sphere": _primitive("uv_sphere"),
    "ico sphere": _primitive("ico_sphere"),
    "torus": _primitive("torus"),
    "cone": _primitive("cone"),
    "cylinder": _primitive("cylinder"),
    "lamp": _lamp,
    "mask": _mask,
    "monkey": _primitive("monkey"),
    "nurbs sphere": _convert(bpy.ops.surface.primitive_nurbs_surface_sphere_add),
    "nurbs torus": _convert(bpy.ops.surface.primitive_nurbs_surface_torus_add),
    "nurbs patch": _convert(bpy.ops.surface.primitive_nurbs_surface_surface_add),
    "curve": _curve,
    "metaball": _convert(lambda: bpy.ops.object.metaball_add(type="ELLIPSOID")),
    "boolean": _boolean,
    "subdivided monkey": _modify("SUBSURF"),
    "thick monkey": _modify("SOLIDIFY", thickness=0.1),
    "remeshed monkey": _modify("REMESH"),
    "decimated monkey": _modify("DECIMATE", ratio=0.5),
    "subdivided cube": _modify("SUBSURF", "cube", levels=3),
    "turned faces": _turn_faces,
    "shared mesh": _share_mesh,
}


def main(arguments: list[str]) -> int:
    """Take every object to its sheets, print the table and write the rows; return 1 if one has failed."""
    bench = Bench(
        "first", arguments, 36, only="",
        thorough=(False, "all objects, at the default count and at 1,500 quads"), quads=(0, "so many instead"),
        cure=(False, "press the first cure once before files are written"),
    )  # fmt: skip
    options = bench.options
    options.only = options.only or ("*" if options.thorough else ",".join(QUICK))
    counts = [options.quads] if options.quads else [USUAL, MANY] if options.thorough else [FEW]
    flexmaps.register()
    for name, add in bench.cases(OBJECTS.items()):
        for quads in counts:
            bench.measure(rows_of_object, f"{name} {quads}", add, quads, options.cure)
    rows = bench.table.rows
    bench.finish(*sum_up(rows))
    return int(any(one["row"] == SHEETS and not one["ok"] for one in rows))


def rows_of_object(name: str, add: Callable[[], None], quads: int, cure: bool) -> Iterator[Row]:
    """Take one object to its sheets and return its rows."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    add()
    source = bpy.context.object
    source.flexmaps.remesh.quads = quads
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        source.flexmaps.export.folder = folder
        presses = list(api.presses(source, cures=int(cure), most=PRESSES))
    last = presses[-1]
    findings, figures = last["findings"], last["figures"]
    left = [finding for finding in findings if finding["kind"] != "information"]
    without_cure = [finding["words"] for finding in left if not finding["cures"]]
    missed = unsaid(bpy.context.object, source, last)
    yield at_least(name, SHEETS, 1, figures["sheets"] or 0, {"status": last["status"]["text"]})
    yield note(name, "quads", figures["quads"])
    errors = {"errors": [press["error"] for press in presses if press["error"]]}
    yield note(name, "presses", len(presses), {"pressed": [press["pressed"] for press in presses]} | errors)
    wall = {"wall": round(time.perf_counter() - began, 1)}
    yield at_most(name, "processor seconds", SECONDS, sum(press["seconds"] for press in presses), wall)
    if figures["rms_percent"] is not None:
        yield note(name, "strain, share of the limit", figures["strain_share"])
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


def sum_up(rows: list[Row]) -> Iterator[Row]:
    """Yield totals over all objects; the required numbers are for a run of 25 objects."""

    def count(name: str, limit: float) -> int:
        return sum(one["measured"] <= limit for one in rows if one["row"] == name)

    yield note("all", "objects", count(SHEETS, np.inf))
    yield note("all", "no warning at all (asked: 18 of 25)", count(LEFT, 0))
    yield note("all", f"RMS over {RMS:g} % (asked: 3 of 25)", count(FAR, np.inf) - count(FAR, RMS))
    lasting = f"{count(YEARS, 1.0)}, {count(YEARS, LARGER)} when up to {LARGER:g} times as large"
    yield note("all", "last for years (asked: 18 then)", lasting)

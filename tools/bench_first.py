"""Benchmark for newcomers: objects made with Blender, from the object to its sheets by *Next* alone, with the default settings.

python3 tools/dev.py bench first [--thorough] [--only NAME ...] [--quads N] [--cure] [--json FILE]

A row per object: presses, processor seconds with child processes, wall seconds, sheets, spirals, RMS, strain, number of open
findings, findings without a cure, and faults found by independent checks that no finding mentions. By default it takes a few objects
with few quads; ``--thorough`` takes all objects with the default number of quads and with 1,500.
"""

from __future__ import annotations

import argparse
import json
import re
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import flexmaps
from findings_apart import unsaid
from flexmaps import api

USUAL, MANY, FEW = 500, 1500, 100  # quads: the default, the former default, and few enough for rows that take seconds
LARGER = 2.0  # largest factor by which *Next* offers to enlarge a piece
PRESSES, SECONDS, RMS = 14, 60.0, 1.0  # required: most presses, most processor seconds, largest RMS distance in percent


def _primitive(name: str, **options: Any) -> Callable[[], None]:
    return lambda: getattr(bpy.ops.mesh, f"primitive_{name}_add")(**options)


def _converted(add: Callable[[], Any]) -> Callable[[], None]:
    def made() -> None:
        add()
        bpy.ops.object.convert(target="MESH")

    return made


def _modified(kind: str, base: str = "monkey", **settings: Any) -> Callable[[], None]:
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


def _turned() -> None:
    _primitive("uv_sphere")()
    for polygon in list(bpy.context.object.data.polygons)[:200:3]:
        polygon.flip()


def _shared() -> None:
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
    "nurbs sphere": _converted(bpy.ops.surface.primitive_nurbs_surface_sphere_add),
    "nurbs torus": _converted(bpy.ops.surface.primitive_nurbs_surface_torus_add),
    "nurbs patch": _converted(bpy.ops.surface.primitive_nurbs_surface_surface_add),
    "curve": _curve,
    "metaball": _converted(lambda: bpy.ops.object.metaball_add(type="ELLIPSOID")),
    "boolean": _boolean,
    "subdivided monkey": _modified("SUBSURF"),
    "thick monkey": _modified("SOLIDIFY", thickness=0.1),
    "remeshed monkey": _modified("REMESH"),
    "decimated monkey": _modified("DECIMATE", ratio=0.5),
    "subdivided cube": _modified("SUBSURF", "cube", levels=3),
    "turned faces": _turned,
    "shared mesh": _shared,
}


def main(arguments: list[str]) -> int:
    """Take every object to its sheets and print a row for each; return 1 if one has failed."""
    parser = argparse.ArgumentParser(prog="dev.py bench first")
    parser.add_argument("--thorough", action="store_true", help="all objects, at the default count and at 1,500 quads")
    parser.add_argument("--only", nargs="+", choices=OBJECTS, help="these alone")
    parser.add_argument("--quads", type=int, help="so many instead")
    parser.add_argument("--cure", action="store_true", help="press the first cure once before files are written")
    parser.add_argument("--json", type=Path, help="write the rows here too")
    options = parser.parse_args(arguments)
    flexmaps.register()
    names = options.only or (OBJECTS if options.thorough else QUICK)
    counts = [options.quads] if options.quads else [USUAL, MANY] if options.thorough else [FEW]
    rows = []
    for name in names:
        for quads in counts:
            rows.append(taken(name, quads, options.cure))
            print(_line(rows[-1]), flush=True)
            if options.json:
                options.json.write_text(json.dumps(rows, indent=1))
    _summary(rows)
    return int(any(row["sheets"] is None for row in rows))


def taken(name: str, quads: int, cure: bool) -> dict[str, Any]:
    """Take one object to its sheets and return its row."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    OBJECTS[name]()
    obj = bpy.context.object
    source = obj
    obj.flexmaps.remesh.quads = quads
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        obj.flexmaps.export.folder = folder
        presses = list(api.presses(obj, cures=int(cure), most=PRESSES))
    last = presses[-1]
    open_ones = [finding for finding in last["findings"] if finding["kind"] != "information"]
    return {
        "object": name,
        "quads": last["figures"]["quads"],
        "presses": len(presses),
        "pressed": [press["pressed"] for press in presses],
        "errors": [press["error"] for press in presses if press["error"]],
        "seconds": round(sum(press["seconds"] for press in presses), 1),
        "wall": round(time.perf_counter() - began, 1),
        **{key: last["figures"][key] for key in ("sheets", "rms_percent", "strain_share")},
        "left": [finding["words"] for finding in open_ones],
        "without_cure": [finding["words"] for finding in open_ones if not finding["cures"]],
        "unsaid": unsaid(bpy.context.object, source, last),
        "larger_for_years": _larger_for_years(last["findings"]),
        "status": last["status"]["text"],
    }


def _larger_for_years(findings: list[dict[str, Any]]) -> float | None:
    """Return the factor by which a piece must be enlarged to last for years, from its finding; None without such a finding."""
    for finding in findings:
        if finding["key"] == "equilibrium/years":
            told = re.search(r"([\d.e+]+) times larger|lasts for years too", finding["text"])
            assert told is not None, finding["text"]
            return float(told[1] or 1.0)
    return None


def _line(row: dict[str, Any]) -> str:
    rms, strain = row["rms_percent"], row["strain_share"]
    shape = "flat" if rms is None else f"RMS {rms:.2f} %, strain {100 * (strain or 0):.0f} %"
    left = f"; left: {', '.join(row['left'])}" if row["left"] else ""
    left += f"; UNSAID: {', '.join(row['unsaid'])}" if row["unsaid"] else ""
    sheets = f"{row['sheets']} sheets" if row["sheets"] else f"STUCK ({row['status']})"
    return f"{row['object']:>18} {row['quads']:5d} quads {row['presses']:2d} presses {row['seconds']:6.1f} s ({row['wall']:.0f} s wall)  {sheets}, {shape}{left}"


def _summary(rows: list[dict[str, Any]]) -> None:
    """Print a summary beside the required values, which hold for 25 objects."""
    there = [row for row in rows if row["sheets"]]
    near = sum(row["rms_percent"] is None or row["rms_percent"] <= RMS for row in there)
    print(f"to sheets {len(there)} of {len(rows)} (asked: all)")
    print(f"no warning at all on {sum(not row['left'] for row in there)} (asked: 18 of 25)")
    print(f"a warning without a cure on {sum(bool(row['without_cure']) for row in rows)} (asked: 0)")
    print(f"something that is told by no finding on {sum(bool(row['unsaid']) for row in rows)} (asked: 0)")
    print(f"RMS <= {RMS:g} % on {near} (asked: 22 of 25)")
    curved = [row["larger_for_years"] for row in there if row["larger_for_years"] is not None]
    lasting = [sum(times <= most for times in curved) for most in (1.0, LARGER)]
    print(
        f"lasts for years: {lasting[0]} of {len(curved)} as they are, {lasting[1]} when up to {LARGER:g} times as large (asked for that default: 18)"
    )
    print(f"over {SECONDS:g} s of processor: {sum(row['seconds'] > SECONDS for row in rows)} (asked: 0)")

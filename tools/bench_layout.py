"""Benchmark of tracing, merging and flattening, beside required values and beside libigl and Blender on the same patches.

python3 tools/dev.py bench layout [--meshes DIR] [--json FILE]
python3 tools/dev.py bench layout --match FILE [--only PATTERNS] [--layouts N] [--patience TIMES] [--meshes DIR]

``--match`` compares the predicted match of layouts with the match that the optimiser reaches. Results of searches are stored in FILE
and not computed again; predictions always are.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import layout_matches
import numpy as np
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.params import LayoutParams, RegulariseParams
from flexmaps.engine.patches.flattening import edit, flatten, outline
from flexmaps.engine.patches.flattening.flatten import FlatPatches
from flexmaps.engine.patches.flattening.flattening_report import layout_report
from flexmaps.engine.patches.flattening.triangles import corner_triangles, quad_energy
from flexmaps.engine.patches.merging import merge
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.progress import SILENT
from flexmaps.engine.surface.checking import check
from flexmaps.engine.surface.mesh import PolygonMesh
from flexmaps.engine.surface.remeshing import regularise
from harness import EDGE, Bench, surfaces
from rows import Row, at_most, row

# largest number of patches, by mesh
PATCHES = {"cubesphere": 1, "three_holes": 11, "bunny": 10, "vault": 2, "spot": 25}
SECONDS = {"bunny": 4.0, "spot": 8.0}  # largest time for tracing and merging; 2 s for other meshes
REPORTED = {"flower_cmc1", "amo_quad"}
SYMMETRIC = {"vault", "torus", "cubesphere"}


def main(arguments: list[str]) -> int:
    """Measure every mesh of a folder and the self-made ones, print the table and write the rows; return 0 whatever the figures."""
    bench = Bench(
        "layout", arguments, only="*", meshes=True,
        match=(Path, "compare predicted matches with those of searches, kept in this file"),
        layouts=(4, "of every surface, for --match"), patience=(0.6, "times the usual search, for --match"),
    )  # fmt: skip
    options = bench.options
    asked = bench.cases(surfaces(options.meshes))
    if options.match is not None:
        layout_matches.compare(dict(asked), options.match, options.layouts, options.patience)
        return 0
    for name, polygons in asked:
        bench.measure(measure, name, polygons)
    bunny = None if options.meshes is None else str(options.meshes / "bunny.obj")
    for name, source, memory in (("made:demo", "shape:demo", None), ("bunny", bunny, 1500)):
        if source is not None and bench.asked(name) and (memory is None or Path(source).is_file()):
            bench.table.add(*whole_job(name, source, memory))
    return bench.finish()


def measure(name: str, polygons: PolygonMesh) -> list[Row]:
    """Return all rows of one mesh."""
    params = LayoutParams()
    polygons = check.scaled(polygons, edge=EDGE)
    mesh = regularise.regularise(check.as_quad_mesh(polygons), RegulariseParams())
    mesh = mesh.moved(mesh.vertices * (EDGE / mesh.median_edge))
    started = time.process_time()
    layout = trace.trace(mesh, params)
    flat = merge.merge(layout, params)
    seconds = time.process_time() - started
    report = layout_report(flat)
    kind = name.removeprefix("made:")
    strict = kind not in REPORTED
    small = report["smallest_patch"] >= min(params.patch_min, len(mesh.quads)) or "forced" in report
    rows = [
        row(name, "quads", "", len(mesh.quads), None),
        at_most(name, "patches", PATCHES.get(name), report["patches"]),
        at_most(name, "seconds", SECONDS.get(kind, 2.0), round(seconds, 2)),
        at_most(name, "energy_max", 0.035 if strict else None, report["energy_max"], peers(flat)),
        row(name, "square_median", "", report["square_median"], None),
        at_most(name, "compactness_max", 5.0, report["compactness_max"]),
        row(name, "disks", "all", "all" if report["disks"] else "not all", report["disks"]),
        at_most(name, "flips", 0, report["flips"]),
        at_most(name, "overlaps", 0, report["overlaps"], {"shapely": _overlap(flat)}),
        row(
            name,
            "neck_min_quads",
            ">= 2",
            report["neck_min_quads"],
            report["neck_min_quads"] >= 2 or "forced" in report,
        ),
        row(name, "isthmus_min", "", round(_isthmus(flat), 3), None),
        row(name, "smallest_patch", ">= 6", report["smallest_patch"], small),
        at_most(name, "seam_mismatch_median", 0.03 if strict else None, report["seam_mismatch_median"]),
        at_most(name, "seam_mismatch_max", 0.15 if strict else None, report["seam_mismatch_max"]),
        row(name, "cut_edges", "", report["cut_edges"], None),
    ]
    if "symmetry" in report or kind in SYMMETRIC:
        kept = f"{report.get('symmetries_kept', 1)} of {report.get('symmetries', 1)}"
        rows.append(row(name, "symmetries", "kept or said", kept, "symmetry" in report or None))
    for text in report.get("forced", []):
        rows.append(row(name, "forced", "", text, None))
    if len(flat.layout.patches) > 1:
        limit = 100.0 if kind == "bunny" else None
        rows.append(at_most(name, "edit_ms_worst", limit, round(1e3 * _worst_edit(flat, params), 1)))
    return rows


def whole_job(name: str, source: str, memory: float | None) -> list[Row]:
    """Run the main job in a separate process; return wall seconds and peak megabytes, with Blender file and pictures."""
    tool = Path(__file__).with_name("dev.py")
    with tempfile.TemporaryDirectory() as folder:
        started = time.monotonic()
        command = [sys.executable, str(tool), "run", source, "--edge", str(EDGE * 1e3), "--out", folder]
        subprocess.run(command, check=True, capture_output=True)
        seconds = time.monotonic() - started
        report = json.loads((Path(folder) / "report.json").read_text())
    return [
        at_most(name, "whole job, seconds", 120.0, round(seconds, 1)),
        at_most(name, "whole job, megabytes", memory, report["memory_mb"]),
    ]


def _worst_edit(flat: FlatPatches, params: LayoutParams) -> float:
    """Return the seconds of the slowest manual edit: opening each seam, and cutting each patch through its middle."""
    worst = 0.0
    layout = flat.layout
    runs = [(False, seam) for seam in layout.seams]
    runs += [(True, trace.middle_line(layout, n)) for n in range(len(layout.patches))]
    for closed, edges in runs:
        cut = layout.cut.copy()
        cut[edges] = closed
        started = time.process_time()
        try:
            edit.with_cuts(flat, cut, params)
        except FlexMapsError:
            continue  # refused: the patch would be a ring
        worst = max(worst, time.process_time() - started)
    return worst


def _overlap(flat: FlatPatches) -> float:
    """Return the largest overlap of a patch with itself, as a share of its area, by shapely's union of its quads."""
    import shapely

    worst = 0.0
    for quads in flat.layout.patches:
        polygons = shapely.polygons(flat.corners[quads])
        total = shapely.area(polygons).sum()
        # snap to a millionth of an edge, since unions of quads with common sides would leave slivers
        union = shapely.union_all(polygons, grid_size=1e-6 * flat.layout.mesh.median_edge)
        worst = max(worst, 1.0 - float(union.area) / float(total))
    return round(worst, 7)


def _isthmus(flat: FlatPatches) -> float:
    points = flat.points[:, 0] + 1j * flat.points[:, 1]
    return min(outline.isthmus_width(points[loop]) for loop in flat.outlines)


# -- others on the same patches --------------------------------------------------------------------------------------


def peers(flat: FlatPatches) -> dict[str, Any]:
    """Return largest energy and seconds of libigl's ARAP and SLIM, of Blender's minimum stretch, and of our flattening."""
    found: dict[str, Any] = {}
    started = time.process_time()
    again = flatten.flatten(flat.layout, LayoutParams(), SILENT)
    spent = round(time.process_time() - started, 2)
    found["ours from scratch"] = {
        "energy_max": round(float(again.energy.max()), 4),
        "overlaps": len(flatten.overlapping(again)),
        "mismatch_max": round(float(flatten.seam_mismatch(again).max(initial=0.0)), 4),
        "seconds": spent,
    }
    for name, method in (("libigl ARAP", igl_arap), ("libigl SLIM", igl_slim), ("Blender minimum stretch", blender)):
        try:
            found[name] = _peer(flat, method)
        except (ImportError, RuntimeError, AttributeError, TypeError) as error:
            found[name] = {"failed": f"{type(error).__name__}: {error}"[:80]}
    return found


def _peer(flat: FlatPatches, method: Any) -> dict[str, Any]:
    mesh, layout = flat.layout.mesh, flat.layout
    worst, seconds = 0.0, 0.0
    tri = corner_triangles(mesh)
    for quads in layout.patches:
        labels, corners = np.unique(layout.flat_corners[quads], return_inverse=True)
        corners = corners.reshape(-1, 4)
        vertices = np.zeros((len(labels), 3))
        vertices[corners] = mesh.vertices[mesh.quads[quads]]
        started = time.process_time()
        points = method(vertices, corners)
        seconds += time.process_time() - started
        u = (points[:, 0] + 1j * points[:, 1])[corners]
        d = np.roll(u, -1, axis=1) - u
        before = np.roll(d, 1, axis=1)
        own = tri.pick(quads)
        a, b = own.along * d + own.against * before, own.along_bar * d + own.against_bar * before
        if method is blender:  # its scale is arbitrary: use the best fit
            scale = (own.area * np.abs(a)).sum() / (own.area * (np.abs(a) ** 2 + np.abs(b) ** 2)).sum()
            a, b = scale * a, scale * b
        worst = max(worst, float(quad_energy(own, a, b).max()))
    return {"energy_max": round(worst, 4), "seconds": round(seconds, 2)}


def _triangles(corners: np.ndarray) -> np.ndarray:
    return np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]]).astype(np.int64)


def _disk_start(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Tutte's embedding on a circle of the patch's area."""
    import igl

    loop = igl.boundary_loop(triangles)
    circle = igl.map_vertices_to_circle(np.asfortranarray(vertices), loop.astype(np.int32))
    area = (
        0.5
        * np.linalg.norm(
            np.cross(
                vertices[triangles[:, 1]] - vertices[triangles[:, 0]],
                vertices[triangles[:, 2]] - vertices[triangles[:, 0]],
            ),
            axis=1,
        ).sum()
    )
    circle = np.asarray(circle)[:, :2] * np.sqrt(area / np.pi)
    return np.asarray(igl.harmonic(vertices, triangles, loop.astype(np.int64), np.ascontiguousarray(circle), 1))


def igl_arap(vertices: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """libigl's ARAP parametrisation of one patch, from Tutte's embedding, 100 iterations."""
    import igl

    triangles = _triangles(corners)
    points = _disk_start(vertices, triangles)
    data = igl.ARAPData()
    data.max_iter = 100
    data.energy = igl.ARAP_ENERGY_TYPE_ELEMENTS
    held = np.array([triangles[0, 0]], dtype=np.int32)
    igl.arap_precomputation(vertices, triangles, 2, held, data)
    return np.asarray(igl.arap_solve(points[held], data, points))


def igl_slim(vertices: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """libigl's SLIM with the symmetric Dirichlet energy, from Tutte's embedding, 30 iterations."""
    import igl

    triangles = _triangles(corners)
    start = np.zeros((len(vertices), 3))
    start[:, :2] = _disk_start(vertices, triangles)
    data = igl.slim_precompute(
        np.asfortranarray(vertices),
        np.asfortranarray(triangles.astype(np.int32)),
        np.asfortranarray(start[:, :2]),
        igl.SYMMETRIC_DIRICHLET,
        np.zeros(0, dtype=np.int32),
        np.asfortranarray(np.zeros((0, 2))),
        0.0,
    )
    return np.asarray(igl.slim_solve(data, 30))[:, :2]


def blender(vertices: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Blender's own minimum-stretch unwrap of one patch."""
    import bpy

    data = bpy.data.meshes.new("patch")
    data.from_pydata(vertices.tolist(), [], corners.tolist())
    layer = data.uv_layers.new(name="flat")
    thing = bpy.data.objects.new("patch", data)
    bpy.context.scene.collection.objects.link(thing)
    try:
        for other in bpy.context.view_layer.objects:
            other.select_set(False)
        bpy.context.view_layer.objects.active = thing
        thing.select_set(True)
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.ops.mesh.select_all(action="SELECT")
        bpy.ops.uv.unwrap(method="MINIMUM_STRETCH", iterations=30, correct_aspect=False, margin=0.0)
        bpy.ops.object.mode_set(mode="OBJECT")
        uv = np.zeros(2 * len(data.loops), dtype=np.float32)
        data.uv_layers["flat"].data.foreach_get("uv", uv)
    finally:
        bpy.data.objects.remove(thing)
        bpy.data.meshes.remove(data)
    del layer
    points = np.zeros((len(vertices), 2))
    points[corners.ravel()] = uv.reshape(-1, 2)
    return points

"""Benchmark of tracing, merging and flattening, beside required values and beside libigl on the same patches.

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

import flattening_peers
import layout_matches
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.params import LayoutParams, Settings
from flexmaps.engine.patches.flattening import edit, outline
from flexmaps.engine.patches.flattening.flatten import FlatPatches
from flexmaps.engine.patches.flattening.flattening_report import layout_report
from flexmaps.engine.patches.merging import merge
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.runs import job
from flexmaps.engine.surface.mesh import PolygonMesh
from harness import EDGE, Bench, surfaces
from rows import Row, at_most, note, row

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
    if options.match is not None:
        asked = {name: make() for name, make in bench.cases(surfaces(options.meshes).items())}
        layout_matches.compare(asked, options.match, options.layouts, options.patience)
        return 0
    bench.each(measure, surfaces(options.meshes))
    bunny = None if options.meshes is None else str(options.meshes / "bunny.obj")
    for name, source, memory in (("made:demo", "shape:demo", None), ("bunny", bunny, 1500)):
        if source is not None and bench.asked(name) and (memory is None or Path(source).is_file()):
            bench.table.add(*whole_job(name, source, memory))
    return bench.finish()


def measure(name: str, polygons: PolygonMesh) -> list[Row]:
    """Return all rows of one mesh."""
    params = LayoutParams()
    mesh = job.run(polygons, Settings(), edge=EDGE, stop_after="regularise").mesh
    started = time.process_time()
    layout = trace.trace(mesh, params)
    flat = merge.merge(layout, params)
    seconds = time.process_time() - started
    report = layout_report(flat)
    kind = name.removeprefix("made:")
    strict = kind not in REPORTED
    small = report["smallest_patch"] >= min(params.patch_min, len(mesh.quads)) or "forced" in report
    neck = report["neck_min_quads"]
    rows = [
        note(name, "quads", len(mesh.quads)),
        at_most(name, "patches", PATCHES.get(name), report["patches"]),
        at_most(name, "seconds", SECONDS.get(kind, 2.0), round(seconds, 2)),
        at_most(name, "energy_max", 0.035 if strict else None, report["energy_max"], flattening_peers.peers(flat)),
        note(name, "square_median", report["square_median"]),
        at_most(name, "compactness_max", 5.0, report["compactness_max"]),
        row(name, "disks", "all", "all" if report["disks"] else "not all", report["disks"]),
        at_most(name, "flips", 0, report["flips"]),
        at_most(name, "overlaps", 0, report["overlaps"], {"shapely": _overlap(flat)}),
        row(name, "neck_min_quads", ">= 2", neck, neck >= 2 or "forced" in report),
        note(name, "isthmus_min", round(_isthmus(flat), 3)),
        row(name, "smallest_patch", ">= 6", report["smallest_patch"], small),
        at_most(name, "seam_mismatch_median", 0.03 if strict else None, report["seam_mismatch_median"]),
        at_most(name, "seam_mismatch_max", 0.15 if strict else None, report["seam_mismatch_max"]),
        note(name, "cut_edges", report["cut_edges"]),
    ]
    if "symmetry" in report or kind in SYMMETRIC:
        kept = f"{report.get('symmetries_kept', 1)} of {report.get('symmetries', 1)}"
        rows.append(row(name, "symmetries", "kept or said", kept, "symmetry" in report or None))
    for text in report.get("forced", []):
        rows.append(note(name, "forced", text))
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

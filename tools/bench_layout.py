"""Benchmark of tracing, merging and flattening, beside required values.

``--match FILE`` compares the predicted match of layouts with the match that the optimiser reaches. Results of searches are stored in FILE
and not computed again; predictions always are.
"""

from __future__ import annotations

from pathlib import Path

import layout_matches
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.params import LayoutParams
from flexmaps.engine.patches.flattening import edit
from flexmaps.engine.patches.flattening.flatten import FlatPatches
from flexmaps.engine.patches.flattening.flattening_report import layout_report
from flexmaps.engine.patches.merging import merge
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.surface.mesh import PolygonMesh
from harness import Bench, Cases, Options, Rows, at_least, at_most, for_each, measure_time, run_job, surfaces

# largest number of patches, by mesh
PATCHES = {"cubesphere": 1, "three_holes": 11, "bunny": 10, "vault": 2, "spot": 25}
SECONDS = {"bunny": 4.0, "spot": 8.0}  # largest time for tracing and merging; 2 s for other meshes
EDIT = {"bunny": 100.0}  # most milliseconds of an edit, by mesh
# most of all meshes; the seams and the energy of those that are only reported may be any
MOST = {"compactness_max": 5.0, "flips": 0, "overlaps": 0}
# of a quad, and shares of an edge
STRICT = {"energy_max": 0.035, "seam_mismatch_median": 0.03, "seam_mismatch_max": 0.15}
LEAST = {"neck_min_quads": 2, "smallest_patch": 6}  # where no panel is forced beyond a limit
REPORTED = {"flower_cmc1", "amo_quad"}


def cases(options: Options) -> Cases:
    return for_each(measure if options.match is None else layout_matches.measure, surfaces(options))


def measure(name: str, polygons: PolygonMesh, _: Options) -> Rows:
    params, kind, mesh = LayoutParams(), name.removeprefix("made:"), run_job(polygons, "regularise").mesh
    seconds, flat = measure_time(lambda: merge.merge(trace.trace_layout(mesh, params), params))
    report = layout_report(flat)
    yield at_most(name, "patches", PATCHES.get(name), report["patches"])
    yield at_most(name, "seconds", SECONDS.get(kind, 2.0), seconds)
    yield at_least(name, "disks", 1, report["disks"])
    for key, limit in (MOST | STRICT).items():
        yield at_most(name, key, None if key in STRICT and kind in REPORTED else limit, report[key])
    for key, limit in LEAST.items():
        limit = 1 if "forced" in report else min(limit, len(mesh.quads))
        yield at_least(name, key, limit, report[key], {"forced": report.get("forced", [])})
    if len(flat.layout.patches) > 1:
        yield at_most(name, "edit_ms_worst", EDIT.get(kind), 1e3 * _worst_edit(flat, params))


def _worst_edit(flat: FlatPatches, params: LayoutParams) -> float:
    """Return the seconds of the slowest manual edit: opening each seam, and cutting each patch through its middle."""
    worst, layout = 0.0, flat.layout
    edits = [(False, seam) for seam in layout.seams]
    edits += [(True, trace.middle_line(layout, n)) for n in range(len(layout.patches))]
    for closed, edges in edits:
        cut = layout.cut.copy()
        cut[edges] = closed
        try:
            worst = max(worst, measure_time(lambda: edit.with_cuts(flat, cut, params))[0])  # noqa: B023
        except FlexMapsError:
            continue  # refused: the patch would be a ring
    return worst


main = Bench(
    "layout", cases, meshes=True, summary=layout_matches.sum_up,
    match=(Path, "compare predicted matches with those of searches, kept in this file"),
    layouts=(4, "of every surface, for --match"), patience=(0.6, "times the usual search, for --match"),
)  # fmt: skip

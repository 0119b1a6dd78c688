"""Benchmark of fabrication, from a mesh to cutting files, which independent programs read back.

python3 tools/dev.py bench fabricate [--meshes DIR] [--json FILE] [--only PATTERNS] [--nesting SECONDS | FAST]
"""

from __future__ import annotations

import os
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import connector_gaps
import drawn_rings
import growth
import numpy as np
import shapely
from flexmaps.engine.fabrication import sheets, sheets_report
from flexmaps.engine.fabrication.connectors.connect import Connections
from flexmaps.engine.fabrication.nesting import nest as nesting
from flexmaps.engine.fabrication.nesting import packing
from flexmaps.engine.fabrication.sheets import CutSheets
from flexmaps.engine.fabrication.writers import export
from flexmaps.engine.params import ConnectorParams, LayoutParams, Settings, SheetParams, SpiralParams
from flexmaps.engine.patches.merging import merge
from flexmaps.engine.patches.splitting import split
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.runs import job
from flexmaps.engine.spirals import fabricable
from flexmaps.engine.spirals.design import SpiralDesign
from flexmaps.engine.surface import curvature
from flexmaps.engine.surface.mesh import PolygonMesh
from harness import EDGE, Bench, surfaces
from rows import Row, at_most, note, row

SECONDS = {"bunny": 30.0}  # most seconds for writing all files, by mesh
MEGABYTES = {"bunny": 15.0}  # largest size of the SVG files, by mesh
KERFS = (0.0, 1e-4, 2e-4)  # metres
COLOURS = {"#000000": "engrave", "#0000ff": "inner", "#ff0000": "outer"}


def main(arguments: list[str]) -> int:
    """Measure every mesh, print the table and write the rows; return 0 whatever the figures."""
    nesting = ("20", "seconds of the search for fewer sheets, or FAST for none")
    bench = Bench("fabricate", arguments, only="*", meshes=True, nesting=nesting)
    bench.each(measure, surfaces(bench.options.meshes), asked_nesting(bench.options.nesting))
    growing = growth.rows(asked_nesting("FAST")) if bench.asked(growth.NAME) else ()
    return bench.finish(*growing, keep=bench.options.only != "*")


def asked_nesting(text: str) -> SheetParams:
    """Return the settings of the sheets for the option ``--nesting``."""
    return SheetParams(nesting="FAST") if text == "FAST" else SheetParams(nesting_seconds=float(text))


def measure(name: str, polygons: PolygonMesh, params: SheetParams) -> list[Row]:
    """Return all rows of one mesh, with quads of 20 mm and sheets of 600 x 400 x 2 mm."""
    layout_params = LayoutParams()
    started = time.process_time()
    mesh = job.run(polygons, Settings(), edge=EDGE, stop_after="regularise").mesh
    merged = merge.merge(trace.trace(mesh, layout_params), layout_params)
    flat = split.split(merged, layout_params, params)
    spirals = fabricable.design_from_curvature(flat, SpiralParams(thickness=0.002), curvature.rms_curvature(mesh))
    quick = sheets.make_sheets(spirals, SheetParams(nesting="FAST"))
    seconds = time.process_time() - started
    # leave out loose keys, which lie in rows on their own sheet
    shapes = [p.outline.sampled(2e-5) for p in quick.panels if p.patch >= 0]
    started = time.monotonic()
    packed = sheets.with_keys(nesting.nest(shapes, params), quick.connections.keys, params)
    made = replace(quick, packing=packed, params=params)
    nested = time.monotonic() - started
    too_large = sum(packing.turn_that_fits(s, (0.6, 0.4), params.margin, "FREE") is None for s in shapes)
    report = sheets_report.sheets_report(made)
    thin = round(0.99e3 * min(SpiralParams.width_min, ConnectorParams.thinnest), 3)
    rows = [
        note(name, "panels", len(shapes), {"before cutting to size": len(merged.layout.patches)}),
        at_most(name, "panels too large", 0, too_large),
        at_most(name, "mesh to sheets, seconds", SECONDS.get(name), round(seconds, 1)),
        at_most(name, "nodes per arm", 40, report["nodes"] / (4 * len(mesh.quads))),
        note(name, "nodes per metre", report["nodes_per_m"]),
        row(name, "narrowest slot, mm", ">= 0.3", report["slot_min_mm"], report["slot_min_mm"] >= 0.2999),
        row(name, "narrowest bridge, mm", f">= {thin:g}", report["bridge_min_mm"], report["bridge_min_mm"] >= thin),
    ]
    rows += connector_rows(name, spirals, made.connections)
    rows += [
        row(name, "sheets", "<= quick", made.count, made.count <= quick.count, {"quick": quick.count}),
        note(name, "nesting, wall seconds", round(nested, 1)),
    ]
    with tempfile.TemporaryDirectory() as folder:
        rows += file_rows(name, made, Path(folder) / "sheet")
    return rows


# -- connectors ------------------------------------------------------------------------------------------------------


def connector_rows(name: str, spirals: SpiralDesign, made: Connections) -> list[Row]:
    """Check that every joint has one connector with two matching parts, and the clearance after cutting with three kerfs."""
    layout = spirals.flat.layout
    named = [c.name for c in made.connectors] + [n for n, *_ in made.unsolved]
    sides = {frozenset(zip(c.faces, c.sides, strict=True)) for c in made.connectors}
    pairs, ends = layout.mesh.edge_quads, layout.mesh.edge_sides
    cuts = {frozenset(zip(pairs[e].tolist(), ends[e].tolist(), strict=True)) for e in np.flatnonzero(layout.cut)}
    partners = {"dovetail": {"head", "socket"}, "key": {"socket"}, "tab": {"face"}}
    alone = sum(set(c.roles) != partners[c.kind] for c in made.connectors) + len(made.connectors) - len(sides & cuts)
    given_way = {"shrunk": sum(c.shrunk for c in made.connectors), "swapped": sum(c.swapped for c in made.connectors)}
    given_way["for glue"] = sum(c.kind == "tab" for c in made.connectors)
    rows = [
        note(name, "connectors", len(made.connectors), given_way),
        at_most(name, "without their partner", 0, alone + len(cuts) - len(set(named))),
        at_most(name, "joints without connector", 0, len(made.unsolved), _describe_cramped(spirals, made)),
    ]
    for kerf in KERFS if made.connectors else ():
        found = connector_gaps.fit(spirals, made, kerf)
        off = max(float(np.abs(gap - made.clearance).max()) for gap in (found.least, found.most))
        overlap = {"overlaps": int((found.overlap > 0.0).sum())}
        rows.append(at_most(name, f"clearance off, kerf {kerf * 1e3:g}", 0.01, off * 1e3, overlap))
    return rows


def _describe_cramped(spirals: SpiralDesign, made: Connections) -> dict[str, Any]:
    """Describe the sizes of the spirals whose joints have no connector."""
    small = [float(spirals.scale[[*faces]].min()) * 1e3 for _, *faces in made.unsolved]
    return {"their spirals, mm": f"{min(small):.1f} to {max(small):.1f}"} if small else {}


# -- files, read back ------------------------------------------------------------------------------------------------


def file_rows(name: str, made: CutSheets, base: Path) -> list[Row]:
    """Return rows on what other programs read from the files."""
    rows = []
    paths = export.write(made, base, ("svg",))
    size = sum(os.path.getsize(p) for p in paths) / 1e6
    rows.append(at_most(name, "SVG, megabytes", MEGABYTES.get(name), round(size, 2)))
    rows.append(at_most(name, "empty or double cuts", 0, sum(map(idle_cuts, paths))))
    rows += shape_rows(name, "SVG by svgelements", [svg_polygons(p) for p in paths], made, close=True)
    for kind in ("dxf", "dxf-r12"):
        paths = export.write(made, base, (kind,))
        rows += shape_rows(name, f"{kind} by ezdxf", [dxf_polygons(p) for p in paths], made)
    return rows


def shape_rows(
    name: str, kind: str, found: list[list[shapely.Polygon]], made: CutSheets, close: bool = False
) -> list[Row]:
    """Check panels read from a file (mm): complete, disjoint, and of the design's area; with ``close``, also slots and bridges."""
    # a file holds the panels in the order of the cuts
    panels = [p for s in found for p in sorted(s, key=lambda one: one.area)]
    wanted = [area * 1e6 for k in range(made.count) for area in sorted(p.area for p in made.on_sheet(k))]
    off = max(abs(a.area / b - 1.0) for a, b in zip(panels, wanted, strict=True))
    near, overlaps = np.inf, 0
    for sheet, size in zip(found, made.packing.sizes * 1e3, strict=True):
        frame = shapely.box(0, 0, *size).buffer(-made.params.margin * 1e3 + 0.02, join_style="mitre")
        overlaps += sum(not frame.contains(p) for p in sheet)
        for i, one in enumerate(sheet):
            for two in sheet[:i]:
                near = min(near, shapely.Polygon(one.exterior).distance(shapely.Polygon(two.exterior)))
                overlaps += one.intersects(two)
    whole = sum(p.is_valid for p in panels)
    rows = [
        row(name, f"{kind}: whole", "all", f"{whole}/{len(wanted)}", whole == len(panels)),
        at_most(name, f"{kind}: overlaps", 0, overlaps),
        at_most(name, f"{kind}: area off", 1e-3, off),
    ]
    if np.isfinite(near):
        least = made.params.spacing * 1e3
        rows.append(row(name, f"{kind}: apart, mm", f">= {least:g}", round(near, 3), near >= least - 0.05))
    if close:
        # both sides of a slot may deviate by the tolerance of the curves, and by the chords in which they are read
        slot, bridge = (0.5e3 * x - 1.5e3 * made.params.tolerance for x in (made.slot_min, made.bridge_min))
        broken = sum(not isinstance(p.buffer(-bridge, quad_segs=2), shapely.Polygon) for p in panels)
        holes = np.array([shapely.Polygon(r) for p in panels for r in p.interiors])
        narrow = shapely.buffer(holes, -slot, quad_segs=2)
        rows.append(at_most(name, "bridges below", 0, broken))
        rows.append(at_most(name, "slots below", 0, int((shapely.get_num_geometries(narrow) > 1).sum())))
    return rows


def svg_polygons(path: Path) -> list[shapely.Polygon]:
    """Read the panels of an SVG file, in mm."""
    rings = {COLOURS.get(colour): found for colour, found in drawn_rings.svg_rings(path).items()}
    return _panels(rings["outer"], rings.get("inner", []))


def idle_cuts(path: Path) -> int:
    """Count segments of zero length and duplicate paths in an SVG file, with svgelements."""
    import svgelements

    found, seen = 0, set()
    for element in svgelements.SVG.parse(str(path), ppi=25.4).elements():
        if isinstance(element, svgelements.Path):
            cuts = [s for s in element if not isinstance(s, svgelements.Move | svgelements.Close)]
            found += sum(abs(s.start - s.end) == 0.0 for s in cuts)
            ends = frozenset((round(s.end.x, 4), round(s.end.y, 4)) for s in cuts)
            found += ends in seen
            seen.add(ends)
    return found


def dxf_polygons(path: Path) -> list[shapely.Polygon]:
    """Read the panels of a DXF file, in mm."""
    rings = drawn_rings.dxf_rings(path, 2e-3)
    return _panels(rings["CUT_OUTER"], rings["CUT_INNER"])


def _panels(outer: list[np.ndarray], inner: list[np.ndarray]) -> list[shapely.Polygon]:
    """Assign every hole to the outline that contains it."""
    outlines = [shapely.Polygon(ring) for ring in outer]
    holes: list[list[np.ndarray]] = [[] for _ in outlines]
    tree = shapely.STRtree(outlines)
    which, where = tree.query(shapely.points([ring[0] for ring in inner]), predicate="within") if inner else ((), ())
    for hole, outline in zip(which, where):
        holes[outline].append(inner[hole])
    assert sum(map(len, holes)) == len(inner), "every hole lies in exactly one panel"
    return [shapely.Polygon(ring, inside) for ring, inside in zip(outer, holes)]

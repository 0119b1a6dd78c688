"""Benchmark of fabrication, from a mesh to cutting files, which independent programs read back.

python3 tools/dev.py bench fabricate [--meshes DIR] [--json FILE] [--only PATTERNS] [--nesting SECONDS | FAST]
"""

from __future__ import annotations

import os
import tempfile
import time
import zipfile
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
from flexmaps.engine.fabrication.writers import panel_solids as solid_files
from flexmaps.engine.params import ConnectorParams, LayoutParams, RegulariseParams, SheetParams, SpiralParams
from flexmaps.engine.patches.merging import merge
from flexmaps.engine.patches.splitting import split
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.spirals import fabricable
from flexmaps.engine.spirals.design import SpiralDesign
from flexmaps.engine.surface import curvature
from flexmaps.engine.surface.checking import check
from flexmaps.engine.surface.mesh import PolygonMesh
from flexmaps.engine.surface.remeshing import regularise
from harness import EDGE, Bench, surfaces
from rows import Row, at_most, row

SOLIDS_UP_TO = 60_000  # most nodes of a panel's solid: triangulating larger ones takes long
SECONDS = {"bunny": 30.0}  # most seconds for writing all files, by mesh
MEGABYTES = {"bunny": 15.0}  # largest size of the SVG files, by mesh
KERFS = (0.0, 1e-4, 2e-4)  # metres
COLOURS = {"#000000": "engrave", "#0000ff": "inner", "#ff0000": "outer"}


def main(arguments: list[str]) -> int:
    """Measure every mesh, print the table and write the rows; return 0 whatever the figures."""
    nesting = ("20", "seconds of the search for fewer sheets, or FAST for none")
    bench = Bench("fabricate", arguments, only="*", meshes=True, nesting=nesting)
    for name, polygons in bench.cases(surfaces(bench.options.meshes)):
        bench.measure(measure, name, polygons, asked_nesting(bench.options.nesting))
    growing = growth.rows(asked_nesting("FAST")) if bench.asked(growth.NAME) else ()
    return bench.finish(*growing, keep=bench.options.only != "*")


def asked_nesting(text: str) -> SheetParams:
    """Return the settings of the sheets for the option ``--nesting``."""
    return SheetParams(nesting="FAST") if text == "FAST" else SheetParams(nesting_seconds=float(text))


def measure(name: str, polygons: PolygonMesh, params: SheetParams) -> list[Row]:
    """Return all rows of one mesh, with quads of 20 mm and sheets of 600 x 400 x 2 mm."""
    layout_params = LayoutParams()
    started = time.process_time()
    mesh = regularise.regularise(check.as_quad_mesh(check.scaled(polygons, edge=EDGE)), RegulariseParams())
    mesh = mesh.moved(mesh.vertices * (EDGE / mesh.median_edge))
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
        row(name, "panels", "", len(shapes), None, {"before cutting to size": len(merged.layout.patches)}),
        at_most(name, "panels too large", 0, too_large),
        at_most(name, "mesh to sheets, seconds", SECONDS.get(name), round(seconds, 1)),
        at_most(name, "nodes per arm", 40, report["nodes"] / (4 * len(mesh.quads))),
        row(name, "nodes per metre", "", report["nodes_per_m"], None),
        row(name, "narrowest slot, mm", ">= 0.3", report["slot_min_mm"], report["slot_min_mm"] >= 0.2999),
        row(name, "narrowest bridge, mm", f">= {thin:g}", report["bridge_min_mm"], report["bridge_min_mm"] >= thin),
    ]
    rows += connector_rows(name, spirals, made.connections)
    rows += fill_rows(name, made, quick, nested, flat)
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
        row(name, "connectors", "", len(made.connectors), None, given_way),
        at_most(name, "without their partner", 0, alone + len(cuts) - len(set(named))),
        at_most(name, "joints without connector", 0, len(made.unsolved), _cramped(spirals, made)),
    ]
    for kerf in KERFS if made.connectors else ():
        found = connector_gaps.fit(spirals, made, kerf)
        off = max(float(np.abs(gap - made.clearance).max()) for gap in (found.least, found.most))
        overlap = {"overlaps": int((found.overlap > 0.0).sum())}
        rows.append(at_most(name, f"clearance off, kerf {kerf * 1e3:g}", 0.01, off * 1e3, overlap))
    return rows


def _cramped(spirals: SpiralDesign, made: Connections) -> dict[str, Any]:
    """Describe the sizes of the spirals whose joints have no connector."""
    small = [float(spirals.scale[[*faces]].min()) * 1e3 for _, *faces in made.unsolved]
    return {"their spirals, mm": f"{min(small):.1f} to {max(small):.1f}"} if small else {}


# -- nesting ---------------------------------------------------------------------------------------------------------


def fill_rows(name: str, made: CutSheets, quick: CutSheets, seconds: float, flat: Any) -> list[Row]:
    """Measure the fill of the sheets, and of one long strip of the same height, where the panels' size matters less."""
    panels = [p for p in made.panels if p.patch >= 0]
    shapes, area = [p.outline.sampled(2e-5) for p in panels], sum(p.outline.area for p in panels)
    strip = replace(made.params, sheet_width=10.0)

    def filled(found: packing.Packing) -> float:
        return round(area / (0.4 * packing.used_length(found, shapes, 0)), 3)

    in_strip = filled(nesting.nest(shapes, strip))
    peers = {
        "quick": filled(packing.pack(shapes, (10.0, 0.4), strip.margin, strip.spacing)),
        "boxes": round(area / (0.4 * box_strip(shapes, 0.39, strip.spacing)), 3),
        "xatlas": xatlas_fill(flat, area, strip.spacing),
    }
    asked = ">= 0.6" if len(shapes) >= 8 else ""
    p, size = made.params, (made.params.sheet_width, made.params.sheet_height)
    boxes = [shapely.get_coordinates(shapely.oriented_envelope(shapely.Polygon(s)).exterior)[:-1] for s in shapes]
    boxed = packing.pack(boxes, size, p.margin, p.spacing)
    loose = sum(p.patch < 0 for p in made.panels)
    nested_only, quick_only = (_without_keys(m.packing, len(m.panels) - loose) for m in (made, quick))
    on_sheets = {
        "nested": packing.fill(nested_only, shapes, area, p.margin),
        "quick": packing.fill(quick_only, shapes, area, p.margin),
        "boxes": packing.fill(boxed, boxes, area, p.margin),
    }
    counts = {"quick": quick.count, "least by area": int(np.ceil(area / (0.59 * 0.39)))}
    return [
        row(name, "fill of a strip", asked, in_strip, in_strip >= 0.6 if asked else None, peers),
        row(name, "sheets", "<= quick", made.count, made.count <= quick.count, counts),
        row(name, "fill of the sheets", ">= boxes", round(on_sheets["nested"], 3),
            on_sheets["nested"] >= on_sheets["boxes"] - 0.005, {k: round(v, 3) for k, v in on_sheets.items()}),
        row(name, "nesting, wall seconds", "", round(seconds, 1), None),
    ]  # fmt: skip


def _without_keys(found: packing.Packing, count: int) -> packing.Packing:
    """Return the packing without the last sheet, which holds only loose keys."""
    sheets_used = int(found.sheet[:count].max()) + 1
    return packing.Packing(found.sheet[:count], found.rotation[:count], found.shift[:count], found.sizes[:sheets_used])


def box_strip(shapes: list[np.ndarray], height: float, spacing: float) -> float:
    """Return the length of a strip of bounding boxes packed in columns, widest first (first fit decreasing)."""
    boxes = []
    for shape in shapes:
        long, short = packing.least_box(shape)[1] + spacing
        boxes.append((short, long) if long <= height + spacing else (long, short))
    columns: list[tuple[float, float]] = []
    for wide, high in sorted(boxes, reverse=True):
        for k, (width, taken) in enumerate(columns):
            if taken + high <= height + spacing:
                columns[k] = (width, taken + high)
                break
        else:
            columns.append((wide, high))
    return sum(c[0] for c in columns)


def xatlas_fill(flat: Any, area: float, spacing: float) -> float:
    """Return the fill of a page packed by xatlas, whose height is free and whose texels are 1 mm, for panels of this area."""
    import xatlas

    atlas = xatlas.Atlas()
    for quads in flat.layout.patches:
        corners = np.unique(flat.layout.flat_corners[quads], return_inverse=True)[1].reshape(-1, 4)
        points = np.zeros((corners.max() + 1, 2))
        points[corners] = flat.corners[quads]
        faces = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
        atlas.add_uv_mesh((points - points.min(axis=0)).astype(np.float32), faces.astype(np.uint32))
    options = xatlas.PackOptions()
    options.texels_per_unit, options.padding, options.bruteForce = 1e3, round(spacing * 1e3), True
    atlas.generate(pack_options=options)
    return round(float(area * 1e6 / (atlas.width * atlas.height * max(atlas.atlas_count, 1))), 3)


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
    rows.append(at_most(name, "PDF by PDFium, mm off", 0.001, pdf_error(made, base.with_suffix(".pdf"))))
    return rows + solid_rows(name, made, base)


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
    rows = [
        row(name, f"{kind}: whole", "all", f"{sum(p.is_valid for p in panels)}/{len(wanted)}", all(p.is_valid for p in panels)),
        at_most(name, f"{kind}: overlaps", 0, overlaps),
        at_most(name, f"{kind}: area off", 1e-3, off),
    ]  # fmt: skip
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


def pdf_error(made: CutSheets, target: Path) -> float:
    """Return the largest difference between the sizes of the PDF's pages and the sheets, in mm."""
    import pypdfium2

    found = [
        np.array(pypdfium2.PdfDocument(path)[0].get_size()) * 25.4 / 72.0
        for path in export.write(made, target.with_suffix(""), ("pdf",))
    ]
    return round(float(np.abs(np.array(found) - made.packing.sizes * 1e3).max()), 6)


def solid_rows(name: str, made: CutSheets, base: Path) -> list[Row]:
    """Check the solids of panels that are not too large with trimesh, the first also after writing and reading a file."""
    import trimesh

    chosen = [p for p in made.panels if sum(len(c.points) for c in (p.outline, *p.holes)) <= SOLIDS_UP_TO]
    if not chosen:
        return []
    tight = 0
    off: float = 0.0
    started = time.process_time()
    for panel in chosen:
        solid = solid_files.extruded(panel, made.thickness)
        mesh = trimesh.Trimesh(solid.vertices * 1e3, solid.triangles, process=False)
        tight += bool(mesh.is_watertight and mesh.is_winding_consistent)
        off = max(off, float(abs(mesh.volume / (panel.area * made.thickness * 1e9) - 1.0)))
    seconds = time.process_time() - started
    solid_files.stl([solid], base.with_suffix(".stl"))
    solid_files.package_3mf([solid], base.with_suffix(".3mf"))
    again = trimesh.load_mesh(base.with_suffix(".stl"))
    whole = bool(again.is_watertight) and zipfile.ZipFile(base.with_suffix(".3mf")).testzip() is None
    return [
        row(name, "solids watertight", "all", f"{tight}/{len(chosen)}", tight == len(chosen), {"seconds": round(seconds, 1)}),
        at_most(name, "solids: volume off", 1e-3, off),
        row(name, "STL and 3MF read back", "whole", "whole" if whole else "broken", whole),
    ]  # fmt: skip


__all__ = ["main"]

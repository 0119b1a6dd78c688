"""Benchmark of fabrication, from a mesh to cutting files, which independent programs read back."""

from __future__ import annotations

from pathlib import Path

import connector_gaps
import drawn_rings
import growth
import numpy as np
import shapely
from flexmaps.engine.fabrication import sheets, sheets_report
from flexmaps.engine.fabrication.sheets import CutSheets
from flexmaps.engine.fabrication.writers import export
from flexmaps.engine.params import SheetParams, SpiralParams
from flexmaps.engine.spirals import fabricable
from flexmaps.engine.spirals.design import SpiralDesign
from flexmaps.engine.surface import curvature
from flexmaps.engine.surface.mesh import PolygonMesh
from harness import (
    Bench,
    Cases,
    Options,
    Rows,
    at_least,
    at_most,
    for_each,
    measure_time,
    run_job,
    surfaces,
    temporary_folder,
)

SECONDS = {"bunny": 30.0}  # most seconds for writing all files, by mesh
MEGABYTES = {"bunny": 15.0}  # largest size of the SVG files, by mesh
KERFS = (0.0, 1e-4, 2e-4)  # metres
QUICK = SheetParams(nesting="FAST")
# names of outer and inner cuts in a file
CUTS = {"svg": ("#ff0000", "#0000ff"), "dxf": ("CUT_OUTER", "CUT_INNER"), "dxf-r12": ("CUT_OUTER", "CUT_INNER")}


def cases(options: Options) -> Cases:
    return for_each(measure, surfaces(options)) | {growth.NAME: lambda _: growth.rows(QUICK)}


def measure(name: str, polygons: PolygonMesh, _: Options) -> Rows:
    """Yield all rows of one mesh, with quads of 20 mm and sheets of 600 x 400 x 2 mm."""
    seconds, (spirals, done) = measure_time(lambda: make_quickly(polygons))
    nodes = sheets_report.sheets_report(done)["nodes"] / (4 * len(spirals.width))
    yield at_most(name, "mesh to sheets, seconds", SECONDS.get(name), seconds)
    yield at_most(name, "nodes per arm", 40, nodes)
    yield at_most(name, "joints without connector", 0, len(done.connections.plain_joints))
    for kerf in KERFS if done.connections.connectors else ():
        found = connector_gaps.fit(spirals, done.connections, kerf)
        off = 1e3 * max(float(np.abs(gap - done.connections.clearance).max()) for gap in (found.least, found.most))
        yield at_most(name, f"clearance off, kerf {kerf * 1e3:g}", 0.01, off)
    with temporary_folder() as folder:
        for kind in CUTS:
            paths = export.write_sheets(done, folder / "sheet", (kind,))
            if kind == "svg":
                size = sum(path.stat().st_size for path in paths) / 1e6
                yield at_most(name, "SVG, megabytes", MEGABYTES.get(name), size)
            yield from rows_of_files(name, kind, paths, done)


def make_quickly(polygons: PolygonMesh) -> tuple[SpiralDesign, CutSheets]:
    """Make the spirals of the curvature, and their sheets with the quick nesting."""
    piece = run_job(polygons, "split")
    params = SpiralParams(thickness=0.002)
    spirals = fabricable.design_from_curvature(piece.flat, params, curvature.rms_curvature(piece.mesh))
    return spirals, sheets.make_sheets(spirals, QUICK)


def rows_of_files(name: str, kind: str, paths: list[Path], done: CutSheets) -> Rows:
    """Check panels read from files (mm): complete, apart, and of the design's area."""
    found = [read_panels(kind, path) for path in paths]
    # a file holds the panels in the order of the cuts
    panels = [p for sheet in found for p in sorted(sheet, key=lambda one: one.area)]
    wanted = [area * 1e6 for k in range(done.count) for area in sorted(p.area for p in done.panels_on_sheet(k))]
    near, overlaps = np.inf, 0
    for sheet, size in zip(found, done.packing.sizes * 1e3, strict=True):
        frame = shapely.box(0, 0, *size).buffer(-done.params.margin * 1e3 + 0.02, join_style="mitre")
        outlines = [shapely.Polygon(panel.exterior) for panel in sheet]
        overlaps += sum(not frame.contains(one) for one in outlines)
        gaps = [one.distance(two) for i, one in enumerate(outlines) for two in outlines[:i]]
        near = min([near, *gaps])
    whole = sum(p.is_valid for p in panels) if len(panels) == len(wanted) else 0
    yield at_least(name, f"{kind}: whole", len(wanted), whole)
    yield at_most(name, f"{kind}: beyond the margin", 0, overlaps)
    yield at_most(name, f"{kind}: area off", 1e-3, max(abs(a.area / b - 1.0) for a, b in zip(panels, wanted)))
    if np.isfinite(near):
        yield at_least(name, f"{kind}: apart, mm", done.params.spacing * 1e3 - 0.05, near)


def read_panels(kind: str, path: Path) -> list[shapely.Polygon]:
    """Read the panels of a file, in mm, and put every hole into the outline that contains it."""
    rings = drawn_rings.svg_rings(path) if kind == "svg" else drawn_rings.dxf_rings(path, 2e-3)
    outer, inner = (rings[cut] for cut in CUTS[kind])
    outlines = [shapely.Polygon(ring) for ring in outer]
    tree, holes = shapely.STRtree(outlines), [list[np.ndarray]() for _ in outlines]
    for hole in inner:
        (around,) = tree.query(shapely.Point(hole[0]), predicate="within").tolist()
        holes[around].append(hole)
    return [shapely.Polygon(ring, inside) for ring, inside in zip(outer, holes)]


main = Bench("fabricate", cases, meshes=True)

"""Benchmark of the fill of sheets.

The fill is the area of the panels over the area of the sheets, where the emptiest sheet counts up to the last panel on it. Outlines leave out
slots that are open to the border, of which every cut opens more; the flat quads have the same area whatever the cuts.
"""

from __future__ import annotations

import numpy as np
import shapely
from flexmaps.engine.fabrication.nesting.packing import fill_ratio
from flexmaps.engine.params import SheetParams
from flexmaps.engine.surface.mesh import PolygonMesh
from harness import Bench, Options, Rows, at_least, note, run_job, surfaces

FILL = 0.6  # share of the sheets that is wanted


def measure_fill(name: str, polygons: PolygonMesh, options: Options) -> Rows:
    values = {"sheet.nesting_seconds": options.seconds, "spiral.border": "left_out"}
    piece = run_job(polygons, values=values)
    panels, packing, flat = piece.sheets.panels, piece.sheets.packing, piece.flat
    shapes = [panel.outline.sample(2e-5) for panel in panels]
    areas = {
        "outlines": sum(panel.outline.area for panel in panels),
        "quads": float(shapely.area(shapely.polygons(flat.corners)).sum()),
    }
    counts = {"joints": np.count_nonzero(flat.layout.cut), "sheets": len(packing.sizes)}
    rows = [note(name, "panels", len(shapes), counts)]
    for what, area in areas.items():
        share = fill_ratio(packing, shapes, area, SheetParams().margin)
        rows.append(at_least(name, f"fill of the sheets, {what}", FILL, share))
    return rows


main = Bench(
    "workshop", surfaces, measure_fill, patterns="made:demo,bunny,three_holes,spot", meshes=True,
    seconds=(SheetParams().nesting_seconds, "nesting_seconds"),
)  # fmt: skip

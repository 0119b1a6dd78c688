"""Benchmark of the fill of sheets.

python3 tools/dev.py bench workshop [--only PATTERNS] [--meshes DIR] [--json FILE]

Sheets measure 600 x 400 mm, and borders have no stubs, as in the demo. The fill is the area of the panels over the area of the sheets, where
the emptiest sheet counts up to the last panel on it. Another row counts every sheet so, as for somebody who keeps the straight offcuts.
A strip of the same height without an end, searched for a longer time, is the bound: sheets cannot be filled better.

The area of the panels is measured in two ways. Their outlines leave out slots that are open to the border; every cut opens more slots, so that
a layout with more cuts seems to fill less. The flat quads of the panels have the same area whatever the cuts.
"""

from __future__ import annotations

import numpy as np
import shapely
import shapely.affinity
from flexmaps.engine.fabrication.nesting.packing import Packing, fill, used_length
from flexmaps.engine.fabrication.nesting.sheet_search import SheetSearch
from flexmaps.engine.fabrication.nesting.strip import PackedStrip
from flexmaps.engine.params import Settings, SheetParams, with_values
from flexmaps.engine.progress import SILENT
from flexmaps.engine.runs import job
from flexmaps.engine.surface.mesh import PolygonMesh
from flexmaps.engine.workers import Workers
from harness import EDGE, Bench, surfaces
from rows import Row, at_least, at_most, note

PIECES = "made:demo,bunny,three_holes,spot"
FILL, STRIP_SECONDS = 0.6, 25  # share of the sheets that is wanted; seconds that the strip is searched


def main(arguments: list[str]) -> int:
    """Measure, print the table and write the rows; return 0 whatever the figures."""
    bench = Bench(
        "workshop", arguments, 38, only=PIECES, meshes=True, seconds=(SheetParams().nesting_seconds, "nesting_seconds")
    )
    bench.each(measure_fill, surfaces(bench.options.meshes), bench.options.seconds)
    return bench.finish()


def measure_fill(name: str, polygons: PolygonMesh, seconds: float) -> list[Row]:
    """Measure the fill of the sheets of a piece, and of an endless strip of its panels."""
    settings = with_values(Settings(), {"sheet.nesting_seconds": seconds, "spiral.border": "left_out"})
    result = job.run(polygons, settings, edge=EDGE)
    made, flat, params = result.sheets, result.flat, settings.sheet
    assert made is not None and flat is not None
    shapes, packing = [p.outline.sampled(2e-5) for p in made.panels], made.packing
    placed = place_shapes(packing, shapes)
    wrong = sum(
        count_too_near([p for p, at in zip(placed, packing.sheet, strict=True) if at == k], params.spacing)
        for k in range(len(packing.sizes))
    )
    area = sum(p.outline.area for p in made.panels)
    quads = float(shapely.area(shapely.polygons(flat.corners)).sum())
    found = shortest_strip(shapes, params)
    long = np.inf if found is None else (found.length + 2.0 * params.margin) * params.sheet_height
    ends = fill_but_offcuts(packing, shapes, area, params.margin)
    joints = np.count_nonzero(flat.layout.cut)
    used = [used_length(packing, shapes, k) + params.margin for k in range(len(packing.sizes))]
    needed = len(used) - 1 + min(min(used) / params.sheet_width, 1.0)
    return [
        note(name, "panels, joints, sheets", f"{len(shapes)}, {joints}, {len(packing.sizes)}"),
        note(name, "sheets, the emptiest as far as used", needed),
        at_least(name, "fill of the sheets, outlines", FILL, fill(packing, shapes, area, params.margin)),
        at_least(name, "fill of the sheets, quads", FILL, fill(packing, shapes, quads, params.margin)),
        note(name, "fill, of each sheet its used end", round(ends, 4)),
        note(name, "fill of an endless strip, outlines", float(f"{area / long:.3g}")),
        note(name, "fill of an endless strip, quads", float(f"{quads / long:.3g}")),
        at_most(name, "panels too near to each other", 0, wrong),
    ]


def shortest_strip(shapes: list[np.ndarray], params: SheetParams) -> PackedStrip | None:
    """Return the shortest strip found with all shapes, as high as a sheet without its margins; None if one is too large."""
    with Workers() as workers:
        search = SheetSearch(shapes, params, workers, SILENT)
        return search.shortest(frozenset(range(len(shapes))), STRIP_SECONDS) if all(search.turns) else None


def fill_but_offcuts(packing: Packing, shapes: list[np.ndarray], area: float, margin: float) -> float:
    """Return the share of the sheets that shapes cover; only the used end of every sheet is counted.

    The rest of a sheet is an offcut, separated by a single straight cut. Parameters as for ``fill``.
    """
    ends = [
        min(used_length(packing, shapes, k) + margin, width) for k, width in enumerate(packing.sizes[:, 0].tolist())
    ]
    rest = (packing.sizes[:, 0] - ends) * packing.sizes[:, 1]
    rest[: len(packing.remnants)] = 0.0  # remnants have no straight offcut
    return area / float(packing.areas.sum() - rest.sum())


def place_shapes(packing: Packing, shapes: list[np.ndarray]) -> list[shapely.Polygon]:
    """Return the outlines as they lie on their sheets, metres, moved by shapely."""
    return [
        shapely.affinity.translate(shapely.affinity.rotate(shapely.Polygon(s), r, origin=(0, 0), use_radians=True), *m)
        for s, r, m in zip(shapes, packing.rotation, packing.shift, strict=True)
    ]


def count_too_near(on: list[shapely.Polygon], spacing: float) -> int:
    """Count pairs of shapes on one sheet that are nearer to each other than the spacing, by shapely."""
    return sum(a.distance(b) < spacing - 1e-7 for i, a in enumerate(on) for b in on[:i])

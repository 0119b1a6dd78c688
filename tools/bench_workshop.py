"""Benchmark of the workshop: accuracy of the calibration sheet, fill of the sheets, and nesting on remnants.

python3 tools/dev.py bench workshop [--only calibration,fill,remnants] [--draws N] [--names demo,spot] [--meshes DIR] [--json FILE]

Played measurements: every reading of a kerf comb's gap, of the sag of a strip and of two spirals has an error of 2 % (normal), three
readings each, on sheets of random thickness, kerf, modulus and Poisson's ratio.
Fill: of sheets of 600 x 400 mm, borders without stubs as in the demo, where of the emptiest sheet only the used end counts; where that is
so of every sheet, as for somebody who keeps the straight offcuts; beside that of one endless strip of the same height, searched for a
longer time: no sheets can be filled better than the strip, but for what the search did not find. What fills the sheets is counted twice. The
outlines of panels leave out the slots that are open to their border, and every cut opens more of them: of two layouts, the one with more cuts may
count less.
The quads of the panels, as they lie flat, are the surface that is made, whatever the cuts.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import ezdxf
import numpy as np
import shapely
import shapely.affinity
from flexmaps.engine.extras.calibrating import bending
from flexmaps.engine.extras.calibrating.calibrate import Readings, calibrate
from flexmaps.engine.extras.calibrating.coupons import GRAVITY, Coupons
from flexmaps.engine.extras.calibrating.sizes import coupons
from flexmaps.engine.fabrication.nesting import nest as nesting
from flexmaps.engine.fabrication.nesting import remnants as odd
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

NOISE, READINGS = 0.02, 3  # of every reading as a share, and how many there are of each
FILL, STRIP_SECONDS = 0.6, 25  # share of the sheets that is wanted; seconds that the strip is searched


def main(arguments: list[str]) -> int:
    """Measure, print the table and write the rows; return 0 whatever the figures."""
    bench = Bench(
        "workshop",
        arguments,
        38,
        only="calibration,fill,remnants",
        meshes=True,
        names=("demo,bunny,three_holes,spot", "pieces whose sheets are filled"),
        seconds=(SheetParams().nesting_seconds, "nesting_seconds"),
        draws=(150, "calibrations that are played"),
    )
    table, options = bench.table, bench.options
    if bench.asked("calibration"):
        table.add(*played(options.draws))
    if bench.asked("remnants"):
        table.add(*remnants())
    if bench.asked("fill"):
        for name, make in surfaces(options.meshes).items():
            if name.removeprefix("made:") in options.names.split(",") and name != "made:three_holes":
                table.add(*filled(name.removeprefix("made:"), make(), options.seconds))
    return bench.finish()


def played(draws: int) -> list[Row]:
    """Measure the errors of modulus and kerf estimated from simulated readings."""
    random, youngs, kerfs, sure = np.random.default_rng(0), [], [], []
    warned = 0
    for _ in range(draws):
        h, kerf, assumed = random.uniform(1.0, 5.0), random.uniform(0.08, 0.3) * 1e-3, random.uniform(0.1, 0.25)
        made = coupons(with_values(Settings(), {
            "spiral.thickness": h, "cut.kerf_outline": assumed, "cut.kerf_holes": assumed, "material.material": "custom",
            "material.youngs": 5.0, "material.poisson": random.uniform(0.2, 0.42),
        }))  # fmt: skip
        true = 1e9 * float(np.exp(random.uniform(np.log(1.5), np.log(12.0))))
        found = calibrate(made, _noisy(made, true, kerf, random))
        assert found.youngs is not None and found.kerf is not None
        youngs.append(abs(found.youngs.value / true - 1.0))
        sure.append(youngs[-1] <= 2.0 * found.youngs.share)
        kerfs.append(1e3 * abs(found.kerf.value - kerf))
        warned += bool(found.warnings)
    return [
        note("played", "modulus, median error %", 100.0 * float(np.median(youngs))),
        at_most("played", "modulus, error % of 95 in 100", 3.0, 100.0 * float(np.quantile(youngs, 0.95))),
        note("played", "modulus within twice its told error", float(np.mean(sure))),
        note("played", "kerf, median error mm", float(np.median(kerfs))),
        at_most("played", "kerf, error mm of 95 in 100", 0.02, float(np.quantile(kerfs, 0.95))),
        note("played", "calibrations with a warning", warned / draws),
    ]


def _noisy(made: Coupons, youngs: float, kerf: float, random: np.random.Generator) -> Readings:
    """Readings of pieces of that modulus and kerf, each with its error; the weights are those engraved."""
    outline, arms = made.kerf - kerf, made.kerf_holes - kerf
    sag = bending.strip_sag(made, youngs, made.strip_load, width=made.strip_width + outline)
    stiff = [bending.spiral_stiffness(made, s.scale, s.width + arms, s.twist, youngs) for s in made.spirals]
    sags = [s.load * GRAVITY / k for s, k in zip(made.spirals, stiff, strict=True)]

    def read(value: float) -> float:
        return value * (1.0 + NOISE * float(random.standard_normal()))

    return replace(
        Readings(),
        kerf_gaps=[read((made.cells + 1) * kerf) for _ in range(READINGS)],
        strip_sags=[read(sag) for _ in range(READINGS)],
        spiral_sags=[(read(sags[0]), read(sags[1])) for _ in range(READINGS)],
    )


# -- sheets ------------------------------------------------------------------------------------------------------------


def filled(name: str, polygons: PolygonMesh, seconds: float) -> list[Row]:
    """Measure the fill of the sheets of a piece, and of an endless strip of its panels."""
    settings = with_values(Settings(), {"sheet.nesting_seconds": seconds, "spiral.border": "left_out"})
    result = job.run(polygons, settings, edge=EDGE)
    made, flat, params = result.sheets, result.flat, settings.sheet
    assert made is not None and flat is not None
    shapes, packing = [p.outline.sampled(2e-5) for p in made.panels], made.packing
    placed = laid_shapes(packing, shapes)
    wrong = sum(
        too_near([p for p, at in zip(placed, packing.sheet, strict=True) if at == k], params.spacing)
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


def laid_shapes(packing: Packing, shapes: list[np.ndarray]) -> list[shapely.Polygon]:
    """Outlines as they lie on their sheets, metres, moved by shapely."""
    return [
        shapely.affinity.translate(shapely.affinity.rotate(shapely.Polygon(s), r, origin=(0, 0), use_radians=True), *m)
        for s, r, m in zip(shapes, packing.rotation, packing.shift, strict=True)
    ]


def too_near(on: list[shapely.Polygon], spacing: float) -> int:
    """Count pairs of shapes on one sheet that are nearer to each other than the spacing, by shapely."""
    return sum(a.distance(b) < spacing - 1e-7 for i, a in enumerate(on) for b in on[:i])


def remnants(draws: int = 12) -> list[Row]:
    """Panels on odd remnants with holes that are drawn at random: how many overlap, are too near or leave their sheet, by shapely."""
    random, wrong, laid = np.random.default_rng(0), 0, 0
    for _ in range(draws):
        with tempfile.TemporaryDirectory() as folder:
            files = [_drawn(Path(folder) / f"{k}.dxf", random) for k in range(2)]
            params = SheetParams(remnants=odd.SEPARATOR.join(map(str, files)), nesting="FAST", spacing=random.uniform(0.001, 0.006),
                                 margin=random.uniform(0.0, 0.008))  # fmt: skip
            shapes = [_star(random.uniform(0.015, 0.05), random) for _ in range(20)]
            packing = nesting.nest(shapes, params)
        placed = laid_shapes(packing, shapes)
        for k, remnant in enumerate(packing.remnants):
            on = [p for p, number in zip(placed, packing.sheet, strict=True) if number == k]
            laid += len(on)
            sheet = remnant.polygon
            wrong += sum(not sheet.contains(p) or p.distance(sheet.boundary) < params.margin - 1e-7 for p in on)
            wrong += too_near(on, params.spacing)
    return [
        note("remnants", "panels laid on remnants", laid),
        at_most("remnants", "overlaps, too near or outside", 0, wrong),
    ]


def _star(size: float, random: np.random.Generator) -> np.ndarray:
    """An uneven outline (24, 2) with bays, of about this radius in metres."""
    angle, radius = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False), size * random.uniform(0.4, 1.0, 24)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def _drawn(path: Path, random: np.random.Generator) -> Path:
    """A DXF file of an odd piece with two holes."""
    document = ezdxf.new(units=4)
    space, outline = document.modelspace(), 1e3 * _star(0.28, random)
    space.add_lwpolyline(outline.tolist(), close=True)
    space.add_circle((20.0, 10.0), 15.0)
    space.add_circle((-40.0, -20.0), 25.0)
    document.saveas(path)
    return path

"""Benchmark of rims: rims read back from the written sheets, and the match with each kind of border on open surfaces.

python3 tools/dev.py bench rim [--only PATTERNS] [--meshes FOLDER] [--no-optimise] [--json FILE]

SVG is read by svgelements, DXF by ezdxf; shapely judges what they hold: holes of the right diameter, inside the panels, and no less than half of
their diameter from the nearest edge. Every mesh in FOLDER whose name fits is taken too, if its border is open. The surface of the demo
stands on its lowest spirals, as there; all others are free.
"""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import zoo
from drawn_rings import dxf_rings, svg_rings
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.fabrication.writers import dxf, svg
from flexmaps.engine.params import Settings, SheetParams, SpiralParams
from flexmaps.engine.runs import by_hand, job
from flexmaps.engine.runs.result import Result
from flexmaps.engine.runs.stages import BY_HAND
from flexmaps.engine.spirals.fabricable import make_fabricable
from flexmaps.engine.surface.checking.check import as_quad_mesh
from flexmaps.engine.surface.mesh import PolygonMesh
from harness import EDGE, Bench, Surfaces, built_in, from_folder, from_zoo
from rows import Row, at_least, at_most, note, row

MADE = ("demo", "vault", "dome", "saddle", "vault-plain", "barrel", "catenoid", "hypar", "tower")
KINDS = ("stubs", "left_out", "rim")
LARGE = 5.0  # metres, of the sheets: panels are not to be split for them


def main(arguments: list[str]) -> int:
    """Measure and print the table; return 0 whatever the figures."""
    meshes, plain = (Path, "a folder with more meshes"), (False, "simulate alone")
    bench = Bench("rim", arguments, 40, only="*", meshes=meshes, no_optimise=plain)
    options = bench.options
    # the zoo's others only where they are asked for
    names = MADE if options.only == "*" else dict.fromkeys((*MADE, *zoo.SURFACES))
    pieces: Surfaces = {name: partial(built_in, name) for name in names} | from_zoo(*names)
    pieces |= {f"{name} of file": make for name, make in from_folder(options.meshes).items()}
    bench.each(_judged, pieces, not options.no_optimise)
    return bench.finish()


def _judged(name: str, mesh: PolygonMesh, optimised: bool) -> Iterator[Row]:
    if not as_quad_mesh(mesh).border.any():
        return
    supports, pieces = "lowest" if name == "demo" else None, dict[str, Result]()
    for searched in (False, True)[: 1 + optimised]:
        when = "optimised" if searched else "as first guessed"
        for kind in KINDS:
            try:
                # arms without a mate carry nothing, so what is best with stubs is best without them
                stubs = pieces.get("stubs") if kind == "left_out" else None
                made = _left_out(stubs) if stubs else _made(mesh, kind, searched, supports)
            except FlexMapsError as error:
                yield note(name, f"{kind}, {when}: refused", str(error)[:60])
                continue
            assert made.simulation is not None
            strain = made.simulation.strain
            peer = {} if strain is None else {"strain, % of the limit": f"{100.0 * strain.max():.0f}"}
            yield at_most(name, f"RMS, %: {kind}, {when}", None, made.simulation.match["rms_percent"], peer)
            pieces[kind] = made
    if "rim" in pieces:
        yield from _read_back(name, pieces["rim"])


def _left_out(stubs: Result) -> Result:
    """Simulate the spirals without the arms at the border."""
    assert stubs.design is not None
    design = make_fabricable(stubs.design.flat, SpiralParams(border="left_out"), stubs.design.width, stubs.design.twist)
    settings = _settings("left_out")
    return job.run_stages(by_hand.with_design(stubs, design, BY_HAND, settings), settings, ["simulate"])


def _settings(kind: str) -> Settings:
    sheet = SheetParams(sheet_width=LARGE, sheet_height=LARGE, nesting="FAST")
    return dataclasses.replace(Settings(), spiral=SpiralParams(border=kind), sheet=sheet)


def _made(mesh: PolygonMesh, kind: str, searched: bool, supports: str | None) -> Result:
    return job.run(mesh, _settings(kind), edge=EDGE, stop_after="simulate", optimised=searched, supports=supports)


def _read_back(name: str, made: Result) -> Iterator[Row]:
    try:
        sheets = job.run_stages(made, _settings("rim"), ["sheets"]).sheets
    except FlexMapsError as error:
        yield note(name, "rim: no sheets", str(error)[:60])
        return
    assert sheets is not None
    params = _settings("rim").spiral
    with tempfile.TemporaryDirectory() as folder:
        for ending, write, reader in (("svg", svg.write, svg_rings), ("dxf", dxf.write, dxf_rings)):
            holes = clear = 0
            worst, wrong, overlaps = np.inf, 0.0, 0
            for number in range(sheets.count):
                path = Path(folder) / f"sheet.{ending}"
                write(sheets, number, path)
                rings = [shapely.Polygon(points) for found in reader(path).values() for points in found]
                panels = [r for r in rings if r.area > 20.0 * np.pi * params.rim_hole**2 * 2.5e5]
                edges = shapely.union_all([r.exterior for r in panels])
                wanted = np.pi * (500.0 * params.rim_hole) ** 2
                small = [r for r in rings if abs(r.area - wanted) < 0.02 * wanted and _round(r)]
                for hole in small:
                    holes += 1
                    clear += any(panel.contains(hole) for panel in panels)
                    worst = min(worst, float(hole.distance(edges)) / (1e3 * params.rim_hole))
                    wrong = max(wrong, abs(2.0 * np.sqrt(hole.area / np.pi) - 1e3 * params.rim_hole))
                overlaps += sum(not r.is_valid for r in rings)
            yield at_least(name, f"{ending}: holes of the rim", 1, holes)
            yield row(name, f"{ending}: of these inside panels", f"{holes}", clear, clear == holes)
            yield at_least(name, f"{ending}: least edge, diameters", 0.5 * (1.0 - 1e-2), worst)
            yield at_most(name, f"{ending}: diameter off, mm", 0.01, wrong)
            yield at_most(name, f"{ending}: outlines not valid", 0, overlaps)


def _round(ring: Any) -> bool:
    return bool(ring.length**2 < 4.0 * np.pi * ring.area * 1.01)

"""Benchmark of rims: rims read back from the written sheets, and the match with each kind of border on open surfaces.

python3 tools/dev.py bench rim [--only PATTERNS] [--meshes FOLDER] [--no-optimise] [--pictures FOLDER] [--json FILE]

SVG is read by svgelements, DXF by ezdxf; shapely judges what they hold: holes of the right diameter, inside the panels, and no less than half of
their diameter from the nearest edge. ``strips`` among the patterns, as by default, compares strips that have a hole with solids. Every mesh in
FOLDER whose name fits is taken too, if its border is open. The surface of the demo stands on its lowest spirals, as there; all others are free.
``--pictures`` renders the optimised pieces with the three borders side by side.
"""

from __future__ import annotations

import dataclasses
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import rim_pictures
import rim_solids
import shapely
import zoo
from drawn_rings import dxf_rings, svg_rings
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.fabrication.writers import dxf, svg
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.params import Settings, SheetParams, SpiralParams
from flexmaps.engine.runs import by_hand, job
from flexmaps.engine.runs.result import Result
from flexmaps.engine.runs.stages import BY_HAND
from flexmaps.engine.spirals.fabricable import make_fabricable
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking.check import as_quad_mesh
from flexmaps.engine.surface.formats.meshio import read
from flexmaps.engine.surface.mesh import PolygonMesh
from harness import Bench
from rows import Table, at_least, at_most, row

MADE = ("demo", "vault", "dome", "saddle", "vault-plain", "barrel", "catenoid", "hypar", "tower")
KINDS = ("stubs", "left_out", "rim")
EDGE = 0.02  # metres, median edge
FORMATS = (".obj", ".off", ".ply")
# width, hole and thickness in metres: the default, a larger hole, as large as may be in thinner sheets, small
STRIPS = ((0.005, 0.002, 0.002), (0.005, 0.0025, 0.002), (0.004, 0.002, 0.001), (0.004, 0.001, 0.003))
SPACING = SpiralParams().rim_spacing
LARGE = 5.0  # metres, of the sheets: panels are not to be split for them


def main(arguments: list[str]) -> int:
    """Measure and print the table; return 0 whatever the figures."""
    bench = Bench(
        "rim",
        arguments,
        40,
        only="*",
        meshes=(Path, "a folder with more meshes"),
        no_optimise=(False, "simulate alone"),
        pictures=(Path, "render the three borders of every piece into this folder"),
    )
    options, table = bench.options, bench.table
    # the zoo's others only where they are asked for
    found: dict[str, Any] = {
        name: name for name in (MADE if options.only == "*" else dict.fromkeys((*MADE, *zoo.SURFACES)))
    }
    if options.meshes:
        found |= {path.name: path for path in sorted(options.meshes.iterdir()) if path.suffix in FORMATS}
    if bench.asked("strips"):
        _strips(table)
    for name, source in bench.cases(found.items()):
        _judged(table, name, source, not options.no_optimise, options.pictures)
    return bench.finish()


def _strips(table: Table) -> None:
    """Strips with one hole between their ends as solids of scikit-fem and as the model takes them: stretched, bent and sheared."""
    material = MATERIALS["vero"]
    for width, hole, height in STRIPS:
        solid, beam = (
            np.diag(of(SPACING, width, hole, height, material)) / np.diag(of(SPACING, width, 0.0, height, material))
            for of in (rim_solids.solid_compliance, rim_solids.beam_compliance)
        )
        name = f"{1e3 * width:g} x {1e3 * height:g}, hole {1e3 * hole:g}"
        softer = " ".join(f"{100.0 * (x - 1.0):.1f}" for x in solid)
        off = float(np.abs(beam / solid - 1.0).max())
        table.add(at_most(name, "compliance off the solid's", 0.05, off, {"a hole adds, %": softer}))


def _mesh(source: str | Path) -> PolygonMesh:
    if isinstance(source, Path):
        return read(source)
    return (
        zoo.SURFACES[source].polygons() if source in zoo.SURFACES else PolygonMesh.from_quads(shapes.make(source, EDGE))
    )


def _judged(table: Table, name: str, source: str | Path, optimised: bool, pictures: Path | None) -> None:
    try:
        mesh = _mesh(source)
        if not as_quad_mesh(mesh).border.any():
            return
    except FlexMapsError:
        return
    pieces: dict[str, Result] = {}
    for searched in (False, True)[: 1 + optimised]:
        when = "optimised" if searched else "as first guessed"
        for kind in KINDS:
            try:
                # arms without a mate carry nothing, so what is best with stubs is best without them
                stubs = pieces.get("stubs") if kind == "left_out" else None
                made = (
                    _made(mesh, kind, searched, "lowest" if name == "demo" else None)
                    if stubs is None
                    else _left_out(stubs)
                )
            except FlexMapsError as error:
                table.add(row(name, f"{kind}, {when}: refused", "", str(error)[:60], None))
                continue
            assert made.simulation is not None
            strain = made.simulation.strain
            peer = {} if strain is None else {"strain, % of the limit": f"{100.0 * strain.max():.0f}"}
            table.add(at_most(name, f"RMS, %: {kind}, {when}", None, made.simulation.match["rms_percent"], peer))
            pieces[kind] = made
    if "rim" in pieces:
        _read_back(table, name, pieces["rim"])
    if pictures is not None and len(pieces) == len(KINDS):
        rim_pictures.beside_each_other(pieces, pictures / f"{name}.png")


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


def _read_back(table: Table, name: str, made: Result) -> None:
    try:
        sheets = job.run_stages(made, _settings("rim"), ["sheets"]).sheets
    except FlexMapsError as error:
        table.add(row(name, "rim: no sheets", "", str(error)[:60], None))
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
            table.add(
                at_least(name, f"{ending}: holes of the rim", 1, holes),
                row(name, f"{ending}: of these inside panels", f"{holes}", clear, clear == holes),
                at_least(name, f"{ending}: least edge, diameters", 0.5 * (1.0 - 1e-2), worst),
                at_most(name, f"{ending}: diameter off, mm", 0.01, wrong),
                at_most(name, f"{ending}: outlines not valid", 0, overlaps),
            )


def _round(ring: Any) -> bool:
    return bool(ring.length**2 < 4.0 * np.pi * ring.area * 1.01)

"""Rims: read back from the sheets as they are written, and what every kind of border brings on open surfaces.

python3 tools/dev.py bench rim [--only PATTERNS] [--meshes FOLDER] [--no-optimise] [--json FILE]

SVG is read by svgelements, DXF by ezdxf; shapely judges what they hold: holes of the right diameter, inside the panels, and no less than half of
their diameter from the nearest edge. Every mesh in FOLDER whose name fits is taken too, if its border is open.
"""

from __future__ import annotations

import argparse
import dataclasses
import fnmatch
import tempfile
from pathlib import Path
from typing import Any

import ezdxf
import numpy as np
import shapely
import svgelements
import zoo
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.fabrication.sheets import CutSheets
from flexmaps.engine.fabrication.writers import dxf, svg
from flexmaps.engine.params import Settings, SheetParams, SpiralParams
from flexmaps.engine.runs import job
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking.check import as_quad_mesh
from flexmaps.engine.surface.files.meshio import read
from flexmaps.engine.surface.mesh import PolygonMesh
from rows import Table, at_least, at_most, row

MADE = ("vault", "dome", "saddle", "vault-plain", "barrel", "catenoid", "hypar", "tower")
KINDS = ("stubs", "left_out", "rim")
EDGE = 0.02  # metres, median edge
FORMATS = (".obj", ".off", ".ply")
LARGE = 5.0  # metres, of the sheets: panels are not to be split for them


def main(arguments: list[str]) -> int:
    """Measure, print the table; 0 whatever was measured."""
    parser = argparse.ArgumentParser(prog="dev.py bench rim")
    parser.add_argument("--only", default="*", help="patterns of names, with commas")
    parser.add_argument("--meshes", type=Path, help="a folder with more meshes")
    parser.add_argument("--no-optimise", action="store_true", help="simulate alone")
    parser.add_argument("--json", type=Path, help="write the rows here too")
    options = parser.parse_args(arguments)
    found: dict[str, Any] = {name: name for name in MADE}
    if options.meshes:
        found |= {path.name: path for path in sorted(options.meshes.iterdir()) if path.suffix in FORMATS}
    table = Table(34)
    for name, source in found.items():
        if any(fnmatch.fnmatch(name, one) for one in options.only.split(",")):
            _judged(table, name, source, not options.no_optimise)
    table.finish(options.json)
    return 0


def _mesh(source: str | Path) -> PolygonMesh:
    if isinstance(source, Path):
        return read(source)
    return zoo.SURFACES[source].polygons() if source in zoo.SURFACES else PolygonMesh.of(shapes.make(source, EDGE))


def _judged(table: Table, name: str, source: str | Path, optimised: bool) -> None:
    try:
        mesh = _mesh(source)
        if not as_quad_mesh(mesh).border.any():
            return
    except FlexMapsError:
        return
    matches = {}
    for kind in KINDS:
        settings = dataclasses.replace(
            Settings(),
            spiral=SpiralParams(border=kind),
            sheet=SheetParams(sheet_width=LARGE, sheet_height=LARGE, nesting="FAST"),
        )
        try:
            last = "sheets" if kind == "rim" else "simulate"
            made = job.run(mesh, settings, edge=EDGE, stop_after=last, optimised=optimised)
        except FlexMapsError as error:
            table.add(row(name, f"{kind}: refused", "", str(error)[:60], None))
            continue
        assert made.simulation is not None
        matches[kind] = made.simulation.match["rms_percent"]
        if kind == "rim" and made.sheets is not None:
            _read_back(table, name, made.sheets, settings.spiral)
    for kind, rms in matches.items():
        table.add(at_most(name, f"RMS of the size, %: {kind}", None, rms))


def _read_back(table: Table, name: str, sheets: CutSheets, params: SpiralParams) -> None:
    with tempfile.TemporaryDirectory() as folder:
        for ending, write, reader in (("svg", svg.write, _svg), ("dxf", dxf.write, _dxf)):
            holes = clear = 0
            worst, wrong, overlaps = np.inf, 0.0, 0
            for number in range(sheets.count):
                path = Path(folder) / f"sheet.{ending}"
                write(sheets, number, path)
                rings = [shapely.Polygon(points) for points in reader(path) if len(points) > 2]
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


def _svg(path: Path) -> list[np.ndarray]:
    """Closed curves in millimetres, as points."""
    out = []
    for item in svgelements.SVG.parse(str(path), ppi=25.4).elements():
        if isinstance(item, svgelements.Path):
            for part in item.as_subpaths():
                curve = svgelements.Path(part)
                if not any(isinstance(piece, svgelements.Close) for piece in curve):
                    continue  # engraved
                points = [curve.point(0.0)]
                for piece in curve:
                    if not isinstance(piece, svgelements.Move):
                        steps = np.linspace(0.0, 1.0, 33)[1:] if isinstance(piece, svgelements.Arc) else [1.0]
                        points += [piece.point(s) for s in steps]
                out.append(np.array([[p.x, p.y] for p in points]))
    return out


def _dxf(path: Path) -> list[np.ndarray]:
    """Closed curves in millimetres, as points."""
    from ezdxf import path as paths

    return [
        np.array([[p.x, p.y] for p in paths.make_path(item).flattening(0.001)])
        for item in ezdxf.readfile(path).modelspace().query("LWPOLYLINE CIRCLE")
        if item.dxftype() == "CIRCLE" or getattr(item, "closed", False)
    ]

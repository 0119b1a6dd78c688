"""Benchmark of the sheets' files: travel, labels and segments, and faults of the drawings.

python3 tools/dev.py bench files [--thorough] [--meshes DIR] [--json FILE] [--only PATTERNS]

It measures small sheets of every kind (``sheet_kinds.py``) and those of the demo; ``--thorough`` adds larger meshes. FreeCAD, LibreCAD
and Inkscape read the files in the tests of the tier ``files``. Travel is compared with vpype's ``linesort`` of the same curves if
``vpype`` is installed (``pip install vpype`` in any environment; FLEXMAPS_VPYPE is its path).
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from flexmaps.engine.fabrication.panels.toolpath import SheetCuts
from flexmaps.engine.fabrication.sheets import CutSheets
from flexmaps.engine.fabrication.writers import export
from flexmaps.engine.params import Settings, with_values
from flexmaps.engine.progress import SILENT
from flexmaps.engine.runs import job
from flexmaps.engine.spirals.curves.arcs import Curve
from flexmaps.engine.surface.checking import check
from flexmaps.engine.surface.mesh import PolygonMesh
from harness import EDGE, Bench, surfaces
from rows import Row, at_least, at_most, note, row
from sheet_kinds import KINDS

QUICK, MESHES = ("made:demo",), ("made:demo", "vault", "cubesphere", "three_holes")
TRAVEL = 1.1  # largest travel over that of vpype's linesort
PASSES = ("engraved", "inner", "outer")  # in the order of cutting


def main(arguments: list[str]) -> int:
    """Measure every mesh, print the table and write the rows; return 0 whatever the figures."""
    thorough = (False, "larger meshes too")
    bench = Bench("files", arguments, 36, only="", meshes=True, thorough=thorough)
    options = bench.options
    options.only = options.only or ",".join(MESHES if options.thorough else QUICK)
    with tempfile.TemporaryDirectory() as place:
        for name, kind in KINDS.items():
            folder = _folder(place, name)
            bench.table.add(*sheet_rows(name, kind(folder), folder, options.thorough))
        bench.each(mesh_rows, surfaces(options.meshes), place, options.thorough)
    return bench.finish()


def _folder(place: str, name: str) -> Path:
    folder = Path(place) / name.replace(" ", "-").replace(":", "-")
    folder.mkdir()
    return folder


def mesh_rows(name: str, polygons: PolygonMesh, place: str, thorough: bool) -> list[Row]:
    """Lay the panels of a mesh on sheets, and return the rows on their files."""
    quick = with_values(Settings(), {"sheet.nesting": "FAST"})
    sheets = job.run(check.scale_to_metres(polygons, edge=EDGE), quick, stop_after="sheets").sheets
    assert sheets is not None
    folder = _folder(place, name)
    return [*travel_rows(name, sheets, folder), *sheet_rows(name, sheets, folder, thorough)]


# -- what the project's files say ----------------------------------------------------------------------------------------


def sheet_rows(name: str, made: CutSheets, folder: Path, thorough: bool) -> list[Row]:
    """Check segments, corners, holding tabs and labels, and the drawings as read by ezdxf and svgelements."""
    runs = [made.runs(k) for k in range(made.count)]
    curves = [c for r in runs for c in (*r.inner, *r.outer)]
    least = 1e3 * min(float(np.linalg.norm(np.diff(c.points, axis=0), axis=1).min()) for c in curves)
    found = [row(name, "shortest segment, mm", ">= 0.02", round(least, 4), least >= 0.02 - 1e-9)]
    report = made.connections.report
    if "connector_rounding_min_mm" in report:
        found.append(at_least(name, "sharpest corner of connectors, mm", 0.199, report["connector_rounding_min_mm"]))
    if made.cut.tabs and not made.cut.lead_in:
        off = 1e3 * max(map(abs, (gap - made.cut.tab_width - made.cut.kerf_outline for r in runs for gap in _gaps(r))))
        found.append(at_most(name, "holding tabs off their width, mm", 0.01, off))
    if made.cut.nozzle:  # arms of 1 mm are thinner than two printed lines
        told = sum("nozzle" in text for text in made.warnings)
        found.append(at_least(name, "warnings of arms under two lines", 1, told))
    found.append(at_most(name, "labels without room", 0, made.labels_left_out))
    faults = sum(_drawing_faults(path, made) for path in written(made, folder, thorough))
    found.append(at_most(name, "faults that ezdxf and svgelements find", 0, faults))
    return found


def written(made: CutSheets, folder: Path, thorough: bool) -> list[Path]:
    """Write the drawings of the first sheet, or with ``thorough`` of all sheets."""
    paths = []
    for key in ("svg", "dxf", "dxf-r12"):
        for index in range(made.count if thorough else 1):
            ending = export.TABLE[key].ending
            paths.append(folder / f"sheet{ending.replace('.', f'-{index + 1:02d}.')}")
            export.TABLE[key].write(made, index, paths[-1], SILENT)
    return paths


def _gaps(runs: SheetCuts) -> Iterator[float]:
    """Return the gaps (metres) of the holding tabs: from the end of each part of an outline to the start of the next."""
    ends = np.array([c.points[-1] for c in runs.outer if not c.closed]).reshape(-1, 2)
    starts = np.array([c.points[0] for c in runs.outer if not c.closed]).reshape(-1, 2)
    for end in ends:
        yield float(np.linalg.norm(starts - end, axis=1).min())


def _drawing_faults(path: Path, made: CutSheets) -> int:
    """Count faults of a drawing: errors of ezdxf's audit, wrong extent, zero bulges in R12, closed paths that repeat their start."""
    index = int(path.stem.rpartition("-")[2]) - 1
    size = 1e3 * made.packing.sizes[index]
    if path.suffix == ".dxf":
        import ezdxf

        document = ezdxf.readfile(path)
        low, high = (np.array(document.header[name][:2]) for name in ("$EXTMIN", "$EXTMAX"))
        wrong = int(np.abs(low).max() > 0.01 or np.abs(high - size).max() > 0.01)
        zero = "r12" in path.name and re.search(r"\n *42\n *0(\.0*)?\n", path.read_text(encoding="latin-1")) is not None
        return len(document.audit().errors) + wrong + zero
    if path.suffix == ".svg":
        data = re.findall(r' d="(M[^"]*)Z"', path.read_text(encoding="utf-8"))
        return sum(re.findall(r"-?[\d.e-]+ -?[\d.e-]+", one)[0] == one.rpartition("L")[2] for one in data)
    return 0


# -- travel ------------------------------------------------------------------------------------------------------------


def travel(curves: list[Curve], here: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the travel between curves in their order, in metres, and the end point."""
    way = 0.0
    for curve in curves:
        way += float(np.linalg.norm(curve.points[0] - here))
        here = curve.points[0] if curve.closed else curve.points[-1]
    return way, here


def travel_rows(name: str, made: CutSheets, folder: Path) -> list[Row]:
    """Measure the travel without cutting in each pass, over all sheets."""
    ours, peer, seconds = dict.fromkeys(PASSES, 0.0), dict.fromkeys(PASSES, 0.0), 0.0
    vpype = os.environ.get("FLEXMAPS_VPYPE") or shutil.which("vpype")
    for index in range(made.count):
        begun = time.process_time()
        runs = made.runs(index)
        seconds += time.process_time() - begun
        here = np.zeros(2)
        for word, curves in zip(PASSES, (runs.engraved, runs.inner, runs.outer), strict=True):
            way, here = travel(list(curves), here)
            ours[word] += way
            if vpype and curves:
                peer[word] += sorted_travel(list(curves), folder, vpype)
    found = [at_most(name, "runs, processor s", None, seconds)]
    for word in PASSES:
        if vpype:
            found.append(
                at_most(name, f"travel {word}, m", TRAVEL * peer[word], ours[word], {"vpype": round(peer[word], 3)})
            )
        else:
            found.append(note(name, f"travel {word}, m", ours[word], {"vpype": "not installed"}))
    return found


def sorted_travel(curves: list[Curve], folder: Path, vpype: str) -> float:
    """Return the travel in the order of vpype's linesort, which starts at the origin and may reverse curves, in metres."""
    lines = [c.sampled(1e-4) for c in curves]
    lines = [np.concatenate([p, p[:1]]) if c.closed else p for c, p in zip(curves, lines, strict=True)]
    np.random.default_rng(0).shuffle(lines)  # type: ignore[arg-type]  # vpype keeps an order that it cannot improve
    paths = "".join(f'<path d="M{" ".join(f"{x:.4f},{y:.4f}" for x, y in p * 1e3)}"/>' for p in lines)
    before, after = folder / "before.svg", folder / "after.svg"
    before.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 600 400" fill="none" stroke="#000">{paths}</svg>'
    )
    command = [vpype, "read", "-q", "0.01mm", str(before), "linesort", "write", "-f", "svg", str(after)]
    subprocess.run(command, check=True, capture_output=True)
    here, way = np.zeros(2), 0.0
    for points in svg_lines(after):
        way += float(np.linalg.norm(points[0] - here))
        here = points[-1]
    return 1e-3 * way


def svg_lines(path: Path) -> list[np.ndarray]:
    """Read the lines of an SVG file by vpype, in its own unit."""
    import svgelements

    found: list[Any] = []
    for shape in svgelements.SVG.parse(str(path)).elements():
        if isinstance(shape, svgelements.Shape):
            for part in svgelements.Path(shape).as_subpaths():
                points = [(s.end.x, s.end.y) for s in svgelements.Path(part) if s.end is not None]
                found.append(np.array(points))
    return [p * 1.0 for p in found if len(p)]

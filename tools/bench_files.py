"""Measures the files of sheets in the programs that read them: travel, labels, segments, and what FreeCAD, LibreCAD, Inkscape, and a slicer find.

python3 tools/dev.py bench files [--meshes DIR] [--json FILE] [--only NAME ...]

A program that is not installed is named. Travel is compared with vpype's ``linesort`` of the same curves where ``vpype`` is installed
(``pip install vpype`` in any environment; FLEXMAPS_VPYPE is its path).
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from bench_layout import EDGE, surfaces
from flexmaps.engine.fabrication.sheets import CutSheets
from flexmaps.engine.params import Settings, changed
from flexmaps.engine.runs import job
from flexmaps.engine.spirals.arcs import Curve
from flexmaps.engine.surface.checking import check
from rows import Row, Table, at_most, row

MESHES = ("made:demo", "vault", "cubesphere", "three_holes")
TRAVEL = 1.1  # times the way of vpype's linesort
PASSES = ("engraved", "inner", "outer")  # in the order of the work


def main(arguments: list[str]) -> int:
    """Measure every mesh, print the table, write the rows; 0 whatever was measured."""
    root = Path(__file__).resolve().parent.parent
    parser = argparse.ArgumentParser(prog="dev.py bench files")
    shared = root.parent / "shared" / "meshes"
    parser.add_argument(
        "--meshes", type=Path, default=shared if shared.is_dir() else None, help="folder of quad meshes"
    )
    parser.add_argument("--json", type=Path, help="write the rows here too")
    parser.add_argument("--only", nargs="*", default=MESHES, help="only meshes of these names")
    options = parser.parse_args(arguments)
    table = Table(36)
    for name, polygons in surfaces(options.meshes):
        if name not in options.only:
            continue
        made = job.run(check.scaled(polygons, edge=EDGE), changed(Settings(), {"sheet.nesting": "FAST"})).sheets
        assert made is not None
        with tempfile.TemporaryDirectory() as folder:
            table.add(*travel_rows(name, made, Path(folder)), *curve_rows(name, made))
    table.finish(options.json)
    return 0


def travel(curves: list[Curve], here: np.ndarray) -> tuple[float, np.ndarray]:
    """Metres between curves in their order, and where that ends."""
    way = 0.0
    for curve in curves:
        way += float(np.linalg.norm(curve.points[0] - here))
        here = curve.points[0] if curve.closed else curve.points[-1]
    return way, here


def travel_rows(name: str, made: CutSheets, folder: Path) -> list[Row]:
    """The way of every pass without cutting, over all sheets."""
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
            found.append(row(name, f"travel {word}, m", "", ours[word], None, {"vpype": "not installed"}))
    return found


def sorted_travel(curves: list[Curve], folder: Path, vpype: str) -> float:
    """Metres between curves in the order of vpype's linesort, which may turn every curve round, from the origin on."""
    lines = [c.sampled(1e-4) for c in curves]
    lines = [np.concatenate([p, p[:1]]) if c.closed else p for c, p in zip(curves, lines, strict=True)]
    np.random.default_rng(0).shuffle(lines)  # type: ignore[arg-type]  # vpype keeps an order that it cannot better
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
    """The lines of a file of vpype in its own unit."""
    import svgelements

    found: list[Any] = []
    for shape in svgelements.SVG.parse(str(path)).elements():
        if isinstance(shape, svgelements.Shape):
            for part in svgelements.Path(shape).as_subpaths():
                points = [(s.end.x, s.end.y) for s in svgelements.Path(part) if s.end is not None]
                found.append(np.array(points))
    return [p * 1.0 for p in found if len(p)]


def curve_rows(name: str, made: CutSheets) -> list[Row]:
    """Segments and labels."""
    curves = [c for k in range(made.count) for c in (*made.runs(k).inner, *made.runs(k).outer)]
    least = 1e3 * min(float(np.linalg.norm(np.diff(c.points, axis=0), axis=1).min()) for c in curves)
    return [row(name, "shortest segment, mm", ">= 0.02", round(least, 4), least >= 0.02 - 1e-9)]


if __name__ == "__main__":
    import sys

    sys.exit(main(sys.argv[1:]))

"""Benchmark of the sheets' files: travel, labels and segments, and faults of the drawings.

It measures small sheets of every kind (``sheet_kinds.py``) and those of the demo; ``--thorough`` adds larger meshes. FreeCAD, LibreCAD
and Inkscape read the files in the tests of the tier ``files``. Travel is compared with vpype's ``linesort`` of the same curves if
``vpype`` is installed (``pip install vpype`` in any environment; FLEXMAPS_VPYPE is its path).
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from functools import partial
from pathlib import Path

import ezdxf
import numpy as np
import svgelements
from flexmaps.engine.fabrication.sheets import CutSheets
from flexmaps.engine.fabrication.writers import export
from flexmaps.engine.progress import SILENT
from flexmaps.engine.spirals.curves.arcs import Curve
from flexmaps.engine.surface.mesh import PolygonMesh
from harness import Bench, Cases, Options, Rows, at_least, at_most, for_each, run_job, surfaces
from sheet_kinds import KINDS

QUICK = (*KINDS, "made:demo")
LARGE = ("made:demo", "vault", "cubesphere", "three_holes")
TRAVEL = 1.1  # largest travel over that of vpype's linesort
PASSES = ("engraved", "inner", "outer")  # in the order of cutting
FOLDER = tempfile.TemporaryDirectory()  # of the files, until the bench ends
VPYPE = os.environ.get("FLEXMAPS_VPYPE") or shutil.which("vpype")


def cases(options: Options) -> Cases:
    large = {name: make for name, make in surfaces(options).items() if name in LARGE}
    small = {name: partial(kind, Path(FOLDER.name)) for name, kind in KINDS.items()}
    return for_each(sheet_rows, small) | for_each(rows_of_mesh, large)


def rows_of_mesh(name: str, polygons: PolygonMesh, options: Options) -> Rows:
    """Lay the panels of a mesh on sheets, and return the rows on their files."""
    sheets = run_job(polygons, "sheets", values={"sheet.nesting": "FAST"}).sheets
    return [*travel_rows(name, sheets), *sheet_rows(name, sheets, options)]


def sheet_rows(name: str, sheets: CutSheets, options: Options) -> Rows:
    """Check segments and labels, and the drawings of the first sheet, or with ``--thorough`` of all, as others read them."""
    curves = [
        c
        for k in range(sheets.count)
        for c in (*sheets.cuts_on_sheet(k).inner_cuts, *sheets.cuts_on_sheet(k).outer_cuts)
    ]
    least = 1e3 * min(float(np.linalg.norm(np.diff(c.points, axis=0), axis=1).min()) for c in curves)
    faults = 0
    for index in range(sheets.count if options.thorough else 1):
        for key in ("dxf", "dxf-r12"):
            path = Path(FOLDER.name, f"{key}.dxf")
            export.FORMAT_TABLE[key].write(sheets, index, path, SILENT)
            faults += dxf_faults(path, 1e3 * sheets.packing.sizes[index])
    return [
        at_least(name, "shortest segment, mm", 0.02 - 1e-9, least),
        at_most(name, "labels without room", 0, sheets.labels_left_out),
        at_most(name, "faults that ezdxf finds", 0, faults),
    ]


def dxf_faults(path: Path, size: np.ndarray) -> int:
    """Count errors of ezdxf's audit, and whether the extent is not that of the sheet."""
    document = ezdxf.readfile(path)  # type: ignore[attr-defined]
    low, high = (np.array(document.header[name][:2]) for name in ("$EXTMIN", "$EXTMAX"))
    return len(document.audit().errors) + int(max(np.abs(low).max(), np.abs(high - size).max()) > 0.01)


def travel(lines: list[np.ndarray], here: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the travel between lines of points in their order, and the end point."""
    starts, ends = np.array([line[0] for line in lines]), np.array([here, *(line[-1] for line in lines)])
    return float(np.linalg.norm(starts.reshape(-1, 2) - ends[:-1], axis=1).sum()), ends[-1]


def travel_rows(name: str, sheets: CutSheets) -> Rows:
    """Measure the travel without cutting in each pass, over all sheets."""
    ours, peer = dict.fromkeys(PASSES, 0.0), dict.fromkeys(PASSES, 0.0)
    for index in range(sheets.count):
        runs, here = sheets.cuts_on_sheet(index), np.zeros(2)
        for word in PASSES:
            curves: list[Curve] = list(getattr(runs, word))
            ends = [c.points[[0, 0]] if c.closed else c.points[[0, -1]] for c in curves]
            way, here = travel(ends, here)
            ours[word] += way
            if VPYPE and curves:
                peer[word] += sorted_travel(curves)
    for word in PASSES:
        limit, vpype = (TRAVEL * peer[word], f"{peer[word]:.3f}") if VPYPE else (None, "not installed")
        yield at_most(name, f"travel {word}, m", limit, ours[word], {"vpype": vpype})


def sorted_travel(curves: list[Curve]) -> float:
    """Return the travel in the order of vpype's linesort, which starts at the origin and may reverse curves, in metres."""
    lines = [c.sample(1e-4) for c in curves]
    lines = [np.concatenate([p, p[:1]]) if c.closed else p for c, p in zip(curves, lines, strict=True)]
    np.random.default_rng(0).shuffle(lines)  # type: ignore[arg-type]  # vpype keeps an order that it cannot improve
    paths = "".join(f'<path d="M{" ".join(f"{x:.4f},{y:.4f}" for x, y in p * 1e3)}"/>' for p in lines)
    before, after = (Path(FOLDER.name, f"{name}.svg") for name in ("before", "after"))
    before.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 600 400" fill="none" stroke="#000">{paths}</svg>'
    )
    command = [VPYPE, "read", "-q", "0.01mm", str(before), "linesort", "write", "-f", "svg", str(after)]
    subprocess.run(command, check=True, capture_output=True)  # type: ignore[arg-type]
    found = [one for one in svgelements.SVG.parse(str(after)).elements() if isinstance(one, svgelements.Shape)]
    parts = [svgelements.Path(part) for shape in found for part in svgelements.Path(shape).as_subpaths()]
    points = [[(s.end.x, s.end.y) for s in part if s.end is not None] for part in parts]
    return 1e-3 * travel([np.array(line) for line in points if line], np.zeros(2))[0]


main = Bench("files", cases, quick=QUICK, meshes=True)

"""Benchmark of proposing layouts, beside the layout found by geometry alone: match, panels, symmetry and time.

python3 tools/dev.py bench panels [--meshes DIR] [--zoo PATTERNS] [--most QUADS] [--pictures DIR] [--json FILE]

Every surface is laid out as by default, and a layout is chosen twice: for a match of 1 %, and for as many panels as there are
now. All figures are those of long searches for spirals, see ``choosing.judge``. Open surfaces stand on their lowest quads.
What is in the JSON file is not measured again. Seconds depend on what else the machine does; the processor's, beside them, do
hardly: half of them is what two free cores take at best.
"""

from __future__ import annotations

import argparse
import fnmatch
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import zoo
from flexmaps.engine.display import plots, raster
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.extras.choosing.choice import INITIAL, Choice
from flexmaps.engine.extras.choosing.choose import choose
from flexmaps.engine.extras.choosing.judge import LayoutProblem
from flexmaps.engine.mechanics import loads
from flexmaps.engine.params import ChooseParams, Settings
from flexmaps.engine.progress import Progress
from flexmaps.engine.runs import job
from flexmaps.engine.surface.formats import meshio
from flexmaps.engine.surface.mesh import PolygonMesh
from flexmaps.engine.surface.symmetry import symmetries
from flexmaps.engine.workers import Workers
from harness import Bench
from PIL import Image
from rows import Row, at_least, at_most, row

MATCH = 1.0  # percent, asked of every surface
EDGE = 0.02  # metres
WORSE = 1.05  # ratio of distances above which a layout counts as worse
# percent; a match below it cannot be improved noticeably: 0.04 mm in a piece of 400 mm, less than a laser's kerf varies
EXACT = 0.01
PICTURE = 160  # pixels


def main(arguments: list[str]) -> int:
    """Measure, print the table and write the rows; return 0 whatever the figures."""
    bench = Bench(
        "panels",
        arguments,
        32,
        only="*",
        meshes=True,
        resume=True,
        zoo=("", "patterns of names of the zoo, with commas"),
        most=(1100, "largest number of quads"),
        pictures=(Path, "folder for a picture of every surface's proposals"),
    )
    for name, polygons in bench.fresh(surfaces(bench.options)):
        bench.measure(measure, name, polygons, bench.options)
    return bench.finish(*summed(bench.table.rows))


def surfaces(options: argparse.Namespace) -> Iterator[tuple[str, PolygonMesh]]:
    """Yield names and polygons of the surfaces to measure."""
    for name, surface in zoo.SURFACES.items():
        asked = any(fnmatch.fnmatch(name, pattern) for pattern in options.zoo.split(","))
        if asked and not surface.refused and surface.remesh is None:
            yield name, surface.polygons()
    for path in sorted(options.meshes.rglob("*.o*")) if options.meshes else ():
        if path.suffix in {".obj", ".off"} and any(fnmatch.fnmatch(path.stem, p) for p in options.only.split(",")):
            yield path.stem, meshio.read(str(path))


def measure(name: str, polygons: PolygonMesh, options: argparse.Namespace) -> list[Row]:
    """The rows of one surface; none where it is too large."""
    try:
        begun = job.begin(polygons, edge=EDGE)
    except FlexMapsError:
        return []  # no mesh of quads
    if len(begun.mesh.quads) > options.most:
        return []
    settings = Settings()
    open_surface = bool(begun.mesh.border.any())
    found = job.run(polygons, settings, edge=EDGE, supports="lowest" if open_surface else None, stop_after="split")
    assert found.flat is not None
    mesh = found.mesh
    held = loads.parse_supports(mesh, "lowest") if open_surface else None
    piece = LayoutProblem(mesh, settings, held, None, tuple(symmetries(mesh)))
    began = processor()
    match, first, seconds = _chosen(piece, found.flat, ChooseParams(match=MATCH))
    spent = processor() - began
    panels = len(found.flat.layout.patches)
    same, _, more = _chosen(piece, found.flat, ChooseParams(goal="panels", panels=panels))
    given = next(one for one in (*same.proposals, *match.proposals) if one.judged.laid.origin == INITIAL)
    if options.pictures:
        _picture(match, options.pictures / f"{name}.png")
    best, alike = match.best, same.best
    symmetric = any(one.symmetric for one in (*match.proposals, *same.proposals))
    return [
        row(name, "quads", "", len(mesh.quads), None),
        row(name, "panels today", "", panels, None),
        row(name, "RMS % today", "", float(f"{100 * given.rms:.4g}"), None),
        at_most(name, "panels for the match", 2 * panels, best.panels),
        row(
            name,
            "RMS % for the match",
            f"<= {MATCH:g}",
            round(100 * best.rms, 3),
            match.reached,
            {"note": match.note[:150]},
        ),
        at_most(name, "RMS % with today's panels", 100 * WORSE * given.rms, 100 * alike.rms),
        *(
            [row(name, "a symmetric proposal", "yes", "yes" if symmetric else "no", symmetric)]
            if piece.symmetries
            else []
        ),
        at_most(name, "seconds until the first", 5.0, round(first, 1)),
        at_most(name, "seconds", 60.0, round(seconds, 1), {"panels": round(more, 1), "processor": round(spent, 1)}),
    ]


def _chosen(piece: LayoutProblem, flat: Any, params: ChooseParams) -> tuple[Choice, float, float]:
    """Return the choice, the seconds until the first layout was judged, and the total."""
    began, first = time.perf_counter(), list[float]()

    def tell(fraction: float, text: str) -> None:
        if "the best" in text and not first:
            first.append(time.perf_counter() - began)

    with Workers() as together:
        made = choose(piece, flat, params, Progress(tell), together)
    seconds = time.perf_counter() - began
    return made, first[0] if first else seconds, seconds


def processor() -> float:
    """Return the processor seconds of this process and of its finished child processes."""
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system


def _picture(choice: Choice, path: Path) -> None:
    drawn = []
    for one in choice.proposals:
        layout = one.flat.layout
        mesh = layout.mesh
        small = plots.thumbnail(mesh.vertices, mesh.quads, layout.outline_sides, layout.patch_of, PICTURE)
        drawn.append(raster.pixels(small, {}))
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.round(255 * np.concatenate(drawn, axis=1)).astype(np.uint8)).save(path)


def summed(rows: list[Row]) -> list[Row]:
    """Return the rows over all surfaces."""
    value: dict[str, dict[str, Any]] = {}
    for one in rows:
        value.setdefault(one["mesh"], {})[one["row"]] = one["measured"]
    full = [v for v in value.values() if "RMS % for the match" in v]
    if not full:
        return []
    rms = np.array([v["RMS % for the match"] for v in full])
    more = np.array([v["panels for the match"] / v["panels today"] for v in full])
    today, alike = (np.array([v[n] for v in full]) for n in ("RMS % today", "RMS % with today's panels"))
    return [
        row("all", "surfaces", "", len(full), None),
        at_most(
            "all",
            "median RMS % for the match",
            MATCH,
            float(np.median(rms)),
            {"today": round(float(np.median(today)), 3)},
        ),
        at_most("all", "median panels over today's", 2.0, float(np.median(more))),
        at_least(
            "all",
            "share that reach the match",
            0.8,
            float((rms <= MATCH).mean()),
            {"today": round(float((today <= MATCH).mean()), 2)},
        ),
        at_least(
            "all",
            "share nearer, panels alike",
            0.7,
            float((alike < today * (1.0 - 1e-3))[today > EXACT].mean()),
            {"exact today": int((today <= EXACT).sum())},
        ),
        at_most("all", "farther by 5 %, panels alike", 0, int((alike > WORSE * today + 1e-3).sum())),
        at_most("all", "median seconds", 60.0, float(np.median([v["seconds"] for v in full]))),
    ]

"""Benchmark of *Propose layouts* on a piece that was made fit: panels, match, seconds of processor, and the messages on the way.

python3 tools/dev.py bench choose [--thorough] [--only PATTERNS] [--quads N] [--json FILE]

Every surface is laid out and optimised as by default. Where that misses the usual match, layouts are proposed, and what is taken is
optimised again. The quick ones are a few; ``--thorough`` takes Blender's primitives, some of the zoo and the meshes beside the checkout. Surfaces
that do not consist of about so many quads are remeshed. What is in the JSON file is not measured again. Seconds are the processor's,
those of other processes included; the time left is told by a clock, so that it depends on what else the machine does.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import bpy
import numpy as np
from flexmaps.engine.extras.choosing.choice import INITIAL, Choice
from flexmaps.engine.params import Settings
from flexmaps.engine.progress import Progress
from flexmaps.engine.remaining import Remaining
from flexmaps.engine.runs import job
from flexmaps.engine.runs.result import Result
from flexmaps.engine.surface.mesh import PolygonMesh
from harness import EDGE, MESHES, Bench, Surfaces, from_folder, from_zoo, processor
from rows import Row, at_most, note
from zoo import trial

PRIMITIVES = ("cube", "uv_sphere", "cylinder", "cone", "monkey")
PREFIX = "blender-"  # of their names here: the zoo has a cube too
ZOO = ("spindle", "star5", "elbow", "catenoid", "hypar", "terrain-rough", "dome-oculus", "genus2")  # one a family
QUICK = ("blender-cone", "blender-cylinder", "vault")
USUAL = 500  # quads: the default
LARGEST = 2.5  # times as many are remeshed
SAME = 1.03  # ratio of distances by which two searches of the same layout differ
SECONDS, FIRST = 60.0, 5.0  # of processor that are asked for: in all, and until the first proposal
RISE = 1.5  # ratio by which the time left may rise
SEARCH = ("spirals", "optimise", "simulate")
SMALL = 6  # quads: a panel of fewer is hard to handle


def main(arguments: list[str]) -> int:
    """Measure, print the table, write the rows; return 0 whatever the figures."""
    thorough, quads = (False, "all surfaces"), (USUAL, "so many where a surface is remeshed")
    bench = Bench("choose", arguments, 34, only="", resume=True, thorough=thorough, quads=quads)
    if not bench.options.only:
        bench.options.only = "*" if bench.options.thorough else ",".join(QUICK)
    primitives: Surfaces = {PREFIX + name: partial(_primitive, name) for name in PRIMITIVES}
    bench.each(
        measure_layouts, primitives | from_zoo(*ZOO) | from_folder(MESHES, "**/*.o[bf][jf]"), bench.options.quads
    )
    return bench.finish()


def _primitive(name: str) -> PolygonMesh:
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    getattr(bpy.ops.mesh, f"primitive_{name}_add")()
    mesh = bpy.context.object.data
    points = np.array([vertex.co for vertex in mesh.vertices])
    corners = np.array([loop.vertex_index for loop in mesh.loops])
    return PolygonMesh(points, corners, np.array([polygon.loop_total for polygon in mesh.polygons]))


def measure_layouts(name: str, polygons: PolygonMesh, quads: int) -> list[Row]:
    """Return the rows of one surface."""
    settings = Settings()
    count = len(polygons.sizes)
    if (polygons.sizes != 4).any() or not quads / LARGEST <= count <= LARGEST * quads:
        polygons = trial.remeshed(polygons, quads)
    laid = job.run(polygons, settings, edge=EDGE, stop_after="split")
    given = job.run_stages(laid, settings, SEARCH)
    if _rms(given) <= settings.choose.match:
        return [*_by_default(name, given), _small(name, given)]
    watch, began = _Watch(), processor()
    chosen = job.run_stages(given, settings, ("choose",), Progress(watch.report))
    spent = processor() - began
    again = chosen if chosen.design is not None else job.run_stages(chosen, settings, SEARCH)
    assert chosen.choice is not None
    return _rows(name, given, chosen.choice, again, watch, spent)


@dataclass
class _Watch:
    """Record of the progress: time of the first proposal, and the predicted time left.

    first : seconds of processor, infinite before; least : seconds, the shortest time left that was told
    rise : the largest ratio of a time left to the shortest one before, of which ``FIRST`` seconds count at least
    """

    first: float = np.inf
    least: float = np.inf
    rise: float = 1.0
    began: float = field(default_factory=time.monotonic)
    used: float = field(default_factory=processor)
    remaining: Remaining = field(default_factory=Remaining)

    def report(self, fraction: float, text: str) -> None:
        now = time.monotonic() - self.began
        if "the best" in text:
            self.first = min(self.first, processor() - self.used)
        self.remaining.report(now, fraction)
        left = self.remaining.seconds(now)
        if left is not None:
            self.least = min(self.least, left)
            self.rise = max(self.rise, left / max(self.least, FIRST))


def _rows(name: str, given: Result, choice: Choice, again: Result, watch: _Watch, spent: float) -> list[Row]:
    before, after = _rms(given), _rms(again)
    best = choice.best
    stays = best.judged.laid.origin == INITIAL
    peer: dict[str, Any] = {"stays": stays, "judged": choice.judged, "note": choice.note[:120]}
    allowed = max(SAME * before, Settings().choose.match) if choice.reached else SAME * before
    return [
        *_by_default(name, given),
        note(name, "panels taken", best.panels, peer),
        note(name, "RMS % as proposed", float(f"{100.0 * best.rms:.4g}")),
        at_most(name, "RMS % after the search", allowed, after),
        _small(name, again),
        at_most(name, "seconds until the first proposal", FIRST, watch.first),
        at_most(name, "seconds of processor", SECONDS, spent),
        at_most(name, "largest rise of the time left", RISE, watch.rise),
    ]


def _by_default(name: str, given: Result) -> list[Row]:
    assert given.flat is not None
    return [
        note(name, "quads", len(given.mesh.quads)),
        note(name, "panels by default", len(given.flat.layout.patches)),
        note(name, "RMS % by default", float(f"{_rms(given):.4g}")),
    ]


def _small(name: str, result: Result) -> Row:
    assert result.flat is not None
    sizes = [len(patch) for patch in result.flat.layout.patches]
    return at_most(name, f"panels under {SMALL} quads", 0, sum(size < SMALL for size in sizes))


def _rms(result: Result) -> float:
    assert result.simulation is not None
    return float(result.simulation.match["rms_percent"])

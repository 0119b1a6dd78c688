"""Benchmark of layouts: panels and match by default, and after the cures that *Optimise* offers where a piece misses the wanted match.

Every surface is laid out and optimised as by default. Where that misses the wanted match, layouts are proposed, and what is taken is
optimised again; then the piece as it was is optimised on the supports that are predicted to bring it nearest, if any are. Surfaces that do not consist of about so many quads are remeshed. Seconds are the processor's, those of other processes
included; the time left is told by a clock, so that it depends on what else the machine does.
"""

from __future__ import annotations

import time
from functools import partial
from typing import Any

import numpy as np
from bench_first import OBJECTS
from flexmaps.engine.extras.choosing.choice import INITIAL_ORIGIN
from flexmaps.engine.extras.choosing.prospects import find_prospects, support_options
from flexmaps.engine.params import Settings
from flexmaps.engine.progress import Progress
from flexmaps.engine.remaining import RemainingTime
from flexmaps.engine.runs import job
from flexmaps.engine.surface.mesh import PolygonMesh
from harness import (
    MESHES,
    Bench,
    Cases,
    Options,
    Rows,
    at_most,
    from_blender,
    from_folder,
    from_zoo,
    processor_seconds,
    run_job,
)
from zoo import trial

PRIMITIVES = ("cube", "uv sphere", "cylinder", "cone", "monkey")
ZOO = ("spindle", "star5", "elbow", "catenoid", "hypar", "terrain-rough", "dome-oculus", "genus2")  # one a family
QUICK = ("blender-cone", "blender-cylinder", "vault")
USUAL = 500  # quads: the default
LARGEST = 2.5  # times as many are remeshed
SAME = 1.03  # ratio of distances by which two searches of the same layout differ
SECONDS, FIRST = 60.0, 5.0  # of processor that are asked for: in all, and until the first proposal
RISE = 1.5  # ratio by which the time left may rise
SEARCH = ("spirals", "optimise", "simulate")
SMALL = 6  # quads: a panel of fewer is hard to handle


def cases(_: Options) -> Cases:
    primitives = {f"blender-{name}": partial(from_blender, OBJECTS[name]) for name in PRIMITIVES}
    return primitives | from_zoo(*ZOO) | from_folder(MESHES, "**/*.o[bf][jf]")


def measure(name: str, polygons: PolygonMesh, options: Options) -> Rows:
    settings, quads = Settings(), options.quads
    if (polygons.sizes != 4).any() or not quads / LARGEST <= len(polygons.sizes) <= LARGEST * quads:
        polygons = trial.remesh_into_quads(polygons, quads)
    first: Any = job.run_stages(run_job(polygons, "split"), settings, SEARCH)
    again, before, panels = first, _rms(first), len(first.flat.layout.patches)
    yield at_most(name, "RMS % by default", None, before, {"quads": len(first.mesh.quads), "panels": panels})
    if before > settings.choose.match:
        watch = _Watch()
        chosen: Any = job.run_stages(first, settings, ("choose",), Progress(watch.report))
        spent = processor_seconds() - watch.used
        choice, best = chosen.choice, chosen.choice.best
        again = chosen if chosen.design is not None else job.run_stages(chosen, settings, SEARCH)
        allowed = max(SAME * before, settings.choose.match if choice.reached else 0.0)
        stays = {"stays": best.judged.laid.origin == INITIAL_ORIGIN, "judged": choice.judged, "note": choice.note[:120]}
        yield at_most(name, "panels taken", None, best.panels, stays)
        yield at_most(name, "RMS % after the search", allowed, _rms(again), {"as proposed": f"{100.0 * best.rms:.4g}"})
        yield at_most(name, "seconds until the first proposal", FIRST, watch.first)
        yield at_most(name, "seconds of processor", SECONDS, spent)
        yield at_most(name, "largest rise of the time left", RISE, watch.rise)
        held, how = _held(first, settings)
        yield at_most(name, "RMS % after one cure", settings.choose.match, min(_rms(again), held), how)
    small = sum(len(patch) < SMALL for patch in again.flat.layout.patches)
    yield at_most(name, f"panels under {SMALL} quads", 0, small)


def _held(first: Any, settings: Settings) -> tuple[float, dict[str, Any]]:
    """Return the RMS distance in percent on the best supports that *Optimise* offers, infinite without any, and what was offered."""
    offered, ways = find_prospects(first.simulation, first.limits, settings) or {}, dict(support_options(first.mesh))
    where = next((way for way in offered if way in ways), None)
    if where is None:
        return np.inf, offered
    found: Any = job.run_stages(first.with_user(supports=ways[where]), settings, SEARCH[1:])
    return _rms(found), {"held": where, **offered}


class _Watch:
    """Record of the progress: time of the first proposal, and the predicted time left.

    first : seconds of processor, infinite before; least : seconds, the shortest time left that was told
    rise : the largest ratio of a time left to the shortest one before, of which ``FIRST`` seconds count at least
    """

    def __init__(self) -> None:
        self.first, self.least, self.rise = np.inf, np.inf, 1.0
        self._began, self.used, self._remaining = time.monotonic(), processor_seconds(), RemainingTime()

    def report(self, fraction: float, text: str) -> None:
        now = time.monotonic() - self._began
        if "the best" in text:
            self.first = min(self.first, processor_seconds() - self.used)
        self._remaining.report(now, fraction)
        left = self._remaining.seconds(now)
        if left is not None:
            self.least = min(self.least, left)
            self.rise = max(self.rise, left / max(self.least, FIRST))


def _rms(result: Any) -> float:
    return float(result.simulation.target_distances["rms_percent"])


main = Bench(
    "choose", cases, measure, quick=QUICK, resume=True, quads=(USUAL, "so many where a surface is remeshed"),
)  # fmt: skip

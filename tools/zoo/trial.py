"""Trial of one surface: the whole main job in a separate process, with its results, their quality and their cost."""

from __future__ import annotations

import json
import math
import os
import resource
import time
import traceback
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.materials import OVERSTRAIN_SHARE
from flexmaps.engine.params import ObjectSettings, Settings
from flexmaps.engine.progress import Progress
from flexmaps.engine.runs import job, report
from flexmaps.engine.spirals.design import SpiralDesign
from flexmaps.engine.surface.checking import check
from flexmaps.engine.surface.mesh import PolygonMesh
from harness import EDGE, processor_seconds

NESTING = 1.0  # seconds
WORSE = 1.005  # the same figure of two simulations differs by less than this from rounding
PHYSICS = ("not-optimised", "not-simulated")
TRUE = 1e-6  # metres, tolerance of polylines for arcs
MOST = 0.98  # width of the test's cutter over the smallest slot, and over the thinnest arm


class Clock:
    """Records from the progress the time of every stage and the longest silence.

    wall, busy : seconds of every stage, of the clock and of all processor cores, child processes included
    silence : longest time of this process between two calls of the progress, with the stage; part : what is written at
    every stage's start, so that a killed process leaves word
    """

    def __init__(self, part: Path | None):
        self.wall: dict[str, float] = {}
        self.busy: dict[str, float] = {}
        self.silence: dict[str, float] = {}
        self.stage = ""
        self._part = part
        self._start, self._told = (time.monotonic(), processor_seconds()), time.process_time()

    def __call__(self, fraction: float, text: str) -> None:
        now, told = (time.monotonic(), processor_seconds()), time.process_time()
        if self.stage:
            quiet = told - self._told
            self.silence[self.stage] = round(max(self.silence.get(self.stage, 0.0), quiet), 3)
            self.wall[self.stage] = round(now[0] - self._start[0], 3)
            self.busy[self.stage] = round(now[1] - self._start[1], 3)
        if text in job.STAGE_NAMES and text != self.stage:
            self.stage, self._start = text, now
            self._write()
        self._told = told

    def _write(self) -> None:
        if self._part is not None:
            self._part.write_text(json.dumps({"stage": self.stage, "wall": self.wall, "busy": self.busy}))


def run(
    make: Callable[[], PolygonMesh],
    *,
    supports: str | None = None,
    remesh: int | None = None,
    optimised: bool = True,
    settings: Settings | None = None,
    part: Path | None = None,
) -> tuple[dict[str, Any], job.Result | None]:
    """The record of a surface, plain JSON types, and what the job made, ``None`` where it ended early.

    ``remesh`` is the number of quads that Blender's remesh makes of triangles before; ``part`` as in ``Clock``.
    """
    clock = Clock(part)
    settings = settings or settings_used()
    record: dict[str, Any] = {}
    result = polygons = None
    try:
        polygons = make()
        record["quads"] = len(polygons.sizes)
        if remesh is not None:
            polygons = remesh_into_quads(polygons, remesh)
        result = job.run(
            polygons, settings, edge=EDGE, optimised=optimised, supports=supports, progress=Progress(report=clock)
        )
        record |= describe(result, settings)
    except FlexMapsError as error:
        record["refused"] = str(error)
        if polygons is not None:
            scaled = check.scale_to_metres(polygons, edge=EDGE)
            record["findings"] = [finding.code for finding in check.findings(scaled)]
    except Exception:
        record["traceback"] = traceback.format_exc()
    return record | {"ended_in": clock.stage, "wall": clock.wall, "busy": clock.busy, "silence": clock.silence}, result


def settings_used(**optimise: Any) -> Settings:
    """The usual settings, but for the time that nesting may take: that is a limit and no cost, and the same for all."""
    usual = Settings()
    return replace(
        usual,
        sheet=replace(usual.sheet, nesting_seconds=NESTING),
        optimise=replace(usual.optimise, **optimise),
    )


def remesh_into_quads(polygons: PolygonMesh, count: int) -> PolygonMesh:
    """Quads by Blender's tools, as ``run --remesh`` makes them."""
    from flexmaps.bridge.hosts import job_folder, remesh

    with job_folder.suppress_output():
        return remesh.make_quads(polygons, count, ObjectSettings()).polygons


def describe(result: job.Result, settings: Settings) -> dict[str, Any]:
    """The figures of a job that came to its end."""
    full = report.build_report(result, source="")
    assert result.flat is not None
    layout, block = result.flat.layout, full["layout"]
    sizes = np.array([len(quads) for quads in layout.patches])
    body = result.mesh.body_of
    whole = np.bincount(body)[body] == 1  # quads that are a body by themselves
    alone = np.array([q[0] for q in layout.patches if len(q) == 1 and not whole[q[0]]], dtype=int)
    bad = result.flat.energy[alone] > settings.layout.distortion_limit
    found = list(full["checks"])
    if result.simulation is not None:
        found += [finding.as_dict() for finding in result.simulation.findings]
    record = {
        "quads": full["input"]["quads"],
        "patches": len(sizes),
        "median": float(np.median(sizes)),
        "sizes": sizes.tolist(),
        "alone": len(alone),
        "alone_own_e": int(bad.sum()),
        "e_max": block["energy_max"],
        "findings": [check["code"] for check in found],
        "left_out": [check["message"] for check in found if check["code"] in PHYSICS],
        "sheets": full.get("sheets", {}).get("sheets", 0),
        "memory_mb": memory(),
    }
    if result.design is not None:
        record["uncuttable"] = count_uncuttable(result.design)
    if result.optimisation is not None:
        record |= _describe_search(result, full["optimise"])
    if result.simulation is not None:
        made = full["equilibrium"]
        record |= {
            "rms_percent": made["rms_percent"],
            "rmse_mm": made["laplacian_rmse_mm"],
            "strain": made.get("strain_share_max"),
        }
    record["not_finite"] = not_finite(full)
    return record


def _describe_search(result: job.Result, block: dict[str, Any]) -> dict[str, Any]:
    assert result.optimisation is not None
    before, after = result.optimisation.before.report(), result.optimisation.after.report()
    strained = (
        before.get("strain_share_max", 0.0) > OVERSTRAIN_SHARE
        and after["strain_share_max"] < before["strain_share_max"]
    )
    worse = after["laplacian_rmse_mm"] > WORSE * before["laplacian_rmse_mm"] and not strained
    return {
        "rmse_mm_before": before["laplacian_rmse_mm"],
        "worse": bool(worse),
    }


def count_uncuttable(design: SpiralDesign) -> int:
    """Count the panels that touch themselves, or whose slots close or arms break for a cutter a little thinner than these."""
    slot, arm = design.params.slot_min, float(design.width.min())
    count = 0
    for outline in design.outlines():
        panel = shapely.Polygon(outline.outer.sample(TRUE), [hole.sample(TRUE) for hole in outline.holes])
        whole = panel.is_valid and len(panel.buffer(0.5 * MOST * slot).interiors) == len(outline.holes)
        count += not (whole and panel.buffer(-0.5 * MOST * arm).geom_type == "Polygon")
    return count


def not_finite(value: Any, path: str = "") -> list[str]:
    """List the places in a report with a NaN or infinite number."""
    if isinstance(value, dict):
        return [found for key, each in value.items() for found in not_finite(each, f"{path}.{key}".lstrip("."))]
    if isinstance(value, list):
        return [found for each in value for found in not_finite(each, path)][:1]
    return [path] if isinstance(value, float) and not math.isfinite(value) else []


def memory() -> float:
    """Peak memory in MB, of this process and of the largest of its children."""
    peak = report.peak_memory() or 0.0
    return round((peak + resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024) / 1e6, 1)


def write(path: Path, record: dict[str, Any]) -> None:
    """Write a record whole or not at all."""
    fresh = path.with_suffix(".new")
    fresh.write_text(json.dumps(record, indent=1, default=float) + "\n")
    os.replace(fresh, path)

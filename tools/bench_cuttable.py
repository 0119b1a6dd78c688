"""Check that every design on the path of a spiral search can be cut, on the surfaces of the zoo.

python3 tools/dev.py bench cuttable [--only PATTERNS] [--most SPIRALS] [--patience P] [--json FILE]

For every surface, five steps of the search are drawn at random, the last one included, and shapely judges their panels: outlines
must not touch themselves, and no slot may close and no arm break when offset by a cutter of nearly their smallest width.
"""

from __future__ import annotations

import argparse

import numpy as np
import shapely
import zoo
from flexmaps.engine.optimisation import codesign, optimise
from flexmaps.engine.optimisation.inverse import DesignPoint
from flexmaps.engine.optimisation.optimisers import SearchRecord
from flexmaps.engine.optimisation.search import FARTHER, Search
from flexmaps.engine.optimisation.task import Task
from flexmaps.engine.optimisation.work import Work
from flexmaps.engine.params import OptimiseParams, Settings, SimulateParams
from flexmaps.engine.progress import SILENT
from flexmaps.engine.runs import job
from flexmaps.engine.spirals.design import SpiralDesign
from flexmaps.engine.threads import one_thread
from harness import Bench
from rows import Row, at_most

STEPS = 5  # steps to judge per search
TRUE = 1e-6  # metres, tolerance of polylines for arcs
MOST = 0.98  # width of the test's cutter over the smallest slot, and over the thinnest arm


def main(arguments: list[str]) -> int:
    """Measure, print the table and write the rows; return 0 whatever the figures."""
    most, patience = (400, "largest number of spirals"), (0.3, "of the searches")
    bench = Bench("cuttable", arguments, 32, only="*", most=most, patience=patience)
    for name, surface in bench.cases(zoo.SURFACES.items()):
        if not surface.refused and surface.remesh is None:
            bench.measure(_rows, name, surface, bench.options)
    return bench.finish()


def _rows(name: str, surface: zoo.Surface, options: argparse.Namespace) -> list[Row]:
    found = job.run(surface.polygons(), Settings(), edge=0.02, supports=surface.supports, stop_after="spirals")
    return measure(name, found, options.patience) if len(found.mesh.quads) <= options.most else []


@one_thread
def measure(name: str, found: job.Result, patience: float) -> list[Row]:
    """Search with the default settings, and count the panels that cannot be cut."""
    design, params = found.design, OptimiseParams(patience=patience)
    assert design is not None
    task = Task(
        found.mesh,
        Settings().material.chosen,
        params,
        SimulateParams(),
        found.supports,
        None,
        Work.for_spirals(len(design.twist), patience),
    )
    problem, points = task.problem(design), list[DesignPoint]()
    starts = optimise.find_starts(problem, design, found.mesh, params, SILENT)
    start = min(starts.values(), key=lambda point: point.value)
    start = start.weighed(start.mismatch.value)
    Search(task, SearchRecord(), points.append, FARTHER * start.distance, design.flat).run([start], design, SILENT)
    rng = np.random.default_rng(len(points))
    chosen = (
        {len(points) - 1, *rng.choice(len(points), min(STEPS - 1, len(points)), replace=False)} if points else set()
    )
    designs = [codesign.to_design(points[k], design) for k in sorted(chosen)]
    faults = [0 if made is None else uncuttable(made) for made in designs]
    return [at_most(name, "panels that cannot be cut", 0, sum(faults), {"steps": f"{len(designs)} of {len(points)}"})]


def uncuttable(design: SpiralDesign) -> int:
    """Count the panels that touch themselves, or whose slots close or arms break for a cutter a little thinner than these."""
    slot, arm = design.params.slot_min, float(design.width.min())
    count = 0
    for outline in design.outlines():
        panel = shapely.Polygon(outline.outer.sampled(TRUE), [hole.sampled(TRUE) for hole in outline.holes])
        whole = panel.is_valid and len(panel.buffer(0.5 * MOST * slot).interiors) == len(outline.holes)
        count += not (whole and panel.buffer(-0.5 * MOST * arm).geom_type == "Polygon")
    return count

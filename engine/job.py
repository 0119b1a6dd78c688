"""The main job: from any polygon mesh to cut-ready sheets, stage by stage, without Blender."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from . import check, curvature, design, estimates, flatten, merge, regularise, sheets, simulate, split, trace
from .check import Finding
from .design import SpiralDesign
from .errors import FlexMapsError
from .estimates import Estimates
from .flatten import FlatPatches
from .mesh import PolygonMesh, QuadMesh
from .params import Settings
from .progress import SILENT, Progress
from .sheets import CutSheets
from .simulate import Simulation

# every stage with its share of the progress bar
STAGES = {
    "check": 0.05,
    "regularise": 0.15,
    "trace": 0.05,
    "merge": 0.35,
    "split": 0.05,
    "spirals": 0.1,
    "simulate": 0.1,
    "sheets": 0.15,
}


@dataclass(frozen=True)
class Result:
    """What the stages that ran have made; ``None`` where a stage has not run.

    source : the mesh as it came in, scaled to metres
    findings : what the check found, warnings included
    mesh : the quad mesh, regularised if that stage ran
    flat : the flat patches, of the last layout: traced, merged, and cut to the sheet's size
    design : the spirals
    simulation : the shape that the assembled object takes; also ``None``, with a finding, where its spirals are outside
        of what the elastic model knows and the job went on to the sheets
    sheets : the sheets to cut; estimates : what making them takes
    seconds : wall time of every stage that ran
    """

    source: PolygonMesh
    findings: list[Finding]
    mesh: QuadMesh
    flat: FlatPatches | None = None
    design: SpiralDesign | None = None
    simulation: Simulation | None = None
    sheets: CutSheets | None = None
    estimates: Estimates | None = None
    seconds: dict[str, float] = field(default_factory=dict)


class _Stages:
    """Gives every stage its part of the progress and notes how long it took."""

    def __init__(self, wanted: list[str], progress: Progress):
        self.seconds: dict[str, float] = {}
        self._progress = progress
        total = sum(STAGES[name] for name in wanted)
        starts = [sum(STAGES[name] for name in wanted[:k]) / total for k in range(len(wanted) + 1)]
        self._spans = dict(zip(wanted, pairwise(starts), strict=True))

    @contextmanager
    def __call__(self, name: str) -> Iterator[Progress]:
        part = self._progress.part(*self._spans[name])
        part(0.0, name)
        start = time.perf_counter()
        yield part
        self.seconds[name] = time.perf_counter() - start
        part(1.0, name)


def run(
    polygons: PolygonMesh,
    settings: Settings,
    *,
    edge: float | None = None,
    height: float | None = None,
    stop_after: str = "sheets",
    progress: Progress = SILENT,
) -> Result:
    """Run the stages in order, up to and including ``stop_after``.

    ``edge`` is the wanted median quad edge, ``height`` the wanted extent along z, both in metres; with neither, the mesh
    is taken to be in metres already. Raises ``FlexMapsError`` where the input or a setting does not allow a stage, and
    ``Cancelled`` when the progress asks to stop.
    """
    if stop_after not in STAGES:
        raise FlexMapsError(f"There is no stage '{stop_after}'; the stages are {', '.join(STAGES)}")
    last = list(STAGES).index(stop_after)
    stage = _Stages(list(STAGES)[: last + 1], progress)
    source = check.scaled(polygons, edge=edge, height=height)

    with stage("check"):
        findings = check.findings(source)
        mesh = check.as_quad_mesh(source, findings)
    result = Result(source, findings, mesh, seconds=stage.seconds)
    if stop_after == "check":
        return result
    with stage("regularise") as part:
        mesh = _resized(regularise.regularise(mesh, settings.regularise, part), edge, height)
    result = replace(result, mesh=mesh)
    if stop_after == "regularise":
        return result
    with stage("trace") as part:
        layout = trace.trace(mesh, settings.layout, part)
    if stop_after == "trace":
        return replace(result, flat=flatten.flatten(layout, settings.layout))
    with stage("merge") as part:
        flat = merge.merge(layout, settings.layout, part)
    result = replace(result, flat=flat)
    if stop_after == "merge":
        return result
    with stage("split") as part:
        flat = split.split(flat, settings.layout, settings.sheet, part)
    result = replace(result, flat=flat)
    if stop_after == "split":
        return result
    with stage("spirals"):
        spirals = design.from_curvature(flat, settings.spiral, curvature.rms_curvature(mesh))
    result = replace(result, design=spirals)
    if stop_after == "spirals":
        return result
    with stage("simulate") as part:
        try:
            found = simulate.simulate(spirals, mesh, settings.material.chosen, settings.simulate, progress=part)
            result = replace(result, simulation=found)
        except FlexMapsError as error:
            if stop_after == "simulate":
                raise
            # the sheets can be cut all the same
            unknown = Finding("not-simulated", "warning", f"Not simulated: {error}", faces=tuple(error.faces))
            result = replace(result, findings=[*findings, unknown])
    if stop_after == "simulate":
        return result
    with stage("sheets") as part:
        made = sheets.make_sheets(spirals, settings.sheet, part, settings.connect, settings.cut)
    return replace(result, sheets=made, estimates=estimates.estimate(made, spirals, settings.material.chosen))


def _resized(mesh: QuadMesh, edge: float | None, height: float | None) -> QuadMesh:
    """Regularising shrinks edges by a little: bring the asked size back, about the origin."""
    if edge is not None:
        return mesh.moved(mesh.vertices * (edge / mesh.median_edge))
    if height is not None:
        return mesh.moved(mesh.vertices * (height / np.ptp(mesh.vertices[:, 2])))
    return mesh

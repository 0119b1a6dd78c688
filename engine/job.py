"""The main job: from any polygon mesh to cut-ready sheets, stage by stage, without Blender."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from . import (
    assembly_check,
    check,
    curvature,
    design,
    estimates,
    flatten,
    merge,
    optimise,
    reach,
    regularise,
    sheets,
    simulate,
    split,
    trace,
)
from .assembly_check import AssemblyCheck
from .check import Finding
from .design import SpiralDesign
from .errors import FlexMapsError
from .estimates import Estimates
from .flatten import FlatPatches
from .mesh import PolygonMesh, QuadMesh
from .optimise import Optimisation
from .params import Settings
from .progress import SILENT, Progress
from .reach import Reach
from .sheets import CutSheets
from .simulate import Simulation

# every stage with its share of the progress bar; only "optimise" is left out unless it is asked for
STAGES = {
    "check": 0.05,
    "regularise": 0.15,
    "trace": 0.05,
    "merge": 0.35,
    "split": 0.05,
    "spirals": 0.1,
    "optimise": 0.5,
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
    design : the spirals, optimised if that stage ran; optimisation : how they became so
    simulation : the shape that the assembled object takes; also ``None``, with a finding, where its spirals are outside
        of what the elastic model knows and the job went on to the sheets; limits : what keeps it from the target
    sheets : the sheets to cut; estimates : what making them takes; assembly : how hard every seam is to join
    seconds : wall time of every stage that ran
    """

    source: PolygonMesh
    findings: list[Finding]
    mesh: QuadMesh
    flat: FlatPatches | None = None
    design: SpiralDesign | None = None
    optimisation: Optimisation | None = None
    simulation: Simulation | None = None
    limits: Reach | None = None
    sheets: CutSheets | None = None
    estimates: Estimates | None = None
    assembly: AssemblyCheck | None = None
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
    optimised: bool = False,
    progress: Progress = SILENT,
) -> Result:
    """Run the stages in order, up to and including ``stop_after``; "optimise" only if that is the last, or ``optimised``.

    ``edge`` is the wanted median quad edge, ``height`` the wanted extent along z, both in metres; with neither, the mesh
    is taken to be in metres already. Raises ``FlexMapsError`` where the input or a setting does not allow a stage, and
    ``Cancelled`` when the progress asks to stop.
    """
    if stop_after not in STAGES:
        raise FlexMapsError(f"There is no stage '{stop_after}'; the stages are {', '.join(STAGES)}")
    last = list(STAGES).index(stop_after)
    optimised = optimised or stop_after == "optimise"
    stage = _Stages([name for name in list(STAGES)[: last + 1] if optimised or name != "optimise"], progress)
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
    if optimised:
        with stage("optimise") as part:
            result = _tried(_optimised, result, settings, part, "optimised", needed=stop_after == "optimise")
    if stop_after == "optimise":
        return result
    with stage("simulate") as part:
        result = _tried(_simulated, result, settings, part, "simulated", needed=stop_after == "simulate")
    if stop_after == "simulate":
        return result
    with stage("sheets") as part:
        assert result.design is not None
        made = sheets.make_sheets(result.design, settings.sheet, part, settings.connect, settings.cut)
        figures = estimates.estimate(made, result.design, settings.material.chosen)
        assembly = assembly_check.check_assembly(result.design, made.connections, result.simulation)
    return replace(result, sheets=made, estimates=figures, assembly=assembly)


def _tried(
    step: Callable[[Result, Settings, Progress], Result],
    result: Result,
    settings: Settings,
    progress: Progress,
    done: str,
    needed: bool,
) -> Result:
    """A stage whose failure is no more than a warning, unless it is ``needed``: the sheets can be cut all the same."""
    try:
        return step(result, settings, progress)
    except FlexMapsError as error:
        if needed:
            raise
        unknown = Finding(f"not-{done}", "warning", f"Not {done}: {error}", faces=tuple(error.faces))
        return replace(result, findings=[*result.findings, unknown])


def _optimised(result: Result, settings: Settings, progress: Progress) -> Result:
    assert result.design is not None
    found = optimise.optimise(
        result.design, result.mesh, settings.material.chosen, settings.optimise, settings.simulate, progress=progress
    )
    return replace(result, flat=found.design.flat, design=found.design, optimisation=found)


def _simulated(result: Result, settings: Settings, progress: Progress) -> Result:
    assert result.design is not None
    better = result.optimisation
    if better is not None and not settings.simulate.restarts:
        return replace(result, simulation=better.after, limits=reach.reach(better))
    start = None if better is None else better.after.equilibrium.pose
    found = simulate.simulate(
        result.design, result.mesh, settings.material.chosen, settings.simulate, start=start, progress=progress
    )
    return replace(result, simulation=found, limits=reach.reach(found if better is None else better))


def _resized(mesh: QuadMesh, edge: float | None, height: float | None) -> QuadMesh:
    """Regularising shrinks edges by a little: bring the asked size back, about the origin."""
    if edge is not None:
        return mesh.moved(mesh.vertices * (edge / mesh.median_edge))
    if height is not None:
        return mesh.moved(mesh.vertices * (height / np.ptp(mesh.vertices[:, 2])))
    return mesh

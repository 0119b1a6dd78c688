"""The main job: from any polygon mesh to cut-ready sheets, stage by stage, without Blender."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np

from ..assembling import assembly_check
from ..assembling.assembly_check import AssemblyCheck
from ..errors import FlexMapsError
from ..fabrication import estimates, sheets
from ..fabrication.estimates import Estimates
from ..fabrication.sheets import CutSheets
from ..mechanics import loads, simulate
from ..mechanics.simulate import Simulation
from ..optimisation import optimise, reach
from ..optimisation.optimise import Optimisation
from ..optimisation.reach import Reach
from ..params import Settings
from ..patches import flatten, merge, split, trace
from ..patches.flatten import FlatPatches
from ..patches.layout import PatchLayout
from ..progress import SILENT, Progress
from ..spirals import design
from ..spirals.design import SpiralDesign
from ..surface import check, curvature, regularise
from ..surface.check import Finding
from ..surface.mesh import PolygonMesh, QuadMesh

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
    edge, height : the size that was asked for, metres, which regularising keeps
    supports : (k,) int, quads that are held where they lie in the target; force : (F, 3) newtons on the quads
    layout : the patches as they were traced; flat : the flat patches, of the last layout: merged, cut to the sheet's size
    design : the spirals, optimised if that stage ran; optimisation : how they became so
    simulation : the shape that the assembled object takes; limits : what keeps it from the target
    sheets : the sheets to cut; estimates : what making them takes; assembly : how hard every seam is to join
    undone : stages that were asked for and could not be done, with the reason; a later success takes them out again
    seconds : wall time of every stage that ran
    """

    source: PolygonMesh
    findings: list[Finding]
    mesh: QuadMesh
    edge: float | None = None
    height: float | None = None
    supports: np.ndarray | None = None
    force: np.ndarray | None = None
    layout: PatchLayout | None = None
    flat: FlatPatches | None = None
    design: SpiralDesign | None = None
    optimisation: Optimisation | None = None
    simulation: Simulation | None = None
    limits: Reach | None = None
    sheets: CutSheets | None = None
    estimates: Estimates | None = None
    assembly: AssemblyCheck | None = None
    undone: dict[str, Finding] = field(default_factory=dict)
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
    supports: str | Sequence[int] | None = None,
    progress: Progress = SILENT,
) -> Result:
    """Run the stages in order, up to and including ``stop_after``; "optimise" only if that is the last, or ``optimised``.

    ``edge`` is the wanted median quad edge, ``height`` the wanted extent along z, both in metres; with neither, the mesh
    is taken to be in metres already. ``supports`` names the quads that stand, see ``loads.standing``. Raises
    ``FlexMapsError`` where the input or a setting does not allow a stage, and ``Cancelled`` when the progress asks to stop.
    """
    wanted = stages(stop_after, optimised)
    stage = _Stages(wanted, progress)
    with stage("check"):
        result = begin(polygons, edge=edge, height=height, supports=supports)
    return _through(result, settings, wanted[1:], stage, lenient=True)


def stages(stop_after: str, optimised: bool = False) -> list[str]:
    """The stages up to ``stop_after``; "optimise" only if that is the last, or ``optimised``."""
    if stop_after not in STAGES:
        raise FlexMapsError(f"There is no stage '{stop_after}'; the stages are {', '.join(STAGES)}")
    first = list(STAGES)[: list(STAGES).index(stop_after) + 1]
    return [name for name in first if optimised or name == stop_after or name != "optimise"]


def begin(
    polygons: PolygonMesh,
    *,
    edge: float | None = None,
    height: float | None = None,
    supports: str | Sequence[int] | None = None,
) -> Result:
    """The checked mesh in the wanted size; arguments as in ``run``."""
    start = time.perf_counter()
    source = check.scaled(polygons, edge=edge, height=height)
    findings = check.findings(source)
    mesh = check.as_quad_mesh(source, findings)
    held = None if supports is None else loads.standing(mesh, supports)
    return Result(source, findings, mesh, edge, height, held, seconds={"check": time.perf_counter() - start})


def go_on(
    result: Result, settings: Settings, wanted: Sequence[str], progress: Progress = SILENT, *, lenient: bool = False
) -> Result:
    """Run more stages, in this order, on what earlier ones have made; what later ones had made before is dropped.

    If ``lenient``, simulating and optimising may fail unless they are the last: ``Result.undone`` tells. Raises as ``run`` does.
    """
    return _through(result, settings, wanted, _Stages(list(wanted), progress), lenient)


def _through(result: Result, settings: Settings, wanted: Sequence[str], stage: _Stages, lenient: bool) -> Result:
    for name in wanted:
        with stage(name) as part:
            if lenient and name in TRIED and name != wanted[-1]:
                result = _tried(name, result, settings, part)
            else:
                result = _done(name, STEPS[name](result, settings, part))
    if result.flat is None and result.layout is not None:
        result = replace(result, flat=flatten.flatten(result.layout, settings.layout))
    return replace(result, seconds=result.seconds | stage.seconds)


# -- the stages --------------------------------------------------------------------------------------------------------

# what stages make, in their order
MADE = ("mesh", "layout", "flat", "design", "optimisation", "simulation", "limits", "sheets", "estimates", "assembly")


def without(result: Result, first: str) -> Result:
    """The result without ``first``, one of ``MADE``, and all that was made from it, or that could not be."""
    later = MADE[MADE.index(first) :]
    nothing: dict[str, Any] = dict.fromkeys(later)
    undone = {stage: why for stage, why in result.undone.items() if TRIED[stage] not in later}
    return replace(result, **nothing, undone=undone)


def _regularised(result: Result, settings: Settings, progress: Progress) -> Result:
    mesh = regularise.regularise(result.mesh, settings.regularise, progress)
    return replace(without(result, "layout"), mesh=_resized(mesh, result.edge, result.height))


def _traced(result: Result, settings: Settings, progress: Progress) -> Result:
    return replace(without(result, "layout"), layout=trace.trace(result.mesh, settings.layout, progress))


def _merged(result: Result, settings: Settings, progress: Progress) -> Result:
    assert result.layout is not None
    held = result.supports is not None and len(result.supports) > 0
    return replace(without(result, "flat"), flat=merge.merge(result.layout, settings.layout, progress, held=held))


def _split(result: Result, settings: Settings, progress: Progress) -> Result:
    assert result.flat is not None
    flat = split.split(result.flat, settings.layout, settings.sheet, progress)
    return replace(without(result, "design"), flat=flat)


def _spirals(result: Result, settings: Settings, progress: Progress) -> Result:
    assert result.flat is not None
    made = design.from_curvature(result.flat, settings.spiral, curvature.rms_curvature(result.mesh), progress)
    return replace(without(result, "design"), design=made)


def _optimised(result: Result, settings: Settings, progress: Progress) -> Result:
    assert result.design is not None
    found = optimise.optimise(
        result.design,
        result.mesh,
        settings.material.chosen,
        settings.optimise,
        settings.simulate,
        supports=result.supports,
        force=result.force,
        progress=progress,
    )
    made = {"flat": found.design.flat, "design": found.design, "optimisation": found}
    return replace(without(result, "design"), **made)  # type: ignore[arg-type]


def _simulated(result: Result, settings: Settings, progress: Progress) -> Result:
    assert result.design is not None
    better = result.optimisation
    if better is not None and not settings.simulate.restarts:
        return _judged(result, better.after)
    found = simulate.simulate(
        result.design,
        result.mesh,
        settings.material.chosen,
        settings.simulate,
        supports=result.supports,
        force=result.force,
        start=None if better is None else better.after.equilibrium.pose,
        progress=progress,
    )
    return _judged(result, found)


def _judged(result: Result, found: Simulation) -> Result:
    """With a simulation, what limits it, and how hard the sheets that are there will be to join."""
    made, better = result.sheets, result.optimisation
    assembly = None
    if made is not None and result.design is not None:
        assembly = assembly_check.check_assembly(result.design, made.connections, found)
    return replace(result, simulation=found, limits=reach.reach(found if better is None else better), assembly=assembly)


def _sheets(result: Result, settings: Settings, progress: Progress) -> Result:
    assert result.design is not None
    split.check_size(result.design.flat, settings.layout, settings.sheet)
    made = sheets.make_sheets(result.design, settings.sheet, progress, settings.connect, settings.cut)
    figures = estimates.estimate(made, result.design, settings.material.chosen)
    assembly = assembly_check.check_assembly(result.design, made.connections, result.simulation)
    return replace(result, sheets=made, estimates=figures, assembly=assembly)


STEPS: dict[str, Callable[[Result, Settings, Progress], Result]] = {
    "regularise": _regularised,
    "trace": _traced,
    "merge": _merged,
    "split": _split,
    "spirals": _spirals,
    "optimise": _optimised,
    "simulate": _simulated,
    "sheets": _sheets,
}
TRIED = {"optimise": "optimisation", "simulate": "simulation"}  # the sheets can be cut without what these make


def _tried(name: str, result: Result, settings: Settings, progress: Progress) -> Result:
    """A stage whose failure does not end the job: it is noted, and what an earlier run of it had made goes."""
    try:
        return _done(name, STEPS[name](result, settings, progress))
    except FlexMapsError as error:
        why = Finding(f"not-{name}d", "warning", f"Not {name}d: {error}", faces=tuple(error.faces))
        left = without(result, TRIED[name])
        return replace(left, undone={**left.undone, name: why})


def _done(name: str, result: Result) -> Result:
    """The result of a stage that could be done now, whether it could before or not."""
    return replace(result, undone={stage: why for stage, why in result.undone.items() if stage != name})


def _resized(mesh: QuadMesh, edge: float | None, height: float | None) -> QuadMesh:
    """Regularising shrinks edges by a little: bring the asked size back, about the origin."""
    if edge is not None:
        return mesh.moved(mesh.vertices * (edge / mesh.median_edge))
    if height is not None:
        return mesh.moved(mesh.vertices * (height / np.ptp(mesh.vertices[:, 2])))
    return mesh

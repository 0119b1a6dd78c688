"""The main job: from a polygon mesh to sheets ready for cutting, stage by stage, without Blender."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields, replace
from itertools import pairwise

import numpy as np

from ..arrays import Float
from ..errors import FlexMapsError
from ..extras import registry
from ..fabrication.nesting.sheet_count import refuse_many_sheets
from ..fabrication.standing.base_checks import check_base_on_target
from ..mechanics import loads
from ..mechanics.assembly import Pose
from ..params import Settings, refuse_crossed
from ..patches.flattening import flatten
from ..patches.layout import PatchLayout
from ..progress import SILENT, Progress
from ..spirals.fabricable import make_fabricable
from ..surface.checking import check
from ..surface.checking.check import Finding
from ..surface.mesh import PolygonMesh
from ..threads import one_thread
from .manual_changes import with_design, with_manual_layout
from .outputs import OUTPUTS, DesignVersion, FinalLayout, MergedLayout, Surface, TracedLayout, UserInput, provenance
from .result import Result
from .stage import Stage
from .stages import STAGES, TABLE, TRACED
from .steps import function_of, simulate_design, simulated_shape

CHECK, CHECK_SHARE = "check", 0.05  # check of the mesh before the stages of the table, and its part of the progress bar
COARSE_TOLERANCE = (
    1e-4  # metres, tolerance of outlines that only serve to estimate the number of sheets; larger: less accurate
)
STAGE_NAMES = (CHECK, *(stage.name for stage in TABLE if not stage.quick))


class _StageTimer:
    """Give every stage its part of the progress bar, and record its wall time in ``seconds``."""

    def __init__(self, wanted: list[str], progress: Progress):
        self.seconds: dict[str, float] = {}
        self._progress = progress
        shares = [STAGES[name].share if name in STAGES else CHECK_SHARE for name in wanted]
        total = sum(shares) or 1.0  # avoid a division by zero without stages
        starts = [sum(shares[:k]) / total for k in range(len(wanted) + 1)]
        self._spans = dict(zip(wanted, pairwise(starts), strict=True))
        self.end = progress.part(1.0, 1.0)  # for quick work after the last stage

    @contextmanager
    def __call__(self, name: str) -> Iterator[Progress]:
        part = self._progress.part(*self._spans[name])
        part(0.0, name)
        start = time.perf_counter()
        yield part
        self.seconds[name] = time.perf_counter() - start
        # tell() does not raise Cancelled: the best result of a cancelled stage is kept, and the next stage stops
        part.tell(1.0, name)


def run(
    polygons: PolygonMesh,
    settings: Settings,
    *,
    edge: float | None = None,
    height: float | None = None,
    stop_after: str = STAGE_NAMES[-1],
    optimised: bool = False,
    chosen: bool = False,
    structured: bool = False,
    supports: str | Sequence[int] | None = None,
    progress: Progress = SILENT,
) -> Result:
    """Run the stages in order, up to and including ``stop_after``.

    Parameters
    ----------
    polygons : the target surface; in metres, or in any unit if ``edge`` or ``height`` is given
    settings : settings of all stages
    edge : wanted median quad edge, metres
    height : wanted extent along z, metres
    stop_after : the last stage, one of ``STAGE_NAMES``
    optimised, chosen, structured : whether to run the stages "optimise", "choose" and "structure"
    supports : quads that are held in place, see ``loads.parse_supports``
    progress : called with the fraction done; may cancel

    Returns
    -------
    outputs of all stages that have run

    Raises
    ------
    FlexMapsError : the input or a setting does not allow a stage
    Cancelled : the user cancels
    """
    wanted = stages(stop_after, optimised, chosen, structured)
    stage = _StageTimer(wanted, progress)
    with stage(CHECK):
        result = check_input(polygons, edge=edge, height=height, supports=supports)
    return _run_all(result, settings, wanted[1:], stage, lenient=True)


def stages(stop_after: str, optimised: bool = False, chosen: bool = False, structured: bool = False) -> list[str]:
    """Return the names of the stages to run, in order.

    Parameters
    ----------
    stop_after : the last stage, one of ``STAGE_NAMES``; it is always included
    optimised, chosen, structured : include "optimise", "choose" and "structure", which run only on request

    Raises
    ------
    FlexMapsError : there is no stage ``stop_after``, or the extra of a requested one is missing
    """
    if stop_after not in STAGE_NAMES:
        raise FlexMapsError(f"There is no stage '{stop_after}'; the stages are {', '.join(STAGE_NAMES)}")
    for folder, is_so in (("choosing", chosen), ("structure", structured)):
        if is_so:
            registry.need(folder)
    first = STAGE_NAMES[: STAGE_NAMES.index(stop_after) + 1]
    asked = {"optimise": optimised, "choose": chosen, "structure": structured}
    wanted = {CHECK, stop_after, *(name for name, is_so in asked.items() if is_so)}
    return [name for name in first if name in wanted or not STAGES[name].asked]


def check_input(
    polygons: PolygonMesh,
    *,
    edge: float | None = None,
    height: float | None = None,
    supports: str | Sequence[int] | None = None,
) -> Result:
    """Check the mesh, scale it to the wanted size and return the first result.

    Parameters
    ----------
    polygons, edge, height, supports : as for ``run``
    """
    start = time.perf_counter()
    source = check.scale_to_metres(polygons, edge=edge, height=height)
    findings = check.all_findings(source)
    mesh = check.as_quad_mesh(source, findings)
    held = None if supports is None else loads.parse_supports(mesh, supports)
    surface = Surface(source, findings, mesh, edge, height)
    return Result(surface, UserInput(supports=held), seconds={CHECK: time.perf_counter() - start})


def run_stages(
    result: Result, settings: Settings, wanted: Sequence[str], progress: Progress = SILENT, *, lenient: bool = False
) -> Result:
    """Run stages on a result; drop outputs of later stages, which become out of date.

    Parameters
    ----------
    result : outputs of the earlier stages
    settings : settings of all stages
    wanted : names of the stages to run, in this order
    progress : called with the fraction done; may cancel
    lenient : record the failure of an optional stage in ``Result.undone`` instead of raising, unless it is the last
        stage

    Raises
    ------
    FlexMapsError : an input of a stage is missing, or a setting does not allow the stage
    Cancelled : the user cancels
    """
    return _run_all(result, settings, wanted, _StageTimer(list(wanted), progress), lenient)


def run_until(
    result: Result,
    settings: Settings,
    name: str,
    after: Sequence[str] = (),
    progress: Progress = SILENT,
    *,
    fresh: bool = False,
) -> Result:
    """Run the stages that an output still lacks, then the stages ``after``.

    Parameters
    ----------
    result : outputs of the earlier stages
    settings : settings of all stages
    name : name of the output, see ``StageOutput``
    after : names of stages to run afterwards
    progress : called with the fraction done; may cancel
    fresh : whether to regularise the mesh first, if it is not cut into panels yet

    Raises
    ------
    FlexMapsError, Cancelled : as in ``run_stages``
    """
    names = result.missing(name)
    first = ("regularise",) if fresh and "trace" in names else ()
    return run_stages(result, settings, (*first, *names, *after), progress)


def scale_piece(
    result: Result, factor: float, about: Float[np.ndarray, " 3"], settings: Settings, progress: Progress = SILENT
) -> Result:
    """Scale the piece: keep its cuts, and split panels that become too large for their sheet.

    The flat shapes are scaled, including changes by an optimisation. The spirals keep their widths and twists, as far
    as such spirals can be cut.

    Parameters
    ----------
    result : results with flat patches and spirals
    factor : new size over old size
    about : (3,) metres, the fixed point of the scaling
    settings : settings of all stages
    progress : called with the fraction done; may cancel

    Raises
    ------
    FlexMapsError, Cancelled : as in ``run_stages``
    """
    version = result.need(DesignVersion)
    design, flat = version.design, version.design.flat
    mesh = result.mesh.with_vertices(about + factor * (result.mesh.vertices - about))
    begun = check_input(PolygonMesh.from_quads(mesh)).with_user(supports=result.supports, force=result.force)
    notes = dict(flat.layout.notes)
    for key in ("expected_percent", "strain_softest"):
        notes.pop(key, None)  # these predictions depend on the size
    larger = flatten.with_energies(PatchLayout(begun.mesh, flat.layout.cut, notes), factor * flat.points)
    made = run_stages(with_manual_layout(begun, larger, settings), settings, ("split",), progress.part(0.0, 0.8))
    last = progress.part(0.8, 1.0)
    flat = made.need(FinalLayout).flat
    again = make_fabricable(flat, settings.spiral, design.width, design.twist, check_outlines=False, progress=last)
    return with_design(made, again, version.origin, settings)


@one_thread
def simulate_from_pose(result: Result, pose: Pose, settings: Settings, progress: Progress = SILENT) -> Result:
    """Simulate again from a known pose at equilibrium, for stages that need the forces in this pose.

    The analyses of tolerances, of the match and of other equilibria are skipped: they were reported when the pose was
    first computed.

    Parameters
    ----------
    result : results with spirals
    pose : pose of all hubs at equilibrium
    settings : settings of all stages
    progress : called with the fraction done; may cancel

    Raises
    ------
    FlexMapsError : there are no spirals
    """
    design = result.need(DesignVersion).design
    once = replace(settings, simulate=replace(settings.simulate, restarts=0))
    found = simulate_design(result, design, once, pose, progress)
    return result.with_outputs(simulated_shape(result, found, None, settings))


def run_quick_stages(result: Result, settings: Settings, progress: Progress = SILENT) -> Result:
    """Add a final layout if there is none, and run the quick stages whose inputs exist.

    Parameters
    ----------
    result : outputs so far
    settings : settings of all stages
    progress : called with the fraction done; may cancel
    """
    if result.get(FinalLayout) is None:
        result = _with_final_layout(result, settings, progress)
    for stage in TABLE:
        if stage.quick and _can_run(stage, result):
            result = _run_stage(stage, result, settings, progress, lenient=False)
    return result


def _with_final_layout(result: Result, settings: Settings, progress: Progress) -> Result:
    """Add a final layout: the merged patches, or else the traced patches after flattening; unchanged without either."""
    traced, merged = result.get(TracedLayout), result.get(MergedLayout)
    if merged is not None:
        flat, origin = merged.merged, merged.origin
    elif traced is not None:
        flat, origin = flatten.flatten(traced.layout, settings.layout, progress), TRACED
    else:
        return result
    made = provenance("merge", settings, result.inputs("mesh", "layout", "merged"))
    return result.with_outputs(FinalLayout(flat, origin, **made))


def _can_run(stage: Stage, result: Result) -> bool:
    """Return whether a stage has all its inputs, and one of its outputs is missing."""
    return all(result.value(name) is not None for name in stage.needs) and not result.outputs.keys() >= {*stage.makes}


# stages before which to check whether the piece can stand on its base: the first two take long, "sheets" makes the base
STAGES_NEEDING_HOLD = {"choose", "optimise", "sheets"}


@one_thread
def _run_all(result: Result, settings: Settings, wanted: Sequence[str], stage: _StageTimer, lenient: bool) -> Result:
    if STAGES_NEEDING_HOLD.intersection(wanted):
        check_base_on_target(result.mesh, result.supports, settings.base, settings.simulate, settings.spiral)
    for name in wanted:
        if name == "optimise" and "sheets" in wanted:  # refuse panels before the search, which takes long
            drawn = result.need(DesignVersion).design.outlines(COARSE_TOLERANCE)
            refuse_many_sheets([one.outer.sample(COARSE_TOLERANCE) for one in drawn], settings.sheet)
        with stage(name) as part:
            result = _run_stage(STAGES[name], result, settings, part, lenient and name != wanted[-1])
    result = run_quick_stages(result, settings, stage.end)
    return replace(result, seconds=result.seconds | stage.seconds)


def _run_stage(stage: Stage, result: Result, settings: Settings, progress: Progress, lenient: bool) -> Result:
    """Run a stage; if it fails, is optional and ``lenient``, record why and drop the outputs of its earlier run."""
    inputs = [result.need(OUTPUTS[name]) for name in stage.needs if name in OUTPUTS]
    if not stage.optional:  # optional stages make nothing to cut, so they accept settings in the wrong order
        refuse_crossed({f.name: getattr(settings, f.name) for f in fields(settings)}, stage.sections)
    try:
        made = function_of(stage)(result, *inputs, stage.readable(settings), progress)
    except FlexMapsError as error:
        if not (lenient and stage.optional):
            raise
        why = Finding(f"not-{stage.done}", "warning", f"Not {stage.done}: {error}", faces=tuple(error.faces))
        left = result.without(*stage.makes)
        return replace(left, undone={**left.undone, stage.name: why})
    return replace(made, undone={name: why for name, why in made.undone.items() if name != stage.name})

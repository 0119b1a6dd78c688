"""The main job: from any polygon mesh to cut-ready sheets, stage by stage, without Blender."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields, replace
from itertools import pairwise

import numpy as np

from ..arrays import Float
from ..errors import FlexMapsError
from ..fabrication.standing.early import check_early
from ..mechanics import loads
from ..mechanics.assembly import Pose
from ..params import LayoutParams, Settings, refuse_crossed
from ..patches.flattening import flatten
from ..patches.flattening.flatten import FlatPatches
from ..patches.layout import PatchLayout
from ..patches.tracing import trace
from ..progress import SILENT, Progress
from ..spirals.design import make_fabricable
from ..surface.checking import check
from ..surface.checking.check import Finding
from ..surface.mesh import PolygonMesh
from ..threads import one_thread
from .result import Result
from .stages import STAGES, TABLE, Stage, begun, missing, needed, without
from .steps import STEPS, at_rest

__all__ = [
    "NAMES",
    "Result",
    "begin",
    "completed",
    "enlarged",
    "flattened",
    "go_on",
    "go_to",
    "run",
    "simulated_at",
    "stages",
    "taken",
]

CHECK, CHECK_SHARE = "check", 0.05  # the step before the stages of the table, and its share of the progress bar
NAMES = (CHECK, *(stage.name for stage in TABLE if not stage.quick))


class _Stages:
    """Timer and progress splitter: gives every stage its part of the progress bar and records its wall time."""

    def __init__(self, wanted: list[str], progress: Progress):
        self.seconds: dict[str, float] = {}
        self._progress = progress
        shares = [STAGES[name].share if name in STAGES else CHECK_SHARE for name in wanted]
        total = sum(shares) or 1.0  # no stages are wanted: avoid a division by zero
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
        # tell() does not raise Cancelled: a cancelled stage that returns its best result keeps it; the next stage stops
        part.tell(1.0, name)


def run(
    polygons: PolygonMesh,
    settings: Settings,
    *,
    edge: float | None = None,
    height: float | None = None,
    stop_after: str = NAMES[-1],
    optimised: bool = False,
    chosen: bool = False,
    structured: bool = False,
    supports: str | Sequence[int] | None = None,
    progress: Progress = SILENT,
) -> Result:
    """Run the stages in order, up to and including ``stop_after``.

    Parameters
    ----------
    polygons : the target surface; in metres if neither ``edge`` nor ``height`` is given
    settings : of all stages
    edge : wanted median quad edge, metres
    height : wanted extent along z, metres
    stop_after : the last stage, one of ``NAMES``
    optimised, chosen, structured : whether to run the optional stages, see ``stages``
    supports : quads that are held in place, see ``loads.standing``
    progress : reports and cancels

    Returns
    -------
    the products of all stages

    Raises
    ------
    FlexMapsError : the input or a setting does not allow a stage
    Cancelled : the progress asks to stop
    """
    wanted = stages(stop_after, optimised, chosen, structured)
    stage = _Stages(wanted, progress)
    with stage(CHECK):
        result = begin(polygons, edge=edge, height=height, supports=supports)
    return _through(result, settings, wanted[1:], stage, lenient=True)


def stages(stop_after: str, optimised: bool = False, chosen: bool = False, structured: bool = False) -> list[str]:
    """Return the names of the stages to run, in order.

    Parameters
    ----------
    stop_after : the last stage, one of ``NAMES``; it is always included
    optimised, chosen, structured : include "optimise", "choose" and "structure", which run only on request

    Raises
    ------
    FlexMapsError : there is no stage ``stop_after``
    """
    if stop_after not in NAMES:
        raise FlexMapsError(f"There is no stage '{stop_after}'; the stages are {', '.join(NAMES)}")
    first = NAMES[: NAMES.index(stop_after) + 1]
    asked = {"optimise": optimised, "choose": chosen, "structure": structured}
    wanted = {CHECK, stop_after, *(name for name, is_so in asked.items() if is_so)}
    return [name for name in first if name in wanted or not STAGES[name].asked]


def begin(
    polygons: PolygonMesh,
    *,
    edge: float | None = None,
    height: float | None = None,
    supports: str | Sequence[int] | None = None,
) -> Result:
    """Check the mesh, scale it to the wanted size and return the first result; parameters and errors as in ``run``."""
    start = time.perf_counter()
    source = check.scaled(polygons, edge=edge, height=height)
    findings = check.everything(source)
    mesh = check.as_quad_mesh(source, findings)
    held = None if supports is None else loads.standing(mesh, supports)
    return Result(source, findings, mesh, edge, height, held, seconds={CHECK: time.perf_counter() - start})


def go_on(
    result: Result, settings: Settings, wanted: Sequence[str], progress: Progress = SILENT, *, lenient: bool = False
) -> Result:
    """Run stages on a result; products of later stages, now out of date, are dropped.

    Parameters
    ----------
    result : products of the earlier stages
    settings : of all stages
    wanted : names of the stages to run, in this order
    progress : reports and cancels
    lenient : record the failure of an optional stage in ``Result.undone`` instead of raising, unless it is the last stage

    Raises
    ------
    FlexMapsError : an input of a stage is missing, or a setting does not allow the stage
    Cancelled : the progress asks to stop
    """
    return _through(result, settings, wanted, _Stages(list(wanted), progress), lenient)


def go_to(
    result: Result,
    settings: Settings,
    member: str,
    after: Sequence[str] = (),
    progress: Progress = SILENT,
    *,
    fresh: bool = False,
) -> Result:
    """Run the missing stages that lead to a member of the result, then the stages ``after``.

    Parameters
    ----------
    result : products of the earlier stages
    settings : of all stages
    member : attribute of ``Result`` that is needed
    after : names of stages to run then
    progress : reports and cancels
    fresh : whether to regularise the mesh first, if it is not cut into panels yet

    Raises
    ------
    FlexMapsError, Cancelled : as in ``go_on``
    """
    names = missing(result, member)
    first = ("regularise",) if fresh and "trace" in names else ()
    return go_on(result, settings, (*first, *names, *after), progress)


def flattened(
    result: Result,
    cut: np.ndarray,
    params: LayoutParams,
    progress: Progress = SILENT,
    previous: FlatPatches | None = None,
) -> Result:
    """Flatten the patches between cuts that the user chose, see ``flatten.flatten``.

    Parameters
    ----------
    result : its mesh is used; products made from the former layout are dropped
    cut : (E,) bool, edges of the mesh to cut
    params : settings of the layout
    progress : reports and cancels
    previous : flat patches whose unchanged shapes are used again
    """
    layout = trace.make_disks(PatchLayout(result.mesh, cut))
    return replace(without(result, {"layout"}), flat=flatten.flatten(layout, params, progress, previous=previous))


def enlarged(
    result: Result, factor: float, about: Float[np.ndarray, " 3"], settings: Settings, progress: Progress = SILENT
) -> Result:
    """Scale the piece: the cuts stay, and panels that become too large for their sheet are split.

    The flat shapes are scaled too, also those that an optimisation has changed. The spirals keep widths and twists, as far
    as such spirals can be cut.

    Parameters
    ----------
    result : a piece with flat patches and spirals
    factor : new size over old size
    about : (3,) metres, the point that stays where it is
    settings : of all stages
    progress : reports and cancels

    Raises
    ------
    FlexMapsError, Cancelled : as in ``go_on``
    """
    flat, design = needed(result, "flat"), needed(result, "design")
    mesh = result.mesh.moved(about + factor * (result.mesh.vertices - about))
    begun = replace(begin(PolygonMesh.from_quads(mesh)), supports=result.supports, force=result.force)
    notes = dict(flat.layout.notes)
    notes.pop("expected_percent", None)  # it holds for the former size only
    larger = flatten.measured(PatchLayout(begun.mesh, flat.layout.cut, notes), factor * flat.points)
    made = go_on(replace(begun, flat=larger), settings, ("split",), progress.part(0.0, 0.8))
    assert made.flat is not None
    again = make_fabricable(
        made.flat, settings.spiral, design.width, design.twist, prove=False, progress=progress.part(0.8, 1.0)
    )
    return replace(made, design=again)


@one_thread
def simulated_at(result: Result, pose: Pose, settings: Settings, progress: Progress = SILENT) -> Result:
    """Simulate again from a pose at equilibrium, for stages that need the forces there.

    The analyses of real sheets, of the match and of other equilibria are skipped: they were reported with that pose.

    Parameters
    ----------
    result : a piece with spirals
    pose : hubs of all spirals at equilibrium
    settings : of all stages
    progress : reports and cancels

    Raises
    ------
    FlexMapsError : there are no spirals
    """
    needed(result, "design")
    once = replace(settings, simulate=replace(settings.simulate, restarts=0))
    return replace(result, simulation=at_rest(result, once, pose, progress))


def taken(result: Result, number: int) -> Result:
    """Change to the layout of another proposal; products made from the former layout are dropped.

    Parameters
    ----------
    result : a piece for which layouts were proposed
    number : index of the proposal, from 0

    Raises
    ------
    FlexMapsError : there are no proposals, or none with this number
    """
    choice = needed(result, "choice")
    if not 0 <= number < len(choice.proposals):
        raise FlexMapsError(f"There is no proposal {number}; they are numbered from 0 to {len(choice.proposals) - 1}")
    choice = replace(choice, taken=number)
    return replace(without(result, {"flat"}), flat=choice.best.flat, choice=choice)


def completed(result: Result, settings: Settings, progress: Progress = SILENT) -> Result:
    """Flatten a traced layout and run the quick stages whose inputs exist; users request neither by name."""
    if result.flat is None and result.layout is not None:
        result = replace(result, flat=flatten.flatten(result.layout, settings.layout, progress))
    for stage in TABLE:
        if stage.quick and _could(stage, result):
            result = _done(stage, result, settings, progress, lenient=False)
    return result


def _could(stage: Stage, result: Result) -> bool:
    """Return whether a stage has all its inputs, and one of its products is missing."""
    ready = all(getattr(result, member) is not None for member in stage.needs)
    return ready and any(getattr(result, member) is None for member in stage.makes)


# check whether the piece can stand before these stages: two take long and lead to a base, "sheets" makes it
HELD = {"choose", "optimise", "sheets"}


@one_thread
def _through(result: Result, settings: Settings, wanted: Sequence[str], stage: _Stages, lenient: bool) -> Result:
    if HELD.intersection(wanted):
        check_early(result.mesh, result.supports, settings.base, settings.simulate, settings.spiral)
    for name in wanted:
        with stage(name) as part:
            result = _done(STAGES[name], result, settings, part, lenient and name != wanted[-1])
    result = completed(result, settings, stage.end)
    return replace(result, seconds=result.seconds | stage.seconds)


def _done(stage: Stage, result: Result, settings: Settings, progress: Progress, lenient: bool) -> Result:
    """Run a stage; if it is optional and fails, record why and drop the products of its earlier run."""
    for member in stage.needs:
        needed(result, member)
    if not stage.optional:  # optional stages make nothing to cut, so conflicting settings may be tried in them
        refuse_crossed({f.name: getattr(settings, f.name) for f in fields(settings)}, stage.sections)
    start = begun(result, stage)
    try:
        made = STEPS[stage.name](start, settings, progress)
    except FlexMapsError as error:
        if not (lenient and stage.optional):
            raise
        why = Finding(f"not-{stage.done}", "warning", f"Not {stage.done}: {error}", faces=tuple(error.faces))
        return replace(start, undone={**start.undone, stage.name: why})
    return replace(made, undone={name: why for name, why in made.undone.items() if name != stage.name})

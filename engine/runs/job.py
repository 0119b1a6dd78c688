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
from ..spirals.design import fitted
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

CHECK, CHECK_SHARE = "check", 0.05  # what comes before the table's stages, and its share of the progress bar
NAMES = (CHECK, *(stage.name for stage in TABLE if not stage.quick))


class _Stages:
    """Gives every stage its part of the progress and notes how long it took."""

    def __init__(self, wanted: list[str], progress: Progress):
        self.seconds: dict[str, float] = {}
        self._progress = progress
        shares = [STAGES[name].share if name in STAGES else CHECK_SHARE for name in wanted]
        total = sum(shares) or 1.0  # there may be none
        starts = [sum(shares[:k]) / total for k in range(len(wanted) + 1)]
        self._spans = dict(zip(wanted, pairwise(starts), strict=True))
        self.end = progress.part(1.0, 1.0)  # for what comes after the last

    @contextmanager
    def __call__(self, name: str) -> Iterator[Progress]:
        part = self._progress.part(*self._spans[name])
        part(0.0, name)
        start = time.perf_counter()
        yield part
        self.seconds[name] = time.perf_counter() - start
        part.tell(1.0, name)  # a stage that was stopped and gives the best so far keeps it; the next one asks again


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
    """Run the stages in order, up to and including ``stop_after``; those that have to be asked for as in ``stages``.

    ``edge`` is the wanted median quad edge, ``height`` the wanted extent along z, both in metres; with neither, the mesh
    is taken to be in metres already. ``supports`` names the quads that stand, see ``loads.standing``. Raises
    ``FlexMapsError`` where the input or a setting does not allow a stage, and ``Cancelled`` when the progress asks to stop.
    """
    wanted = stages(stop_after, optimised, chosen, structured)
    stage = _Stages(wanted, progress)
    with stage(CHECK):
        result = begin(polygons, edge=edge, height=height, supports=supports)
    return _through(result, settings, wanted[1:], stage, lenient=True)


def stages(stop_after: str, optimised: bool = False, chosen: bool = False, structured: bool = False) -> list[str]:
    """The stages up to ``stop_after``; "optimise" only if that is the last or ``optimised``, "choose" likewise if ``chosen``, and
    "structure" if ``structured``.
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
    """The checked mesh in the wanted size; arguments as in ``run``."""
    start = time.perf_counter()
    source = check.scaled(polygons, edge=edge, height=height)
    findings = check.everything(source)
    mesh = check.as_quad_mesh(source, findings)
    held = None if supports is None else loads.standing(mesh, supports)
    return Result(source, findings, mesh, edge, height, held, seconds={CHECK: time.perf_counter() - start})


def go_on(
    result: Result, settings: Settings, wanted: Sequence[str], progress: Progress = SILENT, *, lenient: bool = False
) -> Result:
    """Run more stages, in this order, on what earlier ones have made; what later ones had made before is dropped.

    If ``lenient``, what is optional may fail unless it is the last: ``Result.undone`` tells. Raises as ``run`` does, and
    where what a stage needs is not there.
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
    """Run the stages that are missing until a member of the result is there, and then those ``after``.

    fresh : the mesh is regularised before it is cut. Raises as ``go_on`` does.
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
    """The result with the flat patches between cuts (E,) bool that somebody chose, as ``flatten.flatten`` makes them."""
    layout = trace.make_disks(PatchLayout(result.mesh, cut))
    return replace(without(result, {"layout"}), flat=flatten.flatten(layout, params, progress, previous=previous))


def enlarged(
    result: Result, factor: float, about: Float[np.ndarray, " 3"], settings: Settings, progress: Progress = SILENT
) -> Result:
    """The result ``factor`` times as large, about a point in metres: cut where it was, and further where a panel outgrows its sheet.

    The flat shapes that it has, perhaps moved by a search, are scaled with it. The spirals have the widths and twists that they
    had, as near as they can be cut. Raises as ``go_on`` does.
    """
    flat, design = needed(result, "flat"), needed(result, "design")
    mesh = result.mesh.moved(about + factor * (result.mesh.vertices - about))
    begun = replace(begin(PolygonMesh.of(mesh)), supports=result.supports, force=result.force)
    notes = dict(flat.layout.notes)
    notes.pop("expected_percent", None)  # of the former size
    larger = flatten.measured(PatchLayout(begun.mesh, flat.layout.cut, notes), factor * flat.points)
    made = go_on(replace(begun, flat=larger), settings, ("split",), progress.part(0.0, 0.8))
    assert made.flat is not None
    again = fitted(
        made.flat, settings.spiral, design.width, design.twist, prove=False, progress=progress.part(0.8, 1.0)
    )
    return replace(made, design=again)


@one_thread
def simulated_at(result: Result, pose: Pose, settings: Settings, progress: Progress = SILENT) -> Result:
    """Simulate the result from a known pose at rest, for stages that need its forces.

    The band of real sheets, the limits of the match and other rests are left out: they were reported with that pose.
    """
    needed(result, "design")
    once = replace(settings, simulate=replace(settings.simulate, restarts=0))
    return replace(result, simulation=at_rest(result, once, pose, progress))


def taken(result: Result, number: int) -> Result:
    """The result in the layout of another proposal of its choice; what was made from the former one is dropped.

    Raises ``FlexMapsError`` where there is no such proposal.
    """
    choice = needed(result, "choice")
    if not 0 <= number < len(choice.proposals):
        raise FlexMapsError(f"There is no proposal {number}; they are numbered from 0 to {len(choice.proposals) - 1}")
    choice = replace(choice, taken=number)
    return replace(without(result, {"flat"}), flat=choice.best.flat, choice=choice)


def completed(result: Result, settings: Settings, progress: Progress = SILENT) -> Result:
    """The result with everything that nobody asks for by name: what was traced is flattened, and quick stages are done."""
    if result.flat is None and result.layout is not None:
        result = replace(result, flat=flatten.flatten(result.layout, settings.layout, progress))
    for stage in TABLE:
        if stage.quick and _could(stage, result):
            result = _done(stage, result, settings, progress, lenient=False)
    return result


def _could(stage: Stage, result: Result) -> bool:
    """Whether a stage could make something that is not there."""
    ready = all(getattr(result, member) is not None for member in stage.needs)
    return ready and any(getattr(result, member) is None for member in stage.makes)


# stages before which it is looked whether the piece can stand: those that take long and lead to a base, and that which makes it
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
    """The result after a stage; where an optional one fails, what an earlier run of it had made goes, and it is noted."""
    for member in stage.needs:
        needed(result, member)
    if not stage.optional:  # what is not made of material may be tried with any cutter
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

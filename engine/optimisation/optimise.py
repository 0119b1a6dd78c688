"""Inverse design: the spirals whose assembly takes the target's shape (FlexMaps section 7)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..arrays import Float, Int
from ..errors import Cancelled, FlexMapsError
from ..materials import Material
from ..mechanics.assembly import Pose, target_pose
from ..params import OptimiseParams, SimulateParams
from ..progress import SILENT, Progress
from ..simulation.other_rests import other_rests
from ..simulation.rests import snapping
from ..simulation.simulate import Simulation, carried
from ..spirals.constraints import FREE, Constraints
from ..spirals.design import SpiralDesign, curvature_adjusted, fitted, proved
from ..surface import curvature
from ..surface.mesh import QuadMesh
from ..threads import one_thread
from . import codesign
from .found import Found, opened
from .inverse import Point, Problem
from .optimisers import STOPPED, Trace
from .search import FARTHER, NEAR, Held, Search, Task
from .terms import LENIENT, LOOSE, STRICT
from .wishes import Wishes
from .work import FIT, Work

ENDS = {
    "converged": "Converged: further steps would improve it by next to nothing.",
    "iterations": "Stopped at the largest number of steps. Press Optimise again to improve it further.",
    "time": "Stopped at the time limit. Press Optimise again to improve it further.",
    "stopped": "Cancelled; the best design so far is kept.",
    "nothing": "No better design was found; the design is unchanged.",
    "snapping": "The piece is about to snap, and no step that keeps its shape brings it nearer. Hold the spirals that move with supports.",
}
OPENING_SLOTS = "Opening slots"  # what the progress says
LOADS = (0.1, 0.3, 0.6, 1.0)  # shares in which the loads are put on where all at once lead to no equilibrium
TRIES = 3  # designs that are proved, the best first, until one keeps its shape
# Largest ratio of the first start's mismatch to the smallest one, and of a second start's objective to the first's. The objective alone,
# where closing slots and strain count beside the mismatch, led a vessel of two walls into a collapsed shape; the mismatch alone made
# results of two other surfaces worse by a third
NEARBY = 1.5
ALIKE = 0.01  # of the range of widths and twists by which starts differ at the most that count as one; not measured
SAME = 0.02  # share by which the mismatch of the result may differ from that of the search, which is less exact


@dataclass(frozen=True, eq=False)
class Look:
    """What there is to see after a step: the target's vertices (V, 3) metres as the hubs carry them, and the spirals.

    width : (F, 4) metres; twist : (F,) radians; rmse : metres, of the coordinates that are matched; step : number of steps
    """

    vertices: Float[np.ndarray, "vertices 3"]
    width: Float[np.ndarray, "quads 4"]
    twist: Float[np.ndarray, " quads"]
    rmse: float
    step: int


@dataclass(frozen=True, eq=False)
class Optimisation:
    """The best design that was found.

    before, after : the start and the result, simulated
    trace : seconds, objective and RMSE of every step, rejected and unstable ones counted
    start : which start was taken: "curvature", "uniform" or "given"; "stiff" or "soft" where those have no equilibrium
    point : of the search that the result was
    ended : why it ended, one of ``ENDS``
    """

    before: Simulation
    after: Simulation
    trace: Trace
    method: str
    start: str
    point: Point
    ended: str

    @property
    def at_bound(self) -> Int[np.ndarray, "quads _"]:
        """(F, groups of arms + 1) int, -1 and 1 where widths and twist are at their lower or upper bound."""
        x = self.point.problem.space.by_spiral(self.point.x)
        return np.where(x <= 0.0, -1, np.where(x >= 1.0, 1, 0))

    @property
    def gradient(self) -> Float[np.ndarray, "quads _"]:
        """(F, groups of arms + 1) of the objective by the design's coordinates: where a bound holds the match back."""
        return self.point.problem.space.by_spiral(self.point.gradient)

    @property
    def finished(self) -> bool:
        """False if it was stopped before its end."""
        return self.ended != STOPPED

    @cached_property
    def end(self) -> str:
        """Why it ended, as a sentence."""
        stuck = self.ended in ("converged", "nothing") and self.after.equilibrium.converged
        return ENDS[
            "snapping" if stuck and len(snapping(self.after.equilibrium, self.after.softest)[0]) else self.ended
        ]

    @property
    def design(self) -> SpiralDesign:
        return self.after.design

    def report(self) -> dict[str, Any]:
        """The ``optimise`` block of report.json."""
        before, after = self.before.match, self.after.match
        flat = (self.before.design.flat, self.after.design.flat)
        moved = codesign.flat_report(*flat) if flat[0] is not flat[1] else {}
        target = self.point.problem.target
        wished: dict[str, Any] = {}
        if target.wishes is not None:
            ends = [target.compare(s.equilibrium.pose.centres).wished for s in (self.before, self.after)]
            names = ("wished_mm_before", "wished_mm")
            wished = {"wishes": len(target.wishes.quads)} | dict(zip(names, (1e3 * end for end in ends), strict=True))
            why = target.wishes.unreachable(float(self.after.equilibrium.per_joint.sum()), len(self.design.width))
            wished |= {"wish": why} if why else {}
        return {
            "method": self.method,
            "start": self.start,
            "finished": self.finished,
            "ended": self.ended,
            "end": self.end,
            "iterations": len(self.trace.rows),
            "evaluations": self.trace.evaluations,
            "rejected": self.trace.rejected,
            "unstable": self.trace.unstable,
            "laplacian_rmse_mm_before": before["laplacian_rmse_mm"],
            "laplacian_rmse_mm": after["laplacian_rmse_mm"],
            "rms_percent_before": before["rms_percent"],
            "rms_percent": after["rms_percent"],
            "max_percent": after["max_percent"],
            **({} if self.after.strain is None else {"strain_share_max": float(self.after.strain.max())}),
            "at_bound": float((self.at_bound != 0).mean()),
            "history": [
                {"seconds": round(seconds, 3), "objective": value, "rmse_mm": 1e3 * rmse}
                for seconds, value, rmse in self.trace.rows
            ],
            **moved,
            **wished,
        }


@one_thread
def optimise(
    design: SpiralDesign,
    target: QuadMesh,
    material: Material,
    params: OptimiseParams,
    physics: SimulateParams,
    *,
    supports: np.ndarray | None = None,
    force: np.ndarray | None = None,
    prove: bool = True,
    constraints: Constraints = FREE,
    wishes: Wishes | None = None,
    progress: Progress = SILENT,
) -> Optimisation:
    """Improve a design until its equilibrium matches the target as well as the method finds, or its time is over.

    Arguments as in ``simulate``; ``wishes`` are places where some spirals shall come to. Starts from the given design, the
    curvature-adjusted one or the uniform one, see ``_best_starts``; from a painted one always. With ``codesign`` and the arm model the flat shapes move too. Shows a ``Look`` after every step.
    The result is never worse than the given design. Without ``prove`` it is as the search left it: to compare designs, that is
    enough, and saves a fifth of a short search. When it is stopped it returns the best design so far, or raises
    Cancelled if there is none yet. Raises FlexMapsError if no start has an equilibrium.
    """
    _check(design, target, constraints, wishes)
    work = Work.of(len(design.width), params.patience)
    task = Task(target, material, params, physics, supports, force, work, constraints, wishes)
    problem = task.problem(design, progress.at(0.0, "Starting shapes"))
    points = starts(problem, design, target, params, progress.part(0.0, 0.1))
    farthest = _farthest(points.get("given"), problem)
    names = _best_starts(points, farthest)
    first = [points[name].weighed(points[name].mismatch.value) for name in names]
    name, start = names[0], first[0]
    # now rather than at the end, where somebody who stopped it would have to wait for this
    given = points["given"].weighed(start.mismatch.value) if "given" in points else start
    within = progress.part(0.1, 0.12)
    before = task.simulated(design, given.equilibrium.pose, within) if prove else task.rested(design, given)
    trace, latest = Trace(), (start, design)

    def accepted(point: Point) -> None:
        nonlocal latest
        latest = point, search.held[-1].design if search.held else design
        vertices = carried(design, problem.target.laid(point.equilibrium.pose), target)
        progress.show(Look(vertices, *point.spirals, point.mismatch.rmse, len(trace.rows)))

    search = Search(task, trace, accepted, _farthest(given, problem), design.flat)
    accepted(start)
    try:
        name = names[search.run(first, design, work.paced(progress.part(0.12, 0.9)))]
        found = _proved(search, progress.part(0.9, 1.0)) if prove else _held(search)
    except Cancelled:
        trace.ended, found = STOPPED, _so_far(search, *latest)
    was = Found(before, given, search.farthest)
    strictness = LOOSE if trace.ended == STOPPED else LENIENT
    if found is None or not found.merit(strictness) < was.merit(strictness):
        found, trace.ended = was, STOPPED if trace.ended == STOPPED else "nothing"
    after = (
        _with_other_rests(found.simulation, physics, progress.part(0.99, 1.0))
        if prove and trace.ended != STOPPED
        else found.simulation
    )
    return Optimisation(before, after, trace, params.method, name, found.point, trace.ended)


def _with_other_rests(simulation: Simulation, physics: SimulateParams, progress: Progress) -> Simulation:
    """Return a simulation with the other shapes in which the piece may rest; without them where the user cancels."""
    unseen = replace(progress, shown=None)  # who watches an optimisation is shown designs, and these are poses
    try:
        return other_rests(simulation, physics, unseen)
    except Cancelled:
        return simulation


def _check(design: SpiralDesign, target: QuadMesh, constraints: Constraints, wishes: Wishes | None) -> None:
    if len(target.quads) != len(design.width):
        raise FlexMapsError(
            f"The target has {len(target.quads)} quads and the design {len(design.width)} spirals; lay out the panels again"
        )
    if len(constraints.kept) == len(design.width):
        raise FlexMapsError("All spirals are protected, so there is nothing to optimise; protect fewer of them")
    if wishes is not None:
        wishes.check(len(design.width))


def _farthest(given: Point | None, problem: Problem) -> float:
    """Return the largest RMS distance from the target of a sound result, in distances of neighbours; without limit if there is no given design."""
    return np.inf if given is None else max(FARTHER * given.distance, NEAR) + problem.target.reach


def _best_starts(points: dict[str, Point], farthest: float) -> list[str]:
    """Return the sound starts to search from: one, or two where another design begins nearly as well.

    The first has the least objective among those that match the target nearly as well as the best, the second the least of the others.
    A second start takes a fifth of the search from the first. Without it, two surfaces on which it begins far worse ended as near or nearer.
    """
    sound = {name: point for name, point in points.items() if point.distance <= farthest}
    limit = NEARBY * min(point.mismatch.value for point in sound.values())
    first = min(sound, key=lambda name: (sound[name].mismatch.value > limit, sound[name].value))
    others = [
        name
        for name in sound
        if np.abs(sound[name].x - sound[first].x).max() > ALIKE and sound[name].value <= NEARBY * sound[first].value
    ]
    return [first, *sorted(others, key=lambda name: sound[name].value)[:1]]


def _proved(search: Search, progress: Progress) -> Found | None:
    """The best design that keeps its shape when its outlines are drawn and mended where they touch; None if none can be."""
    found: list[Found] = []
    strictness = _strictness(search)
    for held in _unlike(search.held, strictness)[:TRIES]:
        progress(0.3, "Proving that it can be cut")
        pose = held.point.equilibrium.pose
        try:
            design = proved(held.design, progress.part(0.3, 0.7), free=held.point.problem.space.free)
        except FlexMapsError:
            continue
        found.append(Found(search.task.simulated(design, pose, progress.part(0.7, 0.9)), held.point, search.farthest))
        if found[-1].merit(strictness) <= (1.0 + SAME) * held.merit(strictness):
            break
    best = min(found, key=lambda one: one.merit(strictness), default=None)
    return None if best is None else opened(search, best, progress.at(0.9, OPENING_SLOTS))


def _held(search: Search) -> Found | None:
    """The best design as the search left it; None where none keeps its shape."""
    best = min(search.held, key=lambda one: one.merit(_strictness(search)))
    return Found(search.task.rested(best.design, best.point), best.point, search.farthest) if best.sound else None


def _strictness(search: Search) -> float:
    """A search whose time was over before its strains were down goes on from here when somebody asks for more."""
    return LENIENT if search.trace.ended == "time" else STRICT


def _unlike(held: list[Held], strictness: float) -> list[Held]:
    """The designs, the best first, without those nearly as good as the one before: where that loses its shape they do too."""
    unlike: list[Held] = []
    for one in sorted(held, key=lambda one: one.merit(strictness)):
        if not unlike or one.merit(strictness) > (1.0 + SAME) * unlike[-1].merit(strictness):
            unlike.append(one)
    return unlike


def _so_far(search: Search, point: Point, design: SpiralDesign) -> Found:
    """The latest design, or the best that was known to be better; whoever has stopped the search does not want to wait.

    What is known to be at rest is not simulated again, and where a design that can be cut is as good as the latest, that is it.
    """
    task, found = search.task, list[Found]()
    if search.held and search.best.value < np.inf:
        found.append(Found(task.rested(search.best.design, search.best.point), search.best.point, search.farthest))
    if not found or found[0].merit(LOOSE) > (1.0 + SAME) * point.merit(LOOSE):
        latest = codesign.designed(point, design)
        if latest is not None:
            found.append(Found(task.rested(latest, point), point, search.farthest))
    return min(found, key=lambda one: one.merit(LOOSE))


def starts(
    problem: Problem, design: SpiralDesign, target: QuadMesh, params: OptimiseParams, progress: Progress
) -> dict[str, Point]:
    """The starts that have an equilibrium, by name; only the given design if it is to be improved further.

    Where none of them has one, evenly stiff and evenly soft spirals are tried, and loads that grow little by little.
    """
    space, pose = problem.space, target_pose(target, design.flat.corners)
    places = {"given": space.coordinates(design.width, design.twist)}
    if params.restart and not design.painted:
        places["curvature"] = space.coordinates(*curvature_adjusted(design.params, curvature.rms_curvature(target)))
        places["uniform"] = space.filled(0.5, 0.5)
    points: dict[str, Point] = {}
    for k, (name, x) in enumerate(places.items()):
        within = progress.at(k / len(places), "Starting shapes")
        own, x = _with_room(problem, design, x, within)
        point = own.at(x, pose, within)
        if point.equilibrium.converged:
            points[name] = point
    for name, x in {**places, "stiff": space.filled(1.0, 0.0), "soft": space.filled(0.5, 1.0)}.items():
        if points:
            break
        within = progress.at(0.9, "Starting shapes, one load after the other")
        point = _loaded(*_with_room(problem, design, x, within), pose, within)
        if point.equilibrium.converged:
            points[name] = point
    if not points:
        raise FlexMapsError(
            "No equilibrium was found to start from: simulate the design first and mend what it reports"
        )
    return points


def _with_room(
    problem: Problem, design: SpiralDesign, x: np.ndarray, progress: Progress
) -> tuple[Problem, Float[np.ndarray, " coordinates"]]:
    """The nearest design that can be cut: the problem with a space that holds it, and its coordinates there."""
    problem.work.add(FIT, problem.assembly.size)
    wanted, free = problem.space.design(x), problem.space.free
    made = fitted(design.flat, design.params, *wanted, prove=False, free=free, progress=progress)
    space = problem.space.including(made)
    return replace(problem, space=space), space.coordinates(made.width, made.twist)


def _loaded(problem: Problem, x: np.ndarray, pose: Pose, progress: Progress) -> Point:
    """The point with these coordinates, its loads put on in parts."""
    shares = LOADS if problem.loads.force.any() else LOADS[-1:]
    for share in shares:
        part = replace(problem, loads=replace(problem.loads, force=share * problem.loads.force))
        point = part.at(x, pose, progress)
        pose = point.equilibrium.pose
    return replace(point, problem=problem)

"""Inverse design: find the spirals whose assembly takes the target's shape (FlexMaps section 7)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..arrays import Float, Int
from ..errors import Cancelled, FlexMapsError
from ..materials import Material
from ..mechanics.assembly import Pose, target_pose
from ..mechanics.equilibrium import poses_differ
from ..newton import REACHED
from ..params import OptimiseParams, SimulateParams
from ..progress import SILENT, Progress
from ..simulation.other_rests import find_other_rests
from ..simulation.rests import snapping_spirals
from ..simulation.simulate import Simulation
from ..spirals.constraints import NO_CONSTRAINTS, Constraints
from ..spirals.design import SpiralDesign
from ..spirals.fabricable import curvature_adjusted, make_fabricable, resolve_contacts
from ..surface import curvature
from ..surface.mesh import QuadMesh
from ..threads import one_thread
from . import codesign
from .continuation import continue_far
from .gauss_newton import CANCELLED, SearchRecord
from .inverse import DesignPoint, InverseProblem
from .search import ALWAYS_ALLOWED_DISTANCE, MAX_DISTANCE_GROWTH, Search, StageResult
from .slot_opening import SimulatedResult, open_closed_slots
from .snapshot import OptimisationStep
from .task import Task
from .terms import FULL_STRAIN_PENALTY, MILD_STRAIN_PENALTY, NO_STRAIN_PENALTY
from .wishes import Wishes
from .work import FABRICABLE_COST, Work

ENDS = {
    "converged": "Converged: further steps would improve it by next to nothing.",
    "reached": "Near enough: the piece is about a thousandth of its size from its target, or nearer. Raise Patience to go on.",
    "iterations": "Stopped at the largest number of steps. Press Optimise again to improve it further.",
    "time": "Stopped at the time limit. Press Optimise again to improve it further.",
    "slow": "Stopped because further steps would improve it only slowly. Press Optimise again to go on.",
    "stopped": "Cancelled; the best design so far is kept.",
    "nothing": "No better design was found; the design is unchanged.",
    "snapping": "The piece is about to snap, and no step that keeps its shape brings it nearer. Hold the spirals that move with supports.",
}
OPENING_SLOTS = "Opening slots"  # text of the progress
# shares of the full loads that are applied one after the other if the full loads lead to no equilibrium
LOAD_SHARES = (0.1, 0.3, 0.6, 1.0)
# Largest number of designs that are mended where outlines touch and simulated, the best first, until one keeps its
# merit (see ``DesignPoint.merit``). More: slower, better results
MAX_PROOFS = 3
# Largest mismatch of the best start over the smallest mismatch of all starts; 1 ranks starts by the mismatch, infinity
# by the objective (docs/tuning.md)
START_RATIO = 1.5
# Largest RMS difference of the design variables of free spirals, up to which starts count as equal. Larger: fewer
# starts
SAME_START = 0.1
SAME_MERIT = 1e-6  # relative decrease of the merit that counts as better; equal designs differ by 1e-8 or less
RESULT_TOL = 0.02  # relative difference of merits up to which two designs count as equally good


@dataclass(frozen=True, eq=False)
class Optimisation:
    """Result of an optimisation.

    before, after : the given design and the best design, simulated
    trace : seconds, objective and RMSE of every accepted step; counts of rejected and unstable steps
    start : best start: "given", "curvature", "uniform", or "stiff" or "soft" if the others have no equilibrium
    point : point of the search for ``after``; ended : reason for the end, a key of ``ENDS``
    """

    before: Simulation
    after: Simulation
    trace: SearchRecord
    start: str
    point: DesignPoint
    ended: str

    @property
    def at_bound(self) -> Int[np.ndarray, "quads _"]:
        """(F, groups of arms + 1): -1 for design variables at their lower bound, 1 at their upper, 0 in between."""
        x = self.point.problem.space.by_spiral(self.point.x)
        return np.where(x <= 0.0, -1, np.where(x >= 1.0, 1, 0))

    @property
    def gradient(self) -> Float[np.ndarray, "quads _"]:
        """Gradient (F, groups of arms + 1) by the spirals' design variables; not 0 where a bound limits the match."""
        return self.point.problem.space.by_spiral(self.point.gradient)

    @property
    def is_finished(self) -> bool:
        """Whether the search ended without a cancel by the user."""
        return self.ended != CANCELLED

    @cached_property
    def end_message(self) -> str:
        """Reason for the end, as a sentence."""
        stuck = self.ended in ("converged", "nothing") and self.after.equilibrium.converged
        if stuck and len(snapping_spirals(self.after.equilibrium, self.after.softest)[0]):
            return ENDS["snapping"]
        return ENDS[self.ended]

    @property
    def design(self) -> SpiralDesign:
        return self.after.design

    def report(self) -> dict[str, Any]:
        """Return the ``optimise`` block of report.json."""
        before, after = self.before.target_distances, self.after.target_distances
        flat = (self.before.design.flat, self.after.design.flat)
        moved = codesign.flat_report(*flat) if flat[0] is not flat[1] else {}
        target = self.point.problem.target
        wished: dict[str, Any] = {}
        if target.wishes is not None:
            ends = [target.compare(s.equilibrium.pose.centres).wish_distance for s in (self.before, self.after)]
            names = ("wished_mm_before", "wished_mm")
            wished = {"wishes": len(target.wishes.quads)} | dict(zip(names, (1e3 * end for end in ends), strict=True))
            why = target.wishes.unreachable(float(self.after.equilibrium.per_joint.sum()), len(self.design.width))
            wished |= {"wish": why} if why else {}
        return {
            "method": "gauss_newton",  # other programs may read it
            "start": self.start,
            "finished": self.is_finished,
            "ended": self.ended,
            "end": self.end_message,
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
    constraints: Constraints = NO_CONSTRAINTS,
    wishes: Wishes | None = None,
    progress: Progress = SILENT,
) -> Optimisation:
    """Search for spirals that match the target, from the best start; the result is not worse than ``design``.

    Parameters
    ----------
    design, target, material, supports, force : as in ``simulate``; params, physics : settings of search and equilibria
    prove : mend touching outlines and simulate the result; False saves a fifth of a short search, for comparisons
    constraints : spirals that stay unchanged, straight or wide; wishes : target positions of some spirals
    progress : shows an ``OptimisationStep`` after every step; after a cancel the best design so far is returned

    Raises
    ------
    FlexMapsError : no start has an equilibrium, or arguments do not fit together; Cancelled : before the first design
    """
    _check_arguments(design, target, constraints, wishes)
    progress, work = progress.rising(), Work.for_spirals(len(design.width), params.patience)
    task = Task(target, material, params, physics, supports, force, work, constraints, wishes)
    before = _simulate_given(task, design, progress) if prove else None
    problem = task.build_problem(design, progress.at(0.0, "Finding starting shapes"))
    points = find_starts(problem, design, target, params, progress.part(0.0, 0.1))
    names = _rank_starts(points, _distance_limit(points.get("given"), problem))
    starts = {name: points[name].with_strain_weight(points[names[0]].mismatch.value) for name in names}
    start = starts[names[0]]
    given = starts.get("given", start)  # the given design is always within the allowed distance
    pose = given.equilibrium.pose
    rests_elsewhere = before and poses_differ(before.equilibrium.pose, pose, before.assembly.pairs, before.loads)
    if before is None or rests_elsewhere:
        before = task.simulate(design, pose, progress.part(0.1, 0.12)) if prove else task.simulate_point(design, given)
    trace, latest = SearchRecord(), (start, design)

    def accepted(point: DesignPoint) -> None:
        nonlocal latest
        latest = point, search.results[-1].design if search.results else design
        progress.show(OptimisationStep.from_point(point, design, target, len(trace.rows)))

    search = Search(task, trace, accepted, _distance_limit(given, problem), design.flat)
    accepted(start)
    try:
        search.run(list(starts.values()), design, work.with_work_fraction(progress.part(0.12, 0.9)))
        found = _continue_and_prove(search, progress) if prove else _best_unproved(search)
    except Cancelled:
        trace.ended, found = CANCELLED, _best_so_far(search, *latest)
    found = _better_result(found, SimulatedResult(before, given, search.max_distance), trace)
    after = found.simulation
    if prove and trace.ended != CANCELLED:
        after = _with_other_rests(after, physics, progress.part(0.99, 1.0))
    return Optimisation(before, after, trace, names[0], found.point, trace.ended)


def _simulate_given(task: Task, design: SpiralDesign, progress: Progress) -> Simulation | None:
    """Simulate the given design and show it; return None without an equilibrium.

    This is done first, so that a user who cancels later need not wait for it.
    """
    pose, within = target_pose(task.target, design.flat.corners), progress.at(0.0, "Finding starting shapes")
    found = task.simulate(design, pose, within)
    if not found.equilibrium.converged:
        return None
    progress.show(OptimisationStep.from_simulation(found, task))
    return found


def _better_result(found: SimulatedResult | None, given: SimulatedResult, trace: SearchRecord) -> SimulatedResult:
    """Return the better of the search's result and the given design; set ``trace.ended`` if the given one stays."""
    strain_penalty = NO_STRAIN_PENALTY if trace.ended == CANCELLED else MILD_STRAIN_PENALTY
    if found is None or not found.merit(strain_penalty) < (1.0 - SAME_MERIT) * given.merit(strain_penalty):
        trace.ended = trace.ended if trace.ended in (CANCELLED, REACHED) else "nothing"
        return given
    return found


def _with_other_rests(simulation: Simulation, physics: SimulateParams, progress: Progress) -> Simulation:
    """Return a simulation with the other stable shapes of its piece; return it unchanged if the user cancels."""
    unseen = replace(progress, shown=None)  # shows poses, which the view of an optimisation cannot draw
    try:
        return find_other_rests(simulation, physics, unseen)
    except Cancelled:
        return simulation


def _check_arguments(design: SpiralDesign, target: QuadMesh, constraints: Constraints, wishes: Wishes | None) -> None:
    """Raise FlexMapsError if arguments do not fit together."""
    if len(target.quads) != len(design.width):
        raise FlexMapsError(
            f"The target has {len(target.quads)} quads and the design {len(design.width)} spirals; lay out the panels again"
        )
    if len(constraints.fixed) == len(design.width):
        raise FlexMapsError("All spirals are protected, so there is nothing to optimise; protect fewer of them")
    if wishes is not None:
        wishes.check(len(design.width))


def _distance_limit(given: DesignPoint | None, problem: InverseProblem) -> float:
    """Return the largest allowed RMS distance from the target, in distances of neighbours; inf without ``given``."""
    if given is None:
        return np.inf
    return max(MAX_DISTANCE_GROWTH * given.relative_distance, ALWAYS_ALLOWED_DISTANCE) + problem.target.farthest_wish


def _rank_starts(points: dict[str, DesignPoint], farthest: float) -> list[str]:
    """Return the names of the starts within the allowed distance, the best first.

    Starts are ranked by the objective; starts with more than ``START_RATIO`` times the smallest mismatch come last.
    """
    sound = {name: point for name, point in points.items() if point.relative_distance <= farthest}
    limit = START_RATIO * min(point.mismatch.value for point in sound.values())
    return sorted(sound, key=lambda name: (sound[name].mismatch.value > limit, sound[name].value))


def _continue_and_prove(search: Search, progress: Progress) -> SimulatedResult | None:
    """Continue with springs if the search ended far from its target; then return the best design, proved fabricable."""
    continue_far(search, search.task.work.with_work_fraction(progress.part(0.12, 0.9)))
    return _prove_best(search, progress.part(0.9, 1.0))


def _prove_best(search: Search, progress: Progress) -> SimulatedResult | None:
    """Return the best design after mending its touching outlines and opening its slots; None if none can be cut."""
    found: list[SimulatedResult] = []
    strain_penalty = _strictness(search)
    for held in _drop_similar(search.results, strain_penalty)[:MAX_PROOFS]:
        progress(0.3, "Proving that it can be cut")
        pose = held.point.equilibrium.pose
        try:
            design = resolve_contacts(held.design, progress.part(0.3, 0.7), free=held.point.problem.space.free_spirals)
        except FlexMapsError:
            continue
        simulation = search.task.simulate(design, pose, progress.part(0.7, 0.9))
        found.append(SimulatedResult(simulation, held.point, search.max_distance))
        if found[-1].merit(strain_penalty) <= (1.0 + RESULT_TOL) * held.merit(strain_penalty):
            break
    best = min(found, key=lambda one: one.merit(strain_penalty), default=None)
    return None if best is None else open_closed_slots(search, best, progress.at(0.9, OPENING_SLOTS))


def _best_unproved(search: Search) -> SimulatedResult | None:
    """Return the best design, not proved fabricable; None if it has no equilibrium near the target."""
    best = min(search.results, key=lambda one: one.merit(_strictness(search)))
    rested = search.task.simulate_point(best.design, best.point) if best.is_sound else None
    return None if rested is None else SimulatedResult(rested, best.point, search.max_distance)


def _strictness(search: Search) -> float:
    """Return the penalty on excess strain when ranking results: lenient if no time was left to reduce strains."""
    return MILD_STRAIN_PENALTY if search.task.work.is_late else FULL_STRAIN_PENALTY


def _drop_similar(held: list[StageResult], strain_penalty: float) -> list[StageResult]:
    """Return designs, the best first, without those with nearly the merit of a better one, which are likely similar."""
    unlike: list[StageResult] = []
    for one in sorted(held, key=lambda one: one.merit(strain_penalty)):
        if not unlike or one.merit(strain_penalty) > (1.0 + RESULT_TOL) * unlike[-1].merit(strain_penalty):
            unlike.append(one)
    return unlike


def _best_so_far(search: Search, point: DesignPoint, design: SpiralDesign) -> SimulatedResult:
    """Return the better of the latest point and the best stage result, quickly, because the user has cancelled.

    Equilibria are reused, and the latest point is not made fabricable if the best stage result is as good.
    """
    task, found = search.task, list[SimulatedResult]()
    if search.results and search.best.value < np.inf:
        found.append(
            SimulatedResult(
                task.simulate_point(search.best.design, search.best.point), search.best.point, search.max_distance
            )
        )
    if not found or found[0].merit(NO_STRAIN_PENALTY) > (1.0 + RESULT_TOL) * point.merit(NO_STRAIN_PENALTY):
        latest = codesign.to_design(point, design)
        if latest is not None:
            found.append(SimulatedResult(task.simulate_point(latest, point), point, search.max_distance))
    return min(found, key=lambda one: one.merit(NO_STRAIN_PENALTY))


def find_starts(
    problem: InverseProblem, design: SpiralDesign, target: QuadMesh, params: OptimiseParams, progress: Progress
) -> dict[str, DesignPoint]:
    """Return the starts that have an equilibrium, by name.

    They are the given design and, if ``params.restart`` is set and nothing is painted, curvature-adjusted and uniform
    spirals unless these equal the given ones. If none has an equilibrium, return the first of these, stiff and soft
    spirals that has an equilibrium when the loads are applied in parts. Equilibria are sought from the target's pose,
    because the simulated pose of the given design can lead to an equilibrium farther from the target (docs/tuning.md).

    Raises
    ------
    FlexMapsError : no start has an equilibrium
    """
    space, pose = problem.space, target_pose(target, design.flat.corners)
    places = {"given": space.coordinates(design.width, design.twist)}
    if params.restart and not design.is_painted:
        adjusted = space.coordinates(*curvature_adjusted(design.params, curvature.rms_curvature(target)))
        others = {"curvature": adjusted, "uniform": space.uniform(0.5, 0.5)}
        given, free = places["given"], np.repeat(space.free_spirals, space.coordinates_per_spiral)
        for name, x in others.items():
            if np.sqrt(np.mean((x - given)[free] ** 2)) > SAME_START:
                places[name] = x
    points: dict[str, DesignPoint] = {}
    for k, (name, x) in enumerate(places.items()):
        within = progress.at(k / len(places), "Finding starting shapes")
        own, x = _make_fabricable(problem, design, x, within)
        point = own.point_at(x, pose, within)
        if point.equilibrium.converged:
            points[name] = point
    for name, x in {**places, "stiff": space.uniform(1.0, 0.0), "soft": space.uniform(0.5, 1.0)}.items():
        if points:
            break
        within = progress.at(0.9, "Finding starting shapes, load after load")
        point = _load_in_parts(*_make_fabricable(problem, design, x, within), pose, within)
        if point.equilibrium.converged:
            points[name] = point
    if not points:
        raise FlexMapsError(
            "No equilibrium was found to start from: simulate the design first and mend what it reports"
        )
    return points


def _make_fabricable(
    problem: InverseProblem, design: SpiralDesign, x: np.ndarray, progress: Progress
) -> tuple[InverseProblem, Float[np.ndarray, " coordinates"]]:
    """Return a design near x that can be cut: its design variables, and the problem with a space that contains it."""
    problem.work.add(FABRICABLE_COST, problem.assembly.size)
    wanted, free = problem.space.width_and_twist(x), problem.space.free_spirals
    made = make_fabricable(design.flat, design.params, *wanted, check_outlines=False, free=free, progress=progress)
    space = problem.space.extended_to(made)
    return replace(problem, space=space), space.coordinates(made.width, made.twist)


def _load_in_parts(problem: InverseProblem, x: np.ndarray, pose: Pose, progress: Progress) -> DesignPoint:
    """Return the design x with its equilibrium, found by applying the loads in parts; each part starts at the last."""
    shares = LOAD_SHARES if problem.loads.force.any() else LOAD_SHARES[-1:]
    for share in shares:
        part = replace(problem, loads=replace(problem.loads, force=share * problem.loads.force))
        point = part.point_at(x, pose, progress)
        pose = point.equilibrium.pose
    return replace(point, problem=problem)

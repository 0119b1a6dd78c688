"""Inverse design: the spirals whose assembly takes the target's shape (FlexMaps section 7)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..errors import Cancelled, FlexMapsError
from ..materials import Material
from ..mechanics.arm_model import ArmModel
from ..mechanics.assembly import Pose, of_design, target_pose
from ..mechanics.loads import Loads
from ..mechanics.simulate import Simulation, build_model, carried, simulate
from ..params import OptimiseParams, SimulateParams
from ..progress import SILENT, Progress
from ..spirals.design import SpiralDesign, curvature_adjusted, fitted
from ..surface import curvature
from ..surface.mesh import QuadMesh
from ..threads import one_thread
from . import codesign
from .design_space import DesignSpace
from .inverse import Point, Problem
from .objective import Target
from .optimisers import Trace, gauss_newton, lbfgs

METHODS: dict[str, Callable[..., Point]] = {"gauss_newton": gauss_newton, "lbfgs": lbfgs}
REPAIRS = 2  # rounds that go on after spirals had to give way to their neighbours
REPAIR_STEPS = 6
FLAT_STEPS, FLAT_STOP = 20, 5e-3  # with the flat shapes: half of the time, and nearly all of the gain
POLISH_STEPS = 8  # of the spirals alone, after the flat shapes have moved with them
TOLERANCE = 1e-4  # of the equilibria on the way: what is left is stretch, which hardly moves anything


@dataclass(frozen=True, eq=False)
class Look:
    """What there is to see after a step: the target's vertices (V, 3) metres as the hubs carry them, and the spirals.

    width : (F,) metres; twist : (F,) radians; rmse : metres, of the coordinates that are matched; step : number of steps
    """

    vertices: np.ndarray
    width: np.ndarray
    twist: np.ndarray
    rmse: float
    step: int


@dataclass(frozen=True, eq=False)
class Optimisation:
    """The best design that was found.

    before, after : the start and the result, simulated
    trace : seconds, objective and RMSE of every step, rejected and unstable ones counted
    start : which start was taken: "curvature", "uniform" or "given"
    at_bound : (F, 2) int, -1 and 1 where width and twist are at their lower or upper bound
    gradient : (F, 2) of the objective by the design's coordinates: where a bound holds the match back
    finished : false if it was stopped before its end
    """

    before: Simulation
    after: Simulation
    trace: Trace
    method: str
    start: str
    at_bound: np.ndarray
    gradient: np.ndarray
    finished: bool

    @property
    def design(self) -> SpiralDesign:
        return self.after.design

    def report(self) -> dict[str, Any]:
        """The ``optimise`` block of report.json."""
        before, after = self.before.report(), self.after.report()
        flat = (self.before.design.flat, self.after.design.flat)
        moved = codesign.flat_report(*flat) if flat[0] is not flat[1] else {}
        return {
            "method": self.method,
            "start": self.start,
            "finished": self.finished,
            "iterations": len(self.trace.rows),
            "evaluations": self.trace.evaluations,
            "rejected": self.trace.rejected,
            "unstable": self.trace.unstable,
            "laplacian_rmse_mm_before": before["laplacian_rmse_mm"],
            "laplacian_rmse_mm": after["laplacian_rmse_mm"],
            "rms_percent_before": before["rms_percent"],
            "rms_percent": after["rms_percent"],
            "max_percent": after["max_percent"],
            "at_bound": float((self.at_bound != 0).mean()),
            "history": [
                {"seconds": round(seconds, 3), "objective": value, "rmse_mm": 1e3 * rmse}
                for seconds, value, rmse in self.trace.rows
            ],
            **moved,
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
    progress: Progress = SILENT,
) -> Optimisation:
    """Improve a design until its equilibrium matches the target as well as the method finds.

    Arguments as in ``simulate``. Starts from the given design, the curvature-adjusted one or the uniform one, whichever
    is nearest to the target. With ``codesign`` and the arm model the flat shapes move too. Shows a ``Look`` after every step.
    When it is stopped it returns the best design so far, or raises Cancelled if there is none yet. Raises FlexMapsError if no start has an equilibrium.
    """
    if len(target.quads) != len(design.width):
        raise FlexMapsError(
            f"The target has {len(target.quads)} quads and the design {len(design.width)} spirals; lay out the patches again"
        )
    problem, pose = _problem(design, target, material, params, physics, supports, force)
    progress(0.0, "Starting shapes")
    points = _starts(problem, design, target, pose, params, progress.part(0.0, 0.1))
    name, start = min(points.items(), key=lambda item: item[1].value)
    # now rather than at the end, where somebody who stopped it would have to wait for this
    nearby = points.get("given", start).equilibrium.pose
    before = _simulated(design, target, material, physics, supports, force, nearby, progress.part(0.1, 0.12))
    trace, best, finished = Trace(), start, True

    def accepted(point: Point) -> None:
        nonlocal best
        best = point
        vertices = carried(design, _laid(point.equilibrium.pose, problem), target)
        progress.show(Look(vertices, *point.spirals, point.mismatch.rmse, len(trace.rows)))

    accepted(start)
    try:
        codesigned = params.codesign and isinstance(start.model, ArmModel)
        share = 0.3 if codesigned else 0.8
        METHODS[params.method](problem, start, params, trace, accepted, progress.part(0.12, share))
        if codesigned:
            alone, part = (problem, design, best), progress.part(share, 0.75)
            rough = replace(params, stop=max(params.stop, FLAT_STOP), iterations=min(FLAT_STEPS, params.iterations))
            codesign.refine(problem, best, design, rough, METHODS[params.method], trace, accepted, part)
            moved = codesign.designed(best, design)
            other = _problem(moved, target, material, params, physics, supports, force)[0]
            start = other.at(other.space.coordinates(moved.width, moved.twist), best.equilibrium.pose, progress.quiet())
            if start.equilibrium.converged:
                problem, design = other, moved
                accepted(start)
                short = replace(params, iterations=min(POLISH_STEPS, params.iterations))
                METHODS[params.method](problem, start, short, trace, accepted, progress.part(0.75, 0.8))
            if not start.equilibrium.converged or best.value > alone[2].value:
                problem, design, _ = alone
                accepted(alone[2])
        best, result = _repaired(problem, best, design, params, trace, accepted, progress.part(0.8, 0.95))
    except Cancelled:
        finished = False
        result = codesign.designed(best, design, prove=False)
    # whoever has stopped it does not want to wait
    quiet, pose = progress.part(0.95, 1.0) if finished else SILENT, best.equilibrium.pose
    after = _simulated(result, target, material, physics, supports, force, pose, quiet, quick=not finished)
    if name == "given" and not _better(before, after, params):
        after, best = before, points["given"]
    n = len(before.design.width)
    return Optimisation(before, after, trace, params.method, name, _at_bound(best.x[:n]), best.gradient[:n], finished)


def _better(before: Simulation, after: Simulation, params: OptimiseParams) -> bool:
    """Whether the result is worth having, told by the whole model: on the way the quick one stood in for it."""
    one, two = before.report(), after.report()
    if params.strain_share > 0.0 and one.get("strain_share_max", 0.0) > params.strain_share:
        return True  # it may cost some of the match to strain the arms less
    kind = "laplacian_rmse_mm" if params.laplacian else "rms_mm"
    return bool(two[kind] < one[kind])


def _problem(
    design: SpiralDesign,
    target: QuadMesh,
    material: Material,
    params: OptimiseParams,
    physics: SimulateParams,
    supports: np.ndarray | None,
    force: np.ndarray | None,
) -> tuple[Problem, Pose]:
    """The problem, and the pose to start equilibria from."""
    assembly = of_design(design)
    mass = design.area * assembly.thickness * material.density if physics.gravity else None
    loads = Loads.of(assembly.size, supports=supports, clamped=physics.clamped, force=force, mass=mass)
    aim = Target(assembly.pairs, target.centroids, params.laplacian, free=not loads.fixed.any())
    space = DesignSpace.of(design, assembly)
    loose = replace(physics, tolerance=max(physics.tolerance, TOLERANCE))
    bearing = (material, params.strain_share) if params.strain_share > 0.0 else None
    problem = Problem(
        assembly,
        space,
        aim,
        loads,
        lambda a: build_model(a, material, physics.model, quick=True),
        loose,
        params.smoothness,
        bearing,
    )
    return problem, target_pose(target, design.flat.corners)


def _starts(
    problem: Problem, design: SpiralDesign, target: QuadMesh, pose: Pose, params: OptimiseParams, progress: Progress
) -> dict[str, Point]:
    """The starts that have an equilibrium, by name; only the given design if it is to be improved further."""
    space = problem.space
    places = {"given": space.coordinates(design.width, design.twist)}
    if params.restart:
        adjusted = curvature_adjusted(design.params, curvature.rms_curvature(target))
        places["curvature"] = space.coordinates(*adjusted)
        places["uniform"] = np.full_like(places["given"], 0.5)
    points: dict[str, Point] = {}
    for k, (name, x) in enumerate(places.items()):
        progress(k / len(places), "Starting shapes")
        best = min(points.values(), key=lambda p: p.value, default=None)
        point = problem.at(x, pose, progress.quiet(), keep=best)
        if point.equilibrium.converged:
            points[name] = point
    if not points:
        raise FlexMapsError(
            "No equilibrium was found to start from: simulate the design first and mend what it reports"
        )
    return points


def _repaired(
    problem: Problem,
    best: Point,
    design: SpiralDesign,
    params: OptimiseParams,
    trace: Trace,
    accepted: Callable[[Point], None],
    progress: Progress,
) -> tuple[Point, SpiralDesign]:
    """The best point as a design that can be cut; where spirals had to give way to their neighbours, the rest is adapted."""
    for k in range(REPAIRS):
        part = progress.part(k / (REPAIRS + 1), (k + 1) / (REPAIRS + 1))
        wanted = problem.space.design(best.x)
        result = fitted(design.flat, design.params, *wanted, prove=False)
        given_way = result.twist < 0.999 * wanted[1]
        if not given_way.any():
            break
        problem = replace(problem, space=problem.space.limited(result.width, result.twist, given_way))
        x = problem.space.coordinates(result.width, result.twist)
        start = problem.at(x, best.equilibrium.pose, part.quiet())
        if not start.equilibrium.converged:
            break
        accepted(start)
        short = replace(params, iterations=min(REPAIR_STEPS, params.iterations))
        best = METHODS[params.method](problem, start, short, trace, accepted, part)
    progress(0.9, "Proving that it can be cut")
    return best, fitted(design.flat, design.params, *problem.space.design(best.x))


def _laid(pose: Pose, problem: Problem) -> Pose:
    return pose.aligned(problem.target.points) if problem.target.free else pose


def _at_bound(x: np.ndarray) -> np.ndarray:
    return np.where(x <= 0.0, -1, np.where(x >= 1.0, 1, 0))


def _simulated(
    design: SpiralDesign,
    target: QuadMesh,
    material: Material,
    physics: SimulateParams,
    supports: np.ndarray | None,
    force: np.ndarray | None,
    start: Pose,
    progress: Progress,
    quick: bool = False,
) -> Simulation:
    # a quick look need not be exact
    tolerance = max(physics.tolerance, TOLERANCE) if quick else physics.tolerance
    once = replace(physics, restarts=0, tolerance=tolerance)
    return simulate(
        design,
        target,
        material,
        once,
        supports=supports,
        force=force,
        start=start,
        quick=quick,
        progress=progress.quiet(),
    )

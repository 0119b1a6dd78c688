"""Two ways to the best design behind one interface: Gauss-Newton in a box, and L-BFGS-B (FlexMaps section 7).

Both take a problem and a converged starting point, call ``accepted`` with every better point, and return the best.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..arrays import Float
from ..newton import CONVERGED, ITERATIONS, TIME, TINY, Damped, Iteration, Local, minimise
from ..params import OptimiseParams
from ..progress import SILENT, Progress
from ..threads import one_thread
from . import inverse
from .codesign_problem import FlatPoint
from .composite import CompositeModel
from .inverse import Point, Problem
from .scaling import Bending

TURN_MOST = 0.3  # radians that a hub may turn between the designs of two equilibria by the linear prediction
ENOUGH = 1e-3  # RMSE in distances of neighbours below which no cutter could tell the difference
STOPPED = "stopped"  # why a search ended that was cancelled
GOAL = 0.5 * ENOUGH**2  # the mismatch there
JUMP = 0.5  # distances of neighbours that a hub may come to lie from where the tangent predicted it, beside its shift
# Newton iterations after which an equilibrium is given up: a piece that snaps over takes many. Of 400 steps that were taken
# from where the tangent predicted them, on 8 surfaces, none took more than 8; those given up cost up to half of the time
INNER_ITERATIONS, PREDICTED_ITERATIONS = 30, 12


@dataclass
class Trace:
    """What happened on the way.

    rows : seconds, objective and RMSE (metres) of every accepted point
    rejected : steps that were not taken because the objective rose; unstable : because no equilibrium was found, or another
        one than the nearest
    ended : why the last search ended, a word of ``newton``
    bending, damping : how the objective bends and how much steps are damped, by the number of coordinates: what one stage has
        learned serves the next
    """

    began: float = field(default_factory=time.perf_counter)
    rows: list[tuple[float, float, float]] = field(default_factory=list)
    evaluations: int = 0
    rejected: int = 0
    unstable: int = 0
    ended: str = "converged"
    bending: dict[int, Bending] = field(default_factory=dict)
    damping: dict[int, float] = field(default_factory=dict)

    def note(self, point: Point) -> None:
        self.rows.append((time.perf_counter() - self.began, point.value, point.mismatch.rmse))

    def bending_of(self, size: int) -> Bending:
        """Along so many coordinates."""
        return self.bending.setdefault(size, Bending(size))


Accepted = Callable[[Point], None]


@one_thread
def gauss_newton(
    problem: Problem,
    start: Point,
    params: OptimiseParams,
    trace: Trace,
    accepted: Accepted,
    progress: Progress = SILENT,
) -> Point:
    """Damped Gauss-Newton steps in the box, each solved by conjugate gradients on the equilibrium's Cholesky factor.

    The next equilibrium is sought from the pose that the tangent predicts; where none is found, turns are damped more.
    """
    search = _Search(params, trace, accepted, progress, start, trace.bending_of(len(start.x)))
    trace.ended = TIME if problem.work.over else ITERATIONS
    if params.iterations and not problem.work.over:
        goal = GOAL if params.stop else -np.inf
        rule = Damped(params.iterations, params.stop, goal, damping=trace.damping.get(len(start.x)))
        trace.ended = minimise(search, start, rule).ended
        if rule.damping is not None:
            trace.damping[len(start.x)] = rule.damping
    return search.best


@dataclass(frozen=True, eq=False)
class _Proposal:
    """A step of the coordinates, the hubs' moves (n, 6) that follow to first order, and the fall that is predicted."""

    step: Float[np.ndarray, " coordinates"]
    moves: np.ndarray
    gain: float


@dataclass(eq=False)
class _Search:
    """The objective as a function of designs with their equilibria (a ``newton.Problem``).

    best : the best one so far; bending : how the objective bends along its coordinates
    """

    params: OptimiseParams
    trace: Trace
    note: Accepted
    progress: Progress
    best: Point
    bending: Bending
    step_number: int = 0

    @property
    def over(self) -> bool:
        return self.best.problem.work.over

    def within(self, point: Point) -> Progress:
        done, rmse = self.step_number / self.params.iterations, 1e3 * point.mismatch.rmse
        return self.progress.at(done, f"Step {self.step_number}, RMSE {rmse:.4g} mm")

    def watch(self, point: Point, history: list[Iteration]) -> None:
        pass  # every equilibrium on the way asks whether to stop

    def expand(self, point: Point) -> Local:
        within, point = self.within(point), point.reweighted() if isinstance(point, FlatPoint) else point
        point.prepare(within)
        within(0.0)
        self.bending.refine(point.gauss_newton)
        return Local(point.value, point.gradient, float(np.linalg.norm(point.gradient)), own=point)

    def energy(self, point: Point) -> float:
        return point.value

    def proposed(self, here: Local, damping: float, following: float) -> _Proposal | None:
        point: Point = here.own
        within = self.within(point)

        units = self.bending.units(point.value, damping)
        model = CompositeModel(point, damping, following, self.params.cg_iterations, units, lambda: within(0.0))
        step = model.minimised().step
        step = point.problem.within(np.clip(point.x + step, 0.0, 1.0), point) - point.x
        if self.over:
            return None
        if not np.abs(step).max() > TINY:
            return _Proposal(step, np.zeros((point.problem.assembly.size, 6)), 0.0)
        moves = point.moves(step)
        return _Proposal(step, moves, point.value - model.after(step, moves).value)

    def tried(self, here: Local, proposal: _Proposal) -> Point | None:
        return _predicted(here.own, proposal.step, proposal.moves, self.trace, self.within(here.own))

    def gentle(self, here: Local, proposal: _Proposal) -> float:
        return here.energy / (TURN_MOST**2 * len(proposal.moves))

    def rejected(self) -> None:
        self.trace.rejected += 1

    def accepted(self, point: Point) -> None:
        self.step_number += 1
        if point.value < self.best.value:
            self.best = point
            self.trace.note(point)
            self.note(point)


def _predicted(here: Point, step: np.ndarray, moves: np.ndarray, trace: Trace, progress: Progress) -> Point | None:
    """The point one step on; None where no equilibrium that is safely stable is found near what the tangent predicts."""
    trace.evaluations += 1
    turn = np.linalg.norm(moves[:, 3:], axis=1).max()
    if turn > 4.0 * TURN_MOST:
        trace.unstable += 1
        return None
    moves = moves * min(1.0, TURN_MOST / max(turn, 1e-300))
    x, pose = np.clip(here.x + step, 0.0, 1.0), here.equilibrium.pose
    trial = here.problem.at(x, pose, progress, PREDICTED_ITERATIONS, moves)
    spare = min(here.equilibrium.spare, inverse.MARGIN)
    lost = not trial.equilibrium.converged or trial.equilibrium.spare < spare
    if lost or (jumped(here, trial, moves) and not _nearer(trial, here)):
        trace.unstable += 1
        return None
    return trial


def _nearer(there: Point, here: Point) -> bool:
    """Whether another equilibrium is worth going to: it is better in the objective and nearer to the target."""
    return there.value < here.value and there.distance < here.distance


def jumped(here: Point, there: Point, moves: Float[np.ndarray, "spirals 6"]) -> bool:
    """Whether another equilibrium was found than the one that the moves (n, 6) from ``here`` predict.

    What the tangent does not tell is a fraction of what it does, but the way to another equilibrium is at least as long as
    a spiral is wide.
    """
    target, pose = there.problem.target, here.equilibrium.pose
    predicted = pose.moved(moves)
    shifts = [
        np.linalg.norm(target.laid(one).centres - target.laid(two).centres, axis=1).max()
        for one, two in ((there.equilibrium.pose, predicted), (predicted, pose))
    ]
    return bool(shifts[0] > JUMP * target.unit + shifts[1])


@one_thread
def lbfgs(
    problem: Problem,
    start: Point,
    params: OptimiseParams,
    trace: Trace,
    accepted: Accepted,
    progress: Progress = SILENT,
) -> Point:
    """L-BFGS-B with an equilibrium at every evaluation, the publication's way; kept as the baseline.

    Where no equilibrium is found, and beyond the limits of flat shapes, the objective counts as ten times the start's.
    """
    from scipy.optimize import minimize

    best = last = start

    def value(x: np.ndarray) -> tuple[float, np.ndarray]:
        nonlocal best, last
        done = min(trace.evaluations / (1.2 * params.iterations), 1.0)
        within = progress.at(done, f"RMSE {1e3 * best.mismatch.rmse:.4g} mm")
        trace.evaluations += 1
        if problem.work.over:
            raise StopIteration
        point = problem.at(x, last.equilibrium.pose, within, INNER_ITERATIONS)
        if not (point.equilibrium.converged and np.isfinite(point.value)):
            trace.unstable += 1
            return 10.0 * start.value, np.zeros_like(x)
        last = point
        point.prepare(within)
        gradient = point.gradient.copy()
        if point.value < best.value:
            best = point
            trace.note(point)
            accepted(point)
        return point.value, gradient

    options = {"maxiter": params.iterations, "maxfun": 4 * params.iterations, "ftol": 0.0, "gtol": 0.0}
    bounds = [(0.0, 1.0)] * start.x.size
    try:
        found = minimize(value, start.x, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
        # 1 tells of too many steps; a line search that finds nothing better, 2, is how it ends with these options
        trace.ended = ITERATIONS if found.status == 1 else CONVERGED
    except StopIteration:
        trace.ended = TIME
    return best

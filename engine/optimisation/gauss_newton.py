"""The optimiser: damped Gauss-Newton steps with all design variables in [0, 1]."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..arrays import Float
from ..levenberg_marquardt import NEGLIGIBLE, LevenbergMarquardt
from ..newton import ITERATIONS, REACHED, TIME, Iteration, LocalModel, minimise
from ..params import OptimiseParams
from ..progress import SILENT, Progress
from ..threads import one_thread
from . import inverse
from .codesign_problem import FlatPoint
from .composite import CompositeModel
from .inverse import DesignPoint, InverseProblem
from .near_target import is_near
from .preconditioning import CurvatureEstimate

# Radians, largest predicted rotation of a hub in a step: larger predictions are scaled down to it, and refused beyond
# four times as much. Larger: longer steps, more lost equilibria
MAX_ROTATION = 0.3
CANCELLED = "stopped"  # ``SearchRecord.ended`` of a cancelled search
# RMS change of the design variables in a stage's first step along the gradient, before their bounds are applied, for
# stable pieces and for pieces that are less stable than required. Larger: fewer steps, more lost equilibria of pieces
# about to snap (docs/tuning.md)
FIRST_STEP, FIRST_STEP_NEAR_SNAP = 3.0, 0.3
# After a step that leads to no equilibrium, the hubs' rotations are damped. The damping term of the rotations in that
# step is this multiple of its predicted decrease. Larger: shorter steps, fewer lost equilibria (docs/tuning.md)
GENTLE_COST = 1.5
# Distance of a hub from its predicted place, in distances of neighbouring hubs, beyond which the piece may have
# snapped. Larger: more snaps go unnoticed; smaller: good steps are refused
MAX_JUMP = 0.5
# Newton iterations after which an equilibrium is given up, from a start without and with a prediction. Larger: more
# time for pieces that snap (docs/tuning.md)
MAX_NEWTON_ITERATIONS, PREDICTED_ITERATIONS = 30, 12


@dataclass
class SearchRecord:
    """Record of a search, shared by all of its stages.

    start_time : time of the start, seconds; rows : seconds, objective and RMSE (metres) of every accepted point
    evaluations : number of trial points; rejected : number of steps refused because the objective rose
    unstable : number of steps refused because no equilibrium was found, or the piece would have snapped
    ended : reason for the end of the last stage, at last of the search, a key of ``optimise.ENDS``
    curvature_estimates, damping : last curvature estimate and damping, by number of design variables; later stages
        start from these
    """

    start_time: float = field(default_factory=time.perf_counter)
    rows: list[tuple[float, float, float]] = field(default_factory=list)
    evaluations: int = 0
    rejected: int = 0
    unstable: int = 0
    ended: str = "converged"
    curvature_estimates: dict[int, CurvatureEstimate] = field(default_factory=dict)
    damping: dict[int, float] = field(default_factory=dict)

    def note(self, point: DesignPoint) -> None:
        """Add an accepted point to ``rows``."""
        self.rows.append((time.perf_counter() - self.start_time, point.value, point.mismatch.rmse))

    def curvature_estimate(self, size: int) -> CurvatureEstimate:
        """Return the curvature estimate for ``size`` design variables."""
        return self.curvature_estimates.setdefault(size, CurvatureEstimate(size))


Accepted = Callable[[DesignPoint], None]


@one_thread
def run_gauss_newton(
    problem: InverseProblem,
    start: DesignPoint,
    params: OptimiseParams,
    trace: SearchRecord,
    accepted: Accepted,
    progress: Progress = SILENT,
) -> DesignPoint:
    """Take damped Gauss-Newton steps, each solved by conjugate gradients on the equilibrium's Cholesky factor.

    The next equilibrium is sought from the linearly predicted pose; if none is found, rotations are damped more.

    Parameters
    ----------
    problem, start : the inverse problem, and a point of it with a converged equilibrium
    params : settings of the search
    trace : record of the search, to which steps are added
    accepted : called with every better point
    progress : reports progress and raises Cancelled

    Returns
    -------
    The best point.
    """
    search = _GaussNewtonProblem(params, trace, accepted, progress, start, trace.curvature_estimate(len(start.x)))
    trace.ended = TIME if problem.work.is_over else ITERATIONS
    if is_near(start, params):
        trace.ended = REACHED
    elif params.iterations and not problem.work.is_over:
        first = FIRST_STEP if start.stability_barrier is None else FIRST_STEP_NEAR_SNAP
        rule = LevenbergMarquardt(params.iterations, params.stop, first, trace.damping.get(len(start.x)))
        trace.ended = minimise(search, start, rule).ended
        if rule.damping is not None:
            trace.damping[len(start.x)] = rule.damping
    return search.best


@dataclass(frozen=True, eq=False)
class _Proposal:
    """A proposed step.

    step : of the design variables; increments : (n, 6) linearised increments of the hubs
    gain : predicted decrease of the objective
    """

    step: Float[np.ndarray, " coordinates"]
    increments: np.ndarray
    gain: float


@dataclass(eq=False)
class _GaussNewtonProblem:
    """The objective as a function of points, for ``newton.minimise`` (a ``levenberg_marquardt.DampedProblem``).

    note : called with every better point; best : the best point so far
    curvature_estimates : estimate of the objective's curvature along every design variable
    step_number : number of accepted steps; before : value of ``_depending_on_shape`` before the present step
    """

    params: OptimiseParams
    trace: SearchRecord
    note: Accepted
    progress: Progress
    best: DesignPoint
    curvature_estimates: CurvatureEstimate
    step_number: int = 0
    before: float = np.inf

    @property
    def must_end(self) -> bool:
        return self.best.problem.work.is_over

    def step_progress(self, point: DesignPoint) -> Progress:
        """Return the progress of the present step; its text has the number of steps so far and the point's distance."""
        done = self.step_number / self.params.iterations
        return self.progress.at(
            done, f"Step {len(self.trace.rows)}, {1e3 * point.distance_metres:.3g} mm from the target"
        )

    def watch(self, point: DesignPoint, history: list[Iteration]) -> None:
        pass  # every equilibrium checks for a cancel

    def expand(self, point: DesignPoint) -> LocalModel:
        within, point = (
            self.step_progress(point),
            point.with_barrier_weight() if isinstance(point, FlatPoint) else point,
        )
        point.precompute(within)
        within(0.0)
        self.curvature_estimates.refine(point.gauss_newton_product)
        self.before = _depending_on_shape(point)
        return LocalModel(point.value, point.gradient, float(np.linalg.norm(point.gradient)), own=point)

    def energy(self, point: DesignPoint) -> float:
        return point.value

    def reached(self, point: DesignPoint) -> bool:
        return is_near(point, self.params)

    def propose(self, here: LocalModel, damping: float, following: float) -> _Proposal | None:
        """Return a step that nearly minimises the damped model; None if the search must end.

        damping, following : weights of half the squared step, and of half the hubs' squared rotations
        """
        point: DesignPoint = here.own
        within = self.step_progress(point)

        units = self.curvature_estimates.units(point.value, damping)
        model = CompositeModel(point, damping, following, units, lambda: within(0.0))
        proposal = self._proposal(model, model.minimise().step)
        if self.must_end:
            return None
        point.problem.work.add_proposal()
        return proposal

    def shorten(self, here: LocalModel, proposal: _Proposal, share: float) -> _Proposal:
        point: DesignPoint = here.own
        # damping and units are not needed: the predicted decrease leaves damping out, and no step is solved for
        model = CompositeModel(point, 0.0, 0.0, np.ones_like(point.x), lambda: None)
        return self._proposal(model, share * proposal.step)

    def _proposal(self, model: CompositeModel, step: np.ndarray) -> _Proposal:
        """Return the proposal of a step, which is changed where gaps would close."""
        point = model.point
        step = point.problem.restore_clearances(np.clip(point.x + step, 0.0, 1.0), point.x) - point.x
        if not np.abs(step).max() > NEGLIGIBLE:
            return _Proposal(step, np.zeros((point.problem.assembly.size, 6)), 0.0)
        increments = point.hub_increments(step)
        return _Proposal(step, increments, point.value - model.after(step, increments).value)

    def take_step(self, here: LocalModel, proposal: _Proposal) -> DesignPoint | None:
        return _take_step(here.own, proposal.step, proposal.increments, self.trace, self.step_progress(here.own))

    def min_following(self, proposal: _Proposal) -> float:
        """Return the damping of rotations whose term is ``GENTLE_COST`` times the proposal's predicted decrease."""
        squares = float((proposal.increments[:, 3:] ** 2).sum())
        return 2.0 * GENTLE_COST * proposal.gain / max(squares, NEGLIGIBLE**2)

    def note_rejection(self) -> None:
        self.trace.rejected += 1

    def note_acceptance(self, point: DesignPoint) -> None:
        self.step_number += 1
        point.problem.work.add_step(float(np.log(self.before / max(_depending_on_shape(point), 1e-300))))
        if point.value < self.best.value:
            self.best = point
            self.trace.note(point)
            self.note(point)


def _depending_on_shape(point: DesignPoint) -> float:
    """Return the objective without its costs, such as barriers of flat shapes, whose weight changes at every step."""
    return sum(term.value for term in point.terms)


def _take_step(
    here: DesignPoint, step: np.ndarray, increments: np.ndarray, trace: SearchRecord, progress: Progress
) -> DesignPoint | None:
    """Return the point after a step; None without a stable equilibrium near the linearly predicted pose.

    step, increments : as in ``_Proposal``
    """
    trace.evaluations += 1
    turn = np.linalg.norm(increments[:, 3:], axis=1).max()
    if turn > 4.0 * MAX_ROTATION:
        trace.unstable += 1
        return None
    increments = increments * min(1.0, MAX_ROTATION / max(turn, 1e-300))
    x, pose = np.clip(here.x + step, 0.0, 1.0), here.equilibrium.pose
    trial = here.problem.point_at(x, pose, progress, PREDICTED_ITERATIONS, increments)
    spare = min(here.equilibrium.spare, inverse.MIN_STABILITY)
    lost = not trial.equilibrium.converged or trial.equilibrium.spare < spare
    if lost or (has_jumped(here, trial, increments) and not _is_better(trial, here)):
        trace.unstable += 1
        return None
    return trial


def _is_better(there: DesignPoint, here: DesignPoint) -> bool:
    """Return whether a point after a snap is an improvement: lower objective and nearer to the target."""
    return there.value < here.value and there.relative_distance < here.relative_distance


def has_jumped(here: DesignPoint, there: DesignPoint, increments: Float[np.ndarray, "spirals 6"]) -> bool:
    """Return whether the piece has snapped: the equilibrium ``there`` is far from the pose predicted by ``increments``.

    The error of the linear prediction is a fraction of the predicted shift; after a snap a hub is off by about a
    spiral's size or more.
    """
    target, pose = there.problem.target, here.equilibrium.pose
    predicted = pose.moved(increments)
    shifts = [
        np.linalg.norm(target.align_pose(one).centres - target.align_pose(two).centres, axis=1).max()
        for one, two in ((there.equilibrium.pose, predicted), (predicted, pose))
    ]
    return bool(shifts[0] > MAX_JUMP * target.unit_length + shifts[1])

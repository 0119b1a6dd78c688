"""Static equilibrium of an assembly by Newton's method on the energy (FlexMaps section 6.1).

The Hessian is indefinite except near a minimum; ``newton.LineSearch`` handles that. It is computed with the stresses
that the last step predicted to first order, so that thin shells can bend far in one step (see ``ElasticModel.expand``).
Steps that turn a hub far are shortened. Only a minimum counts as converged, not a saddle.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..arrays import Float
from ..newton import (
    AT_ROUNDING,
    CONVERGED,
    INDEFINITE,
    ITERATIONS,
    NO_DESCENT,
    SADDLE,
    Iteration,
    LineSearch,
    LocalModel,
    Run,
    minimise_stepwise,
    run_to_end,
)
from ..params import SimulateParams
from ..progress import SILENT, Progress
from ..surface.checking.finding import with_count
from ..threads import one_thread
from .assembly import Pose
from .elastic import ElasticModel, Expansion
from .loads import Loads, joints_between_hubs
from .newton_system import NewtonSystem

# largest rotation of a hub in one Newton step, radians; larger needs fewer steps, but the quadratic model of the energy
# is less exact; chosen by eye
TURN_CAP = 0.5
NUDGE = 0.05  # largest rotation of a hub in the step that leaves a saddle, radians; chosen by eye
# The residual is relative to the forces in the joints, but at least to the forces that the joints would have at this
# strain, for pieces that are nearly without stress. Larger accepts larger residual forces in such pieces; strains that
# matter are far larger.
REFERENCE_STRAIN = 1e-5
STATUS = {
    CONVERGED: "Converged in {}.",
    AT_ROUNDING: "Converged in {}.",
    SADDLE: "It balances, but the slightest touch would move it on.",
    ITERATIONS: "No equilibrium within {}.",
    INDEFINITE: "The forces are too uneven to be balanced in numbers.",
    NO_DESCENT: "No step lowers the energy any further, though forces are left.",
}


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """Result of a search for an equilibrium of an assembly.

    pose : of the hubs
    energy : elastic energy minus the work of the forces, joules
    per_joint : (m,) elastic energy of every joint, joules
    converged : True only at a minimum with a residual within the tolerance
    iterations : number of Newton steps
    residual : norm of the unbalanced forces, relative to the forces in the joints
    negative_eigenvalues : number of negative eigenvalues of the Hessian at the end; 0 at a minimum
    torsion_max : largest torsion of a joint, radians
    status : one sentence for the user
    spare : the largest of the ``margins`` of ``solve`` that the equilibrium has, 0 if it has none of them
    """

    pose: Pose
    energy: float
    per_joint: Float[np.ndarray, " joints"]
    converged: bool
    iterations: int
    residual: float
    negative_eigenvalues: int
    torsion_max: float
    status: str
    spare: float = 0.0

    def with_pose(self, pose: Pose) -> Equilibrium:
        """Return a copy with the pose ``pose``, which must be the equilibrium's pose after a rigid motion."""
        return replace(self, pose=pose)


@one_thread
def solve(
    model: ElasticModel,
    start: Pose,
    loads: Loads,
    params: SimulateParams,
    progress: Progress = SILENT,
    system: NewtonSystem | None = None,
    iterations: int | None = None,
    step: Float[np.ndarray, "spirals 6"] | None = None,
    margins: tuple[float, ...] = (),
) -> Equilibrium:
    """Find the equilibrium that Newton's method reaches from a pose. If it reaches none, ``converged`` is False.

    Parameters
    ----------
    model, loads : elastic model, supports and loads
    start : pose in which the search starts
    params : settings: tolerance and largest number of iterations
    progress : is updated and can cancel
    system : linear system of an earlier solve with the same joints and supports, to be used again; default a new one
    iterations : largest number of Newton steps, if it is less than ``params.iterations``; default the latter
    step : (n, 6) predicted increments of the hubs that are made first; default none
    margins : stability margins to test: shares s for which H - s B may be positive definite, with the Hessian H and its
        convex part B. The largest one for which it is becomes ``Equilibrium.spare``

    Raises
    ------
    FlexMapsError : forces would carry away a piece without supports
    """
    return run_to_end(solve_stepwise(model, start, loads, params, progress, system, iterations, step, margins))


def solve_stepwise(
    model: ElasticModel,
    start: Pose,
    loads: Loads,
    params: SimulateParams,
    progress: Progress = SILENT,
    system: NewtonSystem | None = None,
    iterations: int | None = None,
    step: Float[np.ndarray, "spirals 6"] | None = None,
    margins: tuple[float, ...] = (),
) -> Generator[Any, None, Equilibrium]:
    """Run ``solve`` as a generator, so that other work can be done between two steps.

    It yields the model's state after every step and returns the equilibrium.

    Parameters
    ----------
    model, start, loads, params, progress, system, iterations, step, margins : as in ``solve``
    """
    if system is None:
        system = NewtonSystem(model.pairs, loads.held_increments(model.pairs, start.centres), springs=loads.springs)
    rule = LineSearch(params.tolerance, params.iterations if iterations is None else min(iterations, params.iterations))
    problem, state = _Balance(model, loads, params.tolerance, system, progress, margins), model.start(start)
    if step is not None:
        # A predicted step ends near the minimum. If the Hessian is indefinite there, its convex part replaces it in one
        # step only: a decay of 0 leaves no share of it for the next steps
        rule.decay, state = 0.0, model.moved(state, step)
    return _make_result(problem, (yield from minimise_stepwise(problem, state, rule)))


@dataclass(eq=False)
class _Balance:
    """Elastic energy minus the work of the forces, as a function of the model's states (a ``newton.Problem``)."""

    model: ElasticModel
    loads: Loads
    tolerance: float
    system: NewtonSystem
    progress: Progress
    margins: tuple[float, ...] = ()
    spare: float = 0.0
    scale: float = 0.0  # largest force so far in a joint or of the loads, newtons; residuals are relative to it

    def expand(self, state: Any) -> LocalModel:
        here = self.model.expand(state, ahead=True)
        gradient = here.gradient.copy()
        gradient[: len(self.loads.force), :3] -= self.loads.total(state.pose.centres)
        work = self.loads.work(state.pose.centres)
        residual = self._residual(here, gradient, state.pose)
        return LocalModel(here.energy - work, gradient, residual, here.energy + abs(work), here)

    def moved(self, state: Any, step: np.ndarray) -> Any:
        return self.model.moved(state, step)

    def energy(self, state: Any) -> float:
        return self.model.energy(state) - self.loads.work(state.pose.centres)

    def watch(self, state: Any, history: list[Iteration]) -> None:
        residual, least = history[-1].residual, np.log(self.tolerance)
        done = 1.0 - np.log(max(residual, self.tolerance) / self.tolerance) / -least
        self.progress(float(np.clip(done, 0.0, 0.99)), f"Coming to rest, step {len(history) - 1}")
        self.progress.show(state.pose)

    def factor(self, here: LocalModel, convex: float, shift: float) -> bool:
        if not convex:
            return self.system.factor(self.system.values(here.own.hessian))
        part = self.system.make_definite(self.system.values(here.own.convex), shift)
        if convex < 1.0:
            part = (1.0 - convex) * self.system.values(here.own.hessian) + convex * part
        return self.system.factor(part)

    def step(self, here: LocalModel) -> np.ndarray:
        step = -self.system.solve(here.gradient)
        turn = np.linalg.norm(step[:, 3:], axis=1).max()
        return step * min(1.0, TURN_CAP / max(turn, 1e-300))

    def slope(self, here: LocalModel, step: np.ndarray) -> float:
        return float((here.gradient * step).sum())

    def stable(self, state: Any) -> bool:
        here = self.model.expand(state)
        values = self.system.values(here.hessian)
        convex = self.system.values(here.convex) if self.margins else values
        kept = (one for one in sorted(self.margins, reverse=True) if self.system.factor(values - one * convex))
        self.spare = next(kept, 0.0)
        # the exact Hessian is factorised last, because ``stable`` must keep its factorisation
        return self.system.factor(values)

    def exits(self, state: Any) -> list[Any]:
        here = self.model.expand(state)
        way = self.system.softest_modes(self.system.values(here.hessian), self.system.values(here.convex))[0][0]
        way *= NUDGE / max(np.linalg.norm(way[:, 3:], axis=1).max(), 1e-300)
        return [self.model.moved(state, sign * way) for sign in (1.0, -1.0)]

    def _residual(self, here: Expansion, gradient: np.ndarray, pose: Pose) -> float:
        """Return the norm of the unbalanced forces over ``scale``, after ``scale`` is updated.

        here, pose : expansion of the elastic energy at a pose, and this pose; gradient : of the whole energy
        """
        weight, inner = force_scale(self.model, here, pose)
        left = np.linalg.norm((gradient * weight)[~self.system.held])
        self.scale = max(self.scale, inner, float(np.linalg.norm(self.loads.force)))
        return float(left / self.scale)


def force_scale(model: ElasticModel, here: Expansion, pose: Pose) -> tuple[Float[np.ndarray, " 6"], float]:
    """Return weights that convert moments to forces, and the typical force in the joints.

    Parameters
    ----------
    model : the elastic model
    here, pose : its expansion at a state, and the pose of this state

    Returns
    -------
    (6,) : weights of force and moment: 1, 1, 1, then three times 1 over the mean distance of joined hubs, 1 / metres
    float : typical force in the joints, newtons
    """
    pose = pose.whole
    a, b = model.pairs.T
    length = float(np.linalg.norm(pose.centres[b] - pose.centres[a], axis=1).mean())
    stiffness = np.einsum("mii->m", here.convex[:, :3, :3])
    inner = float(np.sqrt(2.0 * here.per_joint * stiffness).sum() / np.sqrt(len(stiffness)))
    return np.repeat([1.0, 1.0 / length], 3), max(inner, REFERENCE_STRAIN * length * float(np.median(stiffness)))


def _make_result(problem: _Balance, run: Run) -> Equilibrium:
    """Build the equilibrium from a finished run of Newton's method, with the status sentence for users."""
    model, state, history = problem.model, run.state, run.history
    torsion = float(np.abs(model.torsion(state)).max(initial=0.0))
    steps, converged, negative = len(history) - 1, run.ended in (CONVERGED, AT_ROUNDING), 0
    sentence = STATUS.get(run.ended, "").format(with_count(steps, "iteration", "iterations"))
    if not converged:
        negative = problem.system.count_negative(problem.system.values(model.expand(state).hessian))
        sentence += f" {with_count(negative, 'way leads', 'ways lead')} downhill from there." if negative else ""
    energy, residual = float(history[-1].energy), float(history[-1].residual)
    joints = run.here.own.per_joint
    return Equilibrium(
        state.pose, energy, joints, converged, steps, residual, negative, torsion, sentence, problem.spare
    )


def other_minima(
    model: ElasticModel, found: Equilibrium, loads: Loads, params: SimulateParams, progress: Progress = SILENT
) -> list[Equilibrium]:
    """Find other stable shapes of an assembly, sorted by energy.

    Searches start from ``params.restarts`` poses: first the pose of the known equilibrium turned inside out, then this
    pose bent along its softest modes. Minima that are as close as ``poses_differ`` says are the same.

    Parameters
    ----------
    found : the known equilibrium, which is not returned
    model, loads : its elastic model and loads
    params : settings of the solver
    progress : is updated and can cancel
    """
    if not params.restarts or not found.converged:
        return []
    system = NewtonSystem(model.pairs, loads.held_increments(model.pairs, found.pose.centres))
    if not len(system.free):
        return []
    here = model.expand(model.start(found.pose))
    count = min(MODE_COUNT, len(system.free))
    modes = system.softest_modes(system.values(here.hessian), system.values(here.convex), count)[0]
    modes /= np.linalg.norm(modes[..., 3:], axis=2).max(axis=1)[:, None, None]
    minima, quick = [found], replace(params, iterations=min(params.iterations, 100))
    for k in range(params.restarts):
        part = progress.part(k / params.restarts, (k + 1) / params.restarts)
        start = _turn_inside_out(found.pose, system.held) if k == 0 else _bend_along_modes(found.pose, modes, k - 1)
        other = solve(model, start, loads, quick, part, system)
        if other.converged and all(poses_differ(other.pose, known.pose, model.pairs, loads) for known in minima):
            minima.append(other)
    return sorted(minima[1:], key=lambda e: e.energy)


def _turn_inside_out(pose: Pose, held: np.ndarray) -> Pose:
    """Return the pose reflected in a plane at right angles to the mean normal of its hubs; held hubs do not move.

    The plane goes through the mean of the held hubs' centres. held : (n, 6) mask of the increments that are held
    """
    held = held[: len(pose.centres)]
    middle = pose.centres[held[:, 0]].mean(axis=0)
    normal = pose.rotations[:, :, 2].mean(axis=0)
    normal /= max(np.linalg.norm(normal), 1e-12)
    mirror = np.eye(3) - 2.0 * np.outer(normal, normal)
    centres = middle + (pose.centres - middle) @ mirror
    rotations = mirror @ pose.rotations @ np.diag([1.0, 1.0, -1.0])
    return Pose(np.where(held[:, :3], pose.centres, centres), np.where(held[:, 3:4, None], pose.rotations, rotations))


def _bend_along_modes(pose: Pose, modes: np.ndarray, k: int) -> Pose:
    """Return the k-th bent pose from which a search starts.

    The first poses are bent along one of the ``modes`` (modes, n, 6), to either side; further poses along random
    combinations of modes.
    """
    rng = np.random.default_rng(k)
    weight = np.eye(len(modes))[k // 2] * (-1.0) ** k if k < 2 * len(modes) else rng.normal(size=len(modes))
    step = np.tensordot(weight / np.abs(weight).sum(), modes, 1) * MIN_BEND * (1.0 + k % 3)
    # the pose is bent in eight small steps, because a mode is a direction of motion for infinitesimal rotations only
    for _ in range(8):
        pose = pose.moved(step / 8.0)
    return pose


MODE_COUNT = 6  # number of softest modes along which starting poses are bent; more take more time; chosen by eye
MIN_BEND = 0.8  # largest rotation of a hub in the starting pose that is bent least, radians; chosen by eye


def poses_differ(first: Pose, second: Pose, pairs: np.ndarray, loads: Loads) -> bool:
    """Return whether the centre of any hub differs between two poses by more than a tenth of the hubs' mean distance.

    Before the comparison, the first pose is moved rigidly to fit the second, as far as its supports allow.

    Parameters
    ----------
    first, second : the poses
    pairs : (m, 2) indices of joined hubs, whose distances are averaged
    loads : with the supports
    """
    aligned, pairs = loads.align(first, pairs, second), joints_between_hubs(pairs, len(first.centres))
    apart = np.linalg.norm(aligned.centres - second.centres, axis=1).max()
    spacing = np.linalg.norm(second.centres[pairs[:, 1]] - second.centres[pairs[:, 0]], axis=1).mean()
    return bool(apart > 0.1 * spacing)

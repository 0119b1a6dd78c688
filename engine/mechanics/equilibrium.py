"""Static equilibrium of an assembly by Newton's method on the energy (FlexMaps section 6.1).

The Hessian is indefinite almost everywhere but near a minimum, which ``newton.LineSearch`` deals with. The stresses in it are
those that the last step predicted to first order, which lets thin shells bend far at once (see ``ElasticModel.expand``); large
turns are capped. A result counts as converged at a minimum only.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..arrays import Float
from ..newton import (
    CONVERGED,
    INDEFINITE,
    ITERATIONS,
    NO_DESCENT,
    ROUNDED,
    SADDLE,
    Iteration,
    LineSearch,
    Local,
    Run,
    exhausted,
    stepping,
)
from ..params import SimulateParams
from ..progress import SILENT, Progress
from ..surface.checking.finding import counted
from ..threads import one_thread
from .assembly import Pose
from .elastic import ElasticModel, Expansion
from .loads import Loads, between
from .newton_system import NewtonSystem

TURN_CAP = 0.5  # radians that a hub may turn in one step, for the expansion to hold; by eye
NUDGE = 0.05  # radians, largest turn of the step that leaves a saddle; by eye
# strain whose forces the residual is measured against where nothing is stressed: far below any that counts
UNSTRESSED = 1e-5
STATUS = {
    CONVERGED: "Converged in {}.",
    ROUNDED: "Converged in {}.",
    SADDLE: "It balances, but the slightest touch would move it on.",
    ITERATIONS: "No equilibrium within {}.",
    INDEFINITE: "The forces are too uneven to be balanced in numbers.",
    NO_DESCENT: "No step lowers the energy any further, though forces are left.",
}


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """Where an assembly rests.

    pose : the hubs; energy : joules, elastic less the work of the forces; per_joint : (m,) elastic joules
    converged : true only at a minimum whose residual is within the tolerance
    iterations : Newton steps; residual : norm of the forces left over, relative to those in the joints
    history : (iterations + 1, 2) energy and residual
    negative_eigenvalues : of the Hessian at the end; 0 at a minimum
    torsion_max : radians, largest turn of two neighbours about the line across their joint
    status : one plain sentence
    spare : the largest of the margins without which it would still be a minimum, 0 if there is none (see ``solve``)
    """

    pose: Pose
    energy: float
    per_joint: Float[np.ndarray, " joints"]
    converged: bool
    iterations: int
    residual: float
    history: Float[np.ndarray, "_ 2"] = field(repr=False)
    negative_eigenvalues: int
    torsion_max: float
    status: str
    spare: float = 0.0

    def placed(self, pose: Pose) -> Equilibrium:
        """The same equilibrium, moved as a whole to a pose."""
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
    """The equilibrium reached from a pose. ``system`` may be shared by solves with the same joints and supports.

    ``iterations`` bounds those of the settings further; ``step`` is a first step (n, 6) that something else predicts;
    ``margins`` are shares of the convex part of the Hessian; ``Equilibrium.spare`` is the largest that leaves it positive definite.

    Raises FlexMapsError if forces would carry an unsupported piece away. Where it does not converge, the result says so.
    """
    return exhausted(settling(model, start, loads, params, progress, system, iterations, step, margins))


def settling(
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
    """The same step by step: gives the model's states on the way and returns the equilibrium; between two, other work may be done."""
    if system is None:
        system = NewtonSystem(model.pairs, loads.held(model.pairs, start.centres))
    rule = LineSearch(params.tolerance, params.iterations if iterations is None else min(iterations, params.iterations))
    problem, state = _Balance(model, loads, params.tolerance, system, progress, margins), model.start(start)
    if step is not None:
        # so near to the end, the convex part is wanted for one step at the most
        rule.decay, state = 0.0, model.moved(state, step)
    return _result(problem, (yield from stepping(problem, state, rule)))


@dataclass(eq=False)
class _Balance:
    """Elastic energy less the work of the forces, as a function of the model's states (a ``newton.Problem``)."""

    model: ElasticModel
    loads: Loads
    tolerance: float
    system: NewtonSystem
    progress: Progress
    margins: tuple[float, ...] = ()
    spare: float = 0.0
    scale: float = 0.0  # newtons, the largest forces so far

    def expand(self, state: Any) -> Local:
        here = self.model.expand(state, ahead=True)
        gradient = here.gradient.copy()
        gradient[: len(self.loads.force), :3] -= self.loads.force
        work = self.loads.work(state.pose.centres)
        residual = self._residual(here, gradient, state.pose)
        return Local(here.energy - work, gradient, residual, here.energy + abs(work), here)

    def moved(self, state: Any, step: np.ndarray) -> Any:
        return self.model.moved(state, step)

    def energy(self, state: Any) -> float:
        return self.model.energy(state) - self.loads.work(state.pose.centres)

    def watch(self, state: Any, history: list[Iteration]) -> None:
        residual, least = history[-1].residual, np.log(self.tolerance)
        done = 1.0 - np.log(max(residual, self.tolerance) / self.tolerance) / -least
        self.progress(float(np.clip(done, 0.0, 0.99)), f"Iteration: {len(history) - 1}, residual {residual:.1e}")
        self.progress.show(state.pose)

    def factor(self, here: Local, convex: float, shift: float) -> bool:
        if not convex:
            return self.system.factor(self.system.values(here.own.hessian))
        part = self.system.definite(self.system.values(here.own.convex), shift)
        if convex < 1.0:
            part = (1.0 - convex) * self.system.values(here.own.hessian) + convex * part
        return self.system.factor(part)

    def step(self, here: Local) -> np.ndarray:
        step = -self.system.solve(here.gradient)
        turn = np.linalg.norm(step[:, 3:], axis=1).max()
        return step * min(1.0, TURN_CAP / max(turn, 1e-300))

    def slope(self, here: Local, step: np.ndarray) -> float:
        return float((here.gradient * step).sum())

    def stable(self, state: Any) -> bool:
        here = self.model.expand(state)
        values = self.system.values(here.hessian)
        convex = self.system.values(here.convex) if self.margins else values
        kept = (one for one in sorted(self.margins, reverse=True) if self.system.factor(values - one * convex))
        self.spare = next(kept, 0.0)
        return self.system.factor(values)  # the last one, as its owner solves with it

    def exits(self, state: Any) -> list[Any]:
        here = self.model.expand(state)
        way = self.system.softest(self.system.values(here.hessian), self.system.values(here.convex))[0][0]
        way *= NUDGE / max(np.linalg.norm(way[:, 3:], axis=1).max(), 1e-300)
        return [self.model.moved(state, sign * way) for sign in (1.0, -1.0)]

    def _residual(self, here: Expansion, gradient: np.ndarray, pose: Pose) -> float:
        """Forces left over, relative to the forces in the joints now and at the start, and to the loads."""
        weight, inner = force_measure(self.model, here, pose)
        left = np.linalg.norm((gradient * weight)[~self.system.held])
        self.scale = max(self.scale, inner, float(np.linalg.norm(self.loads.force)))
        return float(left / self.scale)


def force_measure(model: ElasticModel, here: Expansion, pose: Pose) -> tuple[Float[np.ndarray, " 6"], float]:
    """What makes forces of forces and moments (6,), and newtons, the size of the forces within the joints of a state."""
    pose = pose.whole
    a, b = model.pairs.T
    length = float(np.linalg.norm(pose.centres[b] - pose.centres[a], axis=1).mean())
    stiffness = np.einsum("mii->m", here.convex[:, :3, :3])
    inner = float(np.sqrt(2.0 * here.per_joint * stiffness).sum() / np.sqrt(len(stiffness)))
    return np.repeat([1.0, 1.0 / length], 3), max(inner, UNSTRESSED * length * float(np.median(stiffness)))


def _result(problem: _Balance, run: Run) -> Equilibrium:
    """What a run has led to, with its sentence."""
    model, state, history = problem.model, run.state, np.array([(one.energy, one.residual) for one in run.history])
    torsion = float(np.abs(model.torsion(state)).max(initial=0.0))
    steps, converged, negative = len(history) - 1, run.ended in (CONVERGED, ROUNDED), 0
    sentence = STATUS.get(run.ended, "").format(counted(steps, "iteration", "iterations"))
    if not converged:
        negative = problem.system.negative(problem.system.values(model.expand(state).hessian))
        sentence += f" {counted(negative, 'way leads', 'ways lead')} downhill from there." if negative else ""
    energy, residual = float(history[-1, 0]), float(history[-1, 1])
    joints = run.here.own.per_joint
    return Equilibrium(
        state.pose, energy, joints, converged, steps, residual, history, negative, torsion, sentence, problem.spare
    )


def other_minima(
    model: ElasticModel, found: Equilibrium, loads: Loads, params: SimulateParams, progress: Progress = SILENT
) -> list[Equilibrium]:
    """Other shapes in which the assembly can rest, by energy: searches from starts bent along its softest modes.

    ``params.restarts`` starts: the shape turned inside out, then bent along its softest modes. Minima are the same if no
    hub differs by more than a tenth of the distance of neighbours.
    """
    if not params.restarts or not found.converged:
        return []
    system = NewtonSystem(model.pairs, loads.held(model.pairs, found.pose.centres))
    if not len(system.free):
        return []
    here = model.expand(model.start(found.pose))
    count = min(MODES, len(system.free))
    modes = system.softest(system.values(here.hessian), system.values(here.convex), count)[0]
    modes /= np.linalg.norm(modes[..., 3:], axis=2).max(axis=1)[:, None, None]
    minima, quick = [found], replace(params, iterations=min(params.iterations, 100))
    for k in range(params.restarts):
        part = progress.part(k / params.restarts, (k + 1) / params.restarts)
        start = _inside_out(found.pose, system.held) if k == 0 else _bent(found.pose, modes, k - 1)
        other = solve(model, start, loads, quick, part, system)
        if other.converged and all(differ(other.pose, known.pose, model.pairs, loads) for known in minima):
            minima.append(other)
    return sorted(minima[1:], key=lambda e: e.energy)


def _inside_out(pose: Pose, held: np.ndarray) -> Pose:
    """Mirrored along the mean normal, at the middle of the hubs that are held; these stay."""
    held = held[: len(pose.centres)]
    middle = pose.centres[held[:, 0]].mean(axis=0)
    normal = pose.rotations[:, :, 2].mean(axis=0)
    normal /= max(np.linalg.norm(normal), 1e-12)
    mirror = np.eye(3) - 2.0 * np.outer(normal, normal)
    centres = middle + (pose.centres - middle) @ mirror
    rotations = mirror @ pose.rotations @ np.diag([1.0, 1.0, -1.0])
    return Pose(np.where(held[:, :3], pose.centres, centres), np.where(held[:, 3:4, None], pose.rotations, rotations))


def _bent(pose: Pose, modes: np.ndarray, k: int) -> Pose:
    """Bent along one mode after the other, to both sides, then along random mixtures of them."""
    rng = np.random.default_rng(k)
    weight = np.eye(len(modes))[k // 2] * (-1.0) ** k if k < 2 * len(modes) else rng.normal(size=len(modes))
    step = np.tensordot(weight / np.abs(weight).sum(), modes, 1) * BEND * (1.0 + k % 3)
    # in small parts, as turns do not add
    for _ in range(8):
        pose = pose.moved(step / 8.0)
    return pose


MODES = 6  # softest ones that starts are bent along; by eye
BEND = 0.8  # radians, largest turn of the smallest bent start


def differ(one: Pose, two: Pose, pairs: np.ndarray, loads: Loads) -> bool:
    """Return whether any hub lies more than a tenth of the distance of neighbours apart in two poses."""
    placed, pairs = loads.laid(one, pairs, two), between(pairs, len(one.centres))
    apart = np.linalg.norm(placed.centres - two.centres, axis=1).max()
    spacing = np.linalg.norm(two.centres[pairs[:, 1]] - two.centres[pairs[:, 0]], axis=1).mean()
    return bool(apart > 0.1 * spacing)

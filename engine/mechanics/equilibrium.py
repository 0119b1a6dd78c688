"""Static equilibrium of an assembly by Newton's method on the energy (FlexMaps section 6.1).

The Hessian is indefinite almost everywhere but near a minimum. Where its Cholesky factor fails, its convex part takes its
place and is blended out again over the next steps: far fewer iterations than with always projecting it. Stresses in it
are those that the last step had foreseen, which lets thin shells bend far at once (see ``ElasticModel.expand``). A line
search keeps the energy below those of the last few steps and survives states beyond the model; large turns are capped.
What comes out is said as it is: a saddle is left along its falling direction, and whatever still is no minimum is no
success.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..params import SimulateParams
from ..progress import SILENT, Progress
from ..threads import one_thread
from .assembly import Pose
from .elastic import ElasticModel, Expansion
from .loads import Loads
from .newton_system import SHIFT, NewtonSystem

TURN_CAP = 0.5  # radians that a hub may turn in one step
BLEND_DECAY, BLEND_LEAST = 0.3, 0.01  # of the share of the convex part, from step to step
SHIFTS = (SHIFT, 1e3 * SHIFT, 1e6 * SHIFT)  # of the convex part's diagonal, where rounding leaves it indefinite
ARMIJO, SHORTEST_STEP = 1e-4, 2.0**-30
RECENT = 5  # energies, of which a step may reach the largest: along bends a thin shell gets worse before it gets better
ROUNDING = 1e-13  # radians and metres of a step that changes nothing any more
ESCAPES = 5  # saddles that are left before the search is given up
NUDGE = 0.05  # radians, largest turn of the step that leaves a saddle
LOCKED = 1.0  # radians of twist in a joint beyond which the frames may have locked in a false minimum


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """Where an assembly rests.

    pose : the hubs; energy : joules, elastic less the work of the forces; per_joint : (m,) elastic joules
    converged : true only at a minimum whose residual is within the tolerance
    iterations : Newton steps; residual : norm of the forces left over, relative to those in the joints
    history : (iterations + 1, 2) energy and residual
    negative_eigenvalues : of the Hessian at the end; 0 at a minimum
    twist_max : radians, largest turn of two neighbours about the line across their joint
    status : one plain sentence
    """

    pose: Pose
    energy: float
    per_joint: np.ndarray
    converged: bool
    iterations: int
    residual: float
    history: np.ndarray = field(repr=False)
    negative_eigenvalues: int
    twist_max: float
    status: str

    def placed(self, pose: Pose) -> Equilibrium:
        """The same equilibrium, moved as a whole to a pose."""
        return replace(self, pose=pose)

    @property
    def locked(self) -> bool:
        """Whether some joint is twisted so far that the state is probably a false minimum."""
        return self.twist_max > LOCKED


@one_thread
def solve(
    model: ElasticModel,
    start: Pose,
    loads: Loads,
    params: SimulateParams,
    progress: Progress = SILENT,
    system: NewtonSystem | None = None,
    iterations: int | None = None,
    step: np.ndarray | None = None,
) -> Equilibrium:
    """The equilibrium reached from a pose. ``system`` may be shared by solves with the same joints and supports.

    ``iterations`` bounds those of the settings further; ``step`` is a first step (n, 6) that something else has foretold.

    Raises FlexMapsError if forces would carry an unsupported piece away. Not converging is told by the result.
    """
    if system is None:
        system = NewtonSystem(model.pairs, loads.held(model.pairs, start.centres))
    if iterations is not None:
        params = replace(params, iterations=min(iterations, params.iterations))
    search, state = _Search(model, loads, params, system, progress), model.start(start)
    if step is not None:
        # so near to the end, the convex part is wanted for one step at the most
        search.decay, state = 0.0, model.moved(state, step)
    return search.run(state)


class _Search:
    """One run of Newton's method."""

    def __init__(
        self, model: ElasticModel, loads: Loads, params: SimulateParams, system: NewtonSystem, progress: Progress
    ):
        self.model, self.loads, self.params, self.system, self.progress = model, loads, params, system, progress
        self.blend, self.decay = 0.0, BLEND_DECAY
        self.scale = 0.0
        self.history: list[tuple[float, float]] = []

    def run(self, state: Any) -> Equilibrium:
        escapes = 0
        while True:
            here = self.model.expand(state, ahead=True)
            gradient = here.gradient.copy()
            gradient[:, :3] -= self.loads.force
            residual = self._residual(here, gradient, state.pose)
            self.history.append((here.energy - self.loads.work(state.pose.centres), residual))
            self._report(residual, state.pose)
            steps = len(self.history) - 1
            if residual <= self.params.tolerance:
                here = self.model.expand(state)
                if self.system.factor(self.system.values(here.hessian)):
                    return self._result(state, here, True, "")
                if escapes == ESCAPES:
                    return self._result(state, here, False, "It balances, but the slightest touch would move it on.")
                state, escapes = self._escaped(state, here), escapes + 1
                continue
            if steps >= self.params.iterations:
                return self._result(state, here, False, f"No equilibrium within {steps} iterations.")
            step = self._step(here, gradient)
            if step is None:
                return self._result(state, here, False, "The forces are too uneven to be balanced in numbers.")
            if np.abs(step).max() <= ROUNDING:
                # nothing is left to move: the forces are what rounding leaves
                here = self.model.expand(state)
                return self._result(state, here, self.system.factor(self.system.values(here.hessian)), "")
            moved = self._searched(state, here, gradient, step)
            if moved is None:
                sentence = "No step lowers the energy any further, though forces are left."
                return self._result(state, here, False, sentence)
            state = moved

    def _residual(self, here: Expansion, gradient: np.ndarray, pose: Pose) -> float:
        """Forces left over, relative to the forces in the joints now and at the start, and to the loads."""
        length = self._length(pose)
        weight = np.repeat([1.0, 1.0 / length], 3)
        left = np.linalg.norm((gradient * weight)[~self.system.held])
        stiffness = np.einsum("mii->m", here.convex[:, :3, :3])
        inner = float(np.sqrt(2.0 * here.per_joint * stiffness).sum() / np.sqrt(len(stiffness)))
        # where nothing is stressed, against the forces of a strain of 1e-5
        self.scale = max(
            self.scale, inner, float(np.linalg.norm(self.loads.force)), 1e-5 * length * float(np.median(stiffness))
        )
        return float(left / self.scale)

    def _length(self, pose: Pose) -> float:
        a, b = self.model.pairs.T
        return float(np.linalg.norm(pose.centres[b] - pose.centres[a], axis=1).mean())

    def _report(self, residual: float, pose: Pose) -> None:
        done = 1.0 - np.log(max(residual, self.params.tolerance) / self.params.tolerance) / -np.log(
            self.params.tolerance
        )
        self.progress(float(np.clip(done, 0.0, 0.99)), f"Iteration: {len(self.history) - 1}, residual {residual:.1e}")
        self.progress.show(pose)

    def _step(self, here: Expansion, gradient: np.ndarray) -> np.ndarray | None:
        """Newton's step, with as much of the convex part as the last ones needed, or all of it; capped in its turns.

        None where not even the convex part has a factor.
        """
        exact, system = self.system.values(here.hessian), self.system
        blend = self.blend if self.blend >= BLEND_LEAST else 0.0
        values = exact if blend == 0.0 else (1.0 - blend) * exact + blend * self._convex(here)
        if not system.factor(values):
            blend = 1.0
            if not any(system.factor(self._convex(here, shift)) for shift in SHIFTS):
                return None
        self.blend = self.decay * blend
        step = -system.solve(gradient)
        turn = np.linalg.norm(step[:, 3:], axis=1).max()
        return step * min(1.0, TURN_CAP / max(turn, 1e-300))

    def _convex(self, here: Expansion, shift: float = SHIFTS[0]) -> np.ndarray:
        """Values of the convex part, made definite."""
        return self.system.definite(self.system.values(here.convex), shift)

    def _searched(self, state: Any, here: Expansion, gradient: np.ndarray, step: np.ndarray) -> Any | None:
        """The state after the longest halved step that goes well enough below the largest recent energy (Grippo et al. 1986).

        None if there is none.
        """
        slope = float((gradient * step).sum())
        base, share = max(energy for energy, _ in self.history[-RECENT:]), 1.0
        # what rounding alone may change in the energy
        noise = 1e-13 * (abs(base) + here.energy + abs(self.loads.work(state.pose.centres)))
        while share > SHORTEST_STEP:
            trial = self.model.moved(state, share * step)
            with np.errstate(all="ignore"):
                energy = self.model.energy(trial) - self.loads.work(trial.pose.centres)
            if np.isfinite(energy) and energy <= base + ARMIJO * share * slope + noise:
                return trial
            share *= 0.5
        return None

    def _escaped(self, state: Any, here: Expansion) -> Any:
        """A little way down from a saddle, on the side where the energy falls more."""
        way = self.system.softest(self.system.values(here.hessian), self.system.values(here.convex))[0][0]
        way *= NUDGE / max(np.linalg.norm(way[:, 3:], axis=1).max(), 1e-300)
        both = [self.model.moved(state, sign * way) for sign in (1.0, -1.0)]
        return min(both, key=lambda s: self.model.energy(s) - self.loads.work(s.pose.centres))

    def _result(self, state: Any, here: Expansion, converged: bool, sentence: str) -> Equilibrium:
        twist = float(np.abs(self.model.twist(state)).max(initial=0.0))
        negative = 0 if converged else self.system.negative(self.system.values(self.model.expand(state).hessian))
        history = np.array(self.history)
        if converged:
            sentence = f"Converged in {len(history) - 1} iterations."
            if twist > LOCKED:
                sentence = (
                    f"Converged, but two neighbours are twisted by {np.degrees(twist):.0f} degrees against each other: "
                    "probably not the shape that the object would take."
                )
        elif negative:
            sentence += f" {negative} ways lead downhill from there."
        return Equilibrium(
            state.pose,
            float(history[-1, 0]),
            here.per_joint,
            converged,
            len(history) - 1,
            float(history[-1, 1]),
            history,
            negative,
            twist,
            sentence,
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
        if other.converged and all(_differ(other.pose, known.pose, model.pairs, loads) for known in minima):
            minima.append(other)
    return sorted(minima[1:], key=lambda e: e.energy)


def _inside_out(pose: Pose, held: np.ndarray) -> Pose:
    """Mirrored along the mean normal, at the middle of the hubs that are held; these stay."""
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


MODES = 6
BEND = 0.8  # radians, largest turn of the smallest bent start


def _differ(one: Pose, two: Pose, pairs: np.ndarray, loads: Loads) -> bool:
    placed = loads.laid(one, pairs, two)
    apart = np.linalg.norm(placed.centres - two.centres, axis=1).max()
    spacing = np.linalg.norm(two.centres[pairs[:, 1]] - two.centres[pairs[:, 0]], axis=1).mean()
    return bool(apart > 0.1 * spacing)

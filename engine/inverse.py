"""From design coordinates to the mismatch with the target and back: equilibrium, adjoint and tangent (eq. 7 to 10)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from .assembly import Assembly, Pose
from .design_space import DesignSpace
from .elastic import ElasticModel, summed
from .equilibrium import Equilibrium, solve
from .loads import Loads
from .newton_system import NewtonSystem
from .objective import Mismatch, Target
from .params import SimulateParams
from .progress import SILENT, Progress


@dataclass(frozen=True, eq=False)
class Problem:
    """What is asked: spirals in ``space`` whose equilibrium under ``loads`` matches ``target``.

    build : makes the elastic model of an assembly; smoothness : weight of differences between joined spirals
    """

    assembly: Assembly
    space: DesignSpace
    target: Target
    loads: Loads
    build: Callable[[Assembly], ElasticModel]
    simulate: SimulateParams
    smoothness: float = 0.0
    systems: list[NewtonSystem] = field(default_factory=list)

    def system(self, start: Pose, keep: Point | None) -> NewtonSystem:
        """The linear system for one more equilibrium, but not the one whose factor ``keep`` still needs."""
        if not self.systems:
            pairs = self.assembly.pairs
            held = self.loads.held(pairs, start.centres)
            self.systems.extend(NewtonSystem(pairs, held) for _ in range(2))
        return self.systems[1 if keep is not None and keep.system is self.systems[0] else 0]

    def at(
        self,
        x: np.ndarray,
        start: Pose,
        progress: Progress = SILENT,
        iterations: int | None = None,
        keep: Point | None = None,
    ) -> Point:
        """The point with coordinates (n, 2), its equilibrium sought from a pose; ``keep`` stays usable, other points do not."""
        model = self.build(self.assembly.redesigned(*self.space.design(x)))
        system = self.system(start, keep)
        found = solve(model, start, self.loads, self.simulate, progress, system, iterations)
        return Point(self, x, model, found, self.target.compare(found.pose.centres), system)


@dataclass(frozen=True, eq=False)
class Point:
    """One design with its equilibrium. The derivatives belong to converged equilibria, whose factor ``system`` holds."""

    problem: Problem
    x: np.ndarray
    model: ElasticModel
    equilibrium: Equilibrium
    mismatch: Mismatch
    system: NewtonSystem

    @cached_property
    def value(self) -> float:
        """The objective: mismatch, and roughness by its weight."""
        return self.mismatch.value + 0.5 * self.problem.smoothness * float((self._steps**2).sum() / len(self._steps))

    @property
    def _steps(self) -> np.ndarray:
        a, b = self.problem.assembly.pairs.T
        return self.x[b] - self.x[a]

    def rough(self, change: np.ndarray) -> np.ndarray:
        """(n, 2) product of the roughness's Hessian with (n, 2)."""
        if not self.problem.smoothness:
            return np.zeros_like(change)
        a, b = self.problem.assembly.pairs.T
        step = self.problem.smoothness / len(a) * (change[b] - change[a])
        out = np.zeros_like(change)
        np.add.at(out, b, step)
        np.add.at(out, a, -step)
        return out

    @cached_property
    def _forces(self) -> np.ndarray:
        """(m, 12, 4) change of the joints' gradients with both spirals' coordinates."""
        by_design = self.model.gradient_by_design(self.model.start(self.equilibrium.pose))
        slopes = self.problem.space.slopes(self.x)[self.problem.assembly.pairs]
        return (np.swapaxes(by_design, 1, 2) @ slopes).transpose(0, 2, 1, 3).reshape(-1, 12, 4)

    def moves(self, change: np.ndarray) -> np.ndarray:
        """(n, 6) how the hubs move, to first order, when the coordinates change by (n, 2) (eq. 8, forward)."""
        pairs = self.problem.assembly.pairs
        force = (self._forces @ change[pairs].reshape(-1, 4, 1))[..., 0]
        return -self.system.solve(summed(force, pairs, len(self.x)))

    def adjoint(self, pull: np.ndarray) -> np.ndarray:
        """(n, 2) change with the coordinates of a quantity that changes with the hubs by (n, 6) (eq. 8, backward)."""
        pairs = self.problem.assembly.pairs
        answer = self.system.solve(pull)[pairs].reshape(-1, 1, 12)
        share = (answer @ self._forces)[:, 0].reshape(-1, 2, 2)
        out = np.empty_like(self.x)
        for k in (0, 1):
            out[:, k] = -np.bincount(pairs.ravel(), share[..., k].ravel(), len(out))
        return out

    @cached_property
    def gradient(self) -> np.ndarray:
        """(n, 2) of the objective by the coordinates, by one adjoint solve (eq. 10)."""
        return self.adjoint(_shifts(self.mismatch.gradient)) + self.rough(self.x)

    def gauss_newton(self, change: np.ndarray, turning: float = 0.0) -> np.ndarray:
        """(n, 2) product of the objective's Gauss-Newton matrix with (n, 2): one tangent and one adjoint solve.

        ``turning`` adds half of it times the hubs' squared turns to the quadratic model.
        """
        moves = self.moves(change)
        pull = _shifts(self.mismatch.backward(self.mismatch.forward(moves[:, :3])))
        pull[:, 3:] = turning * moves[:, 3:]
        return self.adjoint(pull) + self.rough(change)


def _shifts(pull: np.ndarray) -> np.ndarray:
    return np.concatenate([pull, np.zeros_like(pull)], axis=1)

"""From design coordinates to the mismatch with the target and back: equilibrium, adjoint and tangent (eq. 7 to 10)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from ..arrays import Float
from ..materials import Material
from ..mechanics.arms.model import ArmModel
from ..mechanics.arms.sensitivity import JointChanges, StrainChanges
from ..mechanics.assembly import Assembly, Pose
from ..mechanics.elastic import ElasticModel, JointSum, summed
from ..mechanics.equilibrium import Equilibrium, solve
from ..mechanics.loads import Loads
from ..mechanics.newton_system import NewtonSystem
from ..params import SimulateParams
from ..progress import SILENT, Progress
from ..spirals.room import Room
from .bounds import Rooms, Within, lowest, restored
from .costs import Cost, Roughness, differences
from .design_space import DesignSpace
from .factors import Factors
from .objective import Mismatch, Target
from .open_slots import Closing, Narrow, Opening
from .work import EQUILIBRIUM, ITERATION, PRODUCT, Work


@dataclass(frozen=True, eq=False)
class Problem:
    """What is asked: spirals in ``space`` whose equilibrium under ``loads`` matches ``target``.

    build : makes the elastic model of an assembly; smoothness : weight of differences between joined spirals
    bearing : the material and the share of its strain limit that arms should stay below; None lets them be strained
    opening : how wide slots should stay in space; None lets them close
    work : counts what has been done for all points; room : what keeps designs such that they can be cut, None for any
    """

    assembly: Assembly
    space: DesignSpace
    target: Target
    loads: Loads
    build: Callable[[Assembly, Progress], ElasticModel]
    simulate: SimulateParams
    smoothness: float = 0.0
    bearing: tuple[Material, float] | None = None
    opening: Opening | None = None
    work: Work = field(default_factory=Work)
    shared: list[Factors] = field(default_factory=list)
    room: Room | None = None
    sums: list[JointSum] = field(default_factory=list)

    def factors(self, start: Pose) -> Factors:
        """For all points with the same supports, which are held alike so that their equilibria lie in the same place."""
        fixed, pairs = self.loads.fixed, self.assembly.pairs
        for known in self.shared:
            if np.array_equal(known.fixed, fixed):
                return known
        self.shared.append(Factors(pairs, fixed, self.loads.held(pairs, start.centres)))
        return self.shared[-1]

    @property
    def joint_sum(self) -> JointSum:
        """For the change of the hubs' forces with the design."""
        if not self.sums:
            self.sums.append(JointSum(self.assembly.pairs, self.assembly.size, self.space.each))
        return self.sums[0]

    def costs(self, x: np.ndarray) -> tuple[Cost, ...]:
        """What the design with these coordinates costs beside its mismatch."""
        if not self.smoothness:
            return ()
        return (Roughness(differences(self.assembly, self.space, len(x)), self.smoothness, x),)

    def rooms(self, x: np.ndarray) -> Rooms:
        """The rooms near the design with these coordinates."""
        if self.room is None:
            return Rooms.none(len(x))
        terms = lowest(self.room.terms(*self.space.design(x)))
        return Rooms.of(terms.value, terms.by_design @ self.by_coordinates(x))

    def by_coordinates(self, x: np.ndarray) -> csr_array:
        """(5 n, coordinates) derivatives of all widths, and then of all twists, by the coordinates."""
        slopes = self.space.slopes(x)
        n, _, each = slopes.shape
        row = np.concatenate([np.arange(4 * n).reshape(n, 4), 4 * n + np.arange(n)[:, None]], axis=1)
        column = each * np.arange(n)[:, None, None] + np.arange(each)
        both = np.broadcast_arrays(row[..., None], column)
        return csr_array((slopes.ravel(), (both[0].ravel(), both[1].ravel())), shape=(5 * n, len(x)))

    def within(self, x: np.ndarray, inner: Point) -> Float[np.ndarray, " coordinates"]:
        """Coordinates near to x of a design that can be cut; those of ``inner`` can."""
        room, space = self.room, self.space
        if room is None:
            return x
        within = Within(
            self.rooms,
            lambda y, quads: room.closed(*space.design(y), quads),
            lambda share: np.repeat(share, space.each),
            len(space.low),
            len(x),
        )
        return restored(x, inner.x, within)

    def at(
        self,
        x: np.ndarray,
        start: Pose,
        progress: Progress = SILENT,
        iterations: int | None = None,
        step: Float[np.ndarray, "spirals 6"] | None = None,
    ) -> Point:
        """The point with these coordinates, its equilibrium sought from a pose and a predicted step (n, 6) from there."""
        model = self.build(self.assembly.redesigned(*self.space.design(x)), progress)
        found, factors = self.rest(model, start, progress, iterations, step)
        return Point(self, x, model, found, self.target.compare(found.pose.centres), factors)

    def rest(
        self,
        model: ElasticModel,
        start: Pose,
        progress: Progress,
        iterations: int | None,
        step: np.ndarray | None,
    ) -> tuple[Equilibrium, Factors]:
        """The equilibrium of a model, sought as in ``at``, and where its factor is kept."""
        factors = self.factors(start)
        factor = factors.free()
        found = solve(model, start, self.loads, self.simulate, progress, factor.system, iterations, step)
        factor.owner = found if found.converged else None
        self.work.add(EQUILIBRIUM + ITERATION * (found.iterations + 1), self.assembly.size)
        return found, factors


@dataclass(frozen=True, eq=False)
class Point:
    """One design with its equilibrium. The derivatives belong to converged equilibria."""

    problem: Problem
    x: np.ndarray
    model: ElasticModel
    equilibrium: Equilibrium
    mismatch: Mismatch
    factors: Factors

    @property
    def system(self) -> NewtonSystem:
        """The linear system with the factor of this point."""
        return self.factors.of(self.equilibrium, lambda: self.model.expand(self._state).hessian)

    def prepare(self, progress: Progress) -> None:
        """Derive, with progress, what the derivatives need: on thousands of spirals it takes a while."""
        for part in ("_strain", "_forces", "system", "gradient"):
            progress(0.0)
            getattr(self, part)

    @cached_property
    def value(self) -> float:
        """The objective: mismatch, excess of strain, slots that close, and what the design costs by itself."""
        slots = 0.0 if self._closing is None else self._closing.value
        return self.mismatch.value + self._strain.value + slots + sum(cost.value for cost in self.costs)

    @cached_property
    def distance(self) -> float:
        """RMS distance of the hubs to the target, in distances of neighbours."""
        return self.problem.target.distance(self.equilibrium.pose)

    @property
    def spirals(self) -> tuple[np.ndarray, np.ndarray]:
        """Widths (n, 4) metres and twists (n,) radians."""
        return self.problem.space.design(self.x)

    @cached_property
    def rooms(self) -> Rooms:
        """The rooms near the design."""
        return self.problem.rooms(self.x)

    @cached_property
    def costs(self) -> tuple[Cost, ...]:
        """What the design costs beside its mismatch."""
        return self.problem.costs(self.x)

    @cached_property
    def _state(self) -> Any:
        return self.model.start(self.equilibrium.pose)

    @cached_property
    def _strain(self) -> Excess:
        if self.problem.bearing is None or not isinstance(self.model, ArmModel):
            return NO_EXCESS
        material, share = self.problem.bearing
        found = StrainChanges.of(self.model.assembly, self._changes, material)
        return Excess.of(found, share * material.strain_limit)

    @cached_property
    def _closing(self) -> Closing | None:
        if self._opening is None or not isinstance(self.model, ArmModel):
            return None
        found = self._opening.at(self.model, self.equilibrium.pose)
        return found if len(found.found.values) else None

    @property
    def _opening(self) -> Opening | None:
        return self.problem.opening

    @cached_property
    def _narrow(self) -> Narrow | None:
        closing = self._closing
        if closing is None:
            return None
        return Narrow(closing, closing.by_pose, closing.by_design @ self.problem.by_coordinates(self.x))

    @cached_property
    def _changes(self) -> JointChanges:
        assert isinstance(self.model, ArmModel)
        return self.model.changes(self._state)

    @cached_property
    def _forces(self) -> csr_array:
        """(6 n, K n) change of the hubs' forces with the spirals' coordinates."""
        arms = isinstance(self.model, ArmModel)
        by_design = self._changes.gradient_by_design if arms else self.model.gradient_by_design(self._state)
        blocks = np.swapaxes(by_design, 1, 2) @ self._slopes
        return self.problem.joint_sum(blocks.transpose(0, 2, 1, 3))

    @cached_property
    def _back_forces(self) -> csr_array:
        """Its transpose."""
        return csr_array(self._forces.T)

    @cached_property
    def _slopes(self) -> Float[np.ndarray, "joints 2 5 _"]:
        """(m, 2, 5, K) of widths and twist (rows) by coordinates (columns) of both spirals of every joint."""
        return self.problem.space.slopes(self.x)[self.problem.assembly.pairs]

    def moves(self, change: np.ndarray) -> Float[np.ndarray, "spirals 6"]:
        """(n, 6) how the hubs move, to first order, when the coordinates change (eq. 8, forward)."""
        return -self.system.solve((self._forces @ change).reshape(-1, 6))

    def adjoint(self, pull: np.ndarray) -> Float[np.ndarray, " coordinates"]:
        """Change with the coordinates of a quantity that changes with the hubs by (n, 6) (eq. 8, backward)."""
        return -(self._back_forces @ self.system.solve(pull).ravel())

    def _gathered(self, share: np.ndarray) -> Float[np.ndarray, " coordinates"]:
        """Sums over the spirals of what their joints (m, 2, K), by side, contribute to their coordinates."""
        index = self.problem.assembly.pairs[..., None] * self.problem.space.each + np.arange(share.shape[2])
        return np.bincount(index.ravel(), share.ravel(), len(self.x))

    @cached_property
    def gradient(self) -> Float[np.ndarray, " coordinates"]:
        """Of the objective by the coordinates, by one adjoint solve (eq. 10)."""
        pull, direct, narrow = _shifts(self.mismatch.gradient), np.zeros(len(self.x)), self._narrow
        if narrow is not None:
            by_pose, direct = narrow.gradient
            pull = pull + by_pose
        back = self._back(pull, self._strain.slope)
        return sum((cost.gradient for cost in self.costs), back + direct)

    def gauss_newton(self, change: np.ndarray, turn_damping: float = 0.0) -> Float[np.ndarray, " coordinates"]:
        """Product of the objective's Gauss-Newton matrix with a change of the coordinates: one tangent and one adjoint solve.

        With ``turn_damping``, of the objective and half of this times the sum of the squares of the hubs' turns in radians.
        """
        self.problem.work.add(PRODUCT, len(self.problem.assembly.width))
        moves = self.moves(change)
        pull = _shifts(self.mismatch.backward(self.mismatch.forward(moves[:, :3])))
        pull[:, 3:] = turn_damping * moves[:, 3:]
        narrow, direct = self._narrow, np.zeros(len(self.x))
        if narrow is not None:
            by_pose, direct = narrow.product(moves, change)
            pull += by_pose
        strain, strained = self._strain, np.zeros(0)
        if strain.found is not None:
            strained = strain.curvature * self._grown(strain.found, moves, change)
        return sum((cost.product(change) for cost in self.costs), self._back(pull, strained) + direct)

    def _grown(self, found: StrainChanges, moves: np.ndarray, change: np.ndarray) -> Float[np.ndarray, "joints 2"]:
        """(m, 2) how the arms' strains change when the coordinates change and the hubs move by (n, 6)."""
        pairs = self.problem.assembly.pairs
        own = self.problem.space.by_spiral(change)[pairs]
        design = (self._slopes @ own[..., None])[..., 0]
        through = (found.by_pose @ moves[pairs].reshape(-1, 12, 1))[..., 0]
        return through + np.einsum("eaks,eks->ea", found.by_design, design)

    def _back(self, pull: np.ndarray, strained: np.ndarray) -> Float[np.ndarray, " coordinates"]:
        """Change of what changes with the hubs by (n, 6), and with the arms' strains by (m, 2)."""
        found = self._strain.found
        if found is None:
            return self.adjoint(pull)
        pairs = self.problem.assembly.pairs
        through = (strained[:, None] @ found.by_pose)[:, 0]
        direct = np.einsum("ea,eaks,ekst->ekt", strained, found.by_design, self._slopes)
        return self.adjoint(pull + summed(through, pairs, len(pull))) + self._gathered(direct)


@dataclass(frozen=True, eq=False)
class Excess:
    """Strains beyond a limit, as a penalty: half the mean square of their relative excess, times ``STRAIN_WEIGHT``.

    Beyond an excess of ``HOPELESS`` it goes on in a straight line (Huber's loss): a few arms that no spirals could save
    would else outweigh all the rest.

    found : the strains, None where they do not count; slope, curvature : (m, 2) derivatives of the penalty by them
    """

    value: float
    slope: Float[np.ndarray, "joints 2"]
    curvature: Float[np.ndarray, "joints 2"]
    found: StrainChanges | None

    @classmethod
    def of(cls, found: StrainChanges, limit: float) -> Excess:
        over = np.maximum(found.values / limit - 1.0, 0.0)
        unit = STRAIN_WEIGHT / over.size
        near = np.minimum(over, HOPELESS)
        value = unit * float((near * (over - 0.5 * near)).sum())
        # the curvature of the parabola with the same slope: so Gauss-Newton steps go down
        curvature = np.divide(near, over, out=np.zeros_like(over), where=over > 0.0) * unit / limit**2
        return cls(value, unit * near / limit, curvature, found)


STRAIN_WEIGHT = 1.0  # of the excess of strain against the mismatch; by eye
HOPELESS = 0.25  # excess of strain from which on its penalty grows in a straight line; by eye
NO_EXCESS = Excess(0.0, np.zeros(0), np.zeros(0), None)  # where strains do not count


def _shifts(pull: np.ndarray) -> np.ndarray:
    return np.concatenate([pull, np.zeros_like(pull)], axis=1)

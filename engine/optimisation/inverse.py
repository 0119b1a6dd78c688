"""From design coordinates to the mismatch with the target and back: equilibrium, adjoint and tangent (eq. 7 to 10)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from scipy.sparse import csr_array

from ..arrays import Bool, Float, Int
from ..mechanics.arms.model import ArmModel
from ..mechanics.arms.sensitivity import JointChanges
from ..mechanics.arms.strain_changes import Strains, StrainSlopes
from ..mechanics.assembly import Assembly, Pose
from ..mechanics.elastic import ElasticModel, JointSum
from ..mechanics.equilibrium import Equilibrium, solve
from ..mechanics.loads import Loads
from ..mechanics.newton_system import NewtonSystem
from ..mechanics.stance import Stance
from ..params import SimulateParams
from ..progress import SILENT, Progress
from ..spirals.room import Room
from .bounds import Rooms, Within, lowest, restored
from .costs import Cost, Roughness, differences
from .design_space import DesignSpace
from .factors import Factors
from .firmness import Firmness, SoftModes, StabilityBarrier
from .objective import Mismatch, Target
from .open_slots import Closing, Narrow, Opening
from .terms import WEIGHT, Apart, Bearing, Change, Excess, Rows, Term, rows_in_runs, total, turning
from .work import EQUILIBRIUM, ITERATION, MODE, OPENING, PRODUCT, ROOMS, SOFTEST, Work

# Share of its stiffness that an equilibrium has to spare (see ``Equilibrium.spare``): a piece nearer to where it snaps is thrown
# into another shape by the hundredth part of a millimetre that proving it may change. Most surfaces end at 0.3 to 0.8
MARGIN = 0.01
NEARLY = 1e-3  # room, in smallest slots, below which rooms are looked at where some are closed


@dataclass(frozen=True, eq=False)
class Problem:
    """What is asked: spirals in ``space`` whose equilibrium under ``loads`` matches ``target``.

    build : makes the elastic model of an assembly; smoothness : weight of differences between joined spirals
    opening : how wide slots should stay in space; None lets them close
    bearing : what strains of the arms should stay below; None lets them be strained
    firmness : how stable equilibria should be; None asks for no more than that steps keep ``MARGIN``
    work : counts what has been done for all points; room : what keeps designs such that they can be cut, None for any
    stance : where supports are held; None leaves them where a search for an equilibrium starts
    """

    assembly: Assembly
    space: DesignSpace
    target: Target
    loads: Loads
    build: Callable[[Assembly, Progress], ElasticModel]
    simulate: SimulateParams
    smoothness: float = 0.0
    bearing: Bearing | None = None
    opening: Opening | None = None
    work: Work = field(default_factory=Work)
    shared: list[Factors] = field(default_factory=list)
    room: Room | None = None
    firmness: Firmness | None = None
    sums: list[JointSum] = field(default_factory=list)
    stance: Stance | None = None

    def factors(self, start: Pose) -> Factors:
        """For all points with the same supports, which are held alike so that their equilibria lie in the same place."""
        fixed, pairs = self.loads.fixed, self.assembly.whole.pairs
        for known in self.shared:
            if np.array_equal(known.fixed, fixed):
                return known
        self.shared.append(Factors(pairs, fixed, self.loads.held(pairs, start.centres)))
        return self.shared[-1]

    @property
    def own(self) -> int:
        """How many of the coordinates are those of the spirals; those of the flat vertices follow, where these may move."""
        return self.space.each * self.assembly.size

    @property
    def joint_sum(self) -> JointSum:
        """For the change of the hubs' forces with the design."""
        if not self.sums:
            self.sums.append(JointSum(self.assembly.whole, self.space.each))
        return self.sums[0]

    def costs(self, x: np.ndarray) -> tuple[Cost, ...]:
        """What the design with these coordinates costs beside its mismatch."""
        if not self.smoothness:
            return ()
        free = np.ones(len(x))  # flat vertices, which come last, do not enter
        free[: self.own] = self._spread(self.space.free.astype(float))[: self.own]
        return (Roughness(differences(self.assembly, self.space, len(x)), self.smoothness, x, free),)

    def rooms(self, x: np.ndarray) -> Rooms:
        """The rooms near the design with these coordinates."""
        if self.room is None:
            return Rooms.none(len(x))
        terms = lowest(self.room.terms(*self.space.design(x), least=True))
        return Rooms.of(terms.value, terms.by_design @ self.by_coordinates(x))

    def by_coordinates(self, x: np.ndarray) -> csr_array:
        """(5 n, coordinates) derivatives of all widths, and then of all twists, by the coordinates."""
        slopes = self.space.slopes(x)
        n, _, each = slopes.shape
        column = (each * np.arange(n)[:, None] + np.arange(each)).astype(np.int32)
        columns = np.concatenate([np.repeat(column, 4, axis=0).ravel(), column.ravel()])
        data = np.concatenate([slopes[:, :4].ravel(), slopes[:, 4].ravel()])
        return csr_array((data, columns, np.arange(0, data.size + 1, each, dtype=np.int32)), shape=(5 * n, len(x)))

    def within(self, x: np.ndarray, inner: Point) -> Float[np.ndarray, " coordinates"]:
        """Coordinates near to x of a design that can be cut; those of ``inner`` can."""
        if self.room is None:
            return x
        self.work.add(ROOMS, self.assembly.size)
        within = Within(self._closing, self._shut, self._spread, self.assembly.size, self.own)
        return restored(x, inner.x, within)

    def inside(self, x: np.ndarray, inner: np.ndarray) -> Float[np.ndarray, " coordinates"]:
        """Coordinates between two designs, as near to x as the limits of flat shapes allow, which ``inner`` keeps."""
        return x

    def _room(self, x: np.ndarray) -> Room:
        """What keeps designs in the flat shapes with these coordinates such that they can be cut."""
        assert self.room is not None
        return self.room

    def _closing(self, x: np.ndarray, quads: np.ndarray | None) -> Rooms:
        """The rooms that are closed or nearly, by the spirals' coordinates; those in which some quads have a part, if given."""
        terms = lowest(self._room(x).terms(*self.space.design(x), below=NEARLY, quads=quads, least=True))
        return Rooms.of(terms.value, terms.by_design @ self.by_coordinates(x[: self.own]))

    def _shut(self, x: np.ndarray, quads: np.ndarray | None) -> Bool[np.ndarray, " quads"]:
        """The spirals that have a part in a closed room, likewise; without those that are kept, which cannot open it."""
        return self._room(x).closed(*self.space.design(x), quads) & self.space.free

    def _spread(self, share: Float[np.ndarray, " quads"]) -> Float[np.ndarray, " coordinates"]:
        """For every coordinate what is given for the spirals."""
        return np.repeat(share, self.space.each)

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
        found, factors = self.rest(model, self.stance, start, progress, iterations, step)
        return Point(self, x, model, found, self.target.compare(found.pose.centres), factors)

    def rest(
        self,
        model: ElasticModel,
        stance: Stance | None,
        start: Pose,
        progress: Progress,
        iterations: int | None,
        step: np.ndarray | None,
    ) -> tuple[Equilibrium, Factors]:
        """The equilibrium of a model in a stance, sought as in ``at``, and where its factor is kept."""
        if stance is not None:
            start, step = (stance.placed(start), None) if step is None else (start, stance.step(start, step))
        factors = self.factors(start)
        factor = factors.free()
        margins = (MARGIN,) if self.firmness is None else (MARGIN, self.firmness.enough)
        found = solve(model, start, self.loads, self.simulate, progress, factor.system, iterations, step, margins)
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
        for part in ("terms", "_forces", "system", "gradient"):
            progress(0.0)
            getattr(self, part)

    @cached_property
    def terms(self) -> tuple[Term, ...]:
        """What there is to say about the equilibrium."""
        found: list[Term] = [Apart(self.mismatch)]
        if self.strains is not None and self.problem.bearing is not None:
            found.append(Excess(self.problem.bearing, self.strains.values, self._strain_rows))
        return (*found, *(one for one in (self._narrow, self.barrier) if one is not None))

    @cached_property
    def value(self) -> float:
        """The objective: what there is to say about the equilibrium, and what the design costs by itself."""
        return sum(term.value for term in self.terms) + sum(cost.value for cost in self.costs)

    def merit(self, strictness: float, found: Mismatch | None = None, strain: float | None = None) -> float:
        """The objective by which designs of different problems are compared (see ``Bearing.merit``).

        With another mismatch and another largest strain: of the same design, simulated.
        """
        # barriers keep the way within its bounds and say nothing of where it has come to
        costs = Problem.costs(self.problem, self.x)
        value = (found or self.mismatch).value + sum(cost.value for cost in costs)
        value += 0.0 if self._closing is None else self._closing.value
        value *= 1.0 if self.barrier is None else self.barrier.merit
        if self.strains is None or self.problem.bearing is None:
            return value
        largest = float(self.strains.values.max()) if strain is None else strain
        return self.problem.bearing.merit(value, largest, strictness)

    def weighed(self, mismatch: float) -> Point:
        """The same point in a search that starts with this mismatch, which decides what excesses of strain weigh.

        A lack of stability weighs nothing in the first stage, so that it turns no piece that ends stable into another way.
        """
        bearing = self.problem.bearing
        bearing = None if bearing is None else replace(bearing, weight=WEIGHT * mismatch)
        return replace(self, problem=replace(self.problem, bearing=bearing, firmness=Firmness(0.0)))

    def firmed(self, *, strong: bool) -> Self:
        """The same point in a stage that starts here; strong : that keeps farther away from where pieces snap."""
        firmness = Firmness.from_mismatch(self.mismatch.value, strong=strong)
        return replace(self, problem=replace(self.problem, firmness=firmness))

    def pressed(self) -> Self:
        """The same point, where what is still strained too much is pushed back with more force."""
        bearing = self.problem.bearing
        if self.strains is None or bearing is None:
            return self
        return replace(self, problem=replace(self.problem, bearing=bearing.pressed(self.strains.values)))

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
    def strains(self) -> Strains | None:
        """Of the arms; None where they do not count."""
        if self.problem.bearing is None or not isinstance(self.model, ArmModel):
            return None
        return Strains.of(self.model.assembly, self._changes, self.problem.bearing.material)

    @cached_property
    def _modes(self) -> SoftModes | None:
        """The softest modes where they are less stable than asked for; None where all are stable enough."""
        asked, found = self.problem.firmness, self.equilibrium
        if asked is None or not found.converged or found.spare >= asked.enough or not isinstance(self.model, ArmModel):
            return None
        self.problem.work.add(SOFTEST, self.problem.assembly.size)
        modes = SoftModes.from_equilibrium(self.model, found.pose, self.system, asked)
        return modes if len(modes.rises) else None

    @cached_property
    def barrier(self) -> StabilityBarrier | None:
        """What keeps the equilibrium away from where it snaps; None where it is stable enough."""
        asked, modes = self.problem.firmness, self._modes
        return None if asked is None or modes is None else StabilityBarrier(asked, modes.rises, self._by_modes)

    def _by_modes(self) -> tuple[Float[np.ndarray, "k spirals 6"], Float[np.ndarray, "k coordinates"]]:
        """Derivatives of the softest eigenvalues by the hubs, and by the coordinates where the hubs stand still."""
        modes, pose = self._modes, self.equilibrium.pose
        assert modes is not None and isinstance(self.model, ArmModel)
        self.problem.work.add(MODE * len(modes.rises), self.problem.assembly.size)
        return modes.by_hubs(self.model, pose), modes.by_spirals(self.model, pose, self._slopes)

    @cached_property
    def _closing(self) -> Closing | None:
        if self._opening is None or not isinstance(self.model, ArmModel):
            return None
        self.problem.work.add(OPENING, self.problem.assembly.size)
        found = self._opening.at(self.model, self.equilibrium.pose)
        return found if len(found.found.values) else None

    @property
    def _opening(self) -> Opening | None:
        return self.problem.opening

    @cached_property
    def _narrow(self) -> Narrow | None:
        return None if self._closing is None else Narrow(self._closing, self._slots_by_x)

    def _slots_by_x(self, closing: Closing) -> csr_array:
        """(K, coordinates) how widths of slots change with the coordinates where the hubs stand still."""
        return csr_array(closing.by_design @ self.problem.by_coordinates(self.x))

    @cached_property
    def _changes(self) -> JointChanges:
        assert isinstance(self.model, ArmModel)
        return self.model.changes(self._state)

    @cached_property
    def _forces(self) -> csr_array:
        """(6 n, coordinates) change of the hubs' forces with the coordinates."""
        return self._forces_by_spirals()

    def _forces_by_spirals(self) -> csr_array:
        """(6 n, K n) the same with those of the spirals."""
        arms = isinstance(self.model, ArmModel)
        by_design = self._changes.gradient_by_design if arms else self.model.gradient_by_design(self._state)
        blocks = np.swapaxes(by_design, 1, 2) @ self._slopes
        return self.problem.joint_sum(blocks.transpose(0, 2, 1, 3))

    @cached_property
    def _back_forces(self) -> csr_array:
        """The transpose of ``_forces``."""
        return csr_array(self._forces.T)

    @cached_property
    def _slopes(self) -> Float[np.ndarray, "joints 2 5 _"]:
        """(m, 2, 5, K) of widths and twist (rows) by coordinates (columns) of both spirals of every joint."""
        return self.problem.space.slopes(self.x)[self.problem.assembly.whole.owners]

    def moves(self, change: np.ndarray) -> Float[np.ndarray, "spirals 6"]:
        """(n, 6) how the hubs, and the nodes of a rim, move, to first order, when the coordinates change (eq. 8, forward)."""
        moves = -self.system.solve((self._forces @ change).reshape(-1, 6))
        return moves if self._held is None else moves + (self._held @ change).reshape(-1, 6)

    def adjoint(self, pull: np.ndarray) -> Float[np.ndarray, " coordinates"]:
        """Change with the coordinates of a quantity that changes with the hubs by (n, 6) (eq. 8, backward)."""
        found = -(self._back_forces @ self.system.solve(pull).ravel())
        return found if self._held is None else found + pull.ravel() @ self._held[: pull.size]

    @property
    def _held(self) -> csr_array | None:
        """(6 n, coordinates) how the supports move with the coordinates; None where they stay."""
        return None

    def _strain_rows(self, arms: Int[np.ndarray, " k"]) -> Rows:
        """Derivatives of the strains of some arms, 2 e + side of the joint e."""
        assert self.strains is not None
        return self._rows_of_spirals(arms // 2, self.strains.slopes(arms))

    def _rows_of_spirals(self, e: Int[np.ndarray, " k"], found: StrainSlopes) -> Rows:
        """Derivatives of strains at the joints e by the hubs and by the spirals' coordinates."""
        problem, whole = self.problem, self.problem.assembly.whole
        hubs = rows_in_runs(found.by_pose.reshape(-1, 2, 6), 6 * whole.pairs[e], 6 * whole.size)
        own = (found.by_design[:, :, None] @ self._slopes[e])[:, :, 0]
        return Rows(hubs, rows_in_runs(own, problem.space.each * whole.owners[e], problem.own))

    @cached_property
    def gradient(self) -> Float[np.ndarray, " coordinates"]:
        """Of the objective by the coordinates, by one adjoint solve (eq. 10)."""
        return sum((cost.gradient for cost in self.costs), self.back([term.gradient for term in self.terms]))

    def gauss_newton(self, change: np.ndarray) -> Float[np.ndarray, " coordinates"]:
        """Product of the objective's Gauss-Newton matrix with a change of the coordinates: one tangent and one adjoint solve."""
        return self.product(change, self.terms, self.costs)

    def product(
        self, change: np.ndarray, terms: Sequence[Term], costs: Sequence[Cost], turn_damping: float = 0.0
    ) -> Float[np.ndarray, " coordinates"]:
        """Product with the matrix of these terms and costs, and of half of ``turn_damping`` times the hubs' squared turns (radians)."""
        self.problem.work.add(PRODUCT, len(self.problem.assembly.width))
        moves = self.moves(change)
        parts = [turning(turn_damping, moves), *(term.product(moves, change) for term in terms)]
        return sum((cost.product(change) for cost in costs), self.back(parts))

    def back(self, parts: list[Change]) -> Float[np.ndarray, " coordinates"]:
        """By the coordinates, of what changes like this with hubs and coordinates."""
        hubs, own = total(parts, self.problem.assembly.whole.size, len(self.x))
        return self.adjoint(hubs) + own

"""Inverse problem: objective of a design at its equilibrium, adjoint gradient, Gauss-Newton products (eq. 7 to 10)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from scipy.sparse import csr_array

from ..arrays import Bool, Float, Int
from ..mechanics.arms.curving_changes import DesignChanges
from ..mechanics.arms.model import ArmModel
from ..mechanics.arms.strain_changes import Strains, StrainSlopes
from ..mechanics.arms.with_arms import with_arms
from ..mechanics.assembly import Assembly, Pose
from ..mechanics.elastic import ElasticModel, JointSum
from ..mechanics.equilibrium import Equilibrium, solve
from ..mechanics.loads import Loads
from ..mechanics.newton_system import NewtonSystem
from ..mechanics.stance import Stance
from ..params import SimulateParams
from ..progress import SILENT, Progress
from ..spirals.clearance.clearance_model import ClearanceModel
from .bounds import ClearanceProblem, narrowest_per_pair, restore_clearances
from .costs import Cost, Roughness
from .design_space import DesignSpace
from .factors import Factors
from .firmness import MIN_STABILITY, SoftModes, StabilityBarrier, StabilityRequirement
from .goal_registry import goals_of
from .objective import Mismatch, Target
from .open_slots import NarrowSlots, SlotPenalty, SlotRequirement
from .other_weights import with_problem
from .polytope import LinearClearances
from .terms import WEIGHT, MismatchTerm, Rows, ScalarChange, StrainLimit, StrainTerm, Term, rows_in_runs, total, turning
from .work import CURVED, EQUILIBRIUM, ITERATION, MODE, OPENING, PRODUCT, ROOMS, SOFTEST, Work

NEAR_GAP = 1e-3  # clearance, in smallest slots, below which a gap is kept open while closed gaps are opened


@dataclass(frozen=True, eq=False)
class InverseProblem:
    """An inverse problem: find spirals in ``space`` whose equilibrium under ``loads`` matches ``target``.

    build : makes the elastic model of an assembly; simulate : settings of equilibria
    smoothness : weight of differences between joined spirals; bearing : limit of the arms' strains, None for no limit
    opening : required width of slots in space; None lets slots close; shared, sums : caches
    work : counter for all points; room : clearances of a design; None does not check whether designs can be cut
    firmness : required stability of equilibria; None requires ``MIN_STABILITY`` only
    stance : poses of the supports; None keeps the supports where the search starts
    """

    assembly: Assembly
    space: DesignSpace
    target: Target
    loads: Loads
    build: Callable[[Assembly, Progress], ElasticModel]
    simulate: SimulateParams
    smoothness: float = 0.0
    bearing: StrainLimit | None = None
    opening: SlotRequirement | None = None
    work: Work = field(default_factory=Work)
    shared: list[Factors] = field(default_factory=list)
    room: ClearanceModel | None = None
    firmness: StabilityRequirement | None = None
    sums: list[JointSum] = field(default_factory=list)
    stance: Stance | None = None

    def factors(self, start: Pose) -> Factors:
        """Return the cache of factors of all points with these supports; they share the increments held at 0 too."""
        fixed, pairs = self.loads.fixed, self.assembly.whole.pairs
        for known in self.shared:
            if np.array_equal(known.fixed, fixed):
                return known
        self.shared.append(Factors(pairs, fixed, self.loads.held_increments(pairs, start.centres), self.loads.springs))
        return self.shared[-1]

    @property
    def own(self) -> int:
        """Number of the spirals' coordinates; coordinates of flat vertices follow, where these may move."""
        return self.space.each * self.assembly.size

    @property
    def joint_sum(self) -> JointSum:
        """Sparsity pattern of the derivatives of the hubs' forces with respect to the spirals' coordinates."""
        if not self.sums:
            self.sums.append(JointSum(self.assembly.whole, self.space.each))
        return self.sums[0]

    def costs(self, x: np.ndarray) -> tuple[Cost, ...]:
        """Return the costs at coordinates x that do not depend on the equilibrium."""
        return (Roughness.from_space(self.assembly, self.space, self.smoothness, x),) if self.smoothness else ()

    def rooms(self, x: np.ndarray) -> LinearClearances:
        """Return the linearised clearances at coordinates x."""
        if self.room is None:
            return LinearClearances.none(len(x))
        terms = narrowest_per_pair(self.room.terms(*self.space.design(x), least=True))
        return LinearClearances.from_clearances(terms.value, terms.by_design @ self.space.jacobian(x))

    def within(self, x: np.ndarray, inner: DesignPoint) -> Float[np.ndarray, " coordinates"]:
        """Return the coordinates of a design near x that can be cut; the design of ``inner`` can be cut."""
        if self.room is None:
            return x
        self.work.add(ROOMS, self.assembly.size)
        within = ClearanceProblem(self._nearly_closed, self._closed_spirals, self._repeat, self.assembly.size, self.own)
        return restore_clearances(x, inner.x, within)

    def inside(self, x: np.ndarray, inner: np.ndarray) -> Float[np.ndarray, " coordinates"]:
        """Return coordinates as near x as the limits of flat shapes allow; ``inner`` keeps these limits."""
        return x

    def _room(self, x: np.ndarray) -> ClearanceModel:
        """Return the clearances of designs in the flat shapes at coordinates x."""
        assert self.room is not None
        return self.room

    def _nearly_closed(self, x: np.ndarray, quads: np.ndarray | None) -> LinearClearances:
        """Return the closed and nearly closed gaps, linearised in the spirals' coordinates; quads : None for all."""
        terms = narrowest_per_pair(self._room(x).terms(*self.space.design(x), below=NEAR_GAP, quads=quads, least=True))
        return LinearClearances.from_clearances(terms.value, terms.by_design @ self.space.jacobian(x[: self.own]))

    def _closed_spirals(self, x: np.ndarray, quads: np.ndarray | None) -> Bool[np.ndarray, " quads"]:
        """Return a mask of the free spirals with an arm in a closed gap; quads : whose gaps count, None for all."""
        return self._room(x).quads_with_closed_gaps(*self.space.design(x), quads) & self.space.free

    def _repeat(self, share: Float[np.ndarray, " quads"]) -> Float[np.ndarray, " coordinates"]:
        """Repeat every spiral's value for each of its coordinates."""
        return np.repeat(share, self.space.each)

    def at(
        self,
        x: np.ndarray,
        start: Pose,
        progress: Progress = SILENT,
        iterations: int | None = None,
        step: Float[np.ndarray, "spirals 6"] | None = None,
    ) -> DesignPoint:
        """Return the point at x; seek its equilibrium from ``start`` moved by ``step``, in at most ``iterations``."""
        model = self.build(self.assembly.with_spirals(*self.space.design(x)), progress)
        found, factors = self.rest(model, self.stance, start, progress, iterations, step)
        return DesignPoint(self, x, model, found, self.target.compare(found.pose.centres), factors)

    def rest(
        self,
        model: ElasticModel,
        stance: Stance | None,
        start: Pose,
        progress: Progress,
        iterations: int | None,
        step: np.ndarray | None,
    ) -> tuple[Equilibrium, Factors]:
        """Return the equilibrium of a model on its supports, and the cache with its factor, see ``at``."""
        if stance is not None:
            start, step = (stance.place_supports(start), None) if step is None else (start, stance.step(start, step))
        factors = self.factors(start)
        factor = factors.free()
        margins = (MIN_STABILITY,) if self.firmness is None else self.firmness.margins
        found = solve(model, start, self.loads, self.simulate, progress, factor.system, iterations, step, margins)
        factor.owner = found if found.converged else None
        self.work.add(EQUILIBRIUM + ITERATION * (found.iterations + 1), self.assembly.size)
        return found, factors


@dataclass(frozen=True, eq=False)
class DesignPoint:
    """One design with its equilibrium; derivatives are defined at converged equilibria only."""

    problem: InverseProblem
    x: np.ndarray
    model: ElasticModel
    equilibrium: Equilibrium
    mismatch: Mismatch
    factors: Factors

    @property
    def arms(self) -> ArmModel | None:
        """The elastic model if it is an arm model, else None."""
        return with_arms(self.model)

    @property
    def system(self) -> NewtonSystem:
        """Linear system with the factor of this equilibrium's Hessian."""
        return self.factors.system_of(self.equilibrium, lambda: self.model.expand(self._state).hessian)

    def prepare(self, progress: Progress) -> None:
        """Compute and cache the parts of the gradient; report progress, because thousands of spirals take seconds."""
        for part in ("terms", "_forces", "system", "gradient"):
            progress(0.0)
            getattr(self, part)

    @cached_property
    def terms(self) -> tuple[Term, ...]:
        """Terms of the objective that depend on the equilibrium."""
        found: list[Term] = [MismatchTerm(self.mismatch)]
        if self.strains is not None and self.problem.bearing is not None:
            found.append(StrainTerm(self.problem.bearing, self.strains.values, self._strain_rows))
        return (*found, *(one for one in (self._narrow, self.barrier) if one is not None), *self.goals)

    @cached_property
    def goals(self) -> tuple[Term, ...]:
        """Terms from the modules in the folder ``goals``."""
        return goals_of(self)

    @cached_property
    def value(self) -> float:
        """The objective: the sum of all terms and costs."""
        return sum(term.value for term in self.terms) + sum(cost.value for cost in self.costs)

    def merit(self, strictness: float, found: Mismatch | None = None, strain: float | None = None) -> float:
        """Return the objective for ranking designs of different problems, see ``StrainLimit.merit``; smaller is better.

        found, strain : mismatch and largest strain of the design in a simulation; the point's own by default
        """
        # leave out the barriers of flat shapes, which only guide the search
        value = (found or self.mismatch).value + sum(c.value for c in InverseProblem.costs(self.problem, self.x))
        value += sum(goal.value for goal in self.goals) + (0.0 if self._closing is None else self._closing.value)
        value = value if self.barrier is None else self.barrier.merit(value)
        if self.strains is None or self.problem.bearing is None:
            return value
        largest = float(self.strains.values.max()) if strain is None else strain
        return self.problem.bearing.merit(value, largest, strictness)

    def weighed(self, mismatch: float) -> DesignPoint:
        """Return this point with the weight of excess strain for a search that starts with this mismatch.

        The stability barrier has no weight until ``firmed``, so that it does not decide between starts.
        """
        bearing = self.problem.bearing and replace(self.problem.bearing, weight=WEIGHT * mismatch)
        return with_problem(self, replace(self.problem, bearing=bearing, firmness=StabilityRequirement(0.0)))

    def firmed(self) -> Self:
        """Return this point with the stability barrier weighted for a stage that starts here."""
        firmness = StabilityRequirement.from_mismatch(self.mismatch.value)
        return with_problem(self, replace(self.problem, firmness=firmness))

    def pressed(self) -> Self:
        """Return this point with the multipliers of the strain limits updated, see ``StrainLimit.pressed``."""
        strains, bearing = self.strains, self.problem.bearing
        pressed = None if strains is None or bearing is None else bearing.pressed(strains.values)
        return self if pressed is None else with_problem(self, replace(self.problem, bearing=pressed))

    @cached_property
    def distance(self) -> float:
        """RMS distance of the hubs from the target, in mean distances of neighbouring hubs."""
        return self.problem.target.distance(self.equilibrium.pose)

    @property
    def metres_away(self) -> float:
        """RMS distance of the hubs from the target, metres."""
        return self.problem.target.unit * self.distance

    @property
    def spirals(self) -> tuple[np.ndarray, np.ndarray]:
        """Widths (n, 4), metres, and twists (n,), radians."""
        return self.problem.space.design(self.x)

    @cached_property
    def rooms(self) -> LinearClearances:
        """Linearised clearances of the design."""
        return self.problem.rooms(self.x)

    @cached_property
    def costs(self) -> tuple[Cost, ...]:
        """Costs that do not depend on the equilibrium."""
        return self.problem.costs(self.x)

    @cached_property
    def _state(self) -> Any:
        return self.model.start(self.equilibrium.pose)

    @cached_property
    def strains(self) -> Strains | None:
        """Strains of the arms; None without a strain limit or an arm model."""
        if self.problem.bearing is None or self._changes is None:
            return None
        return Strains.from_changes(self.model.assembly, self._changes.constant_curving, self.problem.bearing.material)

    @cached_property
    def _modes(self) -> SoftModes | None:
        """Softest modes with eigenvalues below the required one; None if there are none."""
        asked, found = self.problem.firmness, self.equilibrium
        if asked is None or not found.converged or found.spare >= asked.enough or self.arms is None:
            return None
        self.problem.work.add(SOFTEST, self.problem.assembly.size)
        modes = SoftModes.from_equilibrium(self.arms, found.pose, self.system, asked)
        return modes if len(modes.rises) else None

    @cached_property
    def barrier(self) -> StabilityBarrier | None:
        """Stability barrier of the equilibrium; None if it is stable enough."""
        asked, modes = self.problem.firmness, self._modes
        return None if asked is None or modes is None else StabilityBarrier(asked, modes.rises, self._by_modes)

    def _by_modes(self) -> tuple[Float[np.ndarray, "k spirals 6"], Float[np.ndarray, "k coordinates"]]:
        """Return the derivatives of the softest eigenvalues with respect to hubs, and to coordinates at fixed hubs."""
        modes, changes, pose = self._modes, self._changes, self.equilibrium.pose
        assert modes is not None and changes is not None
        self.problem.work.add(MODE * len(modes.rises), self.problem.assembly.size)
        return modes.by_hubs(changes.model, pose), modes.by_spirals(changes, pose, self._slopes)

    @cached_property
    def _closing(self) -> NarrowSlots | None:
        if self._opening is None or self.arms is None:
            return None
        self.problem.work.add(OPENING, self.problem.assembly.size)
        found = self._opening.at(self.arms, self.equilibrium.pose)
        return found if len(found.found.values) else None

    @property
    def _opening(self) -> SlotRequirement | None:
        return self.problem.opening

    @cached_property
    def _narrow(self) -> SlotPenalty | None:
        return None if self._closing is None else SlotPenalty(self._closing, self._slots_by_x)

    def _slots_by_x(self, closing: NarrowSlots) -> csr_array:
        """Return the derivatives (K, coordinates) of the slots' widths with respect to coordinates at fixed hubs."""
        return csr_array(closing.by_design @ self.problem.space.jacobian(self.x))

    @cached_property
    def _changes(self) -> DesignChanges | None:
        return None if self.arms is None else DesignChanges(self.arms, self._state)

    @cached_property
    def _forces(self) -> csr_array:
        """Derivatives (6 n, coordinates) of the hubs' forces with respect to the coordinates."""
        return self._forces_by_spirals()

    def _forces_by_spirals(self) -> csr_array:
        """Return the derivatives (6 n, K n) of the hubs' forces with respect to the K coordinates of each spiral."""
        known = self._changes
        self.problem.work.add(CURVED, 0 if known is None else len(known.curving.joints))
        by_design = self.model.gradient_by_design(self._state) if known is None else known.complete.gradient_by_design
        blocks = np.swapaxes(by_design, 1, 2) @ self._slopes
        return self.problem.joint_sum(blocks.transpose(0, 2, 1, 3))

    @cached_property
    def _back_forces(self) -> csr_array:
        """Transpose of ``_forces``."""
        return csr_array(self._forces.T)

    @cached_property
    def _slopes(self) -> Float[np.ndarray, "joints 2 5 _"]:
        """Derivatives (m, 2, 5, K) of widths and twist of a joint's spirals with respect to their K coordinates."""
        return self.problem.space.slopes(self.x)[self.problem.assembly.whole.owners]

    def moves(self, change: np.ndarray) -> Float[np.ndarray, "spirals 6"]:
        """Return the linearised increments (n, 6) of hubs and rim nodes for a change of coordinates (jvp, eq. 8)."""
        moves = -self.system.solve((self._forces @ change).reshape(-1, 6))
        return moves if self._support_motion is None else moves + (self._support_motion @ change).reshape(-1, 6)

    def adjoint(self, pull: np.ndarray) -> Float[np.ndarray, " coordinates"]:
        """Convert a derivative ``pull`` (n, 6) with respect to hubs to one with respect to coordinates (vjp, eq. 8)."""
        found = -(self._back_forces @ self.system.solve(pull).ravel())
        return found if self._support_motion is None else found + pull.ravel() @ self._support_motion[: pull.size]

    @property
    def _support_motion(self) -> csr_array | None:
        """Derivatives (6 n, coordinates) of the supports' poses with respect to the coordinates; None if all are 0."""
        return None

    def _strain_rows(self, arms: Int[np.ndarray, " k"]) -> Rows:
        """Return the Jacobian of strains by hubs and coordinates; ``arms`` : indices of arms, 2 * joint + side."""
        return self._rows_of_spirals(arms)[1]

    def _rows_of_spirals(self, arms: Int[np.ndarray, " k"]) -> tuple[StrainSlopes, Rows]:
        """Return the derivatives of arms' strains, with respect to joint parameters, and to hubs and coordinates."""
        assert self.strains is not None and self._changes is not None
        found, e = replace(self.strains, changes=self._changes.complete).slopes(arms), arms // 2
        problem, whole = self.problem, self.problem.assembly.whole
        hubs = rows_in_runs(found.by_pose.reshape(-1, 2, 6), 6 * whole.pairs[e], 6 * whole.size)
        own = (found.by_design[:, :, None] @ self._slopes[e])[:, :, 0]
        return found, Rows(hubs, rows_in_runs(own, problem.space.each * whole.owners[e], problem.own))

    @cached_property
    def gradient(self) -> Float[np.ndarray, " coordinates"]:
        """Gradient of the objective with respect to the coordinates, by one adjoint solve (eq. 10)."""
        return sum((cost.gradient for cost in self.costs), self.back([term.gradient for term in self.terms]))

    def gauss_newton(self, change: np.ndarray) -> Float[np.ndarray, " coordinates"]:
        """Return the product of the objective's Gauss-Newton matrix with a change of the coordinates."""
        return self.product(change, self.terms, self.costs)

    def product(
        self, change: np.ndarray, terms: Sequence[Term], costs: Sequence[Cost], turn_damping: float = 0.0
    ) -> Float[np.ndarray, " coordinates"]:
        """Return the Gauss-Newton product of terms and costs; turn_damping : weight of half the squared rotations."""
        self.problem.work.add(PRODUCT, len(self.problem.assembly.width))
        moves = self.moves(change)
        parts = [turning(turn_damping, moves), *(term.product(moves, change) for term in terms)]
        return sum((cost.product(change) for cost in costs), self.back(parts))

    def back(self, parts: list[ScalarChange]) -> Float[np.ndarray, " coordinates"]:
        """Return the gradient with respect to the coordinates of a sum of parts that depend on hubs and coordinates."""
        hubs, own = total(parts, self.problem.assembly.whole.size, len(self.x))
        return self.adjoint(hubs) + own

"""Inverse problem in the design variables x (see ``design_space``): objective, adjoint gradient (eq. 7 to 10)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from scipy.sparse import csr_array

from ..arrays import Float, Int
from ..mechanics.arms.arm_access import as_arm_model
from ..mechanics.arms.curving_changes import DesignChanges
from ..mechanics.arms.model import ArmModel
from ..mechanics.arms.strain_changes import Strains, StrainSlopes
from ..mechanics.assembly import Assembly, Pose
from ..mechanics.elastic import ElasticModel, JointAssembler
from ..mechanics.equilibrium import Equilibrium, solve
from ..mechanics.loads import Loads
from ..mechanics.newton_system import NewtonSystem
from ..mechanics.support_poses import SupportPoses
from ..params import SimulateParams
from ..progress import SILENT, Progress
from .costs import Cost, Roughness
from .design_clearances import DesignClearances
from .factor_cache import FactorCache
from .goal_registry import goals_of
from .objective import Mismatch, Target
from .point_copy import with_problem
from .polytope import LinearClearances
from .slot_penalty import NarrowSlots, SlotPenalty, SlotRequirement
from .stability import MIN_STABILITY, SoftModes, StabilityBarrier, StabilityRequirement
from .terms import (
    STRAIN_WEIGHT,
    Gradient,
    Jacobian,
    MismatchTerm,
    StrainLimit,
    StrainTerm,
    Term,
    rotation_damping_gradient,
    sparse_from_runs,
    sum_gradients,
)
from .work import (
    EQUILIBRIUM_COST,
    ITERATION_COST,
    MODE_DERIVATIVES_COST,
    PRODUCT_COST,
    SECOND_ORDER_COST,
    SLOTS_COST,
    SOFT_MODES_COST,
)


@dataclass(frozen=True, eq=False)
class InverseProblem(DesignClearances):
    """An inverse problem: find spirals in ``space`` whose equilibrium under ``loads`` matches ``target``.

    build_model : makes the elastic model of an assembly; physics : settings of the search for equilibria
    smoothness : weight of differences between joined spirals; strain_limit : of the arms' strains, None for none
    slot_requirement : required width of slots in space; None lets slots close; factor_caches, joint_assemblers : caches
    work : counts the work for all points; clearance_model : clearances of a design; None does not check them
    stability : required stability of equilibria; None requires ``MIN_STABILITY`` only
    support_poses : poses of the supports; None keeps the supports where the search starts
    """

    target: Target
    loads: Loads
    build_model: Callable[[Assembly, Progress], ElasticModel]
    physics: SimulateParams
    smoothness: float = 0.0
    strain_limit: StrainLimit | None = None
    slot_requirement: SlotRequirement | None = None
    factor_caches: list[FactorCache] = field(default_factory=list)
    stability: StabilityRequirement | None = None
    joint_assemblers: list[JointAssembler] = field(default_factory=list)
    support_poses: SupportPoses | None = None

    def factor_cache(self, start: Pose) -> FactorCache:
        """Return the factor cache of all points with these supports; ``start`` decides which increments stay 0."""
        fixed, pairs = self.loads.fixed, self.assembly.whole.pairs
        for known in self.factor_caches:
            if np.array_equal(known.fixed, fixed):
                return known
        self.factor_caches.append(
            FactorCache(pairs, fixed, self.loads.held_increments(pairs, start.centres), self.loads.springs)
        )
        return self.factor_caches[-1]

    @property
    def joint_assembler(self) -> JointAssembler:
        """Sparsity pattern of the derivatives of the hubs' forces with respect to the spirals' design variables."""
        if not self.joint_assemblers:
            self.joint_assemblers.append(JointAssembler(self.assembly.whole, self.space.coordinates_per_spiral))
        return self.joint_assemblers[0]

    def costs(self, x: np.ndarray) -> tuple[Cost, ...]:
        """Return the costs at design variables x that do not depend on the equilibrium."""
        return (Roughness.from_space(self.assembly, self.space, self.smoothness, x),) if self.smoothness else ()

    def clip_flat_shapes(self, x: np.ndarray, feasible: np.ndarray) -> Float[np.ndarray, " coordinates"]:
        """Return x moved towards ``feasible`` until it keeps the limits of flat shapes: here x, as these are fixed."""
        return x

    def point_at(
        self,
        x: np.ndarray,
        start: Pose,
        progress: Progress = SILENT,
        iterations: int | None = None,
        step: Float[np.ndarray, "spirals 6"] | None = None,
    ) -> DesignPoint:
        """Return the design x with its equilibrium, sought from ``start`` moved by ``step`` as in ``solve``."""
        model = self.build_model(self.assembly.with_spirals(*self.space.width_and_twist(x)), progress)
        found, factor_cache = self.find_equilibrium(model, self.support_poses, start, progress, iterations, step)
        return DesignPoint(self, x, model, found, self.target.compare(found.pose.centres), factor_cache)

    def find_equilibrium(
        self,
        model: ElasticModel,
        support_poses: SupportPoses | None,
        start: Pose,
        progress: Progress,
        iterations: int | None,
        step: np.ndarray | None,
    ) -> tuple[Equilibrium, FactorCache]:
        """Return the equilibrium of a model, and the cache with its factor; supports are moved to ``support_poses``."""
        if support_poses is not None:
            start, step = (
                (support_poses.place_supports(start), None)
                if step is None
                else (start, support_poses.correct_step(start, step))
            )
        factor_cache = self.factor_cache(start)
        factor = factor_cache.acquire()
        margins = (MIN_STABILITY,) if self.stability is None else self.stability.margins
        found = solve(model, start, self.loads, self.physics, progress, factor.system, iterations, step, margins)
        factor.owner = found if found.converged else None
        self.work.add(EQUILIBRIUM_COST + ITERATION_COST * (found.iterations + 1), self.assembly.size)
        return found, factor_cache


@dataclass(frozen=True, eq=False)
class DesignPoint:
    """One design with its equilibrium; derivatives are defined at converged equilibria only."""

    problem: InverseProblem
    x: np.ndarray
    model: ElasticModel
    equilibrium: Equilibrium
    mismatch: Mismatch
    factor_cache: FactorCache

    @property
    def arm_model(self) -> ArmModel | None:
        """The elastic model if it is an arm model, else None."""
        return as_arm_model(self.model)

    @property
    def newton_system(self) -> NewtonSystem:
        """Linear system with the factor of this equilibrium's Hessian."""
        return self.factor_cache.system_of(self.equilibrium, lambda: self.model.expand(self._state).hessian)

    def precompute(self, progress: Progress) -> None:
        """Compute and cache the gradient and its parts; report progress, as thousands of spirals take seconds."""
        for part in ("terms", "_forces_by_x", "newton_system", "gradient"):
            progress(0.0)
            getattr(self, part)

    @cached_property
    def terms(self) -> tuple[Term, ...]:
        """Terms of the objective that depend on the equilibrium."""
        found: list[Term] = [MismatchTerm(self.mismatch)]
        if self.strains is not None and self.problem.strain_limit is not None:
            found.append(StrainTerm(self.problem.strain_limit, self.strains.values, self._strain_jacobian))
        return (*found, *(one for one in (self._slot_penalty, self.stability_barrier) if one is not None), *self.goals)

    @cached_property
    def goals(self) -> tuple[Term, ...]:
        """Terms from the modules in the folder ``goals``."""
        return goals_of(self)

    @cached_property
    def value(self) -> float:
        """The objective: the sum of all terms and costs."""
        return sum(term.value for term in self.terms) + sum(cost.value for cost in self.costs)

    def merit(self, strain_penalty: float, found: Mismatch | None = None, strain: float | None = None) -> float:
        """Return the objective with a penalty on strain, to rank designs of different problems; smaller is better.

        strain_penalty : see ``StrainLimit.merit``
        found, strain : mismatch and largest strain of the design in a simulation; by default those at this point
        """
        # leave out the barriers of flat shapes, which only guide the search
        value = (found or self.mismatch).value + sum(c.value for c in InverseProblem.costs(self.problem, self.x))
        value += sum(goal.value for goal in self.goals) + (
            0.0 if self._narrow_slots is None else self._narrow_slots.value
        )
        value = value if self.stability_barrier is None else self.stability_barrier.merit(value)
        if self.strains is None or self.problem.strain_limit is None:
            return value
        largest = float(self.strains.values.max()) if strain is None else strain
        return self.problem.strain_limit.merit(value, largest, strain_penalty)

    def with_strain_weight(self, mismatch: float) -> DesignPoint:
        """Return this point with the weight of excess strain for a search that starts with the given mismatch.

        The stability barrier has no weight until ``with_stability_weight``, so that it does not decide between starts.
        """
        strain_limit = self.problem.strain_limit and replace(self.problem.strain_limit, weight=STRAIN_WEIGHT * mismatch)
        return with_problem(self, replace(self.problem, strain_limit=strain_limit, stability=StabilityRequirement(0.0)))

    def with_stability_weight(self) -> Self:
        """Return this point with the stability barrier weighted for a stage that starts here."""
        stability = StabilityRequirement.from_mismatch(self.mismatch.value)
        return with_problem(self, replace(self.problem, stability=stability))

    def with_updated_multipliers(self) -> Self:
        """Return this point with the multipliers of the strain limits updated from its strains, see ``StrainLimit``."""
        strains, strain_limit = self.strains, self.problem.strain_limit
        pressed = (
            None if strains is None or strain_limit is None else strain_limit.with_updated_multipliers(strains.values)
        )
        return self if pressed is None else with_problem(self, replace(self.problem, strain_limit=pressed))

    @cached_property
    def relative_distance(self) -> float:
        """RMS distance of the hubs from the target, in mean distances of neighbouring hubs."""
        return self.problem.target.relative_distance(self.equilibrium.pose)

    @property
    def distance_metres(self) -> float:
        """RMS distance of the hubs from the target, metres."""
        return self.problem.target.unit_length * self.relative_distance

    @property
    def width_and_twist(self) -> tuple[np.ndarray, np.ndarray]:
        """Widths (n, 4), metres, and twists (n,), radians."""
        return self.problem.space.width_and_twist(self.x)

    @cached_property
    def linear_clearances(self) -> LinearClearances:
        """Linearised clearances of the design."""
        return self.problem.linear_clearances(self.x)

    @cached_property
    def costs(self) -> tuple[Cost, ...]:
        """Summands of the objective that do not depend on the equilibrium, at x."""
        return self.problem.costs(self.x)

    @cached_property
    def _state(self) -> Any:
        return self.model.start(self.equilibrium.pose)

    @cached_property
    def strains(self) -> Strains | None:
        """Strains of the arms; None without a strain limit or an arm model."""
        if self.problem.strain_limit is None or self._joint_derivatives is None:
            return None
        return Strains.from_changes(
            self.model.assembly, self._joint_derivatives.constant_curving, self.problem.strain_limit.material
        )

    @cached_property
    def _soft_modes(self) -> SoftModes | None:
        """Softest modes with eigenvalues below the required one; None if there are none, or without an arm model."""
        asked, found = self.problem.stability, self.equilibrium
        if asked is None or not found.converged or found.spare >= asked.enough or self.arm_model is None:
            return None
        self.problem.work.add(SOFT_MODES_COST, self.problem.assembly.size)
        modes = SoftModes.from_equilibrium(self.arm_model, found.pose, self.newton_system, asked)
        return modes if len(modes.rises) else None

    @cached_property
    def stability_barrier(self) -> StabilityBarrier | None:
        """Stability barrier of the equilibrium; None if it is stable enough."""
        asked, modes = self.problem.stability, self._soft_modes
        return (
            None
            if asked is None or modes is None
            else StabilityBarrier(asked, modes.rises, self._eigenvalue_derivatives)
        )

    def _eigenvalue_derivatives(self) -> tuple[Float[np.ndarray, "k spirals 6"], Float[np.ndarray, "k coordinates"]]:
        """Return derivatives of the softest eigenvalues with respect to hubs, and to design variables at fixed hubs."""
        modes, changes, pose = self._soft_modes, self._joint_derivatives, self.equilibrium.pose
        assert modes is not None and changes is not None
        self.problem.work.add(MODE_DERIVATIVES_COST * len(modes.rises), self.problem.assembly.size)
        return modes.by_hubs(changes.model, pose), modes.by_spirals(changes, pose, self._design_by_x)

    @cached_property
    def _narrow_slots(self) -> NarrowSlots | None:
        if self._slot_requirement is None or self.arm_model is None:
            return None
        self.problem.work.add(SLOTS_COST, self.problem.assembly.size)
        found = self._slot_requirement.narrow_slots(self.arm_model, self.equilibrium.pose)
        return found if len(found.found.values) else None

    @property
    def _slot_requirement(self) -> SlotRequirement | None:
        return self.problem.slot_requirement

    @cached_property
    def _slot_penalty(self) -> SlotPenalty | None:
        return None if self._narrow_slots is None else SlotPenalty(self._narrow_slots, self._slot_widths_by_x)

    def _slot_widths_by_x(self, closing: NarrowSlots) -> csr_array:
        """Return the derivatives (K, coordinates) of the slots' widths by the design variables, at fixed hubs."""
        return csr_array(closing.widths_by_design @ self.problem.space.jacobian(self.x))

    @cached_property
    def _joint_derivatives(self) -> DesignChanges | None:
        return None if self.arm_model is None else DesignChanges(self.arm_model, self._state)

    @cached_property
    def _forces_by_x(self) -> csr_array:
        """Derivatives (6 n, coordinates) of the hubs' forces and moments with respect to the design variables."""
        return self._forces_by_spiral_x()

    def _forces_by_spiral_x(self) -> csr_array:
        """Return the derivatives of the hubs' forces and moments by the K design variables of each spiral."""
        known = self._joint_derivatives
        self.problem.work.add(SECOND_ORDER_COST, 0 if known is None else len(known.curving.joints))
        by_design = self.model.gradient_by_design(self._state) if known is None else known.complete.gradient_by_design
        blocks = np.swapaxes(by_design, 1, 2) @ self._design_by_x
        return self.problem.joint_assembler(blocks.transpose(0, 2, 1, 3))

    @cached_property
    def _forces_transposed(self) -> csr_array:
        """Transpose of ``_forces_by_x``."""
        return csr_array(self._forces_by_x.T)

    @cached_property
    def _design_by_x(self) -> Float[np.ndarray, "joints 2 5 _"]:
        """Derivatives (m, 2, 5, K) of widths and twist of a joint's two spirals by their K design variables."""
        return self.problem.space.spiral_jacobians(self.x)[self.problem.assembly.whole.hub_pairs]

    def hub_increments(self, change: np.ndarray) -> Float[np.ndarray, "spirals 6"]:
        """Return the linearised increments (n, 6) of hubs and rim nodes for a ``change`` of x (jvp, eq. 8)."""
        increments = -self.newton_system.solve((self._forces_by_x @ change).reshape(-1, 6))
        return increments if self._supports_by_x is None else increments + (self._supports_by_x @ change).reshape(-1, 6)

    def adjoint(self, hub_gradient: np.ndarray) -> Float[np.ndarray, " coordinates"]:
        """Convert derivatives (n, 6) of a scalar by the hubs' increments to derivatives by x (vjp, eq. 8)."""
        found = -(self._forces_transposed @ self.newton_system.solve(hub_gradient).ravel())
        return (
            found
            if self._supports_by_x is None
            else found + hub_gradient.ravel() @ self._supports_by_x[: hub_gradient.size]
        )

    @property
    def _supports_by_x(self) -> csr_array | None:
        """Derivatives (6 n, coordinates) of the supports' poses by the design variables; None if all are 0."""
        return None

    def _strain_jacobian(self, arms: Int[np.ndarray, " k"]) -> Jacobian:
        """Return the Jacobian of the largest strains of these arms, 2 * joint + (0 or 1), by hub increments and x."""
        return self._strain_slopes_and_jacobian(arms)[1]

    def _strain_slopes_and_jacobian(self, arms: Int[np.ndarray, " k"]) -> tuple[StrainSlopes, Jacobian]:
        """Return the derivatives of these arms' strains by pose, widths and twists; and the Jacobian by hubs and x."""
        assert self.strains is not None and self._joint_derivatives is not None
        found, e = replace(self.strains, changes=self._joint_derivatives.complete).slopes(arms), arms // 2
        problem, whole = self.problem, self.problem.assembly.whole
        hubs = sparse_from_runs(found.by_pose.reshape(-1, 2, 6), 6 * whole.pairs[e], 6 * whole.size)
        by_x = (found.by_design[:, :, None] @ self._design_by_x[e])[:, :, 0]
        return found, Jacobian(
            hubs, sparse_from_runs(by_x, problem.space.coordinates_per_spiral * whole.hub_pairs[e], problem.n_spiral_x)
        )

    @cached_property
    def gradient(self) -> Float[np.ndarray, " coordinates"]:
        """Gradient of the objective with respect to the design variables, by one adjoint solve (eq. 10)."""
        return sum((cost.gradient for cost in self.costs), self.total_gradient([term.gradient for term in self.terms]))

    def gauss_newton_product(self, change: np.ndarray) -> Float[np.ndarray, " coordinates"]:
        """Return the product of the objective's Gauss-Newton matrix with a change of the design variables."""
        return self.gauss_newton_product_of(change, self.terms, self.costs)

    def gauss_newton_product_of(
        self, change: np.ndarray, terms: Sequence[Term], costs: Sequence[Cost], rotation_damping: float = 0.0
    ) -> Float[np.ndarray, " coordinates"]:
        """Multiply the Gauss-Newton matrix of terms, costs and damping of the hubs' rotations by a change of x."""
        self.problem.work.add(PRODUCT_COST, len(self.problem.assembly.width))
        increments = self.hub_increments(change)
        parts = [
            rotation_damping_gradient(rotation_damping, increments),
            *(term.gauss_newton_product(increments, change) for term in terms),
        ]
        return sum((cost.hessian_product(change) for cost in costs), self.total_gradient(parts))

    def total_gradient(self, parts: list[Gradient]) -> Float[np.ndarray, " coordinates"]:
        """Return the gradient by x of a sum of scalars, from their gradients by hub increments and x at fixed hubs."""
        hubs, by_x = sum_gradients(parts, self.problem.assembly.whole.size, len(self.x))
        return self.adjoint(hubs) + by_x

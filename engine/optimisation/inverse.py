"""Inverse problem: find the spirals whose equilibrium matches a target (FlexMaps section 7)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

import numpy as np

from ..arrays import Bool, Float
from ..mechanics.assembly import Assembly, Pose
from ..mechanics.elastic import ElasticModel, JointAssembler
from ..mechanics.equilibrium import Equilibrium, solve
from ..mechanics.loads import Loads
from ..mechanics.support_poses import SupportPoses
from ..params import SimulateParams
from ..progress import SILENT, Progress
from ..spirals.clearance.clearance_model import ClearanceModel
from . import clearance_restoration
from .clearance_restoration import ClearanceProblem, narrowest_per_pair
from .costs import Cost, Roughness
from .design_space import DesignSpace
from .factor_cache import FactorCache
from .objective import Target
from .polytope import LinearClearances
from .slot_penalty import SlotRequirement
from .stability import MIN_STABILITY, StabilityRequirement
from .terms import StrainLimit
from .work import CLEARANCES_COST, EQUILIBRIUM_COST, ITERATION_COST, Work

NEAR_GAP = 1e-3  # clearance, in smallest slots, below which a gap is kept open while closed gaps are opened


@dataclass(frozen=True, eq=False)
class InverseProblem:
    """An inverse problem: find spirals in ``space`` whose equilibrium under ``loads`` matches ``target``.

    build_model : makes the elastic model of an assembly; physics : settings of equilibria
    smoothness : weight of differences between joined spirals; strain_limit : of the arms' strains, None for none
    slot_requirement : required width of slots in space; None lets slots close; factor_caches, joint_assemblers : caches
    work : counter for all points; clearance_model : of a design; None does not check that designs can be cut
    stability : required stability of equilibria; None requires ``MIN_STABILITY`` only
    support_poses : poses of the supports; None keeps the supports where the search starts
    """

    assembly: Assembly
    space: DesignSpace
    target: Target
    loads: Loads
    build_model: Callable[[Assembly, Progress], ElasticModel]
    physics: SimulateParams
    smoothness: float = 0.0
    strain_limit: StrainLimit | None = None
    slot_requirement: SlotRequirement | None = None
    work: Work = field(default_factory=Work)
    factor_caches: list[FactorCache] = field(default_factory=list)
    clearance_model: ClearanceModel | None = None
    stability: StabilityRequirement | None = None
    joint_assemblers: list[JointAssembler] = field(default_factory=list)
    support_poses: SupportPoses | None = None

    def factor_cache(self, start: Pose) -> FactorCache:
        """Return the cache of factors of all points with these supports; they share the increments held at 0 too."""
        fixed, pairs = self.loads.fixed, self.assembly.whole.pairs
        for known in self.factor_caches:
            if np.array_equal(known.fixed, fixed):
                return known
        self.factor_caches.append(
            FactorCache(pairs, fixed, self.loads.held_increments(pairs, start.centres), self.loads.springs)
        )
        return self.factor_caches[-1]

    @property
    def n_spiral_x(self) -> int:
        """Number of the spirals' coordinates; coordinates of flat vertices follow, where these may move."""
        return self.space.coordinates_per_spiral * self.assembly.size

    @property
    def joint_assembler(self) -> JointAssembler:
        """Sparsity pattern of the derivatives of the hubs' forces with respect to the spirals' coordinates."""
        if not self.joint_assemblers:
            self.joint_assemblers.append(JointAssembler(self.assembly.whole, self.space.coordinates_per_spiral))
        return self.joint_assemblers[0]

    def costs(self, x: np.ndarray) -> tuple[Cost, ...]:
        """Return the costs at coordinates x that do not depend on the equilibrium."""
        return (Roughness.from_space(self.assembly, self.space, self.smoothness, x),) if self.smoothness else ()

    def linear_clearances(self, x: np.ndarray) -> LinearClearances:
        """Return the linearised clearances at coordinates x."""
        if self.clearance_model is None:
            return LinearClearances.empty(len(x))
        terms = narrowest_per_pair(self.clearance_model.clearances(*self.space.width_and_twist(x), narrowest_only=True))
        return LinearClearances.from_clearances(terms.value, terms.by_design @ self.space.jacobian(x))

    def restore_clearances(self, x: np.ndarray, feasible: Any) -> Float[np.ndarray, " coordinates"]:
        """Return the coordinates of a design near x that can be cut; the design of ``feasible`` can be cut."""
        if self.clearance_model is None:
            return x
        self.work.add(CLEARANCES_COST, self.assembly.size)
        problem = ClearanceProblem(
            self._narrow_gaps,
            self._spirals_with_closed_gaps,
            self._repeat_per_coordinate,
            self.assembly.size,
            self.n_spiral_x,
        )
        return clearance_restoration.restore_clearances(x, feasible.x, problem)

    def clip_flat_shapes(self, x: np.ndarray, feasible: np.ndarray) -> Float[np.ndarray, " coordinates"]:
        """Return coordinates as near x as the limits of flat shapes allow; ``feasible`` keeps these limits."""
        return x

    def _clearances_at(self, x: np.ndarray) -> ClearanceModel:
        """Return the clearances of designs in the flat shapes at coordinates x."""
        assert self.clearance_model is not None
        return self.clearance_model

    def _narrow_gaps(self, x: np.ndarray, quads: np.ndarray | None) -> LinearClearances:
        """Return the closed and nearly closed gaps, linearised in the spirals' coordinates; quads : None for all."""
        terms = narrowest_per_pair(
            self._clearances_at(x).clearances(
                *self.space.width_and_twist(x), below=NEAR_GAP, quads=quads, narrowest_only=True
            )
        )
        return LinearClearances.from_clearances(
            terms.value, terms.by_design @ self.space.jacobian(x[: self.n_spiral_x])
        )

    def _spirals_with_closed_gaps(self, x: np.ndarray, quads: np.ndarray | None) -> Bool[np.ndarray, " quads"]:
        """Return a mask of the free spirals with an arm in a closed gap; quads : whose gaps count, None for all."""
        return (
            self._clearances_at(x).quads_with_closed_gaps(*self.space.width_and_twist(x), quads)
            & self.space.free_spirals
        )

    def _repeat_per_coordinate(self, share: Float[np.ndarray, " quads"]) -> Float[np.ndarray, " coordinates"]:
        """Repeat every spiral's value for each of its coordinates."""
        return np.repeat(share, self.space.coordinates_per_spiral)

    def point_at(
        self,
        x: np.ndarray,
        start: Pose,
        progress: Progress = SILENT,
        iterations: int | None = None,
        step: Float[np.ndarray, "spirals 6"] | None = None,
    ) -> Any:
        """Return the ``DesignPoint`` at x; seek its equilibrium from ``start`` plus ``step`` in ``iterations`` steps."""
        model = self.build_model(self.assembly.with_spirals(*self.space.width_and_twist(x)), progress)
        found, factor_cache = self.find_equilibrium(model, self.support_poses, start, progress, iterations, step)
        # ``design_point`` imports this module
        make = import_module(".design_point", __package__).DesignPoint
        return make(self, x, model, found, self.target.compare(found.pose.centres), factor_cache)

    def find_equilibrium(
        self,
        model: ElasticModel,
        support_poses: SupportPoses | None,
        start: Pose,
        progress: Progress,
        iterations: int | None,
        step: np.ndarray | None,
    ) -> tuple[Equilibrium, FactorCache]:
        """Return the equilibrium of a model on its supports, and the cache with its factor, see ``point_at``."""
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

"""Inputs of a search other than the design, and methods that build problem, model and equilibrium of a design."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..materials import Material
from ..mechanics.assembly import Assembly, Pose, assembly_from_design, target_pose
from ..mechanics.elastic import ElasticModel
from ..mechanics.loads import Loads, Springs
from ..mechanics.support_poses import SupportPoses
from ..params import OptimiseParams, SimulateParams
from ..progress import SILENT, Progress
from ..simulation.simulate import Simulation, build_model, simulate
from ..spirals.clearance.clearance_model import ClearanceModel
from ..spirals.constraints import NO_CONSTRAINTS, Constraints
from ..spirals.design import SpiralDesign
from ..surface.mesh import QuadMesh
from ..tolerances import SINGLE_TOL
from .design_space import DesignSpace
from .gauss_newton import MAX_NEWTON_ITERATIONS
from .inverse import DesignPoint, InverseProblem
from .objective import Target
from .point_copy import copy_state
from .slot_penalty import SlotRequirement
from .terms import StrainLimit
from .wishes import Wishes
from .work import DESIGN_SPACE_COST, MODEL_COST, Work

# by the setting "Arms": number of groups of a spiral's arms; the arms of a group share a width
GROUP_COUNTS = {"alike": 1, "pairs": 2, "each": 4}
# Smallest tolerance of equilibria during a search (residual force over the forces within), even if the setting is
# smaller. Larger: quicker, less accurate gradients (docs/tuning.md)
COARSE_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class Task:
    """Inputs of a search other than the design.

    target, material : the surface to make, and the sheet's material
    params, physics : settings of the search, and of its equilibria
    supports, force : as in ``simulate``; work : counts the work of all problems of the search
    constraints : spirals that must stay unchanged, straight or wide; wishes : target positions of some spirals
    springs : pull the piece towards its target during the search; None for a search without springs
    """

    target: QuadMesh
    material: Material
    params: OptimiseParams
    physics: SimulateParams
    supports: np.ndarray | None
    force: np.ndarray | None
    work: Work
    constraints: Constraints = NO_CONSTRAINTS
    wishes: Wishes | None = None
    springs: Springs | None = None

    def build_problem(
        self, design: SpiralDesign, progress: Progress = SILENT, space: DesignSpace | None = None
    ) -> InverseProblem:
        """Return the inverse problem of the spirals in a design's flat panels, with the second-order elastic model.

        Parameters
        ----------
        design : gives the flat panels and the settings of spirals
        progress : reports progress and raises Cancelled
        space : map between design variables and spirals; the space of ``design`` by default
        """
        assembly, physics, params = assembly_from_design(design), self.physics, self.params
        mass = design.area * assembly.thickness * self.material.density if physics.gravity else None
        loads = Loads.for_spirals(
            assembly.size, supports=self.supports, clamped=physics.clamped, force=self.force, mass=mass
        )
        loads = replace(loads, springs=self.springs)
        return InverseProblem(
            assembly,
            space or self.build_space(design, progress),
            self.build_target(assembly),
            loads,
            self.build_model,
            replace(physics, tolerance=max(physics.tolerance, COARSE_TOLERANCE)),
            params.smoothness,
            StrainLimit(self.material, params.strain_share) if params.strain_share > 0.0 else None,
            SlotRequirement.from_design(design) if params.open_slots else None,
            work=self.work,
            clearance_model=ClearanceModel.from_flat(design.flat, design.params),
            support_poses=SupportPoses(loads, self.target, design.flat.corners),
        )

    def evaluate(
        self,
        design: SpiralDesign,
        like: InverseProblem,
        start: Pose,
        progress: Progress,
        known: DesignPoint | None = None,
    ) -> DesignPoint:
        """Return the point of a design in a new problem that takes its limits, weights and design space from ``like``.

        Parameters
        ----------
        design : spirals and flat panels of the new problem
        like : problem with the limits, weights and design space
        start : pose from which the equilibrium is sought
        progress : reports progress and raises Cancelled
        known : point of ``like``; its equilibrium is reused if the designs differ by rounding only
        """
        space = like.space.extended_to(design)
        problem = replace(
            self.build_problem(design, progress, space),
            strain_limit=like.strain_limit,
            stability=like.stability,
            target=like.target,
        )
        x = space.coordinates(design.width, design.twist)
        if known is not None and self._has_equilibrium_of(
            problem.assembly.with_spirals(*space.width_and_twist(x)), known
        ):
            found = DesignPoint(problem, x, known.model, known.equilibrium, known.mismatch, known.factor_cache)
            copy_state(known, found)
            return found
        return problem.point_at(x, start, progress, MAX_NEWTON_ITERATIONS)

    def build_target(self, assembly: Assembly) -> Target:
        """Return the target of the spirals' centres.

        Parameters
        ----------
        assembly : of any design of the piece; only its joints matter
        """
        wishes = self.wishes if self.params.urge > 0.0 else None
        return Target(assembly.pairs, self.target.centroids, self.params.lies, self.supports, wishes, self.params.urge)

    def build_space(self, design: SpiralDesign, progress: Progress = SILENT) -> DesignSpace:
        """Return the design space of this design's patches.

        Parameters
        ----------
        design : gives the patches and limits
        progress : called with the fraction done; may cancel
        """
        self.work.add(DESIGN_SPACE_COST, len(design.width))
        groups = GROUP_COUNTS[self.params.arms]
        space = DesignSpace.from_design(design, assembly_from_design(design), groups, progress, self.constraints)
        return space.extended_to(design)

    def build_model(self, assembly: Assembly, progress: Progress = SILENT) -> ElasticModel:
        """Build the elastic model of an assembly, with second-order strains.

        Parameters
        ----------
        assembly : the piece
        progress : called with the fraction done; may cancel
        """
        self.work.add(MODEL_COST, assembly.size)
        return build_model(assembly, self.material, self.physics.model, progress=progress)

    def simulate(self, design: SpiralDesign, start: Pose, progress: Progress) -> Simulation:
        """Simulate a design, starting from a pose.

        Parameters
        ----------
        design : spirals and panels
        start : pose of all hubs to start from
        progress : called with the fraction done; may cancel
        """
        rest: dict[str, Any] = {"supports": self.supports, "force": self.force}
        rest["progress"] = replace(progress, shown=None)  # the view shows the steps of the search only
        return simulate(design, self.target, self.material, replace(self.physics, restarts=0), start=start, **rest)

    def simulate_point(self, design: SpiralDesign, point: DesignPoint) -> Simulation:
        """Return the simulation of a design; reuse the point's equilibrium if the design equals the point's.

        Parameters
        ----------
        design : made from the point
        point : converged point of the search
        """
        assembly, found, loads = assembly_from_design(design), point.equilibrium, point.problem.loads
        if not self._has_equilibrium_of(assembly, point):
            return self.simulate(design, found.pose, SILENT)
        found = found.with_pose(loads.align(found.pose, assembly.pairs, target_pose(self.target, design.flat.corners)))
        return Simulation(design, self.target, self.material, point.model, assembly, loads, found, [])

    def _has_equilibrium_of(self, assembly: Assembly, point: DesignPoint) -> bool:
        """Return whether an assembly has the equilibrium of a point, because both differ by rounding only.

        Always False under gravity: a search computes the weights of its spirals only at the start of a stage.
        """
        return not self.physics.gravity and _equal_up_to_rounding(assembly.whole, point.model.assembly)


def _equal_up_to_rounding(one: Assembly, two: Assembly) -> bool:
    """Return whether two assemblies of the same joints differ by rounding only."""
    apart = [np.abs(one.lever - two.lever) / one.radius.mean(), one.width / two.width - 1.0, one.twist - two.twist]
    return all(float(np.abs(part).max()) < SINGLE_TOL for part in apart)

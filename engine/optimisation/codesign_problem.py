"""Inverse problem with the flat rest shape of the patches as further unknowns; extends ``inverse``.

The design variables of the spirals come first, as in ``DesignSpace``. Then follow two for every flat vertex, x and y:
1/2 at its initial position, 0 and 1 at the ends of its range.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array, dia_array, diags_array, hstack

from ..arrays import Bool, Float, Int
from ..mechanics.arms.rest_geometry import RestChanges
from ..mechanics.arms.strain_changes import strain_by_rest_shape
from ..mechanics.assembly import Assembly, Pose, rest_joints
from ..mechanics.support_poses import SupportPoses
from ..mechanics.vectors import matvec
from ..patches.flattening.flatten import FlatPatches
from ..patches.loops import NEXT
from ..progress import SILENT, Progress
from ..spirals.clearance.clearance_model import ClearanceModel
from .clearance_restoration import narrowest_per_pair
from .codesign_cost import FlatCost, FlatLimits
from .codesign_geometry import geometry_jacobian, joint_derivatives
from .costs import Cost
from .inverse import DesignPoint, InverseProblem
from .point_copy import copy_state, with_problem
from .polytope import LinearClearances
from .slot_penalty import NarrowSlots, SlotRequirement
from .terms import Jacobian
from .work import FLAT_MODES_COST, GEOMETRY_COST, SECOND_ORDER_COST

# Weight of flat shapes' barriers over the mismatch. Smaller: longer steps, quads get stuck at limits (docs/tuning.md)
BARRIER_WEIGHT = 0.12
# Share of a limit's slack that a step must leave. Smaller: longer steps, but quads get stuck at their limits early
SLACK_SHARE = 0.1
# Vertices of quads and cut edges that would keep less slack move less. SHORTENING: factor on their shifts in each of
# the first SHORTENINGS rounds. The following rounds undo their shifts, up to MAX_ROUNDS rounds in all
SHORTENING, SHORTENINGS, MAX_ROUNDS = 0.6, 20, 40


@dataclass(frozen=True, eq=False)
class FlatRange:
    """Range of the flat vertices, and the cost of moving them.

    flat : the patches before they move; span : (P,) metres, largest shift of each vertex along x and along y
    limits : of distortion and seams; weight : of their barriers in the objective
    """

    flat: FlatPatches
    span: Float[np.ndarray, " points"]
    limits: FlatLimits
    weight: float

    @classmethod
    def from_patches(
        cls,
        flat: FlatPatches,
        span: float,
        energy: float,
        seam: float,
        weight: float,
        first: FlatPatches,
        free: Bool[np.ndarray, " quads"] | None = None,
        *,
        border: bool = True,
    ) -> FlatRange:
        """Return the range of the vertices of flat patches.

        Parameters
        ----------
        flat : the patches
        span : largest shift of a vertex along x or y, as a share of the shortest mean edge of its quads
        energy, seam : as in ``FlatLimits.relaxed_to``
        weight : of the barriers in the objective
        first : the patches before any run moved them; limits that these violate are relaxed to their values
        free : mask of the quads that may move, None for all; a vertex may move if all of its quads may
        border : whether vertices at the open border may move
        """
        length = np.linalg.norm(np.roll(flat.corners, -1, axis=1) - flat.corners, axis=2).mean(axis=1)
        nearest = np.full(len(flat.points), np.inf)
        np.minimum.at(
            nearest, flat.layout.flat_corners, (length if free is None else np.where(free, length, 0.0))[:, None]
        )
        if not border:
            mesh, corner = flat.layout.mesh, flat.layout.flat_corners
            quad, side = np.nonzero(mesh.border[mesh.quad_edges])
            nearest[corner[quad, side]] = nearest[corner[quad, NEXT[side]]] = 0.0
        return cls(flat, span * nearest, FlatLimits.relaxed_to(first, energy, seam), weight)

    def points(self, x: np.ndarray) -> Float[np.ndarray, "points 2"]:
        """Convert design variables (P, 2) of flat vertices to points (P, 2), metres."""
        return self.flat.points + self.shift(x - 0.5)

    def shift(self, change: np.ndarray) -> Float[np.ndarray, "points 2"]:
        """Convert a change of design variables (P, 2) to shifts (P, 2), metres; the matrix of this map is diagonal."""
        return 2.0 * self.span[:, None] * change

    def cost(self, x: np.ndarray) -> FlatCost:
        """Return the barriers at design variables (P, 2) of the flat vertices."""
        return FlatCost.from_points(self.limits, self.points(x))

    def clip_to_limits(self, x: np.ndarray, feasible: np.ndarray) -> Float[np.ndarray, "points 2"]:
        """Return variables near x at which quads and cut edges keep ``SLACK_SHARE`` of their slack at ``feasible``.

        Only vertices of quads and cut edges with less slack move back towards ``feasible``; all vertices if that fails.

        Parameters
        ----------
        x, feasible : (P, 2) design variables of flat vertices; ``feasible`` is within the limits

        Returns
        -------
        (P, 2) design variables, each between ``x`` and ``feasible``
        """
        share, corner, ends = np.ones(len(x)), self.flat.layout.flat_corners, np.concatenate(self.limits.ends, axis=1)
        least = [SLACK_SHARE * slack for slack in self.cost(feasible).left]
        for turn in range(MAX_ROUNDS):
            found = feasible + share[:, None] * (x - feasible)
            quads, cuts = (slack <= enough for slack, enough in zip(self.cost(found).left, least, strict=True))
            if not (quads.any() or cuts.any()):
                return found
            share[np.union1d(corner[quads], ends[cuts])] *= SHORTENING if turn < SHORTENINGS else 0.0
        return feasible


@dataclass(frozen=True, eq=False)
class FlatBarriers:
    """Barriers of flat shapes, as a cost; n_spiral_x : number of design variables of the spirals, which come first."""

    range: FlatRange
    cost: FlatCost
    n_spiral_x: int

    @property
    def value(self) -> float:
        return self.range.weight * self.cost.value

    @cached_property
    def gradient(self) -> Float[np.ndarray, " coordinates"]:
        return self._pad(self.cost.gradient)

    def hessian_product(self, change: np.ndarray) -> np.ndarray:
        return np.concatenate([np.zeros(self.n_spiral_x), self._hessian @ change[self.n_spiral_x :]])

    @cached_property
    def _hessian(self) -> csr_array:
        """Weighted Hessian with respect to the design variables of the flat vertices."""
        scale = diags_array(np.repeat(2.0 * self.range.span, 2))
        return csr_array(self.range.weight * (scale @ self.cost.hessian @ scale))

    def _pad(self, by_points: np.ndarray) -> np.ndarray:
        """Convert derivatives (P, 2) by points to derivatives by all design variables, times the barriers' weight."""
        return np.concatenate([np.zeros(self.n_spiral_x), self.range.weight * self.range.shift(by_points).ravel()])


@dataclass(frozen=True, eq=False, kw_only=True)
class FlatProblem(InverseProblem):
    """``InverseProblem`` with the flat vertices as further unknowns; flat : their range."""

    flat: FlatRange

    @classmethod
    def from_problem(cls, problem: InverseProblem, flat: FlatRange) -> FlatProblem:
        """Return the problem with the flat vertices as further unknowns.

        Parameters
        ----------
        problem : with the spirals as unknowns
        flat : range of the flat vertices
        """
        return cls(**{one.name: getattr(problem, one.name) for one in fields(InverseProblem)}, flat=flat)

    def convert_point(self, start: DesignPoint, progress: Progress = SILENT) -> FlatPoint:
        """Convert a point of the problem without flat vertices to this problem, reusing its values.

        Parameters
        ----------
        start : point in the flat shapes of ``flat``; progress : see ``FlatPoint``
        """
        found = FlatPoint(
            x=np.concatenate([start.x, np.full(2 * len(self.flat.span), 0.5)]),
            problem=self,
            model=start.model,
            equilibrium=start.equilibrium,
            mismatch=start.mismatch,
            factor_cache=start.factor_cache,
            assembly=self.assembly.with_spirals(*start.width_and_twist),
            support_poses=self.support_poses,
            progress=progress,
        )
        copy_state(start, found)
        return found

    def linear_clearances(self, x: np.ndarray) -> LinearClearances:
        if self.clearance_model is None:
            return LinearClearances.empty(len(x))
        found = self._clearances_at(x).clearances(*self.space.width_and_twist(x), with_flat=True, narrowest_only=True)
        terms = narrowest_per_pair(found)
        by_points = terms.by_flat @ diags_array(np.repeat(2.0 * self.flat.span, 2))
        by_spirals = terms.by_design @ self.space.jacobian(x[: self.n_spiral_x])
        return LinearClearances.from_clearances(terms.value, csr_array(hstack([by_spirals, by_points])))

    def _clearances_at(self, x: np.ndarray) -> ClearanceModel:
        points = self.flat.points(x[self.n_spiral_x :].reshape(-1, 2))
        return super()._clearances_at(x).with_flat(replace(self.flat.flat, points=points))

    def restore_clearances(self, x: np.ndarray, feasible: np.ndarray) -> Float[np.ndarray, " coordinates"]:
        return super().restore_clearances(self.clip_flat_shapes(x, feasible), feasible)

    def clip_flat_shapes(self, x: np.ndarray, feasible: np.ndarray) -> Float[np.ndarray, " coordinates"]:
        n = self.n_spiral_x
        return np.append(x[:n], self.flat.clip_to_limits(x[n:].reshape(-1, 2), feasible[n:].reshape(-1, 2)))

    def _repeat_per_coordinate(self, share: np.ndarray) -> np.ndarray:
        flat = self.flat.flat
        at_points = np.ones(len(flat.points))
        np.minimum.at(at_points, flat.layout.flat_corners, share[:, None])
        return np.concatenate([super()._repeat_per_coordinate(share), np.repeat(at_points, 2)])

    def costs(self, x: np.ndarray) -> tuple[Cost, ...]:
        cost = self.flat.cost(x[self.n_spiral_x :].reshape(-1, 2))
        return (*super().costs(x), FlatBarriers(self.flat, cost, self.n_spiral_x))

    def point_at(
        self,
        x: np.ndarray,
        start: Pose,
        progress: Progress = SILENT,
        iterations: int | None = None,
        step: np.ndarray | None = None,
    ) -> FlatPoint:
        """Return the design x of spirals and flat vertices with its equilibrium.

        Parameters
        ----------
        x, start, progress, iterations, step : as for ``InverseProblem.point_at``
        """
        n = self.n_spiral_x
        points = self.flat.points(x[n:].reshape(-1, 2))
        layout = self.flat.flat.layout
        lever, axes = rest_joints(layout.mesh, points[layout.flat_corners])
        assembly = replace(self.assembly, lever=lever, axes=axes).with_spirals(*self.space.width_and_twist(x))
        if assembly.rim is not None:
            shift = (points - self.flat.flat.points)[layout.flat_corners].mean(axis=1)
            assembly = replace(assembly, rim=assembly.rim.with_hubs_moved(shift))
        model = self.build_model(assembly, progress)
        poses = self.support_poses
        poses = None if poses is None else poses.with_corners(points[layout.flat_corners])
        found, factor_cache = self.find_equilibrium(model, poses, start, progress, iterations, step)
        return FlatPoint(
            x=x,
            problem=self,
            model=model,
            equilibrium=found,
            mismatch=self.target.compare(found.pose.centres),
            factor_cache=factor_cache,
            assembly=assembly,
            support_poses=poses,
            progress=progress,
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class FlatPoint(DesignPoint):
    """``DesignPoint`` with flat vertices.

    assembly, support_poses : with the moved flat shapes; progress : raises Cancelled while derivatives are computed
    """

    problem: FlatProblem
    assembly: Assembly
    support_poses: SupportPoses | None
    progress: Progress = SILENT

    def with_barrier_weight(self) -> FlatPoint:
        """Return this point with the barriers of flat shapes weighted by ``BARRIER_WEIGHT`` times its mismatch."""
        flat = replace(self.problem.flat, weight=BARRIER_WEIGHT * self.mismatch.value)
        return with_problem(self, replace(self.problem, flat=flat))

    def with_updated_weights(self) -> FlatPoint:
        """Return ``with_barrier_weight`` with the multipliers of the strain limits updated from the strains here."""
        return self.with_barrier_weight().with_updated_multipliers()

    @property
    def n_spiral_x(self) -> int:
        """Number of design variables of the spirals; those of the flat vertices follow."""
        return self.problem.n_spiral_x

    @property
    def flat_x(self) -> Float[np.ndarray, "points 2"]:
        """Design variables (P, 2) of the flat vertices."""
        return self.x[self.n_spiral_x :].reshape(-1, 2)

    @cached_property
    def _rest_changes(self) -> RestChanges:
        """Derivatives of all joints' forces, loads and tip motions with respect to their rest geometry."""
        assert self.arm_model is not None and self._joint_derivatives is not None
        self.progress(0.0)
        self.problem.work.add(GEOMETRY_COST, self.assembly.size)
        return RestChanges(self.arm_model, self._state, self._joint_derivatives.constant_curving)

    @property
    def _slot_requirement(self) -> SlotRequirement | None:
        known, flat = self.problem.slot_requirement, self.problem.flat
        return None if known is None else known.with_flat(replace(flat.flat, points=flat.points(self.flat_x)))

    def _slot_widths_by_x(self, closing: NarrowSlots) -> csr_array:
        by_spirals = closing.widths_by_design @ self.problem.space.jacobian(self.x[: self.n_spiral_x])
        by_points = closing.widths_by_flat(np.swapaxes(self._rest_changes.tips, 1, 2), self._geometry_by_points)
        return csr_array(hstack([by_spirals, by_points @ self._points_by_flat_x]))

    @cached_property
    def _geometry_by_points(self) -> csr_array:
        """Derivatives (6 m, 2 P) of the rest geometry with respect to the flat vertices."""
        flat = self.problem.flat
        return geometry_jacobian(flat.flat.layout, flat.points(self.flat_x), self.assembly.rim)

    @property
    def _joint_pairs(self) -> Int[np.ndarray, "joints 2"]:
        """The two bodies of every joint, without the strips of a rim, which do not depend on the flat shapes."""
        return self.assembly.without_strips.pairs

    @property
    def _points_by_flat_x(self) -> dia_array:
        """Derivatives (2 P, 2 P) of the flat vertices, metres, with respect to their design variables."""
        return diags_array(np.repeat(2.0 * self.problem.flat.span, 2))

    @cached_property
    def _geometry_by_flat_x(self) -> csr_array:
        """Derivatives (6 m, 2 P) of the rest geometry with respect to the design variables of the flat vertices."""
        return csr_array(self._geometry_by_points @ self._points_by_flat_x)

    @cached_property
    def _forces_by_x(self) -> csr_array:
        pairs = self._joint_pairs
        self.problem.work.add(SECOND_ORDER_COST, len(self._rest_changes.curving.joints))
        joints, values = np.arange(len(pairs)), np.swapaxes(self._rest_changes.gradient[: len(pairs)], 1, 2)
        row = (6 * pairs[:, :, None] + np.arange(6)).reshape(-1, 12, 1)
        column = 6 * joints[:, None, None] + np.arange(6)
        entries = tuple(part.ravel() for part in np.broadcast_arrays(values, row, column))
        by_geometry = csr_array((entries[0], entries[1:]), shape=(6 * self.assembly.whole.size, 6 * len(pairs)))
        by_flats = by_geometry @ self._geometry_by_flat_x
        if self._supports_by_x is not None:
            by_flats += self._support_hessian @ self._supports_by_x[:, self.n_spiral_x :]
        return csr_array(hstack([self._forces_by_spiral_x(), by_flats]))

    @cached_property
    def _supports_by_x(self) -> csr_array | None:
        """Derivatives (6 n, coordinates) of clamped supports' poses by the design variables; None without clamps."""
        if self.support_poses is None or not self.support_poses.loads.fixed[:, 3].any():
            return None
        bodies = self.assembly.whole.size
        by_points = self.support_poses.by_points(self.problem.flat.flat.layout, bodies) @ self._points_by_flat_x
        return csr_array(hstack([csr_array((6 * bodies, self.n_spiral_x)), by_points]))

    @property
    def _support_hessian(self) -> csr_array:
        """Hessian (6 n, 6 n) of the joints at clamped supports, with respect to hubs' and supports' increments."""
        assert self.support_poses is not None
        clamped, pairs = np.flatnonzero(self.support_poses.loads.fixed[:, 3]), self.model.pairs
        beside = np.flatnonzero(np.isin(pairs, clamped).any(axis=1))
        blocks = self.model.expand(self._state).hessian[beside]
        index = (6 * pairs[beside][:, :, None] + np.arange(6)).reshape(-1, 12)
        row, column = np.broadcast_arrays(index[:, :, None], index[:, None, :])
        size = 6 * self.assembly.whole.size
        return csr_array((blocks.ravel(), (row.ravel(), column.ravel())), shape=(size, size))

    def _strain_jacobian(self, arms: Int[np.ndarray, " k"]) -> Jacobian:
        assert self.strains is not None
        found, rows = self._strain_slopes_and_jacobian(arms)
        e = arms // 2
        rims = e >= len(self._joint_pairs)  # strips of a rim, which do not depend on the flat shapes
        e = np.where(rims, 0, e)
        by = matvec(self._rest_changes.loads[e, :, arms % 2], found.arms.by_loads)
        by = by + strain_by_rest_shape(self.strains.assembly, arms, found.arms.by_numbers).reshape(-1, 6)
        column = 6 * e[:, None] + np.arange(6)
        start = np.arange(0, column.size + 1, 6)
        shape = (len(e), self._geometry_by_flat_x.shape[0])
        values = np.where(rims[:, None], 0.0, by)
        by_flats = csr_array((values.ravel(), column.ravel(), start), shape=shape) @ self._geometry_by_flat_x
        return Jacobian(rows.by_hubs, csr_array(hstack([rows.by_coordinates, by_flats])))

    def _eigenvalue_derivatives(self) -> tuple[np.ndarray, np.ndarray]:
        hubs, by_x = super()._eigenvalue_derivatives()
        self.problem.work.add(FLAT_MODES_COST, self.assembly.size)
        modes, pairs, arms = self._soft_modes, self._joint_pairs, self.arm_model
        assert modes is not None and arms is not None
        known = joint_derivatives(
            arms, self.equilibrium.pose, lambda model, there: modes.variations(model, there, pairs)
        )
        by_geometry = np.moveaxis(known, 1, 0)
        curving = self._rest_changes.curving
        if len(curving.joints):
            by_geometry[:, curving.joints] += modes.by_curving(self.equilibrium.pose, curving)
        by_flats = by_geometry.reshape(len(by_x), -1) @ self._geometry_by_flat_x
        return hubs, np.concatenate([by_x, by_flats], axis=1)

"""Penalty on slots that become too narrow in the assembled shape, with exact derivatives.

The elastic models ignore contact, so arms may run through each other at an equilibrium, which the real piece cannot
take.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array, csr_array

from ..arrays import Float, Int
from ..mechanics.arms.model import ArmModel
from ..mechanics.arms.tip_motion import TipMotions, tip_motions
from ..mechanics.assembly import Assembly, Pose
from ..mechanics.clearance.slot_estimate import Slots, SlotWidths
from ..mechanics.clearance.slots_in_space import SpaceSlots
from ..params import SpiralParams
from ..patches.flattening.flatten import FlatPatches
from ..spirals.clearance.slots import min_slot_width
from ..spirals.curves.arm_curves import N_ARM_PARAMETERS
from ..spirals.curves.arm_geometry import ArmGeometry
from ..spirals.curves.blends import (
    ANGLE,
    MATE_LEAN,
    MATE_WIDTH,
    MATE_WIND,
    N_BLEND_PARAMETERS,
    OWN_LEAN,
    OWN_WIDTH,
    OWN_WIND,
    RADIUS,
)
from ..spirals.design import SpiralDesign
from .terms import Gradient, Jacobian, Term

# Width of a slot in space, as a multiple of the smallest flat slot, below which it is penalised. Larger: slots are kept
# open earlier (docs/tuning.md)
WIDTH_SHARE = 1.0
# Weight of the penalty against the mismatch. Larger: more slots stay open, worse match (docs/tuning.md)
SLOT_WEIGHT = 0.05
# Width, in required widths, below which a slot is part of a step's model. Larger: more slots that a step would close
# are foreseen, more work
LOOK_AHEAD = 3.0


@dataclass(frozen=True, eq=False)
class SlotRequirement:
    """Required width of a design's slots in space, and the estimate of their widths.

    arm_geometry : geometry of the arms in the flat quads; slots : estimates widths from the motions of the arms' tips
    width : metres, required width of every slot; params : settings of the spirals
    estimate_error : metres, estimate minus exact width of the slot with this outer arm; None before any was measured
    """

    arm_geometry: ArmGeometry
    slots: Slots
    width: float
    params: SpiralParams
    estimate_error: Float[np.ndarray, " arms"] | None = None

    @classmethod
    def from_design(cls, design: SpiralDesign) -> SlotRequirement:
        """Return the requirement for a design, without corrections."""
        p = design.params
        slots = Slots(p.blend, p.fillet, p.thickness, p.clockwise)
        return cls(ArmGeometry.from_flat(design.flat, p), slots, WIDTH_SHARE * min_slot_width(p), p)

    def with_flat(self, flat: FlatPatches) -> SlotRequirement:
        """Return the requirement for other flat shapes of the same patches."""
        return replace(self, arm_geometry=ArmGeometry.from_flat(flat, self.params))

    def narrow_slots(self, model: ArmModel, pose: Pose) -> NarrowSlots:
        """Return the places of narrow slots of an elastic model in a pose."""
        motions = tip_motions(model.assembly, model.compliance.values, model.at_joint, pose)
        whole, known = model.assembly, np.zeros((len(self.arm_geometry.mate), 6))
        arm, own = 4 * whole.pairs + whole.sides, whole.pairs < whole.spirals
        known[arm[own]] = motions[own]
        found = self._estimate_widths(model, known)
        joint = np.full(len(known), -1)
        joint[arm[own]] = np.flatnonzero(own)
        return NarrowSlots(self, found, joint[found.arms], model, pose)

    def with_measured_slots(self, model: ArmModel, pose: Pose, slots: SpaceSlots) -> SlotRequirement:
        """Return a copy whose estimates are corrected by the exact ``slots`` of ``model`` at ``pose``."""
        exact = slots.width[: len(self.arm_geometry.mate)]
        found, least = replace(self, estimate_error=None).narrow_slots(model, pose).found, np.full(len(exact), np.inf)
        np.minimum.at(least, found.arms[:, 0], found.values)
        outer, excess = slots.arms[: len(exact), 0], np.zeros(len(exact))
        # wide slots have no estimate, and slots beside uncut arms no exact width
        both = np.isfinite(least[outer]) & np.isfinite(exact)
        excess[outer[both]] = np.maximum(least[outer[both]] - exact[both], 0.0)
        return replace(self, estimate_error=excess)

    def _estimate_widths(self, model: ArmModel, known: Float[np.ndarray, "arms 6"]) -> SlotWidths:
        """Estimate the widths of narrow slots in space; ``known`` : motions of the arms' tips, 0 for border arms."""
        excess = np.zeros(len(known)) if self.estimate_error is None else self.estimate_error
        found = self.slots.below(LOOK_AHEAD * self.width + excess, self._arm_parameters(model), known)
        return replace(found, values=found.values - excess[found.arms[:, 0]])

    def _arm_parameters(self, model: ArmModel) -> Float[np.ndarray, "arms numbers"]:
        """Return the parameters of every arm's shape, in the order of ``spirals.curves.blends``."""
        shapes, assembly = self.arm_geometry, model.assembly
        n = assembly.spirals
        width, wind = assembly.width[:n].ravel(), self.twist_sign * np.repeat(assembly.twist[:n], 4)
        out = np.empty((len(width), N_BLEND_PARAMETERS))
        for own, mate, values, sign in (
            (OWN_WIDTH, MATE_WIDTH, width, 1.0),
            (OWN_WIND, MATE_WIND, wind, shapes.sign),
            (OWN_LEAN, MATE_LEAN, shapes.lean, shapes.sign),
        ):
            out[:, own], out[:, mate] = values, sign * values[shapes.mate]
        out[:, RADIUS], out[:, ANGLE] = shapes.radius, shapes.angle
        return out

    @property
    def twist_sign(self) -> float:
        """Sign of twists in the geometry of the arms: -1 for clockwise spirals."""
        return -1.0 if self.slots.clockwise else 1.0


@dataclass(frozen=True, eq=False)
class NarrowSlots:
    """The K places where slots are narrow, and their penalty.

    The penalty is a third of the cube of the missing share of the required width, as a mean over all slots; where arms
    overlap it continues as its tangent. So it rises smoothly before a slot closes.

    slot_requirement : the requirement; found : widths at the places, with derivatives; model, pose : of the piece
    tip_joints : (K, 2) int, 2 * joint + side (0 or 1) of the joint at the tip of either arm; -1 at the border
    """

    slot_requirement: SlotRequirement
    found: SlotWidths
    tip_joints: Int[np.ndarray, "k 2"]
    model: ArmModel
    pose: Pose

    @property
    def assembly(self) -> Assembly:
        return self.model.assembly

    @cached_property
    def tip_motions(self) -> TipMotions:
        """Motions of the arms' tips with derivatives; expensive, so computed for accepted steps only."""
        known = self.model
        parts = (known.compliance.values, known.compliance_by, known.at_joint)
        return TipMotions.from_assembly(known.assembly, *parts, self.pose)

    @property
    def missing_share(self) -> Float[np.ndarray, " k"]:
        """Missing share of the required width of every place; above 1 where arms overlap."""
        return np.maximum(1.0 - self.found.values / self.slot_requirement.width, 0.0)

    @property
    def _weight_per_slot(self) -> float:
        """Weight of one slot's penalty in the objective."""
        return SLOT_WEIGHT / len(self.slot_requirement.arm_geometry.mate)

    @property
    def value(self) -> float:
        return self.penalty(self.missing_share)

    def penalty(self, missing_share: Float[np.ndarray, " k"]) -> float:
        """Return the penalty for places where these shares of the required width are missing."""
        near = np.minimum(missing_share, 1.0)
        return self._weight_per_slot * float((near**3 / 3.0 + missing_share - near).sum())

    def penalty_slope(self, missing_share: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Return the derivatives of the penalty with respect to the widths."""
        return -self._weight_per_slot / self.slot_requirement.width * np.minimum(missing_share, 1.0) ** 2

    def penalty_curvature(self, missing_share: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Return the second derivatives of the penalty with respect to the widths.

        Where arms overlap they are those of a parabola of equal slope, so that steps descend.
        """
        straight = 1.0 / np.maximum(missing_share, 1.0)
        return (
            self._weight_per_slot
            / self.slot_requirement.width**2
            * np.where(missing_share < 1.0, 2.0 * missing_share, straight)
        )

    @cached_property
    def widths_by_pose(self) -> csr_array:
        """Derivatives (K, 6 n) of the slots' widths with respect to the increments of the hubs."""
        through = (self._widths_by_motion @ self._at_tips(self.tip_motions.by_pose))[:, :, 0]
        column = 6 * self._of_tips(self.assembly.pairs)[..., None] + np.arange(6)
        return self._sparse_rows(through.reshape(*column.shape), column, 6 * self.assembly.size)

    @cached_property
    def widths_by_design(self) -> csr_array:
        """Derivatives (K, 5 n) of the slots' widths with respect to all arm widths, then to all twists."""
        found, mate, count = self.found, self.slot_requirement.arm_geometry.mate, self.assembly.spirals
        arms = 4 * count
        flat = self._at_tips(self.tip_motions.by_design.reshape(*self.tip_motions.by_design.shape[:3], 10))
        through = (self._widths_by_motion @ flat)[:, :, 0].reshape(len(found.values), 2, 2, 5)
        spiral = self._of_tips(self.assembly.hub_pairs)[..., None]
        column = np.concatenate([4 * spiral + np.arange(4), arms + spiral], axis=-1)
        by, own = found.slopes[1], found.arms
        direct = np.stack([by[..., OWN_WIDTH], by[..., MATE_WIDTH], by[..., OWN_WIND], by[..., MATE_WIND]], axis=-1)
        direct[..., 2:] *= self.slot_requirement.twist_sign
        direct[..., 3] *= self.slot_requirement.arm_geometry.sign[own]
        at = np.stack([own, mate[own], arms + own // 4, arms + mate[own] // 4], axis=-1)
        return self._sparse_rows(through, column, 5 * count) + self._sparse_rows(direct, at, 5 * count)

    def widths_by_flat(self, by_geometry: Float[np.ndarray, "joints 12 6"], geometry_by_points: csr_array) -> csr_array:
        """Return the derivatives (K, 2 P) of the widths with respect to the flat points, at a fixed pose.

        Parameters
        ----------
        by_geometry : (m, 12, 6) derivatives of both tips' motions with respect to the rest geometry of their joint
        geometry_by_points : (6 m, 2 P) derivatives of the rest geometry with respect to the flat points
        """
        tips, joint = by_geometry.reshape(-1, 6, 6), self.tip_joints
        through = (self._widths_by_motion @ np.where((joint >= 0)[..., None, None], tips[joint], 0.0))[:, :, 0]
        column = 6 * (np.maximum(joint, 0) // 2)[..., None] + np.arange(6)
        out = self._sparse_rows(through, column, geometry_by_points.shape[0]) @ geometry_by_points
        for side in (0, 1):
            numbers = np.zeros((len(self.found.values), N_ARM_PARAMETERS))
            numbers[:, :N_BLEND_PARAMETERS] = self.found.slopes[1][:, side]
            out = out + self.slot_requirement.arm_geometry.by_points(self.found.arms[:, side], numbers)
        return csr_array(out)

    @property
    def _widths_by_motion(self) -> Float[np.ndarray, "k 2 1 6"]:
        """Derivatives of the slots' widths with respect to the tip motions of the outer and the inner arm."""
        return self.found.slopes[0][:, :, None]

    def _at_tips(self, values: np.ndarray) -> np.ndarray:
        """Pick values (K, 2, ...) for both arms of every place from values (m, 2, ...) per joint; 0 at the border."""
        chosen = values.reshape(-1, *values.shape[2:])[self.tip_joints]
        return np.where((self.tip_joints >= 0)[(..., *(None,) * (chosen.ndim - 2))], chosen, 0.0)

    def _of_tips(self, pairs: Int[np.ndarray, "joints 2"]) -> Int[np.ndarray, "k 2 2"]:
        """Return the rows of ``pairs`` for the joints at the tips of both arms of every place."""
        return pairs[np.maximum(self.tip_joints, 0) // 2]

    def _sparse_rows(self, values: np.ndarray, column: np.ndarray, columns: int) -> csr_array:
        """Return a sparse matrix with one row per place, from values and their column numbers, both (K, ...)."""
        count = len(self.found.values)
        row = np.broadcast_to(np.arange(count).reshape(-1, *(1,) * (values.ndim - 1)), values.shape)
        return coo_array((values.ravel(), (row.ravel(), column.ravel())), shape=(count, columns)).tocsr()


@dataclass(frozen=True, eq=False)
class SlotPenalty(Term):
    """Penalty on narrow slots, as a term of the objective.

    narrow_slots : the narrow slots at the equilibrium
    slopes : computes the derivatives (K, coordinates) of their widths by the design variables at fixed hubs
    widths : (K,) metres, widths after a step; None at the equilibrium itself
    """

    narrow_slots: NarrowSlots
    slopes: Callable[[NarrowSlots], csr_array]
    widths: Float[np.ndarray, " k"] | None = None

    @cached_property
    def widths_by_x(self) -> csr_array:
        """Derivatives (K, coordinates) of the widths with respect to the design variables at fixed hubs."""
        return self.slopes(self.narrow_slots)

    @property
    def missing_share(self) -> Float[np.ndarray, " k"]:
        """Missing share of the required width at every place, after the step."""
        return (
            self.narrow_slots.missing_share
            if self.widths is None
            else np.maximum(1.0 - self.widths / self.narrow_slots.slot_requirement.width, 0.0)
        )

    @property
    def value(self) -> float:
        return self.narrow_slots.penalty(self.missing_share)

    @property
    def gradient(self) -> Gradient:
        return self._vjp(self.narrow_slots.penalty_slope(self.missing_share))

    def gauss_newton_product(self, increments: np.ndarray, change: np.ndarray) -> Gradient:
        weight, rows = self._curvature_and_jacobian
        return rows.vjp(weight * rows.jvp(increments, change))

    @cached_property
    def _curvature_and_jacobian(self) -> tuple[Float[np.ndarray, " k"], Jacobian]:
        """Second derivatives of the penalty that are not 0, and the Jacobian of the widths that they belong to."""
        return Jacobian(self.narrow_slots.widths_by_pose, self.widths_by_x).drop_zero_curvature(
            self.narrow_slots.penalty_curvature(self.missing_share)
        )

    def after_step(self, increments: np.ndarray, change: np.ndarray) -> SlotPenalty:
        ahead = SlotPenalty(
            self.narrow_slots, self.slopes, self.narrow_slots.found.values + self._jvp(increments, change)
        )
        ahead.__dict__.update(
            widths_by_x=self.widths_by_x, _transposed=self._transposed
        )  # derivatives are constant along a step
        return ahead

    def _jvp(self, increments: np.ndarray, change: np.ndarray) -> Float[np.ndarray, " k"]:
        return self.narrow_slots.widths_by_pose @ increments.ravel() + self.widths_by_x @ change

    def _vjp(self, weight: Float[np.ndarray, " k"]) -> Gradient:
        return Gradient((self._transposed[0] @ weight).reshape(-1, 6), self._transposed[1] @ weight)

    @cached_property
    def _transposed(self) -> tuple[csr_array, csr_array]:
        return csr_array(self.narrow_slots.widths_by_pose.T), csr_array(self.widths_by_x.T)

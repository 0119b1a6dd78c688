"""Penalty on slots that become too narrow in the assembled shape, with exact derivatives.

Elastic models know no contact: an equilibrium in which arms run through each other is not a shape that the piece can take.
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
from ..spirals.curves.lines import N_ARM_PARAMETERS
from ..spirals.design import SpiralDesign
from .terms import Rows, ScalarChange, Term

# Share of the smallest flat slot below which a slot in space is penalised; a larger share opens slots earlier. With 0.5 instead, a
# sphere of 150 spirals ended at 1.03 times the error, and the worst of its closed slots, all between different spirals, overlapped
# by 0.44 instead of 0.38 mm
WIDTH_SHARE = 1.0
# Weight of the penalty against the mismatch; more opens more slots and matches worse. On that sphere 0.02 to 0.2 change the error by
# less than 0.1 %, and 4 slots end closed, all between spirals. On a body of 986 spirals with three holes 0.2 gives, for the same
# work, 1.13 times the error and 2 closed slots instead of 4
SLOT_WEIGHT = 0.05
# Width, in smallest flat slots, below which slots are followed along a step: larger values see more slots that a step would close, and cost more
LOOK_AHEAD = 3.0


@dataclass(frozen=True, eq=False)
class SlotRequirement:
    """Required widths of a design's slots in space, and how they are estimated.

    shapes : geometry of the arms in the flat quads; slots : estimates widths from the motions of the arms' tips
    width : metres, required width of every slot; params : of the spirals
    excess : metres by which the estimate of the slot with this outer arm is too large; None if not measured
    """

    shapes: ArmGeometry
    slots: Slots
    width: float
    params: SpiralParams
    excess: Float[np.ndarray, " arms"] | None = None

    @classmethod
    def from_design(cls, design: SpiralDesign) -> SlotRequirement:
        """Return the requirement for a design, without corrections."""
        p = design.params
        slots = Slots(p.blend, p.fillet, p.thickness, p.clockwise)
        return cls(ArmGeometry.from_flat(design.flat, p), slots, WIDTH_SHARE * min_slot_width(p), p)

    def moved(self, flat: FlatPatches) -> SlotRequirement:
        """Return the requirement for other flat shapes of the same patches."""
        return replace(self, shapes=ArmGeometry.from_flat(flat, self.params))

    def at(self, model: ArmModel, pose: Pose) -> NarrowSlots:
        """Return the narrow slots of a model in a pose."""
        motions = tip_motions(model.assembly, model.compliance.values, model.at_joint, pose)
        whole, known = model.assembly, np.zeros((len(self.shapes.mate), 6))
        arm, own = 4 * whole.pairs + whole.sides, whole.pairs < whole.spirals
        known[arm[own]] = motions[own]
        found = self._estimated(model, known)
        joint = np.full(len(known), -1)
        joint[arm[own]] = np.flatnonzero(own)
        return NarrowSlots(self, found, joint[found.arms], model, pose)

    def with_excess(self, model: ArmModel, pose: Pose, slots: SpaceSlots) -> SlotRequirement:
        """Return a copy whose estimates are corrected by the exact ``slots`` in this state."""
        exact = slots.width[: len(self.shapes.mate)]
        found, least = replace(self, excess=None).at(model, pose).found, np.full(len(exact), np.inf)
        np.minimum.at(least, found.arms[:, 0], found.values)
        outer, excess = slots.arms[: len(exact), 0], np.zeros(len(exact))
        # wide slots have no estimate, and slots beside uncut arms no exact width
        both = np.isfinite(least[outer]) & np.isfinite(exact)
        excess[outer[both]] = np.maximum(least[outer[both]] - exact[both], 0.0)
        return replace(self, excess=excess)

    def _estimated(self, model: ArmModel, known: Float[np.ndarray, "arms 6"]) -> SlotWidths:
        """Return the places where slots are narrow, from the motions of the tips; ``known`` : 0 for tips at the border."""
        excess = np.zeros(len(known)) if self.excess is None else self.excess
        found = self.slots.below(LOOK_AHEAD * self.width + excess, self._numbers(model), known)
        return replace(found, values=found.values - excess[found.arms[:, 0]])

    def _numbers(self, model: ArmModel) -> Float[np.ndarray, "arms numbers"]:
        """Return the numbers that describe every arm, in the order of ``blends``."""
        shapes, assembly = self.shapes, model.assembly
        n = assembly.spirals
        width, wind = assembly.width[:n].ravel(), self.sign * np.repeat(assembly.twist[:n], 4)
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
    def sign(self) -> float:
        """Sign of twists in the geometry of the arms: -1 for clockwise spirals."""
        return -1.0 if self.slots.clockwise else 1.0


@dataclass(frozen=True, eq=False)
class NarrowSlots:
    """The K places where slots are narrow, and their penalty.

    The penalty is a third of the cube of the missing share of the required width, as a mean over all slots; beyond a closed slot it
    continues as the tangent. So it rises smoothly before a slot closes.

    found : widths of the places, with derivatives; model, pose : of the piece
    joint : (K, 2) int, 2 e + side of the joint e at the tip of both arms, -1 at the border
    """

    opening: SlotRequirement
    found: SlotWidths
    joint: Int[np.ndarray, "k 2"]
    model: ArmModel
    pose: Pose

    @property
    def assembly(self) -> Assembly:
        return self.model.assembly

    @cached_property
    def motions(self) -> TipMotions:
        """Motions of the tips with their derivatives, which are expensive and needed for accepted steps only."""
        known = self.model
        parts = (known.compliance.values, known.compliance_by, known.at_joint)
        return TipMotions.from_assembly(known.assembly, *parts, self.pose)

    @property
    def missing(self) -> Float[np.ndarray, " k"]:
        """Missing share of the required width of every place; above 1 where arms overlap."""
        return np.maximum(1.0 - self.found.values / self.opening.width, 0.0)

    @property
    def _unit(self) -> float:
        """Weight of one slot in the objective."""
        return SLOT_WEIGHT / len(self.opening.shapes.mate)

    @property
    def value(self) -> float:
        return self.cost(self.missing)

    def cost(self, missing: Float[np.ndarray, " k"]) -> float:
        """Return the penalty at these missing shares of the width."""
        near = np.minimum(missing, 1.0)
        return self._unit * float((near**3 / 3.0 + missing - near).sum())

    def slope(self, missing: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Return the derivatives of the penalty by the widths."""
        return -self._unit / self.opening.width * np.minimum(missing, 1.0) ** 2

    def curvature(self, missing: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Return the second derivatives by the widths; on the tangent those of a parabola of equal slope, so that steps descend."""
        straight = 1.0 / np.maximum(missing, 1.0)
        return self._unit / self.opening.width**2 * np.where(missing < 1.0, 2.0 * missing, straight)

    @cached_property
    def by_pose(self) -> csr_array:
        """Derivatives (K, 6 n) of the widths by the increments of the hubs."""
        through = (self._by_motion @ self._at_tips(self.motions.by_pose))[:, :, 0]
        column = 6 * self._of_tips(self.assembly.pairs)[..., None] + np.arange(6)
        return self._rows(through.reshape(*column.shape), column, 6 * self.assembly.size)

    @cached_property
    def by_design(self) -> csr_array:
        """Derivatives (K, 5 n) of the slots' widths by the widths of all arms (spiral by spiral), then by all twists."""
        found, mate, count = self.found, self.opening.shapes.mate, self.assembly.spirals
        arms = 4 * count
        flat = self._at_tips(self.motions.by_design.reshape(*self.motions.by_design.shape[:3], 10))
        through = (self._by_motion @ flat)[:, :, 0].reshape(len(found.values), 2, 2, 5)
        spiral = self._of_tips(self.assembly.owners)[..., None]
        column = np.concatenate([4 * spiral + np.arange(4), arms + spiral], axis=-1)
        by, own = found.slopes[1], found.arms
        direct = np.stack([by[..., OWN_WIDTH], by[..., MATE_WIDTH], by[..., OWN_WIND], by[..., MATE_WIND]], axis=-1)
        direct[..., 2:] *= self.opening.sign
        direct[..., 3] *= self.opening.shapes.sign[own]
        at = np.stack([own, mate[own], arms + own // 4, arms + mate[own] // 4], axis=-1)
        return self._rows(through, column, 5 * count) + self._rows(direct, at, 5 * count)

    def by_flat(self, by_geometry: Float[np.ndarray, "joints 12 6"], geometry_by_points: csr_array) -> csr_array:
        """Return the derivatives (K, 2 P) of the widths by the flat points, at a fixed pose.

        by_geometry : (m, 12, 6) derivatives of both tips' motions by the rest geometry of their joint
        geometry_by_points : (6 m, 2 P) derivatives of the rest geometry by the flat points
        """
        tips, joint = by_geometry.reshape(-1, 6, 6), self.joint
        through = (self._by_motion @ np.where((joint >= 0)[..., None, None], tips[joint], 0.0))[:, :, 0]
        column = 6 * (np.maximum(joint, 0) // 2)[..., None] + np.arange(6)
        out = self._rows(through, column, geometry_by_points.shape[0]) @ geometry_by_points
        for side in (0, 1):
            numbers = np.zeros((len(self.found.values), N_ARM_PARAMETERS))
            numbers[:, :N_BLEND_PARAMETERS] = self.found.slopes[1][:, side]
            out = out + self.opening.shapes.by_points(self.found.arms[:, side], numbers)
        return csr_array(out)

    @property
    def _by_motion(self) -> Float[np.ndarray, "k 2 1 6"]:
        """Derivatives of the widths by the motions of both tips."""
        return self.found.slopes[0][:, :, None]

    def _at_tips(self, values: np.ndarray) -> np.ndarray:
        """Return values (m, 2, ...) of both tips of every joint as (K, 2, ...) at the arms of the places; 0 at the border."""
        chosen = values.reshape(-1, *values.shape[2:])[self.joint]
        return np.where((self.joint >= 0)[(..., *(None,) * (chosen.ndim - 2))], chosen, 0.0)

    def _of_tips(self, pairs: Int[np.ndarray, "joints 2"]) -> Int[np.ndarray, "k 2 2"]:
        """Return the entries of ``pairs`` (both sides of a joint) at the joints of both arms of every place."""
        return pairs[np.maximum(self.joint, 0) // 2]

    def _rows(self, values: np.ndarray, column: np.ndarray, columns: int) -> csr_array:
        """Return a sparse matrix with a row for every place, from values and column numbers (K, ...)."""
        count = len(self.found.values)
        row = np.broadcast_to(np.arange(count).reshape(-1, *(1,) * (values.ndim - 1)), values.shape)
        return coo_array((values.ravel(), (row.ravel(), column.ravel())), shape=(count, columns)).tocsr()


@dataclass(frozen=True, eq=False)
class SlotPenalty(Term):
    """Penalty on narrow slots, as a term of the objective.

    slopes : computes the derivatives (K, coordinates) of the widths by the coordinates at fixed hubs
    widths : (K,) metres after a step; None for those of ``closing``
    """

    closing: NarrowSlots
    slopes: Callable[[NarrowSlots], csr_array]
    widths: Float[np.ndarray, " k"] | None = None

    @cached_property
    def by_x(self) -> csr_array:
        """Derivatives (K, coordinates) of the widths by the coordinates at fixed hubs."""
        return self.slopes(self.closing)

    @property
    def missing(self) -> Float[np.ndarray, " k"]:
        """Missing shares of the required width."""
        return (
            self.closing.missing
            if self.widths is None
            else np.maximum(1.0 - self.widths / self.closing.opening.width, 0.0)
        )

    @property
    def value(self) -> float:
        return self.closing.cost(self.missing)

    @property
    def gradient(self) -> ScalarChange:
        return self._back(self.closing.slope(self.missing))

    def product(self, moves: np.ndarray, change: np.ndarray) -> ScalarChange:
        weight, rows = self._curved
        return rows.backward(weight * rows.forward(moves, change))

    @cached_property
    def _curved(self) -> tuple[Float[np.ndarray, " k"], Rows]:
        """Second derivatives of the penalty by the widths, where they are not 0, and the Jacobian of these widths."""
        return Rows(self.closing.by_pose, self.by_x).curved(self.closing.curvature(self.missing))

    def ahead(self, moves: np.ndarray, change: np.ndarray) -> SlotPenalty:
        ahead = SlotPenalty(self.closing, self.slopes, self.closing.found.values + self._forward(moves, change))
        ahead.__dict__.update(by_x=self.by_x, _transposed=self._transposed)  # derivatives are constant along a step
        return ahead

    def _forward(self, moves: np.ndarray, change: np.ndarray) -> Float[np.ndarray, " k"]:
        return self.closing.by_pose @ moves.ravel() + self.by_x @ change

    def _back(self, weight: Float[np.ndarray, " k"]) -> ScalarChange:
        return ScalarChange((self._transposed[0] @ weight).reshape(-1, 6), self._transposed[1] @ weight)

    @cached_property
    def _transposed(self) -> tuple[csr_array, csr_array]:
        return csr_array(self.closing.by_pose.T), csr_array(self.by_x.T)

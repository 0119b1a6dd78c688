"""Largest strains of the arms of an assembly, with derivatives by the hubs' poses, the design and the rest shapes.

The strips and necks of a rim are treated as straight bars. The width of a strip is the width of its material beside a
hole for the cord or rivet. The design does not change strips; the width of a neck is that of the arm that it joins.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Float, Int
from ...materials import Material
from ...spirals.curves.blends import MATE_LEAN, MATE_WIDTH, MATE_WIND, OWN_LEAN, OWN_WIDTH, OWN_WIND, RADIUS
from ..assembly import Assembly
from ..rim_bodies import FORWARDS
from ..vectors import matvec
from .bar_loads import FIRST_ORDER, LOADS, TURN, WRENCH
from .bars import BESIDE
from .cut import TWIST, WIDTH, rest_shapes
from .peak_strain import GRAIN_INDEX, NUMBERS, PeakStrain, StrainedArms
from .sensitivity import SENSES, JointDerivatives, arm_loads, spread_over_design

# Length of blends in t for arms that are cut as pure spirals. It has no effect: such an arm is its own mate, and an arm
# that is blended with an equal arm stays a pure spiral
_UNCUT = 0.3


@dataclass(frozen=True, eq=False)
class StrainSlopes:
    """Derivatives of the largest strains of K arms.

    by_pose : (K, 12) by the increments of the two hubs of the arm's joint (6 each)
    by_design : (K, 2, 5) by the two spirals of the arm's joint (axis 1): their four widths, then the twist (axis 2)
    arms : the strains, and their derivatives by the arms' own loads and parameters
    """

    by_pose: Float[np.ndarray, "k 12"]
    by_design: Float[np.ndarray, "k 2 5"]
    arms: PeakStrain


@dataclass(frozen=True, eq=False)
class Strains:
    """Largest strains of both arms of m joints (see ``peak_strain``), and what their derivatives need.

    assembly : with the m joints
    changes : wrenches of the joints, with derivatives
    arms : parameters of the 2 m arms
    loads : (2 m, LOADS) loads on the arms, in the columns of ``bar_loads``
    values : (m, 2) the strains
    """

    assembly: Assembly
    changes: JointDerivatives
    arms: StrainedArms
    loads: Float[np.ndarray, "n 15"]
    values: Float[np.ndarray, "joints 2"]

    @classmethod
    def from_changes(cls, assembly: Assembly, changes: JointDerivatives, material: Material) -> Strains:
        """Compute the strains under the wrenches of ``changes``.

        Parameters
        ----------
        assembly, material : spirals and joints at rest, and the material of their sheet
        changes : wrenches of the joints, with derivatives
        """
        arms = strained_arms(assembly, material)
        loads = arm_loads(assembly, changes.wrench, changes.linear, changes.turn).reshape(-1, LOADS)
        return cls(assembly, changes, arms, loads, arms.values(loads).reshape(-1, 2))

    def slopes(self, arms: Int[np.ndarray, " k"]) -> StrainSlopes:
        """Return the derivatives of the largest strains of k arms by the hubs' poses and the spirals' design.

        arms : (k,) indices of the arms, 2 * joint + (0 or 1)
        """
        found, known, changes = self.arms.slopes(self.loads[arms], arms), self.assembly, self.changes
        e, side, rows = arms // 2, arms % 2, np.arange(len(arms))
        axes, by_loads = known.arm_axes[e, side], SENSES[side, None] * found.by_loads
        by_wrench, by_linear = (matvec(axes, by_loads[:, part]) for part in (WRENCH, FIRST_ORDER))
        by_motion = matvec(changes.at_joint[e], by_linear)
        by_motion[:, 3:] += matvec(axes[:, 3:, 3:], by_loads[:, TURN])
        by_pose = (by_wrench[:, None] @ changes.wrench_by_pose[e] + by_motion[:, None] @ changes.by_pose[e])[:, 0]
        by_design = (changes.wrench_by_design[e] @ by_wrench[:, None, :, None])[..., 0]
        by_design += (changes.linear_by_design[e] @ by_linear[:, None, :, None])[..., 0]
        mate, sign = (of[arms] for of in _mates(known))
        # a neck (side 1 of its joint) has the width of the arm that it joins (side 0); strips do not depend on the
        # design
        own = np.where((e >= known.n_inner_joints) & (side == 1), 0, side)
        beyond = np.where(mate == arms, own, mate % 2)
        alive = e < known.tie_joints.stop
        turns = (e < known.n_inner_joints) | (alive & (side == 0))
        for at, numbers, weight in ((own, (OWN_WIDTH, OWN_WIND), 1.0), (beyond, (MATE_WIDTH, MATE_WIND), sign)):
            by_design[rows, at, WIDTH] += alive * found.by_numbers[:, numbers[0]]
            by_design[rows, at, TWIST] += turns * weight * found.by_numbers[:, numbers[1]]
        out = spread_over_design(by_design, known.sides[e])
        # the width ``BESIDE`` of an arm of a spiral is that of another arm of this spiral; necks and strips of a rim
        # have a strip beside them, whose width is constant
        of_spiral = known.pairs[e, side] < known.spirals
        out[rows, side, _inner_side(known, known.sides[e, side])] += of_spiral * found.by_numbers[:, BESIDE]
        return StrainSlopes(by_pose, out, found)


def strain_by_rest_shape(
    assembly: Assembly, arms: Int[np.ndarray, " k"], by: Float[np.ndarray, "k 10"]
) -> Float[np.ndarray, "k 2 3"]:
    """Convert derivatives by the arms' parameters to derivatives by the rest geometry on both sides of their joint.

    Parameters
    ----------
    assembly : with m joints
    arms : (k,) indices of the arms, 2 * joint + (0 or 1)
    by : (k, NUMBERS) derivatives of any quantity by the arms' parameters, as in ``StrainedArms.numbers``

    Returns
    -------
    (k, 2, 3) : axis 1: side of the joint; axis 2: x and y of the lever from the hub to the joint (per metre), then the
        direction of the edge (per radian)
    """
    e, side, rows, sense = arms // 2, arms % 2, np.arange(len(arms)), -1.0 if assembly.clockwise else 1.0
    out, at_rim = np.zeros((len(arms), 2, 3)), e >= assembly.n_inner_joints
    if at_rim.any():
        # side 1 of a joint at the rim is a neck or strip, whose shape does not depend on the flat patches
        by = np.where((at_rim & (side == 1))[:, None], 0.0, by)
        # an arm at the rim is blended with its own mirror image, whose lean is minus that of the arm
        by[at_rim, OWN_LEAN] -= by[at_rim, MATE_LEAN]
        by[at_rim, MATE_LEAN] = 0.0
    for at, lean, radius, grain in ((side, OWN_LEAN, RADIUS, GRAIN_INDEX), (1 - side, MATE_LEAN, None, None)):
        lever = assembly.lever[e, at, :2]
        size = np.linalg.norm(lever, axis=1)
        turn = sense * (by[:, lean] - (0.0 if grain is None else by[:, grain]))
        along = np.zeros(len(arms)) if radius is None else by[:, radius]
        out[rows, at, 0] = (along * lever[:, 0] - turn * lever[:, 1] / size) / size
        out[rows, at, 1] = (along * lever[:, 1] + turn * lever[:, 0] / size) / size
        out[rows, at, 2] = -sense * by[:, lean]
    return out


def strained_arms(assembly: Assembly, material: Material) -> StrainedArms:
    """Collect the parameters of all arms, in the order 2 * joint + (0 or 1)."""
    shape, cut = rest_shapes(assembly, material), assembly.cut
    mate, sign = _mates(assembly)
    numbers = np.zeros((len(mate), NUMBERS))
    width, twist = assembly.arm_width.ravel(), assembly.twist[assembly.pairs].ravel()
    numbers[:, OWN_WIDTH], numbers[:, MATE_WIDTH] = width, width[mate]
    numbers[:, OWN_WIND], numbers[:, MATE_WIND] = twist, sign * twist[mate]
    numbers[:, RADIUS] = shape[:, 0]
    inner = _inner_side(assembly, assembly.sides)
    # arms of rim nodes have only strips beside them, whose width the design does not change
    inner = np.where(assembly.pairs < assembly.spirals, inner, FORWARDS)
    numbers[:, BESIDE] = assembly.width[assembly.pairs, inner].ravel()
    if cut is not None:
        lean = shape[:, 1]
        if assembly.nodes:
            lean = lean.copy()
            lean[1 + 2 * assembly.tie_joints.start : 2 * assembly.tie_joints.stop : 2] = 0.0
        numbers[:, OWN_LEAN], numbers[:, MATE_LEAN] = lean, sign * lean[mate]
    if shape.shape[1] > 3:
        numbers[:, GRAIN_INDEX] = shape[:, 3]
    blend, fillet = (_UNCUT, 0.0) if cut is None else (cut.blend, cut.fillet)
    return StrainedArms(numbers, blend, fillet, assembly.thickness, material)


def arm_strains(
    assembly: Assembly, loads: Float[np.ndarray, "joints 2 15"], material: Material
) -> Float[np.ndarray, "joints 2"]:
    """Return the largest strain (m, 2) in both arms of every joint, under loads in the columns of ``bar_loads``."""
    return strained_arms(assembly, material).values(loads.reshape(-1, LOADS)).reshape(-1, 2)


def max_strain_per_spiral(assembly: Assembly, strains: Float[np.ndarray, "joints 2"]) -> Float[np.ndarray, " spirals"]:
    """Return for every spiral the largest strain in the arms of its joints.

    The strains in both arms of a joint count for both of its spirals, because kinks extend from one arm into the other.

    Parameters
    ----------
    assembly : the joints, and which spirals they join
    strains : (m, 2) strains in both arms of the m joints
    """
    worst = np.zeros(assembly.spirals)
    np.maximum.at(worst, assembly.hub_pairs, strains.max(axis=1)[:, None])
    return worst


def _mates(assembly: Assembly) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Return the indices (2 m,) of the arms' mates, and factors (2 m,) on the mates' twists and leans.

    An arm is blended with its mate, the arm beyond the joint; its factor is 1. At a rim, it is blended with its own
    mirror image: the index is its own, the factor -1. Arms that are cut as pure spirals are not blended: the index is
    their own, the factor 1.
    """
    own = np.arange(2 * len(assembly.pairs))
    mate, sign = own ^ 1, np.ones(len(own))
    if assembly.cut is None:
        mate = own
    elif assembly.nodes:
        rim = slice(2 * assembly.n_inner_joints, None)
        mate[rim], sign[rim] = own[rim], -1.0
    return mate, sign


def _inner_side(assembly: Assembly, sides: Int[np.ndarray, "*n"]) -> Int[np.ndarray, "*n"]:
    """Return for the arms on ``sides`` of their quads the side of the neighbouring arm at their inner edge.

    The inner edge of an arm is the edge towards which the arm curves; both arms belong to the same spiral.
    """
    return (sides + (1 if assembly.clockwise else -1)) % 4

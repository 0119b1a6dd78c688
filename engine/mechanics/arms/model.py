"""The 6 x 6 arm model: rigid hubs joined by two arms in series, each with the tip compliance of the stiffness table and what
the arm that is cut differs by (see ``cut``).

The compliances of both arms of a joint add up, for both carry the same wrench. Their motion is that of one hub against
the other: the relative turn is a rotation vector, and the way from the bend point of the first arm to that of the second
(see ``arm_bend``) is measured in the frame half way between both hubs (corotational). What the curving of the arms adds to
these strains to second order (see ``arm_curving``) makes spirals stiffer as they are pulled straight; it costs time and
matters under strong forces only, so that the search for a design does without it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...arrays import Float
from ...materials import Material
from ...progress import SILENT, Progress
from ..assembly import Assembly, Nodes, Pose
from ..beyond import Beyond
from ..elastic import Expansion, summed
from ..newton_system import NewtonSystem
from ..vectors import skew, times
from . import stiffness
from .compliances import ArmCompliances, arm_compliances
from .curving import Arms, curved, moved_curving, second_order_strains, weighted
from .cut import by_shapes, shapes
from .joint_motion import JointMotion, SpatialMotion, first_order, joint_motion, second_order
from .sensitivity import JointChanges, convex_by_design
from .strain_changes import arm_strains


@dataclass(frozen=True, eq=False)
class ArmState:
    """A pose, how the joints have moved there, and the strains (m, 6) that the step to it predicted."""

    pose: Pose
    motion: JointMotion
    predicted: np.ndarray


@dataclass(frozen=True, eq=False)
class ArmModel:
    """The elastic model of an assembly with one 6 x 6 stiffness a joint.

    assembly : spirals and joints at rest
    compliance : of both arms of every joint
    material : of all arms
    at_joint : (m, 6, 6) SI, stiffness against motions of the joint as the second hub carries it relative to the first, in the joint's axes
    lever : (m, 2, 3) metres, from the hubs to the arms' bend points, in the flat frames of their patches
    rest : (m, 3) metres, from the first bend point to the second at rest, in the joint's axes
    stiffness : (m, 6, 6) SI, of the way between the bend points and the turn, in the joint's axes
    offset : (m, 3) metres, from the joint to the middle between both bend points at rest, in the joint's axes
    curving_at_joint : (m, 6, 6, 6) the second order of the joints' own motion; None leaves it out
    """

    assembly: Assembly
    compliance: ArmCompliances
    material: Material
    at_joint: Float[np.ndarray, "joints 6 6"]
    lever: Float[np.ndarray, "joints 2 3"]
    rest: Float[np.ndarray, "joints 3"]
    stiffness: Float[np.ndarray, "joints 6 6"]
    offset: Float[np.ndarray, "joints 3"]
    curving_at_joint: Float[np.ndarray, "joints 6 6 6"] | None = None
    name: str = "arm"

    @classmethod
    def of(
        cls,
        assembly: Assembly,
        material: Material,
        *,
        curving: bool = True,
        slopes: bool = True,
        progress: Progress = SILENT,
    ) -> ArmModel:
        """The model of an assembly of one material, with or without the strains' second order.

        slopes : find the derivatives by the design at once; they are found when they are needed otherwise
        """
        whole = assembly.whole
        found = arm_compliances(whole, material, slopes)
        return cls._with(whole, found, whole.bend[0], material, curving, progress)

    def varied(self, assembly: Assembly) -> ArmModel:
        """The model of the same spirals on a rest geometry that differs a little; compliances follow to first order.

        The strains' second order stays as it is at the joints.
        """
        change = shapes(assembly, self.material) - shapes(self.assembly, self.material)
        compliance = self.compliance.varied(change, self._by_shapes) if change.any() else self.compliance
        found = self._with(assembly, compliance, self.assembly.bend[0], self.material, False)
        return found.with_curving(self.curving_at_joint)

    def with_compliance(self, compliance: ArmCompliances) -> ArmModel:
        """The model of the same spirals, whose arms have these compliances; without the strains' second order."""
        return self._with(self.assembly, compliance, self.assembly.bend[0], self.material, False)

    @cached_property
    def _by_shapes(self) -> Float[np.ndarray, "n _ 6 6"]:
        found, ties = (
            by_shapes(self.assembly, self.compliance.table.reshape(-1, 6, 6), self.material),
            self.assembly.ties,
        )
        if self.assembly.nodes:  # necks and strips are no spirals
            found[2 * ties.start + 1 : 2 * ties.stop : 2], found[2 * ties.stop :] = 0.0, 0.0
        return found

    @cached_property
    def compliance_by(self) -> Float[np.ndarray, "joints 2 numbers 6 6"]:
        """(m, 2, 5, 6, 6) derivatives of both arms' compliances, as in ``ArmCompliances``: those that are known, which ``varied``
        leaves as they were, else of this assembly."""
        known = self.compliance if self.compliance.by is not None else arm_compliances(self.assembly, self.material)
        assert known.by is not None
        return known.by

    @cached_property
    def curving(self) -> Float[np.ndarray, "joints 6 6 6"] | None:
        """(m, 6, 6, 6) the strains' second order, that of the bend points' motion."""
        return None if self.curving_at_joint is None else moved_curving(self.curving_at_joint, -self.offset)

    def with_own_curving(self) -> ArmModel:
        """The model with the second order of its own strains."""
        return self._with(self.assembly, self.compliance, self.assembly.bend[0], self.material, True)

    def with_curving(self, at_joint: np.ndarray | None) -> ArmModel:
        """The model with this second order of the joints' own motion (m, 6, 6, 6)."""
        return replace(self, curving_at_joint=at_joint)

    @classmethod
    def _with(
        cls,
        assembly: Assembly,
        compliance: ArmCompliances,
        bend: np.ndarray,
        material: Material,
        curving: bool,
        progress: Progress = SILENT,
    ) -> ArmModel:
        """With these compliances and bend points (m, 2, 2) of the arms."""
        axes = assembly.arm_axes
        at_joint = np.linalg.inv((axes @ compliance.values @ np.swapaxes(axes, 2, 3)).sum(axis=1))
        lever = _bend_levers(assembly, bend)
        beyond = np.einsum("ekji,ekj->eki", assembly.axes, assembly.lever - lever)
        # a turn about the middle between the bend points leaves the joint aside
        offset = -0.5 * (beyond[:, 0] + beyond[:, 1])
        stiffness = _at_bend_points(at_joint, offset)
        second = None
        if curving:
            held = np.einsum("ekji,ekj->eki", assembly.axes, lever)
            arms = Arms.of(assembly, material, compliance.values)
            second = second_order_strains(arms, at_joint, held, progress)
        rest = beyond[:, 0] - beyond[:, 1]
        return cls(assembly, compliance, material, at_joint, lever, rest, stiffness, offset, second)

    @property
    def pairs(self) -> np.ndarray:
        return self.assembly.pairs

    def part(self, hubs: np.ndarray, joints: np.ndarray) -> ArmModel:
        whole, rim = self.assembly, self.assembly.rim
        own = replace(whole.plain, rim=rim).part(hubs, joints).whole
        if whole.nodes and rim is not None:
            nodes, strips = rim.kept(hubs)
            joints = np.concatenate([joints, whole.inner + nodes, whole.ties.stop + strips])
        return self._of_joints(own, joints)

    @property
    def without_strips(self) -> ArmModel:
        """The model without the joints between the rim's nodes."""
        return self._of_joints(self.assembly.without_strips, np.arange(self.assembly.ties.stop))

    @property
    def of_rim(self) -> ArmModel:
        """The model of the rim's joints alone."""
        whole, joints = self.assembly, np.arange(self.assembly.inner, len(self.pairs))
        parts = {name: getattr(whole, name)[joints] for name in ("pairs", "sides", "lever", "axes")}
        return self._of_joints(replace(whole, **parts), joints)

    def _of_joints(self, assembly: Assembly, joints: np.ndarray) -> ArmModel:
        return replace(
            self,
            assembly=assembly,
            compliance=self.compliance.part(joints),
            curving_at_joint=None if self.curving_at_joint is None else self.curving_at_joint[joints],
            **{name: getattr(self, name)[joints] for name in ("at_joint", "lever", "rest", "stiffness", "offset")},
        )

    def weakened(self, share: np.ndarray) -> ArmModel:
        factor = np.concatenate([share, np.ones(len(self.at_joint) - len(share))])[:, None, None]
        return replace(self, at_joint=factor * self.at_joint, stiffness=factor * self.stiffness)

    def with_bending(self, factor: float) -> ArmModel:
        """Return the model with so many times the stiffness against what leaves the plane of the sheet."""
        scale = np.where(OUT_OF_PLANE, np.sqrt(factor), 1.0)
        at_joint = np.outer(scale, scale) * self.at_joint
        return replace(self, at_joint=at_joint, stiffness=_at_bend_points(at_joint, self.offset))

    def start(self, pose: Pose) -> ArmState:
        if self.assembly.nodes and pose.nodes is None:
            pose = self._with_nodes(pose)
        motion = self.motion(pose)
        return ArmState(pose, motion, motion.vector)

    def _with_nodes(self, pose: Pose) -> Pose:
        """The pose with the rim's nodes at rest where the hubs stand still."""
        from ...params import SimulateParams
        from ..equilibrium import solve
        from ..loads import Loads

        rim, n = self.assembly.rim, self.assembly.spirals
        assert rim is not None
        held = Loads(np.ones((n, 6), dtype=bool), np.zeros((n, 3)))
        resting, own = replace(pose, nodes=Nodes.resting(rim.hub, rim.offset)), self.of_rim
        system = NewtonSystem(own.pairs, held.fixed)
        return solve(own, resting, held, SimulateParams(), system=system).pose

    def moved(self, state: ArmState, step: np.ndarray) -> ArmState:
        pose, motion = state.pose.moved(step), state.motion
        change = times(first_order(SpatialMotion.of(motion)), step[self.pairs].reshape(-1, 12))
        back = np.swapaxes(motion.middle, 1, 2)
        change = np.concatenate([times(back, change[:, :3]), times(back, change[:, 3:])], axis=1)
        return ArmState(pose, self.motion(pose), motion.vector + change)

    def energy(self, state: ArmState) -> float:
        e = _curved(state.motion.vector, self.curving)[0]
        return 0.5 * float((times(self.stiffness, e) * e).sum())

    def wrenches(self, state: ArmState) -> Float[np.ndarray, "joints 6"]:
        """(m, 6) N and N m at every joint that the second arm exerts on the first, in the joint's axes half way."""
        motion = state.motion.vector
        motion[:, :3] += np.cross(self.offset, motion[:, 3:])
        e, slope = _curved(motion, self.curving_at_joint)
        return times(np.swapaxes(slope, -1, -2), times(self.at_joint, e))

    def joint_gradients(self, state: ArmState) -> Float[np.ndarray, "joints 12"]:
        """(m, 12) every joint's own share of the gradient of the energy, in the order of ``Expansion.hessian``."""
        inner = self.wrenches(state)
        inner[:, 3:] -= np.cross(self.offset, inner[:, :3])
        return times(np.swapaxes(first_order(SpatialMotion.of(state.motion)), 1, 2), _in_space(state.motion, inner))

    def strains(self, state: ArmState, material: Material) -> Float[np.ndarray, "joints 2"]:
        """(m, 2) largest strain on the surface of both arms of every joint, fillets left out; see ``peak_strain``."""
        return arm_strains(self.assembly, self.wrenches(state), material)

    def beyond(self) -> list[Beyond]:
        known = self.assembly
        spiral = known.pairs.ravel()
        own = spiral < known.spirals
        ratio, width = 2.0 * known.radius.ravel()[own], known.arm_width.ravel()[own]
        return stiffness.beyond(ratio, width, known.twist[spiral[own]], known.thickness, spiral[own])

    def torsion(self, state: ArmState) -> np.ndarray:
        return state.motion.turn[:, 0]

    def motion(self, pose: Pose) -> JointMotion:
        """How the joints have moved."""
        return joint_motion(pose, self.pairs, self.lever, self.assembly.axes, self.rest)

    def strain_rates(self, state: ArmState) -> Float[np.ndarray, "joints 6 12"]:
        """Return the derivatives (m, 6, 12) of the strains, to second order, by the increments of both hubs."""
        slope, middle = _curved(state.motion.vector, self.curving)[1], state.motion.middle
        rates = first_order(SpatialMotion.of(state.motion)).reshape(-1, 2, 3, 12)
        return slope @ (np.swapaxes(middle, 1, 2)[:, None] @ rates).reshape(-1, 6, 12)

    def convex_by_design(self, state: ArmState, way: Float[np.ndarray, "joints 12"]) -> Float[np.ndarray, "joints 2 5"]:
        """Return the derivatives of every joint's convex part along a motion by widths and twists of both spirals, at a fixed pose."""
        known = (self.assembly, self.compliance_by, self.at_joint, self.offset)
        return convex_by_design(*known, state.motion, way, self.curving_at_joint)

    def changes(self, state: ArmState) -> JointChanges:
        """How the joints answer to the pose and to the design; the strains' second order counts as given."""
        known = (self.assembly, self.compliance_by, self.at_joint, self.offset)
        return JointChanges.of(*known, state.motion, self.curving_at_joint)

    def gradient_by_design(self, state: ArmState) -> np.ndarray:
        return self.changes(state).gradient_by_design

    def expand(self, state: ArmState, ahead: bool = False) -> Expansion:
        m = len(self.pairs)
        per_joint, gradient = np.empty(m), np.empty((m, 12))
        hessian, convex = np.empty((m, 12, 12)), np.empty((m, 12, 12))
        # a few hundred joints at a time stay in the processor's cache
        for start in range(0, m, BATCH):
            part = slice(start, start + BATCH)
            motion = state.motion.part(part)
            per_joint[part], gradient[part], hessian[part], convex[part] = _expanded(
                motion,
                self.stiffness[part],
                None if self.curving is None else self.curving[part],
                state.predicted[part] if ahead else motion.vector,
            )
        return Expansion(
            float(per_joint.sum()), per_joint, summed(gradient, self.pairs, self.assembly.size), hessian, convex
        )


def _curved(strains: np.ndarray, curving: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Strains (m, 6) with their second order, if that is not left out, and the derivative (m or 1, 6, 6)."""
    return (strains, np.eye(6)[None]) if curving is None else curved(strains, curving)


def _expanded(
    motion: JointMotion, stiffness: np.ndarray, curving: np.ndarray | None, predicted: Float[np.ndarray, "joints 6"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Energy (m,), gradient (m, 12), Hessian (m, 12, 12) and its convex part of joints; all in the axes of space.

    predicted : (m, 6) strains whose stresses weight the curvature of the strains
    """
    base = motion.middle
    strains, slope = _curved(motion.vector, curving)
    across = np.swapaxes(slope, 1, 2)
    inner = times(stiffness, strains)
    per_joint = 0.5 * np.einsum("mi,mi->m", inner, strains)
    ahead = times(stiffness, strains + times(slope, predicted - motion.vector))
    at = SpatialMotion.of(motion)
    jacobian = first_order(at)
    back = np.swapaxes(jacobian, 1, 2)
    spread = np.zeros((len(base), 6, 6))
    spread[:, :3, :3] = spread[:, 3:, 3:] = base
    gradient = times(back, times(spread, times(across, inner)))
    weight = times(spread, times(across, ahead))
    if curving is None:
        convex = back @ (spread @ stiffness @ np.swapaxes(spread, 1, 2) @ jacobian)
        return per_joint, gradient, convex + second_order(at, weight[:, :3], weight[:, 3:]), convex
    turned = np.swapaxes(spread, 1, 2) @ jacobian
    back = np.swapaxes(turned, 1, 2)
    convex = back @ (across @ stiffness @ slope) @ turned
    bent = back @ (2.0 * weighted(ahead, curving)) @ turned
    return per_joint, gradient, convex + bent + second_order(at, weight[:, :3], weight[:, 3:]), convex


def _in_space(motion: JointMotion, vectors: Float[np.ndarray, "joints 6"]) -> Float[np.ndarray, "joints 6"]:
    """(m, 6) in the axes of space of vectors (m, 6) in those half way."""
    middle = motion.middle
    return np.concatenate([times(middle, vectors[:, :3]), times(middle, vectors[:, 3:])], axis=1)


# which motions of a joint leave the plane of the sheet: along its normal, and the turns about both axes in the sheet
OUT_OF_PLANE = np.array([False, False, True, True, True, False])
BATCH = 1000  # joints at a time, so that they stay in the processor's cache


def _bend_levers(assembly: Assembly, bend: np.ndarray) -> Float[np.ndarray, "joints 2 3"]:
    """(m, 2, 3) metres: from the hubs to the bend points (m, 2, 2) of the arms."""
    return bend[..., :1] * assembly.lever + bend[..., 1:] * assembly.left


def _at_bend_points(at_joint: Float[np.ndarray, "joints 6 6"], offset: np.ndarray) -> Float[np.ndarray, "joints 6 6"]:
    """Return stiffnesses against motions between the bend points, of those at the joints."""
    transfer = np.broadcast_to(np.eye(6), at_joint.shape).copy()
    transfer[:, :3, 3:] = skew(offset)
    return np.swapaxes(transfer, 1, 2) @ at_joint @ transfer

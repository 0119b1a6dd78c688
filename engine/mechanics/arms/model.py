"""The 6 x 6 arm model: rigid hubs joined by two arms in series, each with the tip compliance of a cut arm.

The compliance of a cut arm is its compliance in the stiffness table plus a correction (see ``cut``). The compliances of
both arms of a joint add up, because both carry the same wrench. The strains of a joint are the motion of one hub
relative to the other: the relative turn as a rotation vector, and the vector from the first arm's bend point to the
second arm's (see ``arm_bend``) in the frame half way between both hubs (corotational). A second-order term (see
``curving``) stiffens spirals that are pulled straight. It is slow to compute and matters under strong forces only.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...arrays import Float
from ...materials import Material
from ...progress import SILENT, Progress
from ..assembly import Assembly, Pose, RimNodes
from ..elastic import Expansion, sum_joint_vectors
from ..newton_system import NewtonSystem
from ..out_of_range import OutOfRange
from ..vectors import matvec, skew
from . import stiffness
from .compliances import ArmCompliances, arm_compliances
from .curving import CurvedArms, add_second_order, contract_with_wrench, second_order_strains, transfer_second_order
from .cut import added_compliance_by_shape, rest_shapes
from .joint_motion import JointMotion, SpatialMotion, first_order, joint_motion, second_order
from .sensitivity import JointDerivatives, arm_loads, convex_by_design
from .stacked import BATCH
from .strain_changes import arm_strains


@dataclass(frozen=True, eq=False)
class ArmState:
    """A pose, the joints' motion at this pose, and the strains (m, 6) that the last step predicted to first order."""

    pose: Pose
    motion: JointMotion
    predicted: np.ndarray


@dataclass(frozen=True, eq=False)
class ArmModel:
    """The elastic model of an assembly with one 6 x 6 stiffness per joint.

    assembly : spirals and joints at rest, rim included; compliance : of both arms of every joint; material : of all
        arms
    at_joint : (m, 6, 6) SI, stiffness against motions of the joint as fixed to the second hub relative to the joint as
        fixed to the first, in the joint's axes
    lever : (m, 2, 3) metres, from the hubs to the arms' bend points, in the flat frames of their patches
    rest : (m, 3) metres, from the first bend point to the second at rest, in the joint's axes
    stiffness : (m, 6, 6) SI, against motions of the second bend point relative to the first, in the joint's axes
    offset : (m, 3) metres, from the joint to the midpoint of both bend points at rest, in the joint's axes
    curving_at_joint : (m, 6, 6, 6) second-order term of the joints' motion; None leaves it out
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
    def from_assembly(
        cls,
        assembly: Assembly,
        material: Material,
        *,
        curving: bool = True,
        slopes: bool = True,
        progress: Progress = SILENT,
    ) -> ArmModel:
        """Build the arm model of an assembly of one material.

        Parameters
        ----------
        assembly : spirals and joints at rest, with or without a rim
        material : of all arms
        curving : include the second-order term of the strains
        slopes : compute the derivatives by the design now; otherwise they are computed when first used
        progress : is updated while the second-order term is computed
        """
        whole = assembly.whole
        found = arm_compliances(whole, material, slopes)
        return cls.assemble(whole, found, whole.bend_points[0], material, curving, progress)

    def with_rest_geometry(self, assembly: Assembly) -> ArmModel:
        """Return the model of the same spirals on the slightly different rest geometry of ``assembly``.

        Compliances are updated to first order; the second-order term of the motions at the joints is kept.
        """
        change = rest_shapes(assembly, self.material) - rest_shapes(self.assembly, self.material)
        compliance = self.compliance.to_first_order(change, self.cut_by_shapes) if change.any() else self.compliance
        found = self.assemble(assembly, compliance, self.assembly.bend_points[0], self.material, False)
        return found.with_curving(self.curving_at_joint)

    def rebuilt(self, assembly: Assembly, material: Material) -> ArmModel:
        made = ArmModel.from_assembly(assembly, material, curving=False, slopes=False)
        return made.with_curving(self.curving_at_joint)  # the second-order term is kept: it is slowest to compute

    @cached_property
    def cut_by_shapes(self) -> Float[np.ndarray, "n _ 6 6"]:
        """Derivatives of the cut's correction by the arms' rest shapes, see ``cut.added_compliance_by_shape``."""
        table, ties = self.compliance.table.reshape(-1, 6, 6), self.assembly.tie_joints
        found = added_compliance_by_shape(self.assembly, table, self.material)
        if self.assembly.nodes:  # necks and strips have no table compliance
            found[2 * ties.start + 1 : 2 * ties.stop : 2], found[2 * ties.stop :] = 0.0, 0.0
        return found

    @cached_property
    def compliance_by(self) -> Float[np.ndarray, "joints 2 numbers 6 6"]:
        """(m, 2, 5, 6, 6) derivatives of both arms' compliances, as in ``ArmCompliances``.

        They are computed if the compliances do not store them. ``with_rest_geometry`` does not update stored ones.
        """
        known = self.compliance if self.compliance.by is not None else arm_compliances(self.assembly, self.material)
        assert known.by is not None
        return known.by

    @cached_property
    def curving(self) -> Float[np.ndarray, "joints 6 6 6"] | None:
        """(m, 6, 6, 6) second-order term of the strains between the bend points; None if left out."""
        return None if self.curving_at_joint is None else transfer_second_order(self.curving_at_joint, -self.offset)

    def with_own_curving(self) -> ArmModel:
        """Return a copy whose second-order term is computed anew from its assembly and compliances."""
        return self.assemble(self.assembly, self.compliance, self.assembly.bend_points[0], self.material, True)

    def with_curving(self, at_joint: np.ndarray | None) -> ArmModel:
        """Return a copy with this second-order term (m, 6, 6, 6) of the joints' motions; None leaves the term out."""
        return replace(self, curving_at_joint=at_joint)

    @classmethod
    def assemble(
        cls,
        assembly: Assembly,
        compliance: ArmCompliances,
        bend: np.ndarray,
        material: Material,
        curving: bool,
        progress: Progress = SILENT,
    ) -> ArmModel:
        """Build the model from the arms' compliances.

        Parameters
        ----------
        assembly : spirals and joints at rest
        compliance : of both arms of every joint
        bend : (m, 2, 2) bend points, as in ``_bend_levers``
        material, curving, progress : as in ``from_assembly``
        """
        axes = assembly.arm_axes
        at_joint = np.linalg.inv((axes @ compliance.values @ np.swapaxes(axes, 2, 3)).sum(axis=1))
        lever = _bend_levers(assembly, bend)
        beyond = np.einsum("ekji,ekj->eki", assembly.axes, assembly.lever - lever)
        # from the joint to the midpoint of the bend points
        offset = -0.5 * (beyond[:, 0] + beyond[:, 1])
        stiffness = _move_to_bend_points(at_joint, offset)
        second = None
        if curving:
            held = np.einsum("ekji,ekj->eki", assembly.axes, lever)
            arms = CurvedArms.from_assembly(assembly, material, compliance.values)
            second = second_order_strains(arms, at_joint, held, progress)
        rest = beyond[:, 0] - beyond[:, 1]
        return cls(assembly, compliance, material, at_joint, lever, rest, stiffness, offset, second)

    @property
    def pairs(self) -> np.ndarray:
        return self.assembly.pairs

    def part(self, hubs: np.ndarray, joints: np.ndarray) -> ArmModel:
        whole, rim = self.assembly, self.assembly.rim
        own = replace(whole.without_rim, rim=rim).part(hubs, joints).whole
        if whole.nodes and rim is not None:
            nodes, strips = rim.indices_of_hubs(hubs)
            joints = np.concatenate([joints, whole.n_inner_joints + nodes, whole.tie_joints.stop + strips])
        return self._select_joints(own, joints)

    @property
    def without_strips(self) -> ArmModel:
        """The model without the joints between the rim's nodes."""
        return self._select_joints(self.assembly.without_strips, np.arange(self.assembly.tie_joints.stop))

    @property
    def rim_only(self) -> ArmModel:
        """The model of the rim's joints only."""
        whole, joints = self.assembly, np.arange(self.assembly.n_inner_joints, len(self.pairs))
        parts = {name: getattr(whole, name)[joints] for name in ("pairs", "sides", "lever", "axes")}
        return self._select_joints(replace(whole, **parts), joints)

    def _select_joints(self, assembly: Assembly, joints: np.ndarray) -> ArmModel:
        return replace(
            self,
            assembly=assembly,
            compliance=self.compliance.subset(joints),
            curving_at_joint=None if self.curving_at_joint is None else self.curving_at_joint[joints],
            **{name: getattr(self, name)[joints] for name in ("at_joint", "lever", "rest", "stiffness", "offset")},
        )

    def scale_stiffness(self, share: np.ndarray) -> ArmModel:
        factor = np.concatenate([share, np.ones(len(self.at_joint) - len(share))])[:, None, None]
        return replace(self, at_joint=factor * self.at_joint, stiffness=factor * self.stiffness)

    def with_bending(self, factor: float) -> ArmModel:
        """Return the model with its stiffness against bending out of the sheet multiplied by ``factor``."""
        scale = np.where(OUT_OF_PLANE_MASK, np.sqrt(factor), 1.0)
        at_joint = np.outer(scale, scale) * self.at_joint
        return replace(self, at_joint=at_joint, stiffness=_move_to_bend_points(at_joint, self.offset))

    def start(self, pose: Pose) -> ArmState:
        if self.assembly.nodes and pose.nodes is None:
            pose = self._with_nodes(pose)
        motion = self.motion(pose)
        return ArmState(pose, motion, motion.vector)

    def _with_nodes(self, pose: Pose) -> Pose:
        """Return the pose with the rim's nodes, in equilibrium while all hubs are held."""
        from ...params import SimulateParams
        from ..equilibrium import solve
        from ..loads import Loads

        rim, n = self.assembly.rim, self.assembly.spirals
        assert rim is not None
        held = Loads(np.ones((n, 6), dtype=bool), np.zeros((n, 3)))
        resting, own = replace(pose, nodes=RimNodes.at_rest(rim.hub, rim.offset)), self.rim_only
        system = NewtonSystem(own.pairs, held.fixed)
        return solve(own, resting, held, SimulateParams(), system=system).pose

    def moved(self, state: ArmState, step: np.ndarray) -> ArmState:
        pose, motion = state.pose.moved(step), state.motion
        change = matvec(first_order(SpatialMotion.from_joints(motion)), step[self.pairs].reshape(-1, 12))
        back = np.swapaxes(motion.middle, 1, 2)
        change = np.concatenate([matvec(back, change[:, :3]), matvec(back, change[:, 3:])], axis=1)
        return ArmState(pose, self.motion(pose), motion.vector + change)

    def energy(self, state: ArmState) -> float:
        e = _add_second_order(state.motion.vector, self.curving)[0]
        return 0.5 * float((matvec(self.stiffness, e) * e).sum())

    def wrenches(self, state: ArmState) -> Float[np.ndarray, "joints 6"]:
        e, slope = _add_second_order(self.motion_at_joint(state), self.curving_at_joint)
        return matvec(np.swapaxes(slope, -1, -2), matvec(self.at_joint, e))

    def motion_at_joint(self, state: ArmState) -> Float[np.ndarray, "joints 6"]:
        """Return motions (m, 6) of the joints as fixed to the second hub, relative to the first hub; half-way axes."""
        motion = state.motion.vector
        motion[:, :3] += np.cross(self.offset, motion[:, 3:])
        return motion

    def arm_loads(self, state: ArmState) -> Float[np.ndarray, "joints 2 15"]:
        """Return the loads of both arms of every joint in the arms' own axes, in the columns of ``bar_loads``."""
        linear = matvec(self.at_joint, self.motion_at_joint(state))
        return arm_loads(self.assembly, self.wrenches(state), linear, state.motion.turn)

    def joint_gradients(self, state: ArmState) -> Float[np.ndarray, "joints 12"]:
        """Return every joint's contribution (m, 12) to the energy gradient, in the order of ``Expansion.hessian``."""
        inner = self.wrenches(state)
        inner[:, 3:] -= np.cross(self.offset, inner[:, :3])
        return matvec(
            np.swapaxes(first_order(SpatialMotion.from_joints(state.motion)), 1, 2),
            _rotate_to_space(state.motion, inner),
        )

    def strains(self, state: ArmState, material: Material) -> Float[np.ndarray, "joints 2"]:
        return arm_strains(self.assembly, self.arm_loads(state), material)

    def in_plane_energy(self, state: ArmState) -> Float[np.ndarray, " joints"]:
        inside = np.where(OUT_OF_PLANE_MASK, 0.0, state.motion.vector)
        return 0.5 * np.einsum("mi,mij,mj->m", inside, self.stiffness, inside, optimize=True)

    def beyond(self) -> list[OutOfRange]:
        known = self.assembly
        spiral = known.pairs.ravel()
        own = spiral < known.spirals
        ratio, width = 2.0 * known.radius.ravel()[own], known.arm_width.ravel()[own]
        return stiffness.beyond(ratio, width, known.twist[spiral[own]], known.thickness, spiral[own])

    def torsion(self, state: ArmState) -> np.ndarray:
        return state.motion.turn[:, 0]

    def motion(self, pose: Pose) -> JointMotion:
        """Return the motion of the joints at a pose."""
        return joint_motion(pose, self.pairs, self.lever, self.assembly.axes, self.rest)

    def strain_rates(self, state: ArmState) -> Float[np.ndarray, "joints 6 12"]:
        """Return the derivatives (m, 6, 12) of the strains, second-order term included, by both hubs' increments."""
        slope, middle = _add_second_order(state.motion.vector, self.curving)[1], state.motion.middle
        rates = first_order(SpatialMotion.from_joints(state.motion)).reshape(-1, 2, 3, 12)
        return slope @ (np.swapaxes(middle, 1, 2)[:, None] @ rates).reshape(-1, 6, 12)

    def convex_by_design(self, state: ArmState, way: Float[np.ndarray, "joints 12"]) -> Float[np.ndarray, "joints 2 5"]:
        """Differentiate every joint's convex energy in a motion by widths and twists of its spirals, at a fixed pose.

        Parameters
        ----------
        state : at which the energy is expanded
        way : (m, 12) the motion: increments of both hubs, in the order of ``Expansion.hessian``

        Returns
        -------
        (m, 2, 5) : side of the joint; four widths (per metre) and the twist (per radian)
        """
        known = (self.assembly, self.compliance_by, self.at_joint, self.offset)
        return convex_by_design(*known, state.motion, way, self.curving_at_joint)

    def changes(self, state: ArmState) -> JointDerivatives:
        """Return derivatives of the joints' wrenches by pose and design, with a constant second-order term."""
        known = (self.assembly, self.compliance_by, self.at_joint, self.offset)
        return JointDerivatives.from_assembly(*known, state.motion, self.curving_at_joint)

    def gradient_by_design(self, state: ArmState) -> np.ndarray:
        return self.changes(state).gradient_by_design

    def expand(self, state: ArmState, ahead: bool = False) -> Expansion:
        m = len(self.pairs)
        per_joint, gradient = np.empty(m), np.empty((m, 12))
        hessian, convex = np.empty((m, 12, 12)), np.empty((m, 12, 12))
        for start in range(0, m, BATCH):
            part = slice(start, start + BATCH)
            motion = state.motion.subset(part)
            per_joint[part], gradient[part], hessian[part], convex[part] = _expand_joints(
                motion,
                self.stiffness[part],
                None if self.curving is None else self.curving[part],
                state.predicted[part] if ahead else motion.vector,
            )
        return Expansion(
            float(per_joint.sum()),
            per_joint,
            sum_joint_vectors(gradient, self.pairs, self.assembly.size),
            hessian,
            convex,
        )


def _add_second_order(strains: np.ndarray, curving: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Return strains (m, 6) plus their second-order term, if any, and the derivatives (m or 1, 6, 6) by ``strains``."""
    return (strains, np.eye(6)[None]) if curving is None else add_second_order(strains, curving)


def _expand_joints(
    motion: JointMotion, stiffness: np.ndarray, curving: np.ndarray | None, predicted: Float[np.ndarray, "joints 6"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return energies (m,), gradients (m, 12), Hessians (m, 12, 12) and their convex parts of joints, in space's axes.

    predicted : (m, 6) strains whose stresses weight the second derivatives of the strains
    """
    base = motion.middle
    strains, slope = _add_second_order(motion.vector, curving)
    across = np.swapaxes(slope, 1, 2)
    inner = matvec(stiffness, strains)
    per_joint = 0.5 * np.einsum("mi,mi->m", inner, strains)
    ahead = matvec(stiffness, strains + matvec(slope, predicted - motion.vector))
    at = SpatialMotion.from_joints(motion)
    jacobian = first_order(at)
    back = np.swapaxes(jacobian, 1, 2)
    spread = np.zeros((len(base), 6, 6))
    spread[:, :3, :3] = spread[:, 3:, 3:] = base
    gradient = matvec(back, matvec(spread, matvec(across, inner)))
    weight = matvec(spread, matvec(across, ahead))
    if curving is None:
        convex = back @ (spread @ stiffness @ np.swapaxes(spread, 1, 2) @ jacobian)
        return per_joint, gradient, convex + second_order(at, weight[:, :3], weight[:, 3:]), convex
    turned = np.swapaxes(spread, 1, 2) @ jacobian
    back = np.swapaxes(turned, 1, 2)
    convex = back @ (across @ stiffness @ slope) @ turned
    bent = back @ (2.0 * contract_with_wrench(ahead, curving)) @ turned
    return per_joint, gradient, convex + bent + second_order(at, weight[:, :3], weight[:, 3:]), convex


def _rotate_to_space(motion: JointMotion, vectors: Float[np.ndarray, "joints 6"]) -> Float[np.ndarray, "joints 6"]:
    """Rotate vectors (m, 6) from the half-way axes to the axes of space."""
    middle = motion.middle
    return np.concatenate([matvec(middle, vectors[:, :3]), matvec(middle, vectors[:, 3:])], axis=1)


# motions of a joint out of the sheet's plane: the shift along the normal and the turns about the two axes in the plane
OUT_OF_PLANE_MASK = np.array([False, False, True, True, True, False])


def _bend_levers(assembly: Assembly, bend: np.ndarray) -> Float[np.ndarray, "joints 2 3"]:
    """Return the vectors (m, 2, 3), metres, from the hubs to the arms' bend points ``bend`` (m, 2, 2)."""
    return bend[..., :1] * assembly.lever + bend[..., 1:] * assembly.lever_normals


def _move_to_bend_points(
    at_joint: Float[np.ndarray, "joints 6 6"], offset: np.ndarray
) -> Float[np.ndarray, "joints 6 6"]:
    """Convert stiffnesses against motions at the joints to stiffnesses against motions between the bend points."""
    transfer = np.broadcast_to(np.eye(6), at_joint.shape).copy()
    transfer[:, :3, 3:] = skew(offset)
    return np.swapaxes(transfer, 1, 2) @ at_joint @ transfer

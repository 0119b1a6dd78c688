"""The 6 x 6 arm model: rigid hubs joined by two arms in series, each with the tip compliance of a cut arm.

The compliance of a cut arm is its compliance in the stiffness table plus a correction (see ``cut``). The compliances of
both arms of a joint add up, because both carry the same wrench. The six strains of a joint are the motion of its second
hub relative to its first: the shift, which is the change of the vector from the first arm's bend point to the second
arm's (see ``arm_bend``), and the turn, the rotation vector of the second hub relative to the first. Both are measured
in the frame half way between both hubs (corotational). A second-order term of the strains (see ``curving``) stiffens
spirals that are pulled straight. It is slow to compute and matters under strong forces only.
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
from .curving import CurvedArms, second_order_strains, transfer_second_order
from .cut import added_compliance_by_shape, rest_shapes
from .joint_energies import correct_strains, expand_joints
from .joint_motion import JointMotion, SpatialMotion, first_order, joint_motion
from .sensitivity import JointDerivatives, arm_loads, convex_by_design
from .stacked import BATCH
from .strain_changes import arm_strains


@dataclass(frozen=True, eq=False)
class ArmState:
    """A pose of the hubs and the motion of the joints at this pose.

    predicted : (m, 6) strains at this pose as the last Newton step predicted them to first order
    """

    pose: Pose
    motion: JointMotion
    predicted: np.ndarray


@dataclass(frozen=True, eq=False)
class ArmModel:
    """The elastic model of an assembly with one 6 x 6 stiffness per joint.

    The shift between two hubs can be measured between any two points, one fixed to each hub. Two such pairs are used:
    both at the place of the joint at rest ("at the joint"), or each at its arm's bend point. Stiffnesses are in SI
    units, in the joint's axes, for shift (3) and turn (3).

    assembly : spirals and joints at rest, rim included
    compliance : tip compliances of both arms of every joint
    material : of all arms
    at_joint : (m, 6, 6) stiffness against motions that are measured at the joint
    stiffness : (m, 6, 6) stiffness against motions that are measured between the bend points
    lever : (m, 2, 3) metres, from the hubs to their arms' bend points, in the flat frames of their patches
    rest : (m, 3) metres, from the first bend point to the second at rest, in the joint's axes
    offset : (m, 3) metres, from the joint to the midpoint of both bend points at rest, in the joint's axes
    curving_at_joint : (m, 6, 6, 6) second-order term of the motions measured at the joint; None leaves it out
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
        slopes : compute the compliances' derivatives by the design now; otherwise they are computed at their first use
        progress : is updated while the second-order term is computed
        """
        whole = assembly.whole
        found = arm_compliances(whole, material, slopes)
        return cls.assemble(whole, found, whole.bend_points[0], material, curving, progress)

    def with_rest_geometry(self, assembly: Assembly) -> ArmModel:
        """Return the model of ``assembly``, which has the spirals of this model in a slightly different rest geometry.

        Compliances are updated to first order; the second-order term ``curving_at_joint`` is copied unchanged.
        """
        change = rest_shapes(assembly, self.material) - rest_shapes(self.assembly, self.material)
        compliance = self.compliance.to_first_order(change, self.cut_by_shapes) if change.any() else self.compliance
        found = self.assemble(assembly, compliance, self.assembly.bend_points[0], self.material, False)
        return found.with_curving(self.curving_at_joint)

    def rebuilt(self, assembly: Assembly, material: Material) -> ArmModel:
        model = ArmModel.from_assembly(assembly, material, curving=False, slopes=False)
        # the second-order term is copied from this model, because computing it takes longest
        return model.with_curving(self.curving_at_joint)

    @cached_property
    def cut_by_shapes(self) -> Float[np.ndarray, "n _ 6 6"]:
        """Derivatives, by the arms' rest shapes, of the cut arms' compliances minus the table's.

        Axes as in ``cut.added_compliance_by_shape``; zero for necks and strips of a rim.
        """
        table, ties = self.compliance.table.reshape(-1, 6, 6), self.assembly.tie_joints
        found = added_compliance_by_shape(self.assembly, table, self.material)
        if self.assembly.nodes:  # necks and strips of the rim are not in the table
            found[2 * ties.start + 1 : 2 * ties.stop : 2], found[2 * ties.stop :] = 0.0, 0.0
        return found

    @cached_property
    def compliance_by(self) -> Float[np.ndarray, "joints 2 numbers 6 6"]:
        """Derivatives of both arms' compliances by the design, as ``by`` of ``ArmCompliances``.

        They are computed if ``compliance`` has none. ``with_rest_geometry`` copies those of ``compliance`` unchanged.
        """
        known = self.compliance if self.compliance.by is not None else arm_compliances(self.assembly, self.material)
        assert known.by is not None
        return known.by

    @cached_property
    def curving(self) -> Float[np.ndarray, "joints 6 6 6"] | None:
        """Second-order term (m, 6, 6, 6) of the motions measured between the bend points; None if left out."""
        return None if self.curving_at_joint is None else transfer_second_order(self.curving_at_joint, -self.offset)

    def with_own_curving(self) -> ArmModel:
        """Return a copy whose second-order term is computed from its own assembly and compliances."""
        return self.assemble(self.assembly, self.compliance, self.assembly.bend_points[0], self.material, True)

    def with_curving(self, at_joint: np.ndarray | None) -> ArmModel:
        """Return a copy with ``at_joint`` (m, 6, 6, 6) as ``curving_at_joint``; None leaves the term out."""
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
        compliance : tip compliances of both arms of every joint
        bend : (m, 2, 2) bend points of both arms, as ``arm_bend.bend_point`` returns them
        material, curving, progress : as in ``from_assembly``
        """
        axes = assembly.arm_axes
        at_joint = np.linalg.inv((axes @ compliance.values @ np.swapaxes(axes, 2, 3)).sum(axis=1))
        lever = _bend_levers(assembly, bend)
        beyond = np.einsum("ekji,ekj->eki", assembly.axes, assembly.lever - lever)
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
        """The model without the strips of the rim, which are the joints between two of its nodes."""
        return self._select_joints(self.assembly.without_strips, np.arange(self.assembly.tie_joints.stop))

    @property
    def rim_only(self) -> ArmModel:
        """The model with only the joints of the rim: those between necks and arms, and the strips."""
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
        """Return a copy whose stiffness against motions out of the sheet's plane is multiplied by ``factor``."""
        scale = np.where(OUT_OF_PLANE_MASK, np.sqrt(factor), 1.0)
        at_joint = np.outer(scale, scale) * self.at_joint
        return replace(self, at_joint=at_joint, stiffness=_move_to_bend_points(at_joint, self.offset))

    def start(self, pose: Pose) -> ArmState:
        if self.assembly.nodes and pose.nodes is None:
            pose = self._with_nodes(pose)
        motion = self.motion(pose)
        return ArmState(pose, motion, motion.vector)

    def _with_nodes(self, pose: Pose) -> Pose:
        """Return the pose with poses of the rim's nodes, which are in equilibrium between the fixed hubs."""
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
        e = correct_strains(state.motion.vector, self.curving)[0]
        return 0.5 * float((matvec(self.stiffness, e) * e).sum())

    def wrenches(self, state: ArmState) -> Float[np.ndarray, "joints 6"]:
        e, slope = correct_strains(self.motion_at_joint(state), self.curving_at_joint)
        return matvec(np.swapaxes(slope, -1, -2), matvec(self.at_joint, e))

    def motion_at_joint(self, state: ArmState) -> Float[np.ndarray, "joints 6"]:
        """Return the joints' motions (m, 6), in half-way axes, measured at the joint instead of the bend points."""
        motion = state.motion.vector
        motion[:, :3] += np.cross(self.offset, motion[:, 3:])
        return motion

    def arm_loads(self, state: ArmState) -> Float[np.ndarray, "joints 2 15"]:
        """Return the loads on both arms of every joint, in the arms' own axes.

        Columns: ``WRENCH``, ``FIRST_ORDER`` and ``TURN`` of ``bar_loads``.
        """
        linear = matvec(self.at_joint, self.motion_at_joint(state))
        return arm_loads(self.assembly, self.wrenches(state), linear, state.motion.turn)

    def joint_gradients(self, state: ArmState) -> Float[np.ndarray, "joints 12"]:
        """Return every joint's contribution (m, 12) to the gradient of the energy.

        Columns as in ``Expansion.hessian``: increments of the first hub (6), then of the second (6).
        """
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
        """Return the derivatives (m, 6, 12) of the strains by the increments of both hubs (6 each).

        The strains are those between the bend points, with their second-order term.
        """
        slope, middle = correct_strains(state.motion.vector, self.curving)[1], state.motion.middle
        rates = first_order(SpatialMotion.from_joints(state.motion)).reshape(-1, 2, 3, 12)
        return slope @ (np.swapaxes(middle, 1, 2)[:, None] @ rates).reshape(-1, 6, 12)

    def convex_by_design(
        self, state: ArmState, direction: Float[np.ndarray, "joints 12"]
    ) -> Float[np.ndarray, "joints 2 5"]:
        """Differentiate every joint's convex energy by the design, at a fixed pose.

        The convex energy of a direction is the second derivative of the energy along it, by the convex part of the
        Hessian (``Expansion.convex``).

        Parameters
        ----------
        state : at which the energy is expanded
        direction : (m, 12) increments of the first hub (6), then of the second (6), of every joint

        Returns
        -------
        (m, 2, 5) : derivatives; axis 1: side of the joint; axis 2: four widths of the spiral on this side (per metre),
            then its twist (per radian)
        """
        known = (self.assembly, self.compliance_by, self.at_joint, self.offset)
        return convex_by_design(*known, state.motion, direction, self.curving_at_joint)

    def changes(self, state: ArmState) -> JointDerivatives:
        """Return the derivatives of the joints' wrenches by pose and design, as if D did not depend on the design."""
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
            per_joint[part], gradient[part], hessian[part], convex[part] = expand_joints(
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


def _rotate_to_space(motion: JointMotion, vectors: Float[np.ndarray, "joints 6"]) -> Float[np.ndarray, "joints 6"]:
    """Rotate pairs of vectors (m, 3 + 3) from the half-way axes to the axes of space."""
    middle = motion.middle
    return np.concatenate([matvec(middle, vectors[:, :3]), matvec(middle, vectors[:, 3:])], axis=1)


# mask of the strains of a joint that are motions out of the sheet's plane: the shift along the normal and the turns
# about the two axes in the plane
OUT_OF_PLANE_MASK = np.array([False, False, True, True, True, False])


def _bend_levers(assembly: Assembly, bend: np.ndarray) -> Float[np.ndarray, "joints 2 3"]:
    """Return the vectors (m, 2, 3), metres, from the hubs to the arms' bend points, in the flat frames of the patches.

    bend : (m, 2, 2) bend points in units of the arms' radii, as ``arm_bend.bend_point`` returns them
    """
    return bend[..., :1] * assembly.lever + bend[..., 1:] * assembly.lever_normals


def _move_to_bend_points(
    at_joint: Float[np.ndarray, "joints 6 6"], offset: np.ndarray
) -> Float[np.ndarray, "joints 6 6"]:
    """Convert stiffnesses against motions measured at the joint to those against motions between the bend points.

    offset : (m, 3) as in ``ArmModel``
    """
    transfer = np.broadcast_to(np.eye(6), at_joint.shape).copy()
    transfer[:, :3, 3:] = skew(offset)
    return np.swapaxes(transfer, 1, 2) @ at_joint @ transfer

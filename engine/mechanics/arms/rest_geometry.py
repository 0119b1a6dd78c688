"""Derivatives of the arm model's joints by their rest geometry, at a fixed pose, twist and width.

The rest geometry has three parameters on each side of a joint: x and y of the lever, which is the vector from the hub's
centre to the joint, and the direction of the edge there. They determine radius and lean of the arms, hence the
compliances, and the points between which the joint's motion is measured. When only the edge is rotated about the
sheet's normal, the joint moves as if the hub rotated about its normal and the lever then were rotated back. So
derivatives by the edge's direction are derivatives by the hub's increments plus derivatives by the lever.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...arrays import Float
from ..assembly import Assembly
from ..vectors import matvec, rotation_matrix
from .bar_loads import LOADS
from .curving_changes import CurvingChanges
from .cut import SHAPE_GRAIN, SHAPE_LEAN, SHAPE_MATE_LEAN, SHAPE_RADIUS
from .joint_motion import SpatialMotion, second_order, tan_quarter
from .model import ArmModel, ArmState
from .sensitivity import SENSES, JointDerivatives, arm_loads

# signs (2, 1, 1) of the derivatives of a joint's gap, the second bend point minus the first, by the bend points of its
# two sides: -1 and 1
_GAP = -SENSES[:, None, None]


@dataclass(frozen=True, eq=False)
class RestChanges:
    """Derivatives of m joints by their rest geometry: on either side x and y of the lever, and direction of the edge.

    Derivatives are per metre and per radian. Axis 1 of arrays (m, 6, ...) counts the three parameters of the first
    side, then those of the second.

    model : elastic model of the joints
    state : at which they are differentiated
    changes : the joints' derivatives by pose and design in this state
    """

    model: ArmModel
    state: ArmState
    changes: JointDerivatives

    @property
    def _assembly(self) -> Assembly:
        return self.model.assembly

    @cached_property
    def _frames(self) -> Float[np.ndarray, "joints 2 3 3"]:
        """Rotations to the half-way axes from the joint's axes, as these have rotated with the hub on either side."""
        return rotation_matrix(-0.5 * SENSES[:, None] * self.changes.turn[:, None])

    @cached_property
    def _normals(self) -> Float[np.ndarray, "joints 2 3"]:
        """Sheet normals at both hubs of every joint, in space."""
        return self.state.pose.whole.rotations[self._assembly.pairs][..., 2]

    @cached_property
    def _levers(self) -> tuple[Float[np.ndarray, "joints 2 3 3"], Float[np.ndarray, "joints 2 3 3"]]:
        """Derivatives by the rest geometry of two vectors: the lever, and the vector from the hub to the bend point.

        Axes of both arrays: joint; side; parameter of this side; component in the joint's axes.
        """
        known = self._assembly
        back, winding = np.swapaxes(known.axes, 2, 3), -1.0 if known.clockwise else 1.0
        lever, bend = (matvec(back, v) for v in (known.lever, self.model.lever))
        # the x and y axes of the flat patch on either side of the joint, as rows with components in the joint's axes
        own = known.axes[:, :, :2]
        along, aside = np.moveaxis(known.bend_points[0], 2, 0)[..., None, None]
        by_bend = along * own + winding * aside * _about_normal(own)
        return (
            np.concatenate([own, -_about_normal(lever)[:, :, None]], axis=2),
            np.concatenate([by_bend, -_about_normal(bend)[:, :, None]], axis=2),
        )

    @cached_property
    def _shapes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Derivatives by the rest geometry of three numbers of each arm.

        They are its radius, the angle from the edge's direction to its radius, and the angle from the x axis of the
        flat frame to its radius. Each array is (m, 2, 3): joint, side, parameter of this side.
        """
        lever = self._assembly.lever[..., :2]
        radius = self._assembly.radius[..., None]
        by_radius, angle = np.zeros((*radius.shape[:2], 3)), np.zeros((*radius.shape[:2], 3))
        by_radius[..., :2] = lever / radius
        angle[..., :2] = np.stack([-lever[..., 1], lever[..., 0]], axis=2) / radius**2
        return by_radius, angle - np.array([0.0, 0.0, 1.0]), angle

    @cached_property
    def _gap(self) -> Float[np.ndarray, "joints 3"]:
        """Gap at the joint, in the half-way axes.

        The point of the joint at rest is fixed once to the first hub and once to the second; the gap is the vector from
        the first of these points to the second.
        """
        lever = np.swapaxes(self._assembly.axes, 2, 3)
        beyond = matvec(self._frames, matvec(lever, self._assembly.lever - self.model.lever))
        return self.state.motion.gap + beyond[:, 1] - beyond[:, 0]

    @property
    def _by_shapes(self) -> Float[np.ndarray, "joints 2 _ 6 6"]:
        """Derivatives of both arms' compliances, in their own axes, by the columns of ``cut.rest_shapes`` (axis 2)."""
        known = self.model.compliance
        by = self.model.cut_by_shapes.reshape(*known.values.shape[:2], -1, 6, 6).copy()
        by[:, :, SHAPE_RADIUS] += 2.0 * known.table_by_scale
        if by.shape[2] > SHAPE_GRAIN:
            by[:, :, SHAPE_GRAIN] += known.table_by_grain
        return by

    @cached_property
    def _compliances(self) -> Float[np.ndarray, "joints 2 6 6"]:
        """Tip compliances of both arms in the joint's axes."""
        axes = self._assembly.arm_axes
        return axes @ self.model.compliance.values @ np.swapaxes(axes, 2, 3)

    @cached_property
    def _tip_wrenches(self) -> Float[np.ndarray, "joints 6"]:
        """Wrenches at the tips under which the arms reach the tip motions of ``tip_motion``."""
        return matvec(self.changes.at_joint, np.concatenate([self._gap, self.changes.turn], axis=1))

    @cached_property
    def _softened(self) -> Float[np.ndarray, "joints 2 2 3 3 6"]:
        """Derivatives by the rest geometry of compliance @ wrench, the motion of an arm's tip, for three wrenches.

        The wrenches are constant: ``inner`` and ``linear`` of ``JointDerivatives``, and ``_tip_wrenches``. Axes: joint;
        arm; side and parameter of the rest geometry; wrench; component of the motion in the joint's axes.
        """
        known, by = self._assembly, self._by_shapes
        axes, sense = known.arm_axes, -1.0 if known.clockwise else 1.0
        wrenches = np.stack([self.changes.inner, self.changes.linear, self._tip_wrenches], axis=1)[:, None]
        # derivatives of the tips' motions by ``rest_shapes``; axes: joint, arm, column of ``rest_shapes``, wrench,
        # component
        yields = (wrenches @ axes)[:, :, None] @ by @ np.swapaxes(axes, 2, 3)[:, :, None]
        turned = _about_normal(wrenches @ self._compliances) - _about_normal(wrenches) @ self._compliances
        turned += sense * yields[:, :, SHAPE_LEAN]
        mates = sense * yields[:, :, SHAPE_MATE_LEAN]
        if known.nodes:  # an arm at a rim is blended with its own mirror image, whose lean has the opposite sign
            turned[known.tie_joints, 0] -= mates[known.tie_joints, 0]
            mates[known.tie_joints] = 0.0
        by_radius, by_angle, by_direction = (x[..., None, None] for x in self._shapes)
        out = np.empty((len(turned), 2, 2, 3, 3, 6))
        for side in (0, 1):
            out[:, side, side] = (
                by_radius[:, side] * yields[:, side, SHAPE_RADIUS, None] + by_angle[:, side] * turned[:, side, None]
            )
            if by.shape[2] > SHAPE_GRAIN:
                out[:, side, side] -= sense * by_direction[:, side] * yields[:, side, SHAPE_GRAIN, None]
            out[:, side, 1 - side] = by_angle[:, 1 - side] * mates[:, side, None]
        return out

    @cached_property
    def _strains(self) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives by the rest geometry (axes 1 and 2: side, parameter), in half-way axes.

        Returns
        -------
        (m, 2, 3, 6) : of the joints' motions, measured at the joint
        (m, 2, 3, 3) : of the vectors from the first bend point to the second, at constant rotations of the hubs
        """
        lever, bend = self._levers
        turn, beyond = self.changes.turn[:, None, None], lever - bend
        gap = _GAP * (bend @ np.swapaxes(self._frames, 2, 3))
        out = np.zeros((*gap.shape[:3], 6))
        out[..., :3] = gap + _GAP * beyond - 0.5 * np.cross(beyond, turn)
        for side in (0, 1):
            out[:, side, 2] += matvec(self.changes.by_pose[:, :, _rotation(side)], self._normals[:, side])
        return out, gap

    @cached_property
    def curving(self) -> CurvingChanges:
        """Derivatives by the rest geometry of the strains' second-order term D; of no joints if the model has no D."""
        return CurvingChanges.by_rest_geometry(self.model, self.state)

    @cached_property
    def _wrenches(self) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives by the rest geometry of ``wrench`` and of ``linear`` of ``JointDerivatives``.

        Axes of both arrays: joint, side, parameter, component of the wrench.
        """
        known, strains = self.changes, self._strains[0]
        softened = self._softened.sum(axis=1)
        wrench = strains @ known.tangent[:, None] - softened[..., 0, :] @ np.swapaxes(known.across, 1, 2)[:, None]
        if len(self.curving.joints):
            wrench[self.curving.joints] += self.curving.wrenches(self.state)
        return wrench, (strains - softened[..., 1, :]) @ known.at_joint[:, None]

    @property
    def gradient(self) -> Float[np.ndarray, "joints 6 12"]:
        """Derivatives by the rest geometry (axis 1) of every joint's contribution to the energy's gradient by the pose.

        The last axis counts the increments of both hubs.
        """
        known, motion = self.changes, self.state.motion
        (lever, bend), gap = self._levers, self._strains[1]
        force, by_turn = known.wrench[:, None, None, :3], known.by_pose[:, 3:, 9:]
        quarter = _quarter(known.turn)
        out = self._wrenches[0] @ known.by_pose[:, None]
        torque = np.cross(gap, force)
        torque = (
            0.5 * (_GAP * torque - np.cross(quarter[:, None, None], torque)) @ np.swapaxes(motion.middle, 1, 2)[:, None]
        )
        torque += 0.5 * np.cross(lever - bend, force) @ by_turn[:, None]
        out[..., 3:6] -= torque
        out[..., 9:] += torque
        moment = known.wrench[:, 3:] - np.cross(self.model.offset, known.wrench[:, :3])
        weights = matvec(motion.middle, known.wrench[:, :3]), matvec(motion.middle, moment)
        curvature = second_order(SpatialMotion.from_joints(motion), *weights)
        gradient = matvec(np.swapaxes(known.by_pose, 1, 2), known.wrench)
        for side in (0, 1):
            part, normal = _rotation(side), self._normals[:, side]
            out[:, side, 2] += matvec(curvature[:, :, part], normal)
            # rotations do not commute, so the second derivative by two rotations of the same hub has this additional
            # part
            out[:, side, 2, part] += 0.5 * np.cross(normal, gradient[:, part])
        return out.reshape(len(out), 6, 12)

    @cached_property
    def loads(self) -> Float[np.ndarray, "joints 6 2 15"]:
        """Derivatives by the rest geometry (axis 1) of the loads on both arms, in the columns of ``bar_loads``."""
        known, wrenches, turn = self.changes, self._wrenches, self._strains[0][..., 3:]
        out = np.empty((len(turn), 2, 3, 2, LOADS))
        for side in (0, 1):
            for k in range(3):
                now = (*(part[:, side, k] for part in wrenches), turn[:, side, k])
                out[:, side, k] = arm_loads(self._assembly, *now)
        # loads are in the arm's own axes, which rotate when the lever changes its direction
        turned = arm_loads(self._assembly, *(_about_normal(v) for v in (known.wrench, known.linear, known.turn)))
        for side in (0, 1):
            out[:, side, :, side] -= self._shapes[1][:, side, :, None] * turned[:, side, None]
        return out.reshape(len(turn), 6, 2, LOADS)

    @property
    def tips(self) -> Float[np.ndarray, "joints 6 12"]:
        """Derivatives by the rest geometry (axis 1) of the tips' motions of ``tip_motion``.

        The last axis counts the six components of the first arm's tip, then those of the second arm's.
        """
        known, axes, frames, gap = self.changes, self._assembly.axes, self._frames, self._gap
        change = np.concatenate(
            [_GAP * (self._levers[0] @ np.swapaxes(frames, 2, 3)), self._strains[0][..., 3:]], axis=3
        )
        normal, quarter = frames[..., 2], _quarter(known.turn)[:, None]
        # rotation vector of the half-way frame per rotation of the edge on either side about its normal
        middle = 0.5 * (normal + SENSES[:, None] * np.cross(quarter, normal))
        change[:, :, 2, :3] = -np.cross(middle, gap[:, None])
        wrench, softened = self._tip_wrenches[:, None, None], self._softened[..., 2, :]
        change = ((change - softened.sum(axis=1)) @ known.at_joint[:, None])[:, None] @ self._compliances[:, :, None]
        change = SENSES[:, None, None, None] * (change + softened)
        moved = SENSES[:, None] * (wrench @ self._compliances)[:, :, 0]
        change[:, :, :, 2, :3] += np.cross(middle[:, None], moved[:, :, None, :3])
        change[..., :3] = change[..., :3] @ frames[:, :, None]
        for side in (0, 1):
            change[:, side, side, 2, 3:] += _about_normal(moved[:, side, 3:])
        out = change.reshape(*change.shape[:4], 2, 3) @ np.swapaxes(axes, 2, 3)[:, :, None, None]
        return out.transpose(0, 2, 3, 1, 4, 5).reshape(len(out), 6, 12)


def _quarter(turn: Float[np.ndarray, "joints 3"]) -> Float[np.ndarray, "joints 3"]:
    """Return vectors (m, 3) along the rotation vectors ``turn``, of the length tan(angle / 4)."""
    return tan_quarter(np.linalg.norm(turn, axis=1))[:, None] * turn


def _rotation(side: int) -> slice:
    """Return the slice of a joint's 12 increments that is the rotation of its hub on ``side`` (0 or 1)."""
    return slice(3 + 6 * side, 6 + 6 * side)


def _about_normal(v: np.ndarray) -> np.ndarray:
    """Return the cross products (0, 0, 1) x v of vectors v (..., 3), or of both halves of pairs of vectors (..., 6)."""
    out = np.zeros_like(v)
    out[..., ::3], out[..., 1::3] = -v[..., 1::3], v[..., ::3]
    return out

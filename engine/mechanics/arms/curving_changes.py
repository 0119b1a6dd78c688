"""Derivatives of the second-order term D of the joints' strains with respect to the design and the rest geometry.

They are computed only at joints where D contributes much energy. Without them, the predicted motion of a soft piece
under a change of its design can be wrong by half or more (docs/tuning.md).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...arrays import Float, Int
from ..assembly import Assembly
from ..vectors import matvec
from .curving import add_second_order
from .cut import BESIDE, TWIST, WIDTH, rest_shapes
from .model import ArmModel, ArmState
from .sensitivity import PARAMETERS, JointDerivatives

# The second-order term D is differentiated only for joints where it changes the energy by more than this share of the
# mean of y . K y over all joints (y a joint's motion, K its stiffness). Larger: fewer joints, faster, less exact.
MIN_SHARE = 0.01
# Step of the forward differences: radians for angles, else a share of the arm's width or radius. Smaller: more rounding
# errors
STEP = 1e-7


@dataclass(frozen=True, eq=False)
class CurvingChanges:
    """Derivatives of the second-order term D (see ``curving``) of k joints.

    They are with respect to three parameters of each of the joint's two sides: those of the design (``by_design``) or
    those of the rest geometry (``by_rest_geometry``). The methods return only the part of a derivative that comes from
    the change of D.

    model : elastic model of all joints, with D
    joints : (k,) indices of the k joints among all joints
    by : (k, 2, 3, 6, 6, 6) derivatives of D; axes: joint, side, parameter, and the three of D
    """

    model: ArmModel
    joints: Int[np.ndarray, " k"]
    by: Float[np.ndarray, "k 2 3 6 6 6"]

    @classmethod
    def by_design(cls, model: ArmModel, state: ArmState) -> CurvingChanges:
        """Differentiate D with respect to the design: an arm's width, its twist, and the mean width of the arms beside.

        Parameters
        ----------
        model : elastic model of all joints
        state : D is differentiated at joints where it contributes much energy in this state
        """
        return cls._from_changes(model, state, with_design_change, _design_scale)

    @classmethod
    def by_rest_geometry(cls, model: ArmModel, state: ArmState) -> CurvingChanges:
        """Differentiate D with respect to the rest geometry: x and y of the edge's middle, and the edge's direction.

        Parameters
        ----------
        model : elastic model of all joints
        state : D is differentiated at joints where it contributes much energy in this state
        """
        return cls._from_changes(model, state, with_rest_change, _rest_scale)

    @classmethod
    def _from_changes(
        cls,
        model: ArmModel,
        state: ArmState,
        apply_change: Callable[[Assembly, int, int, np.ndarray], Assembly],
        scale: Callable[[Assembly, int, int], np.ndarray],
    ) -> CurvingChanges:
        joints, each = _joints_that_matter(model, state), 2 * PARAMETERS
        shape = (len(joints), 2, PARAMETERS, 6, 6, 6)
        if not len(joints):
            return cls(model, joints, np.zeros(shape))
        assert model.curving_at_joint is not None
        # evaluate one copy of every joint per parameter, because one large evaluation is faster than several small ones
        every = np.repeat(joints, each)
        there = alone = _with_own_spirals(model.assembly, every)
        steps = np.zeros((each, len(every)))
        for k, (side, number) in enumerate(np.ndindex(2, PARAMETERS)):
            steps[k, k::each] = STEP * scale(alone, side, number)[k::each]
            there = apply_change(there, side, number, steps[k])
        change = _curving_nearby(model, every, alone, there) - model.curving_at_joint[every]
        return cls(model, joints, (change / steps.sum(axis=0)[:, None, None, None]).reshape(shape))

    def wrenches(self, state: ArmState) -> Float[np.ndarray, "k 2 3 6"]:
        """Return the derivatives of the joints' wrenches with respect to the parameters at a fixed pose.

        Axes: joint, side, parameter, component in the frame half way between the hubs.
        """
        motion, half, inner, slope = self._at(state)
        across = np.swapaxes(slope, 1, 2) @ self.model.at_joint[self.joints]
        second = (half @ motion[:, None, None, :, None])[..., 0]
        return second @ np.swapaxes(across, 1, 2)[:, None] + 2.0 * (inner[:, None, None, None] @ half)[..., 0, :]

    def energies(self, state: ArmState) -> Float[np.ndarray, "k 2 3"]:
        """Return the derivatives of the joints' energies by the parameters at a fixed pose.

        Axes: joint, side, parameter.
        """
        motion, half, inner, _ = self._at(state)
        return (inner[:, None, None, None] @ half @ motion[:, None, None, :, None])[..., 0, 0]

    def convex(self, state: ArmState, rates: Float[np.ndarray, "joints 6"]) -> Float[np.ndarray, "k 2 3"]:
        """Return the derivatives of the joints' convex energies (see ``sensitivity``) with respect to the parameters.

        Parameters
        ----------
        state : at which the energies are expanded
        rates : (m, 6) derivatives of the motions of all joints of the model along the direction for which the convex
            energy is computed
        """
        _, half, _, slope = self._at(state)
        rate = rates[self.joints]
        force = matvec(self.model.at_joint[self.joints], matvec(slope, rate))
        return 4.0 * (force[:, None, None, None] @ half @ rate[:, None, None, :, None])[..., 0, 0]

    def _at(self, state: ArmState) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return four arrays of the k joints: y, dD y, K (y + y.D.y) and 1 + 2 y.D.

        Here y is a joint's motion, K its stiffness, and dD the derivative of D with respect to every parameter.
        """
        assert self.model.curving_at_joint is not None
        motion = self.model.motion_at_joint(state)[self.joints]
        strains, slope = add_second_order(motion, self.model.curving_at_joint[self.joints])
        half = (self.by.reshape(len(motion), 2 * PARAMETERS * 36, 6) @ motion[:, :, None]).reshape(self.by.shape[:-1])
        return motion, half, matvec(self.model.at_joint[self.joints], strains), slope


@dataclass(frozen=True, eq=False)
class DesignChanges:
    """Derivatives of a model's joints by pose and design in one state; a property is computed at its first use."""

    model: ArmModel
    state: ArmState

    @cached_property
    def constant_curving(self) -> JointDerivatives:
        """Derivatives of all joints by pose and design, as if the design did not change the second-order term D."""
        return self.model.changes(self.state)

    @cached_property
    def curving(self) -> CurvingChanges:
        """Derivatives of the second-order term D by the design; of no joints if the model has no D."""
        return CurvingChanges.by_design(self.model, self.state)

    @cached_property
    def complete(self) -> JointDerivatives:
        """Derivatives of all joints by pose and design, including the change of the second-order term D."""
        if not len(self.curving.joints):
            return self.constant_curving
        wrenches = self.constant_curving.wrench_by_design.copy()
        wrenches[self.curving.joints] += self.curving.wrenches(self.state)
        return replace(self.constant_curving, wrench_by_design=wrenches)


def with_design_change(assembly: Assembly, side: int, number: int, step: np.ndarray) -> Assembly:
    """Return a copy of an assembly in which one design parameter is changed on one side of all joints.

    Parameters
    ----------
    assembly : m joints that share no spirals
    side : 0 or 1
    number : the parameter: ``WIDTH``, ``TWIST`` or ``BESIDE`` of ``cut``
    step : (m,) changes of the parameter, metres or radians
    """
    width, twist = assembly.width.copy(), assembly.twist.copy()
    spiral, arm = assembly.pairs[:, side], assembly.sides[:, side]
    if number == TWIST:
        twist[spiral] += step
    for turn in {WIDTH: (0,), BESIDE: (1, -1)}.get(number, ()):
        width[spiral, (arm + turn) % 4] += step
    return assembly.with_spirals(width, twist)


def with_rest_change(assembly: Assembly, side: int, number: int, step: np.ndarray) -> Assembly:
    """Return a copy of an assembly in which one parameter of the rest geometry is changed on one side of all joints.

    Parameters
    ----------
    assembly : m joints
    side : 0 or 1
    number : the parameter: 0 and 1 for x and y of the edge's middle, metres; 2 for the edge's direction, radians
    step : (m,) changes of the parameter
    """
    if number < 2:
        lever = assembly.lever.copy()
        lever[:, side, number] += step
        return replace(assembly, lever=lever)
    axes, (cosine, sine) = assembly.axes.copy(), (np.cos(step)[:, None], np.sin(step)[:, None])
    x, y = axes[:, side, 0].copy(), axes[:, side, 1].copy()
    axes[:, side, 0], axes[:, side, 1] = cosine * x - sine * y, sine * x + cosine * y
    return replace(assembly, axes=axes)


def _design_scale(assembly: Assembly, side: int, number: int) -> Float[np.ndarray, " joints"]:
    """Return the unit (m,) of the step of a design parameter: 1 rad for twists, the arms' widths in metres for widths.

    Parameters as in ``with_design_change``.
    """
    return np.ones(len(assembly.pairs)) if number == TWIST else assembly.arm_width[:, side]


def _rest_scale(assembly: Assembly, side: int, number: int) -> Float[np.ndarray, " joints"]:
    """Return the unit (m,) of the step of a rest parameter: 1 rad for directions, the radii in metres for positions.

    Parameters as in ``with_rest_change``.
    """
    return np.ones(len(assembly.pairs)) if number == 2 else assembly.radius[:, side]


def _joints_that_matter(model: ArmModel, state: ArmState) -> Int[np.ndarray, " k"]:
    """Return the indices of the joints whose D is differentiated (see ``MIN_SHARE``); joints of a rim never are."""
    if model.curving_at_joint is None:
        return np.zeros(0, dtype=int)
    motion = model.motion_at_joint(state)
    linear = matvec(model.at_joint, motion)
    second = add_second_order(motion, model.curving_at_joint)[0] - motion
    energy = np.abs((linear * second).sum(axis=1))[: model.assembly.n_inner_joints]
    return np.flatnonzero(energy > MIN_SHARE * (linear * motion).sum(axis=1).mean())


def _curving_nearby(
    model: ArmModel, joints: np.ndarray, before: Assembly, after: Assembly
) -> Float[np.ndarray, "k 6 6 6"]:
    """Return the second-order term D (k, 6, 6, 6) of k joints after a slight change of their assembly.

    The arms' compliances are updated to first order.

    Parameters
    ----------
    model : elastic model of all joints, before the change
    joints : (k,) indices of the joints in ``model``
    before, after : assemblies of these k joints only, before and after the change
    """
    compliance, values = model.compliance.subset(joints), 0.0
    if after.lever is before.lever and after.axes is before.axes:
        numbers = _cut_numbers(after) - _cut_numbers(before)
        values = (numbers[..., None, None] * model.compliance_by[joints]).sum(axis=2)
    else:
        by = model.cut_by_shapes.reshape(len(model.pairs), 2, -1, 6, 6)[joints]
        shapes = rest_shapes(after, model.material) - rest_shapes(before, model.material)
        compliance = compliance.to_first_order(shapes, by.reshape(-1, *by.shape[2:]))
    compliance = replace(compliance, values=compliance.values + values)
    found = ArmModel.assemble(after, compliance, after.bend_points[0], model.material, True).curving_at_joint
    assert found is not None
    return found


def _cut_numbers(assembly: Assembly) -> Float[np.ndarray, "joints 2 5"]:
    """Return the five parameters ``WIDTH``, ``TWIST``, ... of ``cut`` (last axis) of both arms of every joint."""
    width, twist = assembly.arm_width, assembly.twist[assembly.pairs]
    beside = 0.5 * sum(assembly.width[assembly.pairs, (assembly.sides + turn) % 4] for turn in (1, -1))
    return np.stack([width, twist, beside, width[:, ::-1], twist[:, ::-1]], axis=2)


def _with_own_spirals(assembly: Assembly, joints: Int[np.ndarray, " k"]) -> Assembly:
    """Return an assembly of k joints that share no spirals, so that a change of a spiral changes one joint only.

    Every joint gets its own copies of its two spirals.

    joints : (k,) indices of the joints in ``assembly``
    """
    parts = {name: getattr(assembly, name)[joints] for name in ("sides", "lever", "axes")}
    spirals = assembly.pairs[joints].ravel()
    width, twist = assembly.width[spirals], assembly.twist[spirals]
    pairs = np.arange(len(spirals)).reshape(-1, 2)
    return replace(assembly, pairs=pairs, **parts, width=width, twist=twist, rim=None, nodes=0)

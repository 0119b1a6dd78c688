"""Derivatives of the joints by their rest geometry, against differences of models whose rest geometry differs."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.mechanics.arms import curving_changes
from flexmaps.engine.mechanics.arms.model import ArmModel
from flexmaps.engine.mechanics.arms.rest_geometry import RestChanges
from flexmaps.engine.mechanics.arms.tip_motion import tip_motions
from flexmaps.engine.mechanics.assembly import Assembly, CutSettings, Pose, assembly_from_design, target_pose
from flexmaps.engine.optimisation.codesign_geometry import joint_derivatives
from flexmaps.engine.params import LayoutParams, SpiralParams
from flexmaps.engine.patches.flattening.flatten import flatten
from flexmaps.engine.patches.layout import PatchLayout
from flexmaps.engine.spirals.design import SpiralDesign
from flexmaps.engine.surface import shapes
from scipy.spatial.transform import Rotation

COUNT = 20


def joints(rng: np.random.Generator, clockwise: bool) -> Assembly:
    """Joints of unlike arms in unlike quads, each between two spirals of its own, with edges in any direction."""
    turn = Rotation.from_rotvec(np.outer(rng.uniform(-3.0, 3.0, 2 * COUNT), [0.0, 0.0, 1.0])).as_matrix()
    lever, axes = np.zeros((COUNT, 2, 3)), turn.reshape(COUNT, 2, 3, 3)
    lever[:, 0, 0], lever[:, 1, 0] = 0.01, -0.01
    lever[..., :2] += rng.uniform(-0.002, 0.002, (COUNT, 2, 2))
    return Assembly(
        np.arange(2 * COUNT).reshape(-1, 2),
        rng.integers(0, 4, (COUNT, 2)),
        (axes @ lever[..., None])[..., 0],
        axes,
        rng.uniform(0.0007, 0.0018, (2 * COUNT, 4)),
        rng.uniform(0.0, 4.5, 2 * COUNT),
        0.002,
        clockwise,
        CutSettings(0.15, 0.00015),
        0.4,
    )


def bent(known: Assembly, rng: np.random.Generator) -> Pose:
    """Hubs that are turned by half a radian or so, and shifted, from where their joints would be at rest."""
    centres, rotations = np.zeros((2 * COUNT, 3)), Rotation.random(2 * COUNT, random_state=2).as_matrix()
    kink = Rotation.from_rotvec(rng.normal(0.0, 0.3, (COUNT, 3))).as_matrix()
    first = rotations[::2] @ known.axes[:, 0]
    rotations[1::2] = first @ kink @ np.swapaxes(known.axes[:, 1], 1, 2)
    ends = [(rotations[side::2] @ known.lever[:, side, :, None])[..., 0] for side in (0, 1)]
    centres[1::2] = ends[0] - ends[1] + rng.normal(0.0, 0.001, (COUNT, 3))
    return Pose(centres, rotations)


def compared(model: ArmModel, pose: Pose, curving: bool = False) -> list[tuple[np.ndarray, np.ndarray]]:
    """Gradients, loads and tips: the derivatives and their differences, in units of the largest of each component.

    curving : let the second-order strains change with the rest geometry
    """

    def measure(there: ArmModel, pose: Pose) -> np.ndarray:
        if curving:
            there = there.with_own_curving()
        state, known = there.start(pose), (there.assembly, there.compliance.values, there.at_joint)
        parts = (there.joint_gradients(state), there.arm_loads(state), tip_motions(*known, pose))
        return np.concatenate([part.reshape(len(part), -1) for part in parts], axis=1)

    state = model.start(pose)
    changes = RestChanges(model, state, model.changes(state))
    parts = (changes.gradient, changes.loads, changes.tips)
    wanted = joint_derivatives(model, state.pose, measure)
    found = np.concatenate([part.reshape(*part.shape[:2], -1) for part in parts], axis=2)[: len(wanted)]
    found = found.reshape(len(found), 2, 3, -1).transpose(0, 3, 1, 2)
    unit = np.abs(wanted).max(axis=(0, 2), keepdims=True) + 1e-300
    return list(zip(np.split(found / unit, [12, 42], axis=1), np.split(wanted / unit, [12, 42], axis=1), strict=True))


@pytest.mark.parametrize("clockwise", [False, True])
@pytest.mark.parametrize("curving", [False, True])
@pytest.mark.parametrize("material", ["vero", "birch"])
def test_derivatives_are_differences(
    material: str, curving: bool, clockwise: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(curving_changes, "MIN_SHARE", 0.0)
    rng = np.random.default_rng(1)
    known = joints(rng, clockwise)
    model = ArmModel.from_assembly(known, MATERIALS[material], curving=curving)
    for found, wanted in compared(model, bent(known, rng), curving):
        assert found == pytest.approx(wanted, abs=1e-6)
        assert np.abs(wanted).max() == 1.0


def rimmed() -> tuple[ArmModel, Pose]:
    """A sheet with a rim whose target is a strip, where it is out of equilibrium."""
    mesh = shapes.strip(3, 4)
    mesh = mesh.with_vertices(mesh.vertices * 0.02 / mesh.median_edge)
    flat = flatten(PatchLayout(mesh, np.zeros(len(mesh.edges), dtype=bool)), LayoutParams())
    made = SpiralDesign(flat, SpiralParams(border="rim"), np.full((12, 4), 0.0015), np.linspace(0.5, 2.0, 12))
    assert made.rim is not None
    pose, rng = target_pose(mesh, flat.corners), np.random.default_rng(3)
    moved = pose.moved(rng.normal(size=(12, 6)) * np.repeat([0.0005, 0.2], 3))
    return ArmModel.from_assembly(assembly_from_design(made), MATERIALS["vero"], curving=False), moved


def test_arms_at_a_rim() -> None:
    model, pose = rimmed()
    ties = model.assembly.tie_joints
    for found, wanted in compared(model, pose):
        assert len(found) == ties.stop > ties.start
        assert found[: ties.start] == pytest.approx(wanted[: ties.start], abs=1e-6)
        # the rim's side of a tie has no rest geometry of its own
        assert found[ties, :, 0] == pytest.approx(wanted[ties, :, 0], abs=1e-6)

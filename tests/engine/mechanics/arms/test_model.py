"""The elastic model of the arms against finite differences and symmetries."""

from __future__ import annotations

import dataclasses
import sys

import numpy as np
import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.mechanics.arms.model import ArmModel
from flexmaps.engine.mechanics.assembly import Assembly, Pose
from flexmaps.engine.mechanics.elastic import sum_joint_vectors
from flexmaps.engine.mechanics.rods.rod_model import RodModel
from scipy.spatial.transform import Rotation

chains = sys.modules["flexmaps_chains"]
WIDTH, VERO, row, straight, ring, shaken = (
    getattr(chains, name) for name in ("WIDTH", "VERO", "row", "straight", "ring", "shaken")
)


@pytest.mark.parametrize("twist", [0.0, 2.5])
@pytest.mark.parametrize("turn", [1e-7, 0.3, 1.0])
@pytest.mark.parametrize("curving", [False, True])
def test_derivatives_are_those_of_the_energy(twist: float, turn: float, curving: bool) -> None:
    model = ArmModel.from_assembly(row(5, twist=twist, closed=True), VERO, curving=curving)
    state = model.start(shaken(ring(5), 0.003, turn, seed=3))
    here = model.expand(state)
    rng = np.random.default_rng(1)
    direction = rng.normal(size=(5, 6)) * np.repeat([0.01, 1.0], 3)

    def energy(t: float) -> float:
        return model.energy(model.moved(state, t * direction))

    h = 1e-3
    slope = (8 * (energy(h) - energy(-h)) - energy(2 * h) + energy(-2 * h)) / (12 * h)
    bend = (16 * (energy(h) + energy(-h)) - 30 * energy(0.0) - energy(2 * h) - energy(-2 * h)) / (12 * h * h)
    both = direction[model.pairs].reshape(-1, 12)
    assert slope == pytest.approx(float((here.gradient * direction).sum()), rel=1e-6)
    assert bend == pytest.approx(float(np.einsum("mi,mij,mj->", both, here.hessian, both)), rel=1e-6)
    assert np.linalg.eigvalsh(here.convex).min() > -1e-9 * np.abs(here.convex).max()
    assert here.per_joint.sum() == pytest.approx(here.energy)


def mixed(count: int, clockwise: bool, rng: np.random.Generator) -> Assembly:
    """A row of unequal spirals with unequal arms, every one in a plane of its own and joined at an angle."""
    one = row(count, clockwise=clockwise)
    axes = Rotation.from_rotvec(np.outer(rng.uniform(-3.0, 3.0, one.pairs.size), [0.0, 0.0, 1.0])).as_matrix()
    axes = axes.reshape(*one.pairs.shape, 3, 3)
    kink = Rotation.from_rotvec(np.outer(rng.uniform(-0.4, 0.4, one.pairs.size), [0.0, 0.0, 1.0])).as_matrix()
    lever = kink.reshape(axes.shape) @ one.lever[..., None] * rng.uniform(0.9, 1.2, (*one.pairs.shape, 1, 1))
    bent = dataclasses.replace(one, axes=axes, lever=(axes @ lever)[..., 0])
    return bent.with_spirals(WIDTH * rng.uniform(0.5, 1.0, (count, 4)), rng.uniform(0.5, 2.5, count))


def unrolled(chain: Assembly) -> Pose:
    """All joints closed and not strained."""
    pose = Pose(np.zeros((chain.size, 3)), np.tile(np.eye(3), (chain.size, 1, 1)))
    for (i, j), lever, axes in zip(chain.pairs, chain.lever, chain.axes, strict=True):
        pose.rotations[j] = pose.rotations[i] @ axes[0] @ axes[1].T
        pose.centres[j] = pose.centres[i] + pose.rotations[i] @ lever[0] - pose.rotations[j] @ lever[1]
    return pose


@pytest.mark.parametrize("clockwise", [False, True])
@pytest.mark.parametrize("turn", [1e-4, 0.3, 1.0])
def test_forces_by_the_design_are_finite_differences(turn: float, clockwise: bool) -> None:
    rng = np.random.default_rng(6)
    chain = mixed(9, clockwise, rng)
    pose = shaken(unrolled(chain), 0.01 * turn, 0.4 * turn, seed=7)
    design = np.column_stack([chain.width, chain.twist])

    def forces(design: np.ndarray) -> np.ndarray:
        model = ArmModel.from_assembly(chain.with_spirals(design[:, :4], design[:, 4]), VERO, curving=False)
        return model.expand(model.start(pose)).gradient

    here = ArmModel.from_assembly(chain, VERO, curving=False)
    blocks = here.gradient_by_design(here.start(pose))
    for scale in ([1e-3] * 4 + [0.0], [0.0] * 4 + [1.0]):
        way, step = rng.normal(size=design.shape) * scale, 2e-4
        line = [forces(design + k * step * way) for k in (-2, -1, 1, 2)]
        expected = (line[0] - 8 * line[1] + 8 * line[2] - line[3]) / (12 * step)
        found = sum_joint_vectors(np.einsum("miks,mks->mi", blocks, way[chain.pairs]), chain.pairs, chain.size)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7 * np.abs(expected).max())


@pytest.mark.parametrize("kind", [ArmModel, RodModel])
def test_looking_ahead_changes_the_stresses_to_second_order_in_the_step(kind: type) -> None:
    chain = row(6, twist=1.5, closed=True)
    model = kind.from_assembly(dataclasses.replace(chain, thickness=0.003), VERO)
    state = model.start(shaken(ring(6), 0.001, 0.2, seed=4))
    way = np.random.default_rng(5).normal(size=(6, 6)) * np.repeat([0.01, 1.0], 3)

    def missed(step: float) -> float:
        there = model.moved(state, step * way)
        ahead, exact = model.expand(there, ahead=True), model.expand(there)
        assert ahead.gradient == pytest.approx(exact.gradient)
        return float(np.abs(ahead.hessian - exact.hessian).max() / np.abs(exact.hessian).max())

    assert model.expand(state, ahead=True).hessian == pytest.approx(model.expand(state).hessian)
    assert missed(0.02) > 1e-7
    assert missed(0.02) == pytest.approx(100.0 * missed(0.002), rel=0.2)


def test_rigid_motion_and_rest_cost_nothing() -> None:
    model = ArmModel.from_assembly(row(4, twist=3.0), VERO)
    assert model.energy(model.start(straight(4))) == pytest.approx(0.0, abs=1e-25)
    bent = shaken(straight(4), 0.002, 0.3)
    turned = bent.transform(Rotation.from_rotvec([2.0, -1.0, 0.4]).as_matrix(), np.array([3.0, -1.0, 2.0]))
    assert model.energy(model.start(turned)) == pytest.approx(model.energy(model.start(bent)), rel=1e-10)


def test_clockwise_arms_are_the_mirror_image() -> None:
    mirror = np.diag([1.0, -1.0, 1.0])
    pose = shaken(straight(3), 0.001, 0.2)
    mirrored = Pose(pose.centres @ mirror, mirror @ pose.rotations @ mirror)
    one, other = (ArmModel.from_assembly(row(3, twist=3.0, clockwise=c), VERO) for c in (False, True))
    assert one.energy(one.start(pose)) == pytest.approx(other.energy(other.start(mirrored)), rel=1e-12)
    assert one.energy(one.start(mirrored)) != pytest.approx(other.energy(other.start(mirrored)), rel=1e-3)


def test_a_spiral_outside_the_table_is_named() -> None:
    assembly = row(4)
    width = assembly.width.copy()
    width[2] = 0.0003
    (found,) = ArmModel.from_assembly(assembly.with_spirals(width, assembly.twist), VERO).beyond()
    assert found.quantity == "width / thickness" and found.spirals.tolist() == [2]
    width[1] = np.nan
    with pytest.raises(FlexMapsError, match="not a number") as caught:
        ArmModel.from_assembly(assembly.with_spirals(width, assembly.twist), VERO)
    assert caught.value.faces == [1]


def test_motions_in_the_plane_and_out_of_it_share_the_energy() -> None:
    """Stiffness against bending out of the sheet bears nothing of a motion in its plane, and all of one out of it."""
    model, pose = ArmModel.from_assembly(row(3), VERO, curving=False), straight(3)
    for axis, share in ((0, 1.0), (2, 0.0)):
        centres = pose.centres.copy()
        centres[1, axis] += 1e-6
        state = model.start(dataclasses.replace(pose, centres=centres))
        energy = model.energy(state)
        assert model.in_plane_energy(state).sum() == pytest.approx(share * energy, abs=1e-6 * energy)
        assert model.with_bending(2.0).energy(state) == pytest.approx((2.0 - share) * energy, rel=1e-6)

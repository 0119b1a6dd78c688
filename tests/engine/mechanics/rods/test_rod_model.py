"""The rod model: derivatives by finite differences, the paper's formulas written out plainly, beams in closed form."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from flexmaps.database import rods
from flexmaps.engine.materials import find_material
from flexmaps.engine.mechanics import assembly
from flexmaps.engine.mechanics.assembly import Assembly, Pose
from flexmaps.engine.mechanics.elastic import sum_joint_vectors
from flexmaps.engine.mechanics.rods.rod_model import RodModel
from flexmaps.engine.params import SpiralParams
from flexmaps.engine.spirals import fabricable
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

SIZES = np.array([1.0, 1e-4, 3e-4, 2e-4])


def _chain(spirals: int, rng: np.random.Generator) -> Assembly:
    """Spirals one after the other, each in a plane of its own, with arms of unequal length that meet at an angle."""
    pairs = np.stack([np.arange(spirals - 1), np.arange(1, spirals)], axis=1)
    axes = Rotation.from_rotvec(np.outer(rng.uniform(-3, 3, pairs.size), [0, 0, 1])).as_matrix()
    axes = axes.reshape(*pairs.shape, 3, 3)
    reach, angle = rng.uniform(0.006, 0.012, pairs.shape) * [1, -1], rng.uniform(-0.3, 0.3, pairs.shape)
    lever = np.stack([reach * np.cos(angle), reach * np.sin(angle), 0 * angle], axis=-1)
    lever = np.einsum("mkij,mkj->mki", axes, lever)
    return Assembly(
        pairs, np.tile([1, 3], (len(pairs), 1)), lever, axes, np.full((spirals, 4), 0.0015), np.ones(spirals), 0.002
    )


def _row(spirals: int, spacing: float) -> tuple[Assembly, Pose]:
    """Equal spirals along x."""
    pairs = np.stack([np.arange(spirals - 1), np.arange(1, spirals)], axis=1)
    lever = np.zeros((spirals - 1, 2, 3))
    lever[:, 0, 0], lever[:, 1, 0] = 0.5 * spacing, -0.5 * spacing
    axes = np.broadcast_to(np.eye(3), (spirals - 1, 2, 3, 3))
    row = Assembly(
        pairs, np.tile([1, 3], (len(pairs), 1)), lever, axes, np.full((spirals, 4), 0.0015), np.ones(spirals), 0.002
    )
    return row, Pose(np.outer(np.arange(spirals), [spacing, 0, 0]), np.tile(np.eye(3), (spirals, 1, 1)))


def _unrolled(chain: Assembly) -> Pose:
    """The chain with all its joints closed and not strained."""
    pose = Pose(np.zeros((chain.size, 3)), np.tile(np.eye(3), (chain.size, 1, 1)))
    for (i, j), lever, axes in zip(chain.pairs, chain.lever, chain.axes, strict=True):
        pose.rotations[j] = pose.rotations[i] @ axes[0] @ axes[1].T
        pose.centres[j] = pose.centres[i] + pose.rotations[i] @ lever[0] - pose.rotations[j] @ lever[1]
    return pose


def _respun(net: Assembly, pose: Pose, angles: np.ndarray) -> tuple[Assembly, Pose]:
    """The same spirals in flat frames turned by angles (n,) rad, as if every one lay in a patch of its own."""
    spin = Rotation.from_rotvec(np.outer(angles, [0, 0, 1])).as_matrix()
    lever = np.einsum("mkij,mkj->mki", spin[net.pairs], net.lever)
    turned = replace(net, lever=lever, axes=spin[net.pairs] @ net.axes)
    return turned, Pose(pose.centres, pose.rotations @ np.swapaxes(spin, 1, 2))


@pytest.fixture
def net(flat_grid) -> tuple[Assembly, Pose]:
    """A distorted grid of 20 spirals in two patches, flat."""
    rng = np.random.default_rng(3)
    flat = flat_grid(5, 4, move=lambda p: p + rng.uniform(-0.002, 0.002, p.shape), cut=lambda x, y: x == 2)
    corners = flat.corners
    found = assembly.assembly_from_design(
        fabricable.uniform_design(flat, SpiralParams(thickness=0.002), width=0.0015, twist=1.0)
    )
    centres = np.zeros((len(corners), 3))
    centres[:, :2] = corners.mean(axis=1)
    return found, Pose(centres, np.tile(np.eye(3), (len(corners), 1, 1)))


def _random_parameters(size: int, rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(0.5, 2, (size, 4)) * SIZES


def _shaken(pose: Pose, amount: float, rng: np.random.Generator) -> Pose:
    return pose.moved(rng.normal(size=(len(pose.centres), 6)) * np.repeat([0.004 * amount, amount], 3))


@pytest.mark.parametrize("amount", [0.01, 0.3, 1.0])
@pytest.mark.parametrize("shape", ["chain", "net"])
def test_derivatives_agree_with_finite_differences(net, shape, amount):
    rng = np.random.default_rng(round(100 * amount))
    chain = _chain(21, rng)
    one, pose = (chain, _unrolled(chain)) if shape == "chain" else _respun(*net, rng.uniform(-3, 3, 20))
    model = RodModel.with_parameters(one, _random_parameters(one.size, rng))
    state = model.start(_shaken(pose, amount, rng))
    here = model.expand(state)
    assert here.energy == pytest.approx(model.energy(state), rel=1e-13)
    assert here.per_joint.sum() == pytest.approx(here.energy, rel=1e-13)
    # central differences of sixth order
    slopes, bulges, step = (
        np.array([-1, 9, -45, 0, 45, -9, 1]) / 60,
        np.array([2, -27, 270, -490, 270, -27, 2]) / 180,
        1e-3,
    )
    for _ in range(6):
        way = rng.normal(size=(one.size, 6)) * np.repeat([0.01, 1.0], 3)
        line = [model.energy(model.moved(state, k * step * way)) for k in range(-3, 4)]
        ends = way[one.pairs].reshape(-1, 12)
        force = sum_joint_vectors(np.einsum("mij,mj->mi", here.hessian, ends), one.pairs, one.size)
        assert (here.gradient * way).sum() == pytest.approx(slopes @ line / step, rel=1e-7)
        assert (force * way).sum() == pytest.approx(bulges @ line / step**2, rel=1e-6)
    largest = np.abs(here.hessian).max()
    assert np.abs(here.hessian - np.swapaxes(here.hessian, 1, 2)).max() < 1e-12 * largest
    values = np.linalg.eigvalsh(here.convex)
    assert (values[:, 0] > -1e-12 * values[:, -1]).all()


@pytest.mark.parametrize("clockwise", [False, True])
@pytest.mark.parametrize("amount", [1e-4, 0.3, 1.0])
def test_forces_by_the_design_agree_with_finite_differences(net, amount, clockwise):
    """Everything the forces depend on but the pose: parameters of both spirals, and the roll that follows them."""
    rng = np.random.default_rng(4)
    one, pose = net
    one, pose = replace(one, clockwise=clockwise), _shaken(pose, amount, rng)
    design = np.column_stack([rng.uniform(0.0012, 0.0018, (one.size, 4)), rng.uniform(0.5, 1.5, one.size)])

    def model(design: np.ndarray) -> RodModel:
        return RodModel.from_assembly(one.with_spirals(design[:, :4], design[:, 4]), find_material("vero"))

    def forces(design: np.ndarray) -> np.ndarray:
        varied = model(design)
        return varied.expand(varied.start(pose)).gradient

    here = model(design)
    blocks = here.gradient_by_design(here.start(pose))
    for scale in ([1e-3] * 4 + [0.0], [0.0] * 4 + [1.0]):
        way, step = rng.normal(size=(one.size, 5)) * scale, 1e-3
        line = [forces(design + k * step * way) for k in (-2, -1, 1, 2)]
        expected = (line[0] - 8 * line[1] + 8 * line[2] - line[3]) / (12 * step)
        found = sum_joint_vectors(np.einsum("miks,mks->mi", blocks, way[one.pairs]), one.pairs, one.size)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7 * np.abs(expected).max())


def test_energy_and_state_go_along_with_rigid_motion(net):
    rng = np.random.default_rng(8)
    one, pose = net
    model = RodModel.with_parameters(one, _random_parameters(one.size, rng))
    pose = _shaken(pose, 0.5, rng)
    turn = Rotation.from_rotvec([2.0, -1.0, 0.7]).as_matrix()
    before, after = model.start(pose), model.start(pose.transform(turn, np.array([0.3, -0.2, 1.0])))
    assert model.energy(after) == pytest.approx(model.energy(before), rel=1e-10)
    found, turned = model.expand(before).gradient, model.expand(after).gradient
    np.testing.assert_allclose(turned[:, :3], found[:, :3] @ turn.T, atol=1e-10 * np.abs(found).max())
    # forces and moments about the origin cancel
    moments = found[:, 3:] + np.cross(pose.centres, found[:, :3])
    assert np.abs(found[:, :3].sum(axis=0)).max() < 1e-12 * np.abs(found[:, :3]).sum()
    assert np.abs(moments.sum(axis=0)).max() < 1e-12 * np.abs(moments).sum()


def test_rest_has_no_energy_whatever_the_planes_of_the_patches(net):
    rng = np.random.default_rng(4)
    chain = _chain(15, rng)
    for one, pose in ((chain, _unrolled(chain)), net, _respun(*net, rng.uniform(-3, 3, 20))):
        model = RodModel.with_parameters(one, _random_parameters(one.size, rng))
        here = model.expand(model.start(pose.transform(Rotation.from_rotvec([1.0, 2.0, 0.3]).as_matrix(), np.zeros(3))))
        assert here.energy < 1e-25
        assert np.abs(here.gradient).max() < 1e-12
        np.testing.assert_allclose(here.hessian, here.convex, atol=1e-10 * np.abs(here.convex).max())


def test_flat_frames_do_not_matter(net):
    rng = np.random.default_rng(5)
    one, pose = net
    parameters, pose = _random_parameters(one.size, rng), _shaken(pose, 0.4, rng)
    other, turned = _respun(one, pose, rng.uniform(-3, 3, one.size))
    first, second = RodModel.with_parameters(one, parameters), RodModel.with_parameters(other, parameters)
    assert second.energy(second.start(turned)) == pytest.approx(first.energy(first.start(pose)), rel=1e-12)


def test_mirrored_spirals_have_mirrored_energies(net):
    one, pose = net
    flip = np.diag([1.0, -1.0, 1.0])
    mirrored = replace(one, lever=one.lever @ flip, axes=flip @ one.axes @ flip, clockwise=True)
    pose = _shaken(pose, 0.4, np.random.default_rng(6))
    there = Pose(pose.centres @ flip, flip @ pose.rotations @ flip)
    first, second = (
        RodModel.from_assembly(one, find_material("vero")),
        RodModel.from_assembly(mirrored, find_material("vero")),
    )
    assert second.energy(second.start(there)) == pytest.approx(first.energy(first.start(pose)), rel=1e-12)
    np.testing.assert_allclose(second.torsion(second.start(there)), -first.torsion(first.start(pose)), atol=1e-12)


def _carried(v: np.ndarray, old: np.ndarray, new: np.ndarray) -> np.ndarray:
    """v turned as the shortest turn from unit vector old to new does."""
    axis = np.cross(old, new)
    return v * (old @ new) + np.cross(axis, v) + axis * (axis @ v) / (1 + old @ new)


class _Plain:
    """One joint of the paper, written out: a frame carried along in time, a roll, a reference twist at either end."""

    def __init__(self, one: Assembly, parameters: np.ndarray, pose: Pose):
        self.half, self.parameters = one.radius[0], parameters[one.pairs[0]]
        tangent = (pose.centres[1] - pose.centres[0]) / self.half.sum()
        self.rest = [pose.rotations[k].T @ np.stack([tangent, [0, 0, 1.0]], axis=1) for k in (0, 1)]
        self.tangent, self.normal = tangent, np.array([0, 0, 1.0])
        self.reference, self.roll = np.zeros(2), 0.0

    def go(self, pose: Pose) -> float:
        """Joules at the next pose, with the roll that is best near the last one."""
        edge = pose.centres[1] - pose.centres[0]
        length = np.linalg.norm(edge)
        self.normal = _carried(self.normal, self.tangent, edge / length)
        self.tangent = edge / length
        aside = np.cross(self.normal, self.tangent)
        rigid = [pose.rotations[k] @ self.rest[k] for k in (0, 1)]
        for k in (0, 1):
            own = _carried(rigid[k][:, 1], rigid[k][:, 0], self.tangent)
            psi = np.arctan2(np.cross(own, self.normal) @ self.tangent, own @ self.normal)
            self.reference[k] = psi + 2 * np.pi * np.round((self.reference[k] - psi) / (2 * np.pi))

        def energy(theta: float) -> float:
            n2 = np.cos(theta) * self.normal - np.sin(theta) * aside
            total = 0.0
            for k, (ks, kb0, kb1, kt) in enumerate(self.parameters):
                t1, n1 = rigid[k].T
                binormal = 2 * np.cross(t1, self.tangent) / (1 + t1 @ self.tangent)
                kappa_n = 0.5 * binormal @ (n1 + n2)
                kappa_b = -0.5 * binormal @ (np.cross(n1, t1) + np.cross(n2, self.tangent))
                total += 0.5 * ks * self.half[k] * (length / self.half.sum() - 1) ** 2
                twist = theta + self.reference[k]
                total += 0.5 / self.half[k] * (kb0 * kappa_n**2 + kb1 * kappa_b**2 + kt * twist**2)
            return total

        best = minimize_scalar(energy, bracket=(self.roll - 0.05, self.roll + 0.05), method="brent", tol=1e-12)
        self.roll = best.x
        return best.fun


def test_energy_is_the_papers_along_a_path_with_whole_turns():
    """Time-parallel frames, rolls and reference twists as printed, against the state that only knows both hubs."""
    rng = np.random.default_rng(9)
    one, pose = _row(2, 0.02)
    one = replace(one, lever=one.lever * np.array([1.0, 1.2])[None, :, None])
    pose = Pose(pose.centres * 1.1, pose.rotations)
    parameters = _random_parameters(2, rng)
    model, plain = RodModel.with_parameters(one, parameters), _Plain(one, parameters, pose)
    state = model.start(pose)
    drift = rng.normal(size=(2, 6)) * np.repeat([0.0004, 0.06], 3)
    drift[1, 3] = 0.35
    for _ in range(17):
        state = model.moved(state, drift)
        assert model.energy(state) == pytest.approx(plain.go(state.pose), rel=1e-9)
    assert model.torsion(state)[0] > 1.1 * np.pi


def test_twist_goes_on_beyond_half_a_turn():
    one, pose = _row(2, 0.02)
    parameters = np.array([SIZES, 3 * SIZES])
    model = RodModel.with_parameters(one, parameters)
    state = model.start(pose)
    step = np.zeros((2, 6))
    step[1, 3] = 0.5
    for _ in range(10):
        state = model.moved(state, step)
    assert model.torsion(state)[0] == pytest.approx(5.0, abs=1e-12)
    compliance = (0.01 / parameters[:, 3]).sum()
    assert model.energy(state) == pytest.approx(0.5 * 25.0 / compliance, rel=1e-12)
    assert model.expand(state).gradient[1, 3] == pytest.approx(5.0 / compliance, rel=1e-9)
    # started afresh there, it is taken to have come the short way
    assert model.torsion(model.start(state.pose))[0] == pytest.approx(5.0 - 2 * np.pi, abs=1e-12)


def test_one_end_agrees_with_the_fit_to_single_spirals():
    """With its second end's hub along the edge, free to bend and held in roll, only the first end has energy."""
    rng = np.random.default_rng(11)
    one, _ = _row(2, 0.02)
    one = replace(one, lever=one.lever * np.array([1.0, 1e-6])[None, :, None])
    parameters = np.array([[3.0, 1e-4, 3e-4, 2e-4], [0.0, 0.0, 0.0, 1.0]])
    model = RodModel.with_parameters(one, parameters)
    rest = 0.01 * np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0.0]])
    for _ in range(5):
        hub = Rotation.random(random_state=rng).as_matrix()
        tip = hub @ Rotation.from_rotvec(rng.normal(size=3) * 0.5).as_matrix()
        centres = np.concatenate([rest @ hub.T, np.zeros((1, 3))])[None]
        centres[0, 0] = 0.011 * tip[:, 0]
        rotations = np.array([tip, hub, hub, hub, hub])[None]
        expected = rods.chord_features(centres, rotations, rest) @ parameters[0]
        found = model.energy(model.start(Pose(centres[0, [4, 0]], rotations[0, [4, 0]])))
        assert found == pytest.approx(expected[0], rel=1e-5)


def test_small_motions_of_a_pair_agree_with_the_fit_to_pairs():
    rng = np.random.default_rng(12)
    scale, parameters = 0.02, SIZES * [0.7, 1.3, 0.8, 1.9]
    root = np.zeros((6, 6))
    for rows in ((0, 1, 5), (2, 3, 4)):  # in the plane and out of it are apart in any spiral
        root[np.ix_(rows, rows)] = rng.normal(size=(3, 3))
    compliance = root @ root.T * np.outer(*2 * [np.repeat([1.0, 100.0], 3)]) * 1e-3
    wrenches = rng.normal(size=(50, 6)) * np.repeat([1e-4, 1e-6], 3)
    features, _ = rods.pair_features(wrenches, compliance, scale)
    one, pose = _row(2, scale)
    model = RodModel.with_parameters(one, np.array([parameters, parameters]))
    half_turn = np.diag([-1.0, -1.0, 1.0] * 2)
    for wrench, feature in zip(wrenches, features, strict=True):
        # the joint against the first hub, and against the second one, both in the first one's axes
        moves = np.array([compliance @ wrench, half_turn @ compliance @ half_turn @ -wrench])
        turn = moves[0, 3:] - moves[1, 3:]
        shift = moves[0, :3] - moves[1, :3] + np.cross(turn, [0.5 * scale, 0, 0])
        energy = model.energy(model.start(pose.moved(np.array([np.zeros(6), np.concatenate([shift, turn])]))))
        assert energy == pytest.approx(feature @ parameters, rel=2e-3)


def test_cantilever_row_is_a_beam():
    """Hubs between springs 2 k / L: a load bends the row by F (N L)^3 / (3 k) (1 + 1 / (2 N^2)), a beam for many hubs."""
    count, spacing = 8, 0.02
    one, pose = _row(count + 1, spacing)
    ks, kb0, kb1, kt = parameters = SIZES * [0.7, 1.3, 0.8, 1.9]
    model = RodModel.with_parameters(one, np.tile(parameters, (count + 1, 1)))
    stiffness = _dense(model.expand(model.start(pose)).hessian, one)
    answer = np.linalg.inv(stiffness[6:, 6:])[-6:, -6:]
    reach = count * spacing
    bending = reach**3 / 3 * (1 + 1 / (2 * count**2))
    assert answer[0, 0] == pytest.approx(reach / ks, rel=1e-9)
    assert answer[1, 1] == pytest.approx(bending / kb0, rel=1e-9)  # in the plane
    assert answer[2, 2] == pytest.approx(bending / kb1, rel=1e-9)  # out of it
    assert answer[3, 3] == pytest.approx(reach / kt, rel=1e-9)
    assert answer[5, 5] == pytest.approx(reach / kb0, rel=1e-9)


def _dense(blocks: np.ndarray, one: Assembly) -> np.ndarray:
    out = np.zeros((6 * one.size, 6 * one.size))
    for block, pair in zip(blocks, one.pairs, strict=True):
        index = (6 * pair[:, None] + np.arange(6)).ravel()
        out[np.ix_(index, index)] += block
    return out


@pytest.mark.parametrize(("axis", "k"), [([0, 0, 1.0], 1), ([0, 1.0, 0], 2)], ids=["in-plane", "out-of-plane"])
def test_end_moment_bends_a_row_into_an_arc(axis, k):
    """Each end turns by p: energy (2 tan(p/2))^2 k / (2 D), so the moment is 2 tan(p/2) / cos^2(p/2) k / D."""
    count, spacing, angle = 9, 0.02, 0.35
    one, _ = _row(count, spacing)
    turns = Rotation.from_rotvec(np.outer(2 * angle * np.arange(count), axis))
    edges = Rotation.from_rotvec(np.outer(angle * (2 * np.arange(count - 1) + 1), axis)).apply([spacing, 0, 0])
    arc = Pose(np.concatenate([np.zeros((1, 3)), np.cumsum(edges, axis=0)]), turns.as_matrix())
    model = RodModel.with_parameters(one, np.tile(SIZES, (count, 1)))
    here = model.expand(model.start(arc))
    moment = 2 * np.tan(angle / 2) / np.cos(angle / 2) ** 2 * SIZES[k] / (0.5 * spacing)
    expected = np.zeros((count, 6))
    expected[0, 3:], expected[-1, 3:] = -moment * np.array(axis), moment * np.array(axis)
    np.testing.assert_allclose(here.gradient, expected, atol=1e-12)
    assert here.energy == pytest.approx(
        (count - 1) * (2 * np.tan(angle / 2)) ** 2 * SIZES[k] / (0.5 * spacing), rel=1e-12
    )


def test_states_beyond_the_model_have_no_energy_and_raise_nothing():
    one, pose = _row(3, 0.02)
    model = RodModel.with_parameters(one, np.tile(SIZES, (3, 1)))
    back, met = pose.centres.copy(), pose.centres.copy()
    back[2], met[1] = [-0.02, 0, 0], met[0]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for centres in (back, met, np.full((3, 3), np.nan)):
            assert not np.isfinite(model.energy(model.start(Pose(centres, pose.rotations))))


def test_spirals_outside_the_parameters_are_named(net):
    one, _ = net
    width = one.width.copy()
    width[[3, 7]] = 0.004
    (found,) = RodModel.from_assembly(replace(one, width=width), find_material("vero")).beyond()
    assert found.quantity == "width / thickness" and found.spirals.tolist() == [3, 7]

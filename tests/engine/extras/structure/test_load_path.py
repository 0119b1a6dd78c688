"""Load paths against a closed form of a column, displacement control of a shallow arch, and work."""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest
from flexmaps.engine.extras.structure import load_path
from flexmaps.engine.extras.structure.actions import Action
from flexmaps.engine.extras.structure.buckling import linear_buckling
from flexmaps.engine.extras.structure.load_path import BRANCH, LIMIT, LoadPath, PathFollower, follow_path
from flexmaps.engine.mechanics.arms.model import ArmModel
from flexmaps.engine.mechanics.assembly import Assembly, Pose, assembly_from_design, target_pose
from flexmaps.engine.mechanics.elastic import sum_joint_vectors
from flexmaps.engine.mechanics.equilibrium import solve
from flexmaps.engine.mechanics.loads import Loads
from flexmaps.engine.mechanics.newton_system import NewtonSystem
from flexmaps.engine.params import LayoutParams, SimulateParams, SpiralParams
from flexmaps.engine.patches.flattening.flatten import flatten
from flexmaps.engine.patches.layout import PatchLayout
from flexmaps.engine.spirals.fabricable import uniform_design
from flexmaps.engine.surface.mesh import QuadMesh
from scipy.integrate import trapezoid

chains = sys.modules["flexmaps_chains"]
SPACING, VERO, row, at_joints, straight, shaken = (
    getattr(chains, name) for name in ("SPACING", "VERO", "row", "at_joints", "straight", "shaken")
)
PARAMS = SimulateParams(tolerance=1e-10)


def follower(model: ArmModel, loads: Loads, action: Action, rest: Pose) -> PathFollower:
    return PathFollower(
        model, NewtonSystem(model.pairs, loads.held_increments(model.pairs, rest.centres)), action, 1e-10
    )


# -- a column ----------------------------------------------------------------------------------------------------------


def column(count: int, twist: float) -> tuple[Assembly, PathFollower]:
    """A straight strip, clamped at one end and pushed at the other by one newton."""
    assembly = row(count, twist=twist)
    action = Action.none(count)
    action.force[-1, 0] = -1.0
    return assembly, follower(
        ArmModel.from_assembly(assembly, VERO),
        Loads.for_spirals(count, supports=np.array([0])),
        action,
        straight(count),
    )


def test_a_column_buckles_where_euler_and_engesser_say() -> None:
    """pi^2 EI / 4 L^2 of the strip's own compliance, less what its shear takes (Engesser 1889)."""
    count = 30
    assembly, pushed = column(count, 0.0)
    compliance, length = at_joints(assembly)[0], SPACING * (count - 1)
    # about the axis in the sheet, as the strip is thinner than its arms are wide
    euler = np.pi**2 * SPACING / compliance[4, 4] / (4.0 * length**2)
    wanted = euler / (1.0 + euler * compliance[2, 2] / SPACING)
    path = follow_path(pushed, straight(count), marks=(0.5 * wanted,), most=3.0 * wanted)
    assert path.kind == BRANCH
    assert path.critical == pytest.approx(wanted, rel=3e-3)
    assert 0.5 * wanted in path.marks
    assert linear_buckling(pushed, path.points[0]) == pytest.approx(wanted, rel=3e-3)


def test_a_pulled_column_does_not_buckle() -> None:
    _, pushed = column(8, 0.0)
    pulled = PathFollower(pushed.model, pushed.system, pushed.action.times(-1.0), 1e-10)
    path = follow_path(pulled, straight(8), most=10.0)
    assert path.critical is None and path.points[-1].factor == pytest.approx(10.0) and not path.ended
    quick, start = linear_buckling(pulled, path.points[0]), pushed.model.start(straight(8))
    pushing = linear_buckling(pushed, pushed.point(start, 0.0, None))
    assert pushing is not None and (quick is None or quick > 1e4 * pushing)


def test_a_cantilever_bends_in_proportion_to_small_loads() -> None:
    count = 6
    action = Action.none(count)
    action.force[-1, 2] = 1e-4
    model = ArmModel.from_assembly(row(count, twist=2.0), VERO)
    path = follow_path(
        follower(model, Loads.for_spirals(count, supports=np.array([0])), action, straight(count)),
        straight(count),
        marks=(1.0, 2.0, 4.0),
        most=4.0,
    )
    tips = [path.marks[factor].pose.centres[-1, 2] for factor in (1.0, 2.0, 4.0)]
    assert np.array(tips) / tips[0] == pytest.approx([1.0, 2.0, 4.0], rel=1e-4)
    compliance, moved = at_joints(row(count, twist=2.0)), 0.0
    for joint in range(count - 1):
        reach = np.array([SPACING * (count - 1 - joint - 0.5), 0.0, 0.0])
        motion = compliance[joint] @ np.concatenate([[0.0, 0.0, 1e-4], np.cross(reach, [0.0, 0.0, 1e-4])])
        moved += (motion[:3] + np.cross(motion[3:], reach))[2]
    assert tips[0] == pytest.approx(moved, rel=1e-4)


# -- a shallow arch ------------------------------------------------------------------------------------------------------


class Arch:
    """Two rows of nine spirals bent to an arc, clamped at both ends and pushed in the middle."""

    def __init__(self, half: float = 0.93):
        """half : radians, half of the arc's angle"""
        columns, rows = 9, 2
        x, y = np.meshgrid(np.arange(columns + 1.0), np.arange(rows + 1.0))
        corner = np.arange(x.size).reshape(x.shape)
        quads = np.stack([corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]], axis=-1).reshape(-1, 4)
        angle, radius = (x.ravel() / columns - 0.5) * 2.0 * half, columns / (2.0 * half)
        place = np.stack([radius * np.sin(angle), y.ravel(), radius * np.cos(angle)], axis=1)
        mesh = QuadMesh(SPACING * place, quads)
        flat = flatten(PatchLayout(mesh, np.zeros(len(mesh.edges), bool)), LayoutParams())
        self.design = uniform_design(flat, SpiralParams(), twist=2.6)
        self.model = ArmModel.from_assembly(assembly_from_design(self.design), VERO)
        self.loads = Loads.for_spirals(18, supports=np.array([0, 8, 9, 17]))
        self.middle = [4, 13]
        start = target_pose(mesh, flat.corners)
        self.rest = solve(self.model, start, self.loads, PARAMS)
        self.action = Action.none(18)
        self.action.force[self.middle, 2] = -0.5

    def follow(self, **options: object) -> LoadPath:
        path = follow_path(follower(self.model, self.loads, self.action, self.rest.pose), self.rest.pose, **options)  # type: ignore[arg-type]
        assert isinstance(path, LoadPath)
        return path

    def fall(self, pose: Pose) -> float:
        return float((self.rest.pose.centres - pose.centres)[self.middle, 2].mean())

    def pushed(self, falls: np.ndarray) -> np.ndarray:
        """Newtons that hold the middle at these falls (k,), metres: the middle's height is held, not its force."""
        fixed, pose, found = self.loads.fixed.copy(), self.rest.pose, []
        fixed[self.middle, 2] = True
        loads, before = Loads(fixed, np.zeros((18, 3))), 0.0
        for fall in falls:
            step = np.zeros((18, 6))
            step[self.middle, 2] = before - fall
            rest = solve(self.model, pose.moved(step), loads, PARAMS)
            assert rest.converged
            pose, before = rest.pose, fall
            found.append(-float(self.model.expand(self.model.start(pose)).gradient[self.middle, 2].sum()))
        return np.array(found)


@pytest.fixture(scope="module")
def arch() -> Arch:
    return Arch()


def test_an_arch_snaps_at_the_most_that_its_middle_bears(arch: Arch) -> None:
    path = arch.follow(most=50.0, beyond=8)
    assert path.kind == LIMIT and path.critical is not None
    falls = np.linspace(0.0, 1.3 * arch.fall(path.points[-1].pose), 120)[1:]
    forces = arch.pushed(falls)
    # beyond the snap the arch hangs and is pulled straight
    assert path.critical == pytest.approx(forces[: 1 + np.flatnonzero(np.diff(forces) < 0.0)[0]].max(), rel=1e-3)
    # and the whole path, past the limit point too
    known = [(arch.fall(one.pose), one.factor) for one in path.points if one.factor]
    assert [f for _, f in known] == pytest.approx(np.interp([x for x, _ in known], falls, forces), rel=3e-3)
    turned = [one for one in path.points if one.unstable]
    assert turned and all(one.rises < 0.0 for one in turned[:2])


def test_the_quick_answer_is_of_the_size_of_the_path(arch: Arch) -> None:
    path = arch.follow(most=50.0)
    quick = linear_buckling(follower(arch.model, arch.loads, arch.action, arch.rest.pose), path.points[0])
    assert quick is not None and path.critical is not None and 0.5 < quick / path.critical < 2.0


def test_the_work_of_a_load_is_the_energy_it_leaves(arch: Arch) -> None:
    path = arch.follow(most=50.0, beyond=3, marks=tuple(np.linspace(0.05, 1.0, 20)))
    path_points = [one for one in path.points if one.factor <= 1.0]
    factors = np.array([one.factor for one in path_points])
    falls = np.array([arch.fall(one.pose) for one in path_points])
    energies = np.array([arch.model.energy(one.state) for one in path_points])
    assert trapezoid(factors, falls) == pytest.approx(energies[-1] - energies[0], rel=2e-3)


def test_marks_are_equilibria_at_their_factor(arch: Arch) -> None:
    path = arch.follow(marks=(0.37, 1.0), most=1.0)
    assert list(path.marks) == [0.37, 1.0] and path.points[-1].factor == 1.0
    for factor, point in path.marks.items():
        loads = Loads(arch.loads.fixed, factor * arch.action.force)
        found = solve(arch.model, point.pose, loads, PARAMS)
        assert np.abs(found.pose.centres - point.pose.centres).max() < 1e-8


# -- derivatives ---------------------------------------------------------------------------------------------------------


def product(blocks: np.ndarray, way: np.ndarray, model: ArmModel) -> np.ndarray:
    ends = way[model.pairs].reshape(-1, 12)
    return sum_joint_vectors(np.einsum("mij,mj->mi", blocks, ends), model.pairs, len(way))


def slope(found: Callable[[float], np.ndarray], step: float = 1e-4) -> np.ndarray:
    """A central difference of the fourth order."""
    near, far = found(step) - found(-step), found(2.0 * step) - found(-2.0 * step)
    out: np.ndarray = (8.0 * near - far) / (12.0 * step)
    return out


def test_the_tangent_of_a_pressure_that_follows_is_exact() -> None:
    """What a small turn of the hubs does to the forces; the matrix is not symmetric."""
    count = 5
    model = ArmModel.from_assembly(row(count, twist=2.0), VERO)
    pose = shaken(straight(count), 0.002, 0.2)
    action = Action(np.zeros((count, 3)), np.linspace(1.0, 2.0, count), np.zeros((count, 3)))
    one = follower(model, Loads.for_spirals(count, supports=np.array([0])), action, pose)
    way = np.random.default_rng(1).normal(size=(count, 6)) * ~one.system.held

    def forces(share: float) -> np.ndarray:
        return -3.0 * action.at(pose.moved(share * way))

    told = one.system.expand(one.follows(pose, 3.0) @ one.system.free_entries(way))
    wanted = np.zeros((count, 6))
    wanted[:, :3] = slope(forces)
    assert told[1:] == pytest.approx(wanted[1:], abs=1e-9 * np.abs(wanted).max())
    matrix = one.follows(pose, 3.0)
    assert abs(matrix - matrix.T).max() > 0.5


def test_the_pull_of_supports_that_move_is_exact() -> None:
    count = 5
    model = ArmModel.from_assembly(row(count, twist=2.0), VERO)
    pose = shaken(straight(count), 0.002, 0.2)
    action = Action.none(count)
    action.shift[0] = [0.01, 0.02, -0.01]
    action.force[-1] = [1.0, 2.0, 3.0]
    one = follower(model, Loads.for_spirals(count, supports=np.array([0])), action, pose)

    def residual(share: float) -> np.ndarray:
        step = np.zeros((count, 6))
        step[:, :3] = share * action.shift
        moved = model.start(pose.moved(step))
        return one.residual(model.expand(moved), moved.pose, share)

    told = one.pull(model.expand(model.start(pose)), pose)
    assert told == pytest.approx(-slope(residual, 1e-3), abs=1e-7 * np.abs(told).max())


def test_a_pressure_stays_normal_and_a_moved_support_carries_the_row_along() -> None:
    count = 6
    model = ArmModel.from_assembly(row(count), VERO)
    loads = Loads.for_spirals(count, supports=np.array([0]))
    pressed = Action(np.zeros((count, 3)), np.full(count, 0.05), np.zeros((count, 3)))
    path = follow_path(follower(model, loads, pressed, straight(count)), straight(count), most=1.0)
    there = path.marks[1.0]
    left = follower(model, loads, pressed, straight(count)).residual(model.expand(there.state), there.pose, 1.0)
    assert np.abs(left[1:]).max() < 1e-8 and np.degrees(np.arccos(there.pose.rotations[-1, 2, 2])) > 10.0
    moved = Action.none(count)
    moved.shift[0] = [0.0, 0.0, 0.03]
    path = follow_path(follower(model, loads, moved, straight(count)), straight(count), most=1.0)
    shift = path.marks[1.0].pose.centres - straight(count).centres
    assert shift == pytest.approx(np.tile([0.0, 0.0, 0.03], (count, 1)), abs=1e-9)
    assert path.marks[1.0].state.pose.rotations == pytest.approx(np.tile(np.eye(3), (count, 1, 1)), abs=1e-9)


@pytest.mark.parametrize("top", [1.5, 2.0])
def test_the_most_that_is_borne_is_the_vertex_of_a_parabola(top: float) -> None:
    """Along a path whose load rises and falls as a parabola, from points on either side of its vertex."""
    path = SimpleNamespace(edge=0.5)

    def at(way: float) -> SimpleNamespace:
        """The load at a length of the path in edges, and its slope."""
        pose = SimpleNamespace(centres=np.array([[way * path.edge, 0.0, 0.0]]))
        return SimpleNamespace(factor=1.0 - (way - top) ** 2 / 4e4, rises=-(way - top) / 2e4, pose=pose)

    assert load_path._critical_factor(path, at(1.0), at(2.5)) == (pytest.approx(1.0, abs=1e-12), LIMIT)

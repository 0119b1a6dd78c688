"""Static equilibrium against closed forms: cantilevers, rings, columns; and how the search tells what it found."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from flexmaps.engine.errors import Cancelled
from flexmaps.engine.linalg import SparsityPattern, negative_eigenvalues
from flexmaps.engine.mechanics.arms.model import ArmModel
from flexmaps.engine.mechanics.equilibrium import _bend_along_modes, other_minima, solve
from flexmaps.engine.mechanics.loads import Loads, Springs
from flexmaps.engine.mechanics.newton_system import NewtonSystem
from flexmaps.engine.mechanics.vectors import nearest_rotation
from flexmaps.engine.params import SimulateParams
from flexmaps.engine.progress import Progress

chains = sys.modules["flexmaps_chains"]
SPACING, VERO, row, at_joints, straight, ring, shaken, free = (
    getattr(chains, name) for name in ("SPACING", "VERO", "row", "at_joints", "straight", "ring", "shaken", "free")
)


@pytest.mark.parametrize("twist", [0.0, 3.0])
def test_cantilever_bends_as_its_compliances_in_series(twist: float) -> None:
    count, pull = 8, np.array([0.4, 0.3, 1.0]) * 1e-4
    assembly = row(count, twist=twist)
    force = np.zeros((count, 3))
    force[-1] = pull
    found = solve(
        ArmModel.from_assembly(assembly, VERO),
        straight(count),
        Loads.for_spirals(count, supports=np.array([0]), force=force),
        SimulateParams(tolerance=1e-10),
    )
    # small loads: every joint turns and shifts the rest of the row by its own compliance under the force's wrench there
    compliance = at_joints(assembly)
    moved = np.zeros(3)
    for joint in range(count - 1):
        reach = np.array([SPACING * (count - 1 - joint - 0.5), 0.0, 0.0])
        motion = compliance[joint] @ np.concatenate([pull, np.cross(reach, pull)])
        moved += motion[:3] + np.cross(motion[3:], reach)
    assert found.converged
    assert found.pose.centres[-1] - straight(count).centres[-1] == pytest.approx(
        moved, rel=1e-3, abs=1e-3 * np.abs(moved).max()
    )


def test_springs_act_like_the_forces_that_they_exert_at_the_end() -> None:
    count = 8
    model, places = ArmModel.from_assembly(row(count), VERO), straight(count).centres.copy()
    places[:, 2] += 0.02 * np.linspace(0.0, 1.0, count) ** 2
    held = Loads.for_spirals(count, supports=np.array([0]))
    springs = Springs(0.5, places)
    exact = SimulateParams(tolerance=1e-10)
    found = solve(model, straight(count), Loads(held.fixed, held.force, springs), exact)
    force = springs.force(found.pose.centres)
    again = solve(model, straight(count), Loads(held.fixed, force), exact)
    assert found.converged and again.converged and found.iterations <= again.iterations
    assert again.pose.centres == pytest.approx(found.pose.centres, abs=1e-8 * SPACING)
    left = np.linalg.norm(found.pose.centres - places, axis=1)
    assert 0.0 < left.max() < 0.9 * np.linalg.norm(straight(count).centres - places, axis=1).max()
    assert found.energy == pytest.approx(found.per_joint.sum() + 0.25 * (left**2).sum(), rel=1e-9)


def test_springs_add_their_stiffness_to_every_free_shift_of_a_hub() -> None:
    count = 4
    pairs, held = np.array([[0, 1], [1, 2], [2, 3]]), np.zeros((count, 6), dtype=bool)
    held[1] = True
    blocks = np.tile(np.eye(12), (3, 1, 1))
    system = NewtonSystem(pairs, held, springs=Springs(7.0, np.zeros((count, 3))))
    other = system.without_springs
    stiffness = (system.pattern.matrix(system.values(blocks)) - other.pattern.matrix(other.values(blocks))).toarray()
    assert stiffness == pytest.approx(np.diag(np.tile([7.0, 7.0, 7.0, 0.0, 0.0, 0.0], count - 1)))
    assert other.without_springs is other


def test_a_row_closed_to_a_ring_is_a_circle_of_constant_moment() -> None:
    count = 24
    assembly = row(count, closed=True)
    found = solve(
        ArmModel.from_assembly(assembly, VERO), shaken(ring(count), 0.001, 0.05), free(count), SimulateParams()
    )
    turn = 2.0 * np.pi / count
    bending = at_joints(assembly)[0][4, 4]
    assert found.converged and found.negative_eigenvalues == 0
    assert found.energy == pytest.approx(count * turn**2 / (2.0 * bending), rel=1e-3)
    off = found.pose.centres - found.pose.centres.mean(axis=0)
    # the chord of an inextensible arc of the length of a spacing
    assert np.linalg.norm(off, axis=1) == pytest.approx(SPACING / turn, rel=2e-3)


def test_straight_rest_is_found_and_kept() -> None:
    model = ArmModel.from_assembly(row(6, twist=2.0), VERO)
    found = solve(model, shaken(straight(6), 0.002, 0.2), free(6), SimulateParams())
    assert found.converged and found.energy < 1e-12
    aligned = found.pose.aligned_to(straight(6).centres)
    assert aligned.centres == pytest.approx(straight(6).centres, abs=1e-8)
    again = solve(model, found.pose, free(6), SimulateParams())
    assert again.converged and again.iterations <= 1


def test_a_column_under_pressure_leaves_its_saddle() -> None:
    """Pressed beyond its buckling load, a straight row balances but does not rest: the search must bend it."""
    count = 10
    assembly = row(count)
    bending = at_joints(assembly)[0][4, 4]
    length = SPACING * (count - 1)
    euler = np.pi**2 * SPACING / bending / (4.0 * length**2)
    for load, buckles in ((0.8, False), (1.3, True)):
        force = np.zeros((count, 3))
        force[-1, 0] = -load * euler
        found = solve(
            ArmModel.from_assembly(assembly, VERO),
            straight(count),
            Loads.for_spirals(count, supports=np.array([0]), force=force),
            SimulateParams(),
        )
        assert found.converged and found.negative_eigenvalues == 0
        assert (np.abs(found.pose.centres[:, 2]).max() > 0.01 * length) == buckles


def test_both_backends_find_the_same_shape() -> None:
    model = ArmModel.from_assembly(row(12, twist=1.0, closed=True), VERO)
    start, loads = shaken(ring(12), 0.001, 0.1), free(12)
    held = loads.held_increments(model.pairs, start.centres)
    one, other = (
        solve(model, start, loads, SimulateParams(), system=NewtonSystem(model.pairs, held, backend))
        for backend in ("cvxopt", "superlu")
    )
    assert one.iterations == other.iterations
    assert one.pose.centres == pytest.approx(other.pose.centres, abs=1e-9)


def test_negative_eigenvalues_are_counted() -> None:
    rng = np.random.default_rng(2)
    dense = rng.normal(size=(12, 12))
    dense += dense.T
    rows, cols = np.tril_indices(12)
    pattern = SparsityPattern(rows, cols, 12)
    counted = negative_eigenvalues(pattern, pattern.sum(dense[rows, cols]))
    assert counted == (np.linalg.eigvalsh(dense) < 0).sum()


def test_a_pivot_of_zero_is_no_fault() -> None:
    """Hubs that nothing links leave rows of zeros: their eigenvalues are neither counted nor a reason to stop."""
    system = NewtonSystem(np.array([[0, 1]]), np.zeros((2, 6), dtype=bool))
    values = system.values(np.diag([-1.0, 2.0, *np.zeros(10)])[None])
    assert system.count_negative(values) == 1
    assert not system.factor(values) and system.factor(system.make_definite(np.abs(values)))


def test_softest_motions_are_found_where_lanczos_gives_up(monkeypatch: pytest.MonkeyPatch) -> None:
    from flexmaps.engine.mechanics import newton_system
    from scipy.sparse.linalg import ArpackNoConvergence

    model = ArmModel.from_assembly(row(30, twist=1.0, closed=True), VERO)
    found = solve(model, ring(30), free(30), SimulateParams())
    system = NewtonSystem(model.pairs, free(30).held_increments(model.pairs, found.pose.centres))
    here = model.expand(model.start(found.pose))
    known, lanczos = system.softest_modes(system.values(here.hessian), system.values(here.convex)), newton_system.eigsh

    def weary(*arguments: object, tol: float, **rest: object) -> object:
        if tol < 0.1:
            raise ArpackNoConvergence("no convergence", np.zeros(0), np.zeros((len(system.free), 0)))
        return lanczos(*arguments, tol=tol, **rest)

    monkeypatch.setattr(newton_system, "eigsh", weary)
    modes, rise = system.softest_modes(system.values(here.hessian), system.values(here.convex), 3)
    assert modes.shape == (1, 30, 6) and rise[0] < known[1][0] + 0.5


def test_a_dome_snaps_through_and_back() -> None:
    """A ring of larger circumference than its rim allows has two mirrored shapes; one is found from the other."""
    count = 12
    assembly = row(count)
    # both ends are held nearer to each other than the row is long: it arches up or down
    start = straight(count)
    start.centres[:, 0] *= 0.9
    start.centres[:, 2] = 0.02 * np.sin(np.pi * np.arange(count) / (count - 1))
    loads = Loads.for_spirals(count, supports=np.array([0, count - 1]))
    model = ArmModel.from_assembly(assembly, VERO)
    found = solve(model, start, loads, SimulateParams())
    assert found.converged and found.pose.centres[5, 2] > 0.02
    others = other_minima(model, found, loads, SimulateParams(restarts=6))
    down = [o for o in others if o.pose.centres[5, 2] < -0.02]
    assert down and down[0].energy == pytest.approx(found.energy, rel=1e-6)


def test_what_an_equilibrium_has_to_spare_is_its_softest_eigenvalue() -> None:
    count = 12
    start = straight(count)
    start.centres[:, 0] *= 0.9
    start.centres[:, 2] = 0.02 * np.sin(np.pi * np.arange(count) / (count - 1))
    loads = Loads.for_spirals(count, supports=np.array([0, count - 1]))
    model = ArmModel.from_assembly(row(count), VERO)
    found = solve(model, start, loads, SimulateParams())
    system = NewtonSystem(model.pairs, loads.held_increments(model.pairs, found.pose.centres))
    here = model.expand(model.start(found.pose))
    rise = system.softest_modes(system.values(here.hessian), system.values(here.convex))[1][0]
    assert 0.0 < rise < 1.0 and found.spare == 0.0
    for share in (0.9, 1.1):
        again = solve(model, start, loads, SimulateParams(), margins=(0.5 * rise, share * rise))
        assert again.spare == (share if share < 1.0 else 0.5) * rise
        np.testing.assert_array_equal(again.pose.centres, found.pose.centres)


def test_few_free_increments_have_the_eigenvectors_of_the_dense_matrix() -> None:
    model, start = ArmModel.from_assembly(row(30, twist=1.0), VERO), straight(30)
    found = {}
    for held in (22, 12):  # below and above where Lanczos takes over
        loads = Loads.for_spirals(30, supports=np.arange(held))
        system = NewtonSystem(model.pairs, loads.held_increments(model.pairs, start.centres))
        here = model.expand(model.start(start))
        h, b = (system.values(v) for v in (here.hessian, here.convex + np.eye(12) * 1e-3))
        modes, rise = system.softest_modes(h, b, 2)
        found[held] = [
            float(system.free_entries(m) @ system.pattern.matrix(h) @ system.free_entries(m))
            / float(system.free_entries(m) @ system.pattern.matrix(b) @ system.free_entries(m))
            for m in modes
        ]
        assert found[held] == pytest.approx(rise, rel=1e-2)


def test_giving_up_is_told_and_cancelling_works() -> None:
    model = ArmModel.from_assembly(row(12, closed=True), VERO)
    start = shaken(ring(12), 0.004, 0.5)
    found = solve(model, start, free(12), SimulateParams(iterations=2))
    assert not found.converged and found.iterations == 2 and "2 iterations" in found.status
    calls = []

    def stopped() -> bool:
        calls.append(1)
        return len(calls) > 2

    with pytest.raises(Cancelled):
        solve(model, start, free(12), SimulateParams(), Progress(stopped=stopped))


def test_nearest_rotation_is_proper() -> None:
    rng = np.random.default_rng(5)
    for _ in range(20):
        found = nearest_rotation(rng.normal(size=(3, 3)))
        assert found @ found.T == pytest.approx(np.eye(3))
        assert np.linalg.det(found) == pytest.approx(1.0)


def test_a_pose_is_bent_along_every_mode_to_both_sides() -> None:
    modes = np.zeros((3, 6, 6))
    modes[0, 1, 2] = modes[1, 3, 2] = modes[2, 5, 2] = 1.0  # each shifts another hub
    for k in range(6):
        shifts = _bend_along_modes(straight(6), modes, k).centres - straight(6).centres
        moved = np.flatnonzero(np.abs(shifts).max(axis=1) > 0.0)
        assert moved.tolist() == [2 * (k // 2) + 1] and np.sign(shifts[moved[0], 2]) == (-1.0) ** k

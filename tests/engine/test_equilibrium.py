"""Elastic model of the arms and static equilibrium: finite differences, closed forms, bad input."""

import dataclasses

import numpy as np
import pytest
from flexmaps.engine.errors import Cancelled, FlexMapsError
from flexmaps.engine.linalg import Pattern, negative_eigenvalues
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.mechanics.arms.model import ArmModel, arm_compliances
from flexmaps.engine.mechanics.assembly import Assembly, Pose, nearest_rotation
from flexmaps.engine.mechanics.elastic import summed
from flexmaps.engine.mechanics.equilibrium import other_minima, solve
from flexmaps.engine.mechanics.loads import Loads, standing
from flexmaps.engine.mechanics.newton_system import NewtonSystem
from flexmaps.engine.mechanics.rigid import freedoms
from flexmaps.engine.mechanics.rods.model import RodModel
from flexmaps.engine.params import SimulateParams
from flexmaps.engine.progress import Progress
from flexmaps.engine.surface import shapes
from scipy.spatial.transform import Rotation

SPACING, WIDTH, THICKNESS = 0.02, 0.0025, 0.0015
VERO = MATERIALS["vero"]


def row(count: int, *, twist: float = 0.0, closed: bool = False, clockwise: bool = False) -> Assembly:
    """Spirals in squares side by side along x; ``closed`` joins the last to the first."""
    first = np.arange(count if closed else count - 1)
    pairs = np.stack([first, (first + 1) % count], axis=1)
    lever = np.zeros((len(pairs), 2, 3))
    lever[:, 0, 0], lever[:, 1, 0] = 0.5 * SPACING, -0.5 * SPACING
    axes = np.broadcast_to(np.eye(3), (len(pairs), 2, 3, 3))
    full = np.full(count, 1.0)
    return Assembly(pairs, lever, axes, WIDTH * full, twist * full, THICKNESS, clockwise)


def at_joints(assembly: Assembly) -> np.ndarray:
    """(m, 6, 6) compliance of both arms of every joint in series, in the joint's axes."""
    axes = assembly.arm_axes
    return (axes @ arm_compliances(assembly, VERO).values @ np.swapaxes(axes, 2, 3)).sum(axis=1)


def straight(count: int) -> Pose:
    centres = np.zeros((count, 3))
    centres[:, 0] = SPACING * np.arange(count)
    return Pose(centres, np.broadcast_to(np.eye(3), (count, 3, 3)).copy())


def ring(count: int) -> Pose:
    """Hubs on a circle, their normals outwards."""
    angle = 2.0 * np.pi * np.arange(count) / count
    radius = SPACING * count / (2.0 * np.pi)
    turns = Rotation.from_rotvec(np.outer(angle, [0.0, 1.0, 0.0])).as_matrix()
    return Pose(radius * np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=1), turns)


def shaken(pose: Pose, shift: float, turn: float, seed: int = 0) -> Pose:
    noise = np.random.default_rng(seed).normal(size=(len(pose.centres), 6))
    return pose.moved(noise * np.repeat([shift, turn], 3))


def free(count: int) -> Loads:
    return Loads.of(count)


@pytest.mark.parametrize("twist", [0.0, 2.5])
@pytest.mark.parametrize("turn", [1e-7, 0.3, 1.0])
@pytest.mark.parametrize("curving", [False, True])
def test_derivatives_are_those_of_the_energy(twist: float, turn: float, curving: bool) -> None:
    model = ArmModel.of(row(5, twist=twist, closed=True), VERO, curving=curving)
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
    return bent.redesigned(WIDTH * rng.uniform(0.5, 1.0, count), rng.uniform(0.5, 2.5, count))


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
    design = np.stack([chain.width, chain.twist], axis=1)

    def forces(design: np.ndarray) -> np.ndarray:
        model = ArmModel.of(chain.redesigned(*design.T), VERO, curving=False)
        return model.expand(model.start(pose)).gradient

    here = ArmModel.of(chain, VERO, curving=False)
    blocks = here.gradient_by_design(here.start(pose))
    for scale in ([1e-3, 0.0], [0.0, 1.0]):
        way, step = rng.normal(size=design.shape) * scale, 2e-4
        line = [forces(design + k * step * way) for k in (-2, -1, 1, 2)]
        expected = (line[0] - 8 * line[1] + 8 * line[2] - line[3]) / (12 * step)
        found = summed(np.einsum("miks,mks->mi", blocks, way[chain.pairs]), chain.pairs, chain.size)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7 * np.abs(expected).max())


@pytest.mark.parametrize("kind", [ArmModel, RodModel])
def test_looking_ahead_changes_the_stresses_to_second_order_in_the_step(kind: type) -> None:
    chain = row(6, twist=1.5, closed=True)
    model = kind.of(dataclasses.replace(chain, thickness=0.003), VERO)
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
    model = ArmModel.of(row(4, twist=3.0), VERO)
    assert model.energy(model.start(straight(4))) == pytest.approx(0.0, abs=1e-25)
    bent = shaken(straight(4), 0.002, 0.3)
    turned = bent.placed(Rotation.from_rotvec([2.0, -1.0, 0.4]).as_matrix(), np.array([3.0, -1.0, 2.0]))
    assert model.energy(model.start(turned)) == pytest.approx(model.energy(model.start(bent)), rel=1e-10)


def test_clockwise_arms_are_the_mirror_image() -> None:
    mirror = np.diag([1.0, -1.0, 1.0])
    pose = shaken(straight(3), 0.001, 0.2)
    mirrored = Pose(pose.centres @ mirror, mirror @ pose.rotations @ mirror)
    one, other = (ArmModel.of(row(3, twist=3.0, clockwise=c), VERO) for c in (False, True))
    assert one.energy(one.start(pose)) == pytest.approx(other.energy(other.start(mirrored)), rel=1e-12)
    assert one.energy(one.start(mirrored)) != pytest.approx(other.energy(other.start(mirrored)), rel=1e-3)


@pytest.mark.parametrize("twist", [0.0, 3.0])
def test_cantilever_bends_as_its_compliances_in_series(twist: float) -> None:
    count, pull = 8, np.array([0.4, 0.3, 1.0]) * 1e-4
    assembly = row(count, twist=twist)
    force = np.zeros((count, 3))
    force[-1] = pull
    found = solve(
        ArmModel.of(assembly, VERO),
        straight(count),
        Loads.of(count, supports=np.array([0]), force=force),
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


def test_a_row_closed_to_a_ring_is_a_circle_of_constant_moment() -> None:
    count = 24
    assembly = row(count, closed=True)
    found = solve(ArmModel.of(assembly, VERO), shaken(ring(count), 0.001, 0.05), free(count), SimulateParams())
    turn = 2.0 * np.pi / count
    bending = at_joints(assembly)[0][4, 4]
    assert found.converged and found.negative_eigenvalues == 0
    assert found.energy == pytest.approx(count * turn**2 / (2.0 * bending), rel=1e-3)
    off = found.pose.centres - found.pose.centres.mean(axis=0)
    # the chord of an inextensible arc of the length of a spacing
    assert np.linalg.norm(off, axis=1) == pytest.approx(SPACING / turn, rel=2e-3)


def test_straight_rest_is_found_and_kept() -> None:
    model = ArmModel.of(row(6, twist=2.0), VERO)
    found = solve(model, shaken(straight(6), 0.002, 0.2), free(6), SimulateParams())
    assert found.converged and found.energy < 1e-12
    aligned = found.pose.aligned(straight(6).centres)
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
            ArmModel.of(assembly, VERO),
            straight(count),
            Loads.of(count, supports=np.array([0]), force=force),
            SimulateParams(),
        )
        assert found.converged and found.negative_eigenvalues == 0
        assert (np.abs(found.pose.centres[:, 2]).max() > 0.01 * length) == buckles


def test_both_backends_find_the_same_shape() -> None:
    model = ArmModel.of(row(12, twist=1.0, closed=True), VERO)
    start, loads = shaken(ring(12), 0.001, 0.1), free(12)
    held = loads.held(model.pairs, start.centres)
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
    pattern = Pattern(rows, cols, 12)
    counted = negative_eigenvalues(pattern, pattern.sum(dense[rows, cols]))
    assert counted == (np.linalg.eigvalsh(dense) < 0).sum()


def test_a_pivot_of_zero_is_no_fault() -> None:
    """Hubs that nothing links leave rows of zeros: their eigenvalues are neither counted nor a reason to stop."""
    system = NewtonSystem(np.array([[0, 1]]), np.zeros((2, 6), dtype=bool))
    values = system.values(np.diag([-1.0, 2.0, *np.zeros(10)])[None])
    assert system.negative(values) == 1
    assert not system.factor(values) and system.factor(system.definite(np.abs(values)))


def test_softest_motions_are_found_where_lanczos_gives_up(monkeypatch: pytest.MonkeyPatch) -> None:
    from flexmaps.engine.mechanics import newton_system
    from scipy.sparse.linalg import ArpackNoConvergence

    model = ArmModel.of(row(30, twist=1.0, closed=True), VERO)
    found = solve(model, ring(30), free(30), SimulateParams())
    system = NewtonSystem(model.pairs, free(30).held(model.pairs, found.pose.centres))
    here = model.expand(model.start(found.pose))
    known, lanczos = system.softest(system.values(here.hessian), system.values(here.convex)), newton_system.eigsh

    def weary(*arguments: object, tol: float, **rest: object) -> object:
        if tol < 0.1:
            raise ArpackNoConvergence("no convergence", np.zeros(0), np.zeros((len(system.free), 0)))
        return lanczos(*arguments, tol=tol, **rest)

    monkeypatch.setattr(newton_system, "eigsh", weary)
    modes, rise = system.softest(system.values(here.hessian), system.values(here.convex), 3)
    assert modes.shape == (1, 30, 6) and rise[0] < known[1][0] + 0.5


def test_a_dome_snaps_through_and_back() -> None:
    """A ring of larger circumference than its rim allows has two mirrored shapes; one is found from the other."""
    count = 12
    assembly = row(count)
    # both ends are held nearer to each other than the row is long: it arches up or down
    start = straight(count)
    start.centres[:, 0] *= 0.9
    start.centres[:, 2] = 0.02 * np.sin(np.pi * np.arange(count) / (count - 1))
    loads = Loads.of(count, supports=np.array([0, count - 1]))
    model = ArmModel.of(assembly, VERO)
    found = solve(model, start, loads, SimulateParams())
    assert found.converged and found.pose.centres[5, 2] > 0.02
    others = other_minima(model, found, loads, SimulateParams(restarts=6))
    down = [o for o in others if o.pose.centres[5, 2] < -0.02]
    assert down and down[0].energy == pytest.approx(found.energy, rel=1e-6)


def test_pinned_supports_let_the_ends_turn() -> None:
    count = 9
    start = straight(count)
    force = np.zeros((count, 3))
    force[:, 2] = -0.01
    ends = np.array([0, count - 1])
    model = ArmModel.of(row(count), VERO)
    sag = [
        solve(model, start, Loads.of(count, supports=ends, clamped=c, force=force), SimulateParams()).pose
        for c in (True, False)
    ]
    assert sag[0].rotations[0] == pytest.approx(np.eye(3))
    assert abs(sag[1].rotations[0][0, 2]) > 1e-3
    assert sag[1].centres[4, 2] < sag[0].centres[4, 2] < 0.0


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: Loads.of(5, supports=np.array([], dtype=int)), "group of the supports"),
        (lambda: Loads.of(5, supports=np.array([7])), "there are only 5"),
        (lambda: Loads.of(5, force=np.full((5, 3), np.nan)), "finite"),
    ],
)
def test_bad_supports_are_refused(make: object, message: str) -> None:
    with pytest.raises(FlexMapsError, match=message):
        make()


@pytest.mark.parametrize(
    "which",
    ["99999999999999999999", "9" * 5000, [10**30], "-1", "150", "1.5", "1_0", "", " , ", [1, 2.5], ["3", "x"], [],
     "\N{FULLWIDTH DIGIT ONE},\N{FULLWIDTH DIGIT TWO}", "\N{ARABIC-INDIC DIGIT THREE}"],
)  # fmt: skip
def test_supports_that_name_no_quad_are_refused(which: object) -> None:
    """Digits of other scripts among them: what looks like a number here but not there is better typed again."""
    with pytest.raises(FlexMapsError, match="upports") as caught:
        standing(shapes.make("cubesphere"), which)  # type: ignore[arg-type]
    assert len(str(caught.value)) < 200


def test_supports_by_number() -> None:
    mesh = shapes.make("cubesphere")
    assert standing(mesh, " 3, +4 ,3").tolist() == [3, 4]
    assert standing(mesh, np.array([149, 0])).tolist() == [0, 149]


def test_weight_without_supports_names_the_piece() -> None:
    assembly = row(6)
    apart = dataclasses.replace(
        assembly, pairs=assembly.pairs[[0, 1, 3, 4]], lever=assembly.lever[:4], axes=assembly.axes[:4]
    )
    model = ArmModel.of(apart, VERO)
    loads = Loads.of(6, supports=np.array([0]), mass=np.full(6, 0.001))
    with pytest.raises(FlexMapsError, match="nothing holds") as caught:
        solve(model, straight(6), loads, SimulateParams())
    assert caught.value.faces == [3, 4, 5]


@pytest.mark.parametrize("hinges", [[], [3], [0, 5], [2, 3, 4], [0, 1, 6], [0, 1, 2, 3, 4, 5, 6, 7, 8]])
def test_hinges_hold_no_more_than_they_should(hinges: list[int]) -> None:
    """What they leave free to move as a whole changes nothing: energy and strain are those of the free piece, and the
    increments that are held in its place carry no force. Rows and single hinges leave turns; a bent row leaves none.
    """
    count = 9
    assembly = row(count, twist=0.6, closed=True)
    model, start = ArmModel.of(assembly, VERO), ring(count)
    loads = Loads.of(count, supports=np.array(hinges, dtype=int) if hinges else None, clamped=False)
    found = solve(model, start, loads, SimulateParams())
    assert found.converged
    forces = model.expand(model.start(found.pose)).gradient
    held = loads.held(model.pairs, found.pose.centres)
    size = np.abs(forces[~loads.fixed]).max()
    assert size < 1e-7 * max(np.abs(model.expand(model.start(found.pose)).convex).max() * SPACING, 1e-12)
    extra = held & ~loads.fixed
    on_a_line = len(hinges) in (0, 1, 2)
    assert extra.sum() == {0: 6, 1: 3, 2: 1}.get(len(hinges), 0) and (on_a_line or not extra.any())
    if len(hinges) < 2:
        assert found.energy == pytest.approx(solve(model, start, free(count), SimulateParams()).energy, rel=1e-9)


def test_hinges_in_a_row_leave_the_turn_about_it() -> None:
    """All spirals of a flat strip on one line: the roll about it costs nothing, and weight beside the line turns it."""
    count = 6
    model = ArmModel.of(row(count), VERO)
    loads = Loads.of(count, supports=np.arange(count), clamped=False)
    found = solve(model, straight(count), loads, SimulateParams())
    assert found.converged and found.pose.centres == pytest.approx(straight(count).centres)
    (left,) = freedoms(loads.fixed, model.pairs, straight(count).centres)
    assert left.entries.tolist() == [3]
    assert np.abs(left.motions[0, 3:] / np.linalg.norm(left.motions[0, 3:])) == pytest.approx([1, 0, 0], abs=1e-9)


def test_what_swings_about_its_hinges_is_refused() -> None:
    model, force = ArmModel.of(row(6), VERO), np.zeros((6, 3))
    force[5, 2] = -0.01
    with pytest.raises(FlexMapsError, match="one hinge") as caught:
        solve(model, straight(6), Loads.of(6, supports=np.array([1]), clamped=False, force=force), SimulateParams())
    assert caught.value.faces == list(range(6))
    bent = ring(6)
    force[5] = [0.0, 0.01, 0.0]
    with pytest.raises(FlexMapsError, match="hinges in a line"):
        solve(model, bent, Loads.of(6, supports=np.array([1, 2]), clamped=False, force=force), SimulateParams())
    # pulled away from its hinge in a straight line it only grows longer
    force[5] = [0.01, 0.0, 0.0]
    found = solve(model, straight(6), Loads.of(6, supports=np.array([0]), clamped=False, force=force), SimulateParams())
    assert found.converged and found.pose.centres[5, 0] > 5.0 * SPACING


@pytest.mark.parametrize("hinges", [[], [2], [0, 4]])
def test_pieces_are_laid_as_near_as_their_supports_allow(hinges: list[int]) -> None:
    """A piece that has only been moved by what is left free comes back to its target exactly."""
    target = ring(7)
    fixed = np.zeros((7, 6), dtype=bool)
    fixed[hinges, :3] = True
    loads = Loads(fixed, np.zeros((7, 3)))
    pairs = row(7, closed=True).pairs
    axis = target.centres[4] - target.centres[0]
    turn = {0: [0.3, -0.7, 0.2], 1: [0.3, -0.7, 0.2], 2: 0.8 * axis / np.linalg.norm(axis)}[len(hinges)]
    rotation = Rotation.from_rotvec(turn).as_matrix()
    pivot = target.centres[hinges[0]] if hinges else np.array([0.1, 0.2, 0.3])
    moved = target.placed(rotation, pivot - rotation @ pivot)
    back = loads.laid(moved, pairs, target)
    assert back.centres == pytest.approx(target.centres, abs=1e-12)
    assert back.rotations == pytest.approx(target.rotations, abs=1e-12)


@pytest.mark.parametrize("backend", ["cvxopt", "superlu"])
@pytest.mark.parametrize("free_hubs", [0, 1, 2])
def test_all_or_nearly_all_held(backend: str, free_hubs: int) -> None:
    """Nothing, or hardly anything, is left to seek: still an equilibrium, with its softest motions and other shapes."""
    count = 8
    model, start = ArmModel.of(row(count, closed=True), VERO), shaken(ring(count), 0.001, 0.1)
    loads = Loads.of(count, supports=np.arange(count - free_hubs))
    system = NewtonSystem(model.pairs, loads.held(model.pairs, start.centres), backend)
    found = solve(model, start, loads, SimulateParams(), system=system)
    assert found.converged
    here = model.expand(model.start(found.pose))
    modes, rise = system.softest(system.values(here.hessian), system.values(here.convex), 3)
    assert modes.shape[1:] == (count, 6) and (rise > 0).all() and not modes[:, loads.fixed].any()
    assert other_minima(model, found, loads, SimulateParams(restarts=2)) == []
    assert system.solve(np.ones((count, 6)))[loads.fixed] == pytest.approx(0)


def test_few_free_increments_have_the_eigenvectors_of_the_dense_matrix() -> None:
    model, start = ArmModel.of(row(30, twist=1.0), VERO), straight(30)
    found = {}
    for held in (22, 12):  # below and above where Lanczos takes over
        loads = Loads.of(30, supports=np.arange(held))
        system = NewtonSystem(model.pairs, loads.held(model.pairs, start.centres))
        here = model.expand(model.start(start))
        h, b = (system.values(v) for v in (here.hessian, here.convex + np.eye(12) * 1e-3))
        modes, rise = system.softest(h, b, 2)
        found[held] = [
            float(system.reduced(m) @ system.pattern.matrix(h) @ system.reduced(m))
            / float(system.reduced(m) @ system.pattern.matrix(b) @ system.reduced(m))
            for m in modes
        ]
        assert found[held] == pytest.approx(rise, rel=1e-2)


def test_forces_that_turn_an_unsupported_piece_are_refused() -> None:
    model, force = ArmModel.of(row(4), VERO), np.zeros((4, 3))
    force[0, 2], force[3, 2] = 0.01, -0.01
    with pytest.raises(FlexMapsError, match="turn a piece"):
        solve(model, straight(4), Loads.of(4, force=force), SimulateParams())
    # pulled apart along its length it only grows longer
    force[:] = 0.0
    force[0, 0], force[3, 0] = -0.01, 0.01
    found = solve(model, straight(4), Loads.of(4, force=force), SimulateParams())
    assert found.converged and np.ptp(found.pose.centres[:, 0]) > 3 * SPACING


def test_a_spiral_outside_the_table_is_named() -> None:
    assembly = row(4)
    width = assembly.width.copy()
    width[2] = 0.0003
    (found,) = ArmModel.of(assembly.redesigned(width, assembly.twist), VERO).beyond()
    assert found.quantity == "width / thickness" and found.spirals.tolist() == [2]
    width[1] = np.nan
    with pytest.raises(FlexMapsError, match="no number") as caught:
        ArmModel.of(assembly.redesigned(width, assembly.twist), VERO)
    assert caught.value.faces == [1]


def test_giving_up_is_told_and_cancelling_works() -> None:
    model = ArmModel.of(row(12, closed=True), VERO)
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

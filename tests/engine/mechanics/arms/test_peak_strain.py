"""The largest strain of arms: sections against closed forms of elasticity, derivatives against differences, loads with their signs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flexmaps.engine.materials import MATERIALS, OVERSTRAIN_SHARE, Material
from flexmaps.engine.mechanics.arms.bar_loads import BEYOND, FIRST_ORDER, LOADS, TURN, WRENCH, BarLoads
from flexmaps.engine.mechanics.arms.bar_sections import SATURATION, Curvature, Torsion
from flexmaps.engine.mechanics.arms.bars import BEFORE_FILLET, BESIDE, Bars
from flexmaps.engine.mechanics.arms.peak_strain import GRAIN_INDEX, MEAN_OVER_MAX, NUMBERS, StrainedArms
from flexmaps.engine.mechanics.arms.sensitivity import arm_loads
from flexmaps.engine.mechanics.arms.strain_changes import (
    arm_strains,
    max_strain_per_spiral,
    strain_by_rest_shape,
    strained_arms,
)
from flexmaps.engine.mechanics.assembly import Assembly, CutSettings, assembly_from_design
from flexmaps.engine.params import LayoutParams, SimulateParams, SpiralParams
from flexmaps.engine.patches.flattening.flatten import flatten
from flexmaps.engine.patches.layout import PatchLayout
from flexmaps.engine.simulation.simulate import Simulation, simulate
from flexmaps.engine.spirals.curves.blends import (
    ANGLE,
    MATE_LEAN,
    MATE_WIDTH,
    MATE_WIND,
    OWN_LEAN,
    OWN_WIDTH,
    OWN_WIND,
    RADIUS,
)
from flexmaps.engine.spirals.design import SpiralDesign
from flexmaps.engine.surface import shapes

POM, BIRCH = MATERIALS["pom"], MATERIALS["birch"]
UNITS = np.repeat([1.0, 0.01], 3)  # N and N m of ordinary wrenches
LOAD_UNITS = np.concatenate([UNITS, 0.1 * UNITS, [0.5, 0.5, 0.5]])  # of wrenches, first-order wrenches and turns


def unbent(wrench: np.ndarray) -> np.ndarray:
    """Loads of arms that stay flat under their wrenches."""
    return np.concatenate([wrench, np.zeros((len(wrench), LOADS - 6))], axis=1)


def arms(count: int, material: Material = POM, seed: int = 0) -> StrainedArms:
    """Arms unlike their mates, some of them with sharp kinks."""
    rng, numbers = np.random.default_rng(seed), np.zeros((count, NUMBERS))
    numbers[:, [OWN_WIDTH, MATE_WIDTH, BESIDE]] = rng.uniform(0.001, 0.002, (count, 3))
    numbers[:, [OWN_WIND, MATE_WIND]] = rng.uniform(0.0, 4.0, (count, 2))
    numbers[:, RADIUS] = rng.uniform(0.008, 0.015, count)
    numbers[:, [ANGLE, OWN_LEAN, MATE_LEAN, GRAIN_INDEX]] = rng.uniform(-0.4, 0.4, (count, 4))
    return StrainedArms(numbers, 0.3, 0.00015, 0.002, material)


def straight(width: float, length: float = 0.015) -> StrainedArms:
    found = arms(1)
    numbers = np.zeros((1, NUMBERS))
    numbers[:, [OWN_WIDTH, MATE_WIDTH, BESIDE]], numbers[:, RADIUS] = width, length
    return replace(found, numbers=numbers)


def fourth_order(value: object, step: float) -> np.ndarray:
    """Slope of a function of one number at 0."""
    near, far = (value(k * step) - value(-k * step) for k in (1, 2))  # type: ignore[operator]
    return (8.0 * near - far) / (12.0 * step)


@pytest.mark.parametrize("curvature", [0.05, 0.3, 0.6, 1.0])
def test_bending_of_a_curved_bar_by_the_exact_solution(curvature: float) -> None:
    """Golovin's ring sector in pure bending (Timoshenko and Goodier, Theory of Elasticity, section 29): hoop stress at both edges."""
    inside, outside = 1.0 / curvature - 0.5, 1.0 / curvature + 0.5
    log, a, b = np.log(outside / inside), inside**2, outside**2
    total = (b - a) ** 2 - 4.0 * a * b * log**2

    def hoop(r: float) -> float:
        # of a moment that bends it more
        return 4.0 / total * (-a * b / r**2 * log + b * np.log(r / outside) + a * np.log(inside / r) + b - a)

    # the saturated curvature is what the sections use
    free = curvature / (1.0 - (curvature / SATURATION) ** 4) ** 0.25
    at = Curvature.evaluate(np.array([free]))
    assert at.bend[0] == pytest.approx(curvature)
    for side, radius in ((1.0, inside), (-1.0, outside)):
        found = -(0.5 * side - at.off * at.bend) / (at.off * (1.0 - 0.5 * side * at.bend))
        assert float(found[0]) == pytest.approx(hoop(radius), rel=0.035)


def test_functions_of_the_curvature_have_exact_derivatives() -> None:
    product = np.linspace(-6.0, 6.0, 1201)
    found = Curvature.evaluate(product)
    for name in ("bend", "log", "off"):
        slope = fourth_order(lambda t, n=name: getattr(Curvature.evaluate(product + t), n), 1e-3)
        assert getattr(found, name + "_by") == pytest.approx(slope, abs=1e-8), name
    assert found.log == pytest.approx(found.log[::-1]) and found.off[600] == pytest.approx(1.0 / 12.0)


@pytest.mark.parametrize(
    ("ratio", "constant", "shear"),
    [(1.0, 0.1406, 0.208), (1.5, 0.196, 0.231), (2.0, 0.229, 0.246), (4.0, 0.281, 0.282), (10.0, 0.312, 0.312)],
)
def test_torsion_of_rectangles_against_tabled_values(ratio: float, constant: float, shear: float) -> None:
    """Timoshenko and Goodier, section 109: M = k1 G theta a^3 b and M = k2 tau a^2 b, the shorter side being a."""
    tall, wide = (Torsion.evaluate(np.array([w]), h) for w, h in ((0.002, 0.002 * ratio), (0.002 * ratio, 0.002)))
    for found, middle in ((tall, 1), (wide, 2)):
        assert 1.0 / found.values[0, 0] == pytest.approx(constant * 0.002**4 * ratio, rel=3e-3)
        assert 1.0 / found.values[middle, 0] == pytest.approx(shear * 0.002**3 * ratio, rel=3e-3)
    width = np.geomspace(0.0003, 0.02, 200)
    slope = fourth_order(lambda t: Torsion.evaluate(width * (1.0 + t), 0.002).values, 1e-4) / width
    assert Torsion.evaluate(width, 0.002).slopes == pytest.approx(slope, rel=1e-6, abs=1e-9 * np.abs(slope).max())
    # wider than high, sections hardly warp; narrow ones by a quarter of width times height (thin plates)
    assert Torsion.evaluate(np.array([0.0002]), 0.002).values[3, 0] == pytest.approx(0.25 * 0.0002 * 0.002, rel=0.1)
    assert Torsion.evaluate(np.array([0.004]), 0.002).values[3, 0] < 1e-3 * 0.004 * 0.002


def test_straight_arms_are_cantilevers() -> None:
    """Largest strain F L / (E W) at the end of the last piece, to within what the mean of a high power is off."""
    known = straight(0.0015)
    for component, modulus in ((2, 0.0015 * 0.002**2 / 6.0), (1, 0.002 * 0.0015**2 / 6.0)):
        wrench = np.zeros((1, 6))
        wrench[0, component] = 0.5
        found = known.values(unbent(wrench))[0] * POM.youngs * modulus / 0.5
        # the arm ends about a width and a half before its hub's centre
        assert 0.010 < found < 0.015
    stretched = known.values(unbent(np.array([[10.0, 0.0, 0.0, 0.0, 0.0, 0.0]])))[0]
    uniform = 10.0 / (POM.youngs * 0.0015 * 0.002)
    assert stretched == pytest.approx(uniform / MEAN_OVER_MAX, rel=0.01)
    twisted = straight(0.002).values(unbent(np.array([[0.0, 0.0, 0.0, 0.01, 0.0, 0.0]])))[0]
    shear = 0.01 / (0.208 * 0.002**3) * 2.0 * (1.0 + POM.poisson) / POM.youngs
    # reached in half of the points: the middles of the sides
    assert twisted == pytest.approx(0.5 * shear * 0.5 ** (1.0 / 32.0) / MEAN_OVER_MAX, rel=0.02)


def test_loads_that_cancel_do() -> None:
    """A force and a moment that straighten each other at the hub strain less together than the force alone; a load of the other
    sense strains as much; twice the load, twice the strain."""
    known, wrench = straight(0.0015), np.array([[0.0, 1.0, 0.0, 0.0, 0.0, 0.0]])
    moment = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.006]])
    against, along = wrench - moment, wrench + moment
    alone = known.values(unbent(wrench))[0]
    assert known.values(unbent(against))[0] < 0.6 * alone < 0.9 * known.values(unbent(along))[0]
    some, loads = arms(40), unbent(np.random.default_rng(1).normal(size=(40, 6)) * UNITS)
    assert some.values(-loads) == pytest.approx(some.values(loads), rel=1e-12)
    assert some.values(2.0 * loads) == pytest.approx(2.0 * some.values(loads), rel=0.03)


@pytest.mark.parametrize("axis", [1, 2])
def test_loads_of_an_arm_bent_to_a_circle(axis: int) -> None:
    """A moment bends a straight arm to an arc, so that a pull along its tip bends it back the more, the nearer to the hub."""
    known = straight(0.0015)
    bars = Bars.from_numbers(known.numbers, known.shortest, known.fillet)
    place, angle, pull = bars.lever[0].real, 0.5, 3.0
    compliance = np.full((3, 1, len(place)), 20.0)
    length, loads = bars.length.sum() + BEYOND * 0.0015, np.zeros((1, LOADS))
    loads[0, WRENCH.start], loads[0, FIRST_ORDER.start + 3 + axis] = pull, angle / (20.0 * length)
    loads[0, TURN.start + axis] = 2.0 * angle
    found = BarLoads.from_bars(bars, loads, compliance)
    turned, radius = angle * place / length, length / angle
    assert found.normal[0] == pytest.approx(pull * np.cos(turned), rel=0.01)
    bending = np.abs({1: found.lift, 2: found.turn}[axis][0])
    wanted = pull * radius * (1.0 - np.cos(turned))
    assert bending == pytest.approx(wanted, rel=0.03, abs=0.01 * wanted.max())
    assert np.abs(found.torque).max() < 1e-12


@pytest.mark.parametrize("material", [POM, BIRCH], ids=lambda m: m.name)
def test_derivatives_by_loads_and_numbers(material: Material) -> None:
    known, loads = arms(60, material), np.random.default_rng(2).normal(size=(60, LOADS)) * LOAD_UNITS
    every = np.arange(60)
    found = known.slopes(loads, every)
    assert found.values == pytest.approx(known.values(loads), rel=1e-13)
    assert not len(known.slopes(loads[:0], every[:0]).values)
    some = known.slopes(loads[[7, 3]], np.array([7, 3]))
    assert some.by_numbers == pytest.approx(found.by_numbers[[7, 3]], rel=1e-9)
    for k in range(LOADS):
        way = LOAD_UNITS * (np.arange(LOADS) == k)
        slope = fourth_order(lambda t, d=way: known.values(loads + t * d), 1e-4)
        assert found.by_loads @ way == pytest.approx(slope, rel=1e-7, abs=1e-9), k
    for k in range(NUMBERS):
        way = (np.arange(NUMBERS) == k) * (
            1e-3 if k in (OWN_WIDTH, MATE_WIDTH, BESIDE) else 1e-2 if k == RADIUS else 1.0
        )
        slope = fourth_order(lambda t, d=way: replace(known, numbers=known.numbers + t * d).values(loads), 1e-5)
        assert found.by_numbers @ way == pytest.approx(slope, rel=1e-6, abs=1e-9), k
    assert found.by_numbers[:, GRAIN_INDEX].any() == (material is BIRCH)


@pytest.mark.parametrize("clockwise", [False, True])
def test_bars_end_before_the_first_fillets_of_the_arms_that_are_cut(clockwise: bool) -> None:
    """To within 0.4 of the arms' widths, against the fillets of whole spirals of unlike arms."""
    mesh = shapes.vault(4)
    mesh = mesh.with_vertices(mesh.vertices * 0.02 / mesh.median_edge)
    flat = flatten(PatchLayout(mesh, np.zeros(len(mesh.edges), dtype=bool)), LayoutParams())
    rng, count = np.random.default_rng(7), len(mesh.quads)
    width, twist = rng.uniform(0.0008, 0.0015, (count, 4)), rng.uniform(0.0, 3.5, count)
    design = SpiralDesign(flat, SpiralParams(clockwise=clockwise), width, twist)
    known, roots = assembly_from_design(design), design.roots
    own = strained_arms(known, POM)
    bars = Bars.from_numbers(own.numbers, own.shortest, own.fillet)
    at = known.pairs, known.sides
    first = np.minimum(roots.left, np.roll(roots.right, 1, axis=1))[at].ravel()
    speed = bars.lines.radius * np.hypot(1.0, bars.lines.wind * (1.0 - first))
    missed = (bars.end - first) * speed / bars.lines.width + BEFORE_FILLET
    assert np.abs(missed).max() < 0.4 and np.abs(missed).mean() < 0.2


def joints(count: int, *, clockwise: bool = False, cut: CutSettings | None = CutSettings(0.15, 0.00015)) -> Assembly:  # noqa: B008
    """Joints of unlike arms in unlike quads, each between two spirals of its own."""
    rng, lever = np.random.default_rng(5), np.zeros((count, 2, 3))
    lever[:, 0, 0], lever[:, 1, 0] = 0.012, -0.012
    lever[..., :2] += rng.uniform(-0.002, 0.002, (count, 2, 2))
    return Assembly(
        np.arange(2 * count).reshape(-1, 2), rng.integers(0, 4, (count, 2)), lever,
        np.broadcast_to(np.eye(3), (count, 2, 3, 3)), rng.uniform(0.001, 0.002, (2 * count, 4)),
        rng.uniform(0.2, 3.5, 2 * count), 0.002, clockwise, cut, 0.4,
    )  # fmt: skip


def test_the_mirror_image_is_strained_alike() -> None:
    known, mirror = joints(20), np.array([1.0, -1.0, 1.0])
    image = replace(
        known,
        sides=-known.sides % 4,
        width=known.width[:, [0, 3, 2, 1]],
        lever=known.lever * mirror,
        clockwise=True,
        grain=-known.grain,
    )
    wrench, linear = np.random.default_rng(3).normal(size=(2, 20, 6)) * UNITS
    turn, across = 0.5 * wrench[:, 3:] / UNITS[3:], np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    found = arm_strains(known, arm_loads(known, wrench, linear, turn), BIRCH)
    turned = arm_loads(image, wrench * across, linear * across, turn * across[3:])
    assert arm_strains(image, turned, BIRCH) == pytest.approx(found, rel=1e-12)
    assert max_strain_per_spiral(known, found) == pytest.approx(np.repeat(found.max(axis=1), 2))


@pytest.mark.parametrize("clockwise", [False, True])
def test_derivatives_by_the_rest_geometry(clockwise: bool) -> None:
    known = joints(20, clockwise=clockwise)
    own = strained_arms(known, BIRCH)
    loads = np.random.default_rng(4).normal(size=(40, LOADS)) * LOAD_UNITS
    found = strain_by_rest_shape(known, np.arange(40), own.slopes(loads, np.arange(40)).by_numbers)
    rng = np.random.default_rng(6)
    move, turn = rng.normal(size=(20, 2, 2)) * 0.01, rng.normal(size=(20, 2))

    def strains(t: float) -> np.ndarray:
        lever, axes = known.lever.copy(), known.axes.copy()
        lever[..., :2] += t * move
        c, s = np.cos(t * turn), np.sin(t * turn)
        axes[..., :2, :2] = np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], -2)
        return strained_arms(replace(known, lever=lever, axes=axes), BIRCH).values(loads)

    way = np.concatenate([move, turn[..., None]], axis=2)
    wanted = np.einsum("nsk,nsk->n", found, np.repeat(way, 2, axis=0))
    assert fourth_order(strains, 1e-5) == pytest.approx(wanted, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("material", [POM, BIRCH])
def test_arms_without_loads_have_no_strain_and_no_slopes(material: Material) -> None:
    found = arms(5, material).slopes(np.zeros((5, LOADS)), np.arange(5))
    assert not found.values.any() and not found.by_loads.any() and not found.by_numbers.any()


@pytest.fixture(scope="module")
def checker() -> Simulation:
    """A sheet of thick spirals at rest, wound much and little in turn."""
    mesh = shapes.strip(4, 4)
    mesh = mesh.with_vertices(mesh.vertices * 0.02 / mesh.median_edge)
    flat = flatten(PatchLayout(mesh, np.zeros(len(mesh.edges), dtype=bool)), LayoutParams())
    odd = (np.arange(16) + np.arange(16) // 4) % 2 == 1
    params = SpiralParams(thickness=0.004)
    design = SpiralDesign(flat, params, np.full((len(odd), 4), 0.0015), np.where(odd, 0.5, 3.5))
    force = np.zeros((len(odd), 3))
    force[-1] = [0.0, 0.0, 0.3]
    return simulate(design, mesh, POM, SimulateParams(), supports=np.arange(4), force=force)


def test_only_strain_over_the_limit_is_named(checker: Simulation) -> None:
    assert checker.strain is not None
    largest_share = checker.strain.max() * POM.strain_limit

    def codes(share: float) -> set[str]:
        material = replace(POM, strain_limit=largest_share / share)
        return {finding.code for finding in replace(checker, material=material).findings}

    assert "strained" in codes(1.01 * OVERSTRAIN_SHARE) and "strained" not in codes(0.99 * OVERSTRAIN_SHARE)


def test_arms_that_are_cut_as_pure_spirals_have_no_kink() -> None:
    pure = strained_arms(joints(10, cut=None), POM).numbers
    assert (pure[:, OWN_WIND] == pure[:, MATE_WIND]).all() and (pure[:, OWN_WIDTH] == pure[:, MATE_WIDTH]).all()

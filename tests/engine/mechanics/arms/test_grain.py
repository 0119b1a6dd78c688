"""Sheets with a grain: sections against closed forms, the arm model against the isotropic one, derivatives against differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flexmaps.engine.fabrication.sheets import make_sheets
from flexmaps.engine.materials import MATERIALS, Material, Orthotropy
from flexmaps.engine.mechanics.arms.bent import bend_arms
from flexmaps.engine.mechanics.arms.compliances import arm_compliances
from flexmaps.engine.mechanics.arms.cut import BESIDE, MATE_TWIST, MATE_WIDTH, TWIST, WIDTH, rest_shapes
from flexmaps.engine.mechanics.arms.grain import GrainBeams, SectionFlexibility
from flexmaps.engine.mechanics.arms.model import ArmModel
from flexmaps.engine.mechanics.arms.stiffness import table_tip_compliance
from flexmaps.engine.mechanics.assembly import Assembly, CutSettings, Pose, assembly_from_design, target_pose
from flexmaps.engine.params import MaterialParams, SheetParams, SpiralParams
from flexmaps.engine.patches.flattening.flatten import with_energies
from flexmaps.engine.spirals.design import SpiralDesign
from scipy.spatial.transform import Rotation

BIRCH, POM = MATERIALS["birch"], MATERIALS["pom"]
WOOD = BIRCH.orthotropy
assert WOOD is not None
HEIGHT = 0.003


def uniform(known: Material) -> Material:
    """The same material, told as one whose directions do not differ."""
    shear = 0.5 * known.youngs / (1.0 + known.poisson)
    return replace(known, orthotropy=Orthotropy(known.youngs, known.youngs, known.poisson, shear, shear, shear))


def joints(count: int, *, clockwise: bool = False, grain: float = 0.4, seed: int = 0) -> Assembly:
    """Joints of unlike arms in unlike quads, each between two spirals of its own."""
    rng = np.random.default_rng(seed)
    lever = np.zeros((count, 2, 3))
    lever[:, 0, 0], lever[:, 1, 0] = 0.012, -0.012
    lever[..., :2] += rng.uniform(-0.002, 0.002, (count, 2, 2))
    return Assembly(
        np.arange(2 * count).reshape(-1, 2), rng.integers(0, 4, (count, 2)), lever,
        np.broadcast_to(np.eye(3), (count, 2, 3, 3)), rng.uniform(0.001, 0.002, (2 * count, 4)),
        rng.uniform(0.2, 3.5, 2 * count), HEIGHT, clockwise, CutSettings(0.15, 0.00015), grain,
    )  # fmt: skip


def test_youngs_modulus_at_an_angle() -> None:
    """1/E = c^4/E1 + s^4/E2 + (1/G12 - 2 nu12/E1) s^2 c^2 (Jones, Mechanics of Composite Materials, section 2.6)."""
    angle, width = np.linspace(-2.0, 2.0, 9), np.full(9, 0.002)
    c, s = np.cos(angle) ** 2, np.sin(angle) ** 2
    soft = c * c / WOOD.along + s * s / WOOD.across + (1.0 / WOOD.shear - 2.0 * WOOD.poisson / WOOD.along) * s * c
    found = SectionFlexibility.evaluate(WOOD, angle, width, HEIGHT)
    np.testing.assert_allclose(found.stretch[0], soft / (width * HEIGHT), rtol=1e-12)
    np.testing.assert_allclose(found.bend[0], soft * 12.0 / (HEIGHT * width**3), rtol=1e-12)


def test_wide_strips_are_plates() -> None:
    """Torsion 3 S66 / (w h^3) and 12 S16 / (2 w h^3) with bending: Kirchhoff's plate whose sides are free."""
    width, height, angle = np.array(0.5), 0.001, np.array(0.6)
    found = SectionFlexibility.evaluate(WOOD, angle, width, height)
    shear = found.slide[0] * width * height / 1.2
    assert found.twist[0] == pytest.approx(3.0 * shear / (width * height**3), rel=3e-3)
    mixed = found.mixed[0] * width * height
    assert found.coupled[0] == pytest.approx(-6.0 * mixed / (width * height**3), rel=1e-12)


def test_torsion_along_the_grain() -> None:
    """Lekhnitskii: T / rate = G12 w h^3 b(q), q = w/h (G13/G12)^0.5, by his series for orthotropic rectangles."""
    width, height = np.array(0.002), 0.003
    q = width / height * np.sqrt(WOOD.shear_along / WOOD.shear)
    k = 2.0 * np.arange(60) + 1.0
    rigid = WOOD.shear * width * height**3 * (1 / 3 - 64 / np.pi**5 / q * (np.tanh(0.5 * np.pi * k * q) / k**5).sum())
    assert SectionFlexibility.evaluate(WOOD, np.array(0.0), width, height).twist[0] == pytest.approx(
        1.0 / rigid, rel=1e-6
    )


@pytest.mark.parametrize("clockwise", [False, True])
def test_a_grain_that_makes_no_difference_makes_none(clockwise: bool) -> None:
    known = joints(40, clockwise=clockwise)
    plain, told = (ArmModel.from_assembly(known, one) for one in (POM, uniform(POM)))
    unit = np.sqrt(np.einsum("esii->esi", plain.compliance.values))
    apart = (told.compliance.values - plain.compliance.values) / (unit[..., None] * unit[..., None, :])
    assert np.abs(apart).max() < 1e-6
    assert told.curving == pytest.approx(plain.curving, abs=1e-6 * np.abs(plain.curving).max())


def test_sheets_without_a_grain_do_not_feel_the_setting() -> None:
    one, other = (ArmModel.from_assembly(joints(20, grain=angle), POM) for angle in (0.0, 0.7))
    assert np.array_equal(one.stiffness, other.stiffness) and np.array_equal(one.curving, other.curving)
    assert (
        one.with_rest_geometry(joints(20, seed=1)).stiffness.tobytes()
        == other.with_rest_geometry(joints(20, seed=1)).stiffness.tobytes()
    )


def test_panels_and_their_grain_turn_together() -> None:
    known, turn = joints(20), Rotation.from_rotvec([0.0, 0.0, 1.1]).as_matrix()
    turned = replace(known, lever=known.lever @ turn.T, axes=turn @ known.axes, grain=known.grain + 1.1)
    one, other = ArmModel.from_assembly(known, BIRCH), ArmModel.from_assembly(turned, BIRCH)
    assert other.stiffness == pytest.approx(one.stiffness, abs=1e-9 * np.abs(one.stiffness).max())
    assert other.curving == pytest.approx(one.curving, abs=1e-9 * np.abs(one.curving).max())
    still = ArmModel.from_assembly(replace(turned, grain=known.grain), BIRCH)
    assert np.abs(still.stiffness - one.stiffness).max() > 0.05 * np.abs(one.stiffness).max()


def test_clockwise_arms_with_a_mirrored_grain_are_the_mirror_image() -> None:
    mirror = np.diag([1.0, -1.0, 1.0])
    known = joints(20)
    image = replace(known, lever=known.lever @ mirror, clockwise=True, grain=-known.grain)
    rng = np.random.default_rng(5)
    centres = np.zeros((40, 3))
    centres[known.pairs[:, 1]] = known.lever[:, 0] - known.lever[:, 1]
    turns = Rotation.from_rotvec(0.3 * rng.normal(size=(40, 3))).as_matrix()
    pose = Pose(centres + 0.002 * rng.normal(size=(40, 3)), turns)
    other = Pose(pose.centres @ mirror, mirror @ turns @ mirror)
    one, two = ArmModel.from_assembly(known, BIRCH), ArmModel.from_assembly(image, BIRCH)
    assert one.energy(one.start(pose)) == pytest.approx(two.energy(two.start(other)), rel=1e-10)
    straight = ArmModel.from_assembly(replace(image, grain=known.grain), BIRCH)
    assert one.energy(one.start(pose)) != pytest.approx(straight.energy(straight.start(other)), rel=1e-3)


@pytest.mark.parametrize("name", ["scale", "width", "twist", "grain"])
def test_derivatives_of_single_arms(name: str) -> None:
    rng = np.random.default_rng(5)
    width = rng.uniform(0.001, 0.002, 100)
    at = {"scale": width * rng.uniform(4.0, 40.0, 100), "width": width, "twist": rng.uniform(0.02, 8.0, 100)}
    at["grain"] = rng.uniform(-3.0, 3.0, 100)

    def values(given: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        beam = GrainBeams(WOOD, given["grain"], BIRCH.youngs, BIRCH.poisson)
        kind = {"thickness": HEIGHT, "youngs": BIRCH.youngs, "poisson": BIRCH.poisson}
        found = table_tip_compliance(given["scale"], given["width"], given["twist"], beam=beam, **kind)
        return found.values, getattr(found, f"by_{name}")

    step = 1e-6 * (at[name] if name in ("scale", "width") else np.ones(100))
    ahead, behind = (values(at | {name: at[name] + sign * step})[0] for sign in (1, -1))
    slope, found = (ahead - behind) / (2.0 * step)[:, None, None], values(at)[1]
    unit = np.sqrt(np.einsum("nii->ni", values(at)[0])) / np.sqrt(step * 1e6)[:, None]
    assert (np.abs(found - slope) <= 1e-6 * unit[:, :, None] * unit[:, None]).all()


@pytest.mark.parametrize("clockwise", [False, True])
def test_derivatives_of_cut_arms(clockwise: bool) -> None:
    known = joints(30, clockwise=clockwise)
    wrench = np.random.default_rng(3).normal(size=(30, 6)) * np.repeat([1.0, 0.005], 3)
    by = arm_compliances(known, BIRCH).by

    def values(width: np.ndarray, twist: np.ndarray) -> np.ndarray:
        moved = known.with_spirals(width, twist)
        return np.einsum("ei,esij,ej->es", wrench, arm_compliances(moved, BIRCH).values, wrench)

    exact = np.einsum("ei,esnij,ej->esn", wrench, by, wrench)
    for side in (0, 1):
        for step, numbers, share in (
            (0, (WIDTH, MATE_WIDTH), 1.0),
            (1, (BESIDE, None), 0.5),
            (None, (TWIST, MATE_TWIST), 1.0),
        ):
            line, size = [], 1e-4 if step is None else 1e-7
            for k in (-2, -1, 1, 2):
                width, twist = known.width.copy(), known.twist.copy()
                if step is None:
                    twist[known.pairs[:, side]] += k * size
                else:
                    width[known.pairs[:, side], (known.sides[:, side] + step) % 4] += k * size
                line.append(values(width, twist))
            found = (line[0] - 8 * line[1] + 8 * line[2] - line[3]) / (12 * size)
            for arm, number in ((side, numbers[0]), (1 - side, numbers[1])):
                wanted = np.zeros(30) if number is None else share * exact[:, arm, number]
                np.testing.assert_allclose(found[:, arm], wanted, rtol=0, atol=1e-6 * np.abs(exact).max())


def test_compliances_follow_the_rest_geometry() -> None:
    known = joints(30)
    model, rng = ArmModel.from_assembly(known, BIRCH, curving=False), np.random.default_rng(8)
    # the second arms point against the x axis, where the angle to the grain jumps
    step = 1e-6 * rng.normal(size=known.lever.shape) * [1.0, 1.0, 0.0]

    def missed(share: float) -> float:
        there = replace(known, lever=known.lever + share * step)
        exact = ArmModel.from_assembly(there, BIRCH, curving=False).compliance.values
        unit = np.sqrt(np.einsum("esii->esi", exact))
        apart = model.with_rest_geometry(there).compliance.values - exact
        return float(np.abs(apart / (unit[..., None] * unit[..., None, :])).max())

    assert rest_shapes(known, BIRCH).shape == (60, 4) and rest_shapes(known, POM).shape == (60, 3)
    assert missed(1.0) < 1e-6
    assert missed(10.0) == pytest.approx(100.0 * missed(1.0), rel=0.2)


def test_arms_along_the_grain_are_stiffer() -> None:
    found = []
    for angle in (0.0, 0.5 * np.pi):
        lever = np.array([[[0.01, 0.0, 0.0], [-0.01, 0.0, 0.0]]])
        alone = replace(joints(1, grain=angle), lever=lever, twist=np.zeros(2), width=np.full((2, 4), 0.001))
        found.append(arm_compliances(alone, BIRCH).values[0, 0, 2, 2])
    # bending alone would give the ratio of the moduli; hubs and shear take some of it
    assert 0.7 < found[1] / found[0] / (WOOD.along / WOOD.across) < 1.0


def plate(flat_grid: object, **params: object) -> SpiralDesign:
    flat = flat_grid(4, 2)  # type: ignore[operator]
    given = SpiralParams(thickness=0.0004, width_min=0.0003, **params)  # type: ignore[arg-type]
    return SpiralDesign(flat, given, np.full((8, 4), 0.0004), np.full(8, 2.5))


@pytest.mark.parametrize("clockwise", [False, True])
def test_bent_arms_meet_and_follow_the_grain(flat_grid: object, clockwise: bool) -> None:
    """Poses of single joints against the tips' compliance: the energy's slope is the wrench that bent arms carry."""
    design = plate(flat_grid, clockwise=clockwise, grain=0.5)
    mesh = design.flat.layout.mesh
    pose = target_pose(mesh, design.flat.corners)
    moved = pose.moved(1e-4 * np.random.default_rng(2).normal(size=(8, 6)) * np.repeat([0.01, 1.0], 3))
    plain, wood = (bend_arms(design, moved, material=one) for one in (uniform(BIRCH), BIRCH))
    told = bend_arms(design, moved, material=replace(BIRCH, orthotropy=None))
    assert plain.place == pytest.approx(told.place, abs=1e-9)
    assert np.abs(wood.place - told.place).max() > 1e-9
    model = ArmModel.from_assembly(assembly_from_design(design), BIRCH)
    wanted = model.wrenches(model.start(moved))
    inner = np.flatnonzero(~mesh.border)
    arm = 4 * mesh.edge_quads[inner, 0] + mesh.edge_sides[inner, 0]
    found = wood.wrench[arm] * BIRCH.youngs
    size = np.linalg.norm(wanted / np.repeat([1.0, 0.005], 3), axis=1)
    # beams without hubs against slender arms with theirs; with the grain on the other side they are 0.19 to 0.37 apart
    apart = np.linalg.norm((found - wanted) / np.repeat([1.0, 0.005], 3), axis=1) / size
    assert np.median(apart) < 0.12


@pytest.mark.parametrize("degrees", [0.0, 30.0, -70.0])
def test_panels_lie_along_the_grain_that_the_physics_knows(flat_grid: object, degrees: float) -> None:
    design = plate(flat_grid, grain=np.radians(degrees))
    turned = with_energies(design.flat.layout, design.flat.points - design.flat.points.mean(axis=0))
    found = make_sheets(replace(design, flat=turned), SheetParams(rotation="GRAIN", nesting_seconds=1.0, labels=False))
    on_sheet = np.degrees(found.packing.rotation[0]) + degrees
    assert on_sheet % 180.0 == pytest.approx(0.0, abs=1e-6) or on_sheet % 180.0 == pytest.approx(180.0, abs=1e-6)


def test_custom_materials_may_have_a_grain() -> None:
    plain = MaterialParams(material="custom", youngs=8e9).chosen
    assert plain.orthotropy is None and plain.youngs == 8e9
    wood = MaterialParams(material="custom", youngs=12.7e9, across=4.8e9).chosen
    assert wood.orthotropy is not None and wood.youngs == pytest.approx(8.75e9)
    assert wood.orthotropy.shear == pytest.approx(WOOD.shear) and wood.orthotropy.shear_across == WOOD.shear_across
    # whatever is given, no direction stores less than nothing
    for across in (1e6, 4e9, 1e12):
        known = MaterialParams(material="custom", youngs=8e9, across=across, poisson=0.44).chosen.orthotropy
        assert known is not None and known.poisson**2 < known.along / known.across

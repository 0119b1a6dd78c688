"""Arms as they are cut: against closed forms of beams, numerical integration of the drawn arms, and differences."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from flexmaps.engine.materials import MATERIALS, Material
from flexmaps.engine.mechanics.arms import cut
from flexmaps.engine.mechanics.arms.beams import torsion_constant
from flexmaps.engine.mechanics.arms.compliances import arm_compliances
from flexmaps.engine.mechanics.arms.cut import ROOT_DISTANCE, CutArms, added_compliance
from flexmaps.engine.mechanics.assembly import Assembly, CutSettings, assembly_from_design
from flexmaps.engine.params import SpiralParams
from flexmaps.engine.patches.flattening.flatten import FlatPatches
from flexmaps.engine.spirals.curves.spiral import Arms, centre_line, width_at
from flexmaps.engine.spirals.design import SpiralDesign

VERO, BIRCH, THICKNESS = MATERIALS["vero"], MATERIALS["birch"], 0.002


def joints(count: int, *, clockwise: bool = False, seed: int = 0) -> Assembly:
    """Joints of unlike arms in unlike quads, each between two spirals of its own."""
    rng = np.random.default_rng(seed)
    lever = np.zeros((count, 2, 3))
    lever[:, 0, 0], lever[:, 1, 0] = 0.01, -0.01
    lever[..., :2] += rng.uniform(-0.002, 0.002, (count, 2, 2))
    return Assembly(
        np.arange(2 * count).reshape(-1, 2),
        rng.integers(0, 4, (count, 2)),
        lever,
        np.broadcast_to(np.eye(3), (count, 2, 3, 3)),
        rng.uniform(0.0007, 0.0018, (2 * count, 4)),
        rng.uniform(0.0, 4.5, 2 * count),
        THICKNESS,
        clockwise,
        CutSettings(0.15, 0.00015),
    )


def pulls(count: int, seed: int = 3) -> np.ndarray:
    """Wrenches in newtons and in newton half-widths of a spiral."""
    return np.random.default_rng(seed).normal(size=(count, 6)) * np.repeat([1.0, 0.005], 3)


@pytest.mark.parametrize("clockwise", [False, True])
def test_derivatives_are_differences(clockwise: bool) -> None:
    known = joints(30, clockwise=clockwise)
    by = added_compliance(CutArms.from_assembly(known), THICKNESS, VERO)[1].reshape(30, 2, cut.N_CUT_PARAMETERS, 6, 6)
    wrench = pulls(1)[0]
    own = known.pairs, known.sides
    beside = known.pairs, (known.sides + 1) % 4

    def stored(width: np.ndarray, twist: np.ndarray) -> np.ndarray:
        value = added_compliance(
            CutArms.from_assembly(known.with_spirals(width, twist)), THICKNESS, VERO, slopes=False
        )[0]
        return wrench @ value.reshape(30, 2, 6, 6) @ wrench

    for side in (0, 1):
        for at, size, numbers, share in (
            (own, 1e-7, (cut.WIDTH, cut.MATE_WIDTH), 1.0),
            (beside, 1e-7, (cut.BESIDE, None), 0.5),
            (None, 1e-4, (cut.TWIST, cut.MATE_TWIST), 1.0),
        ):
            line = []
            for k in (-2, -1, 1, 2):
                width, twist = known.width.copy(), known.twist.copy()
                if at is None:
                    twist[known.pairs[:, side]] += k * size
                else:
                    width[at[0][:, side], at[1][:, side]] += k * size
                line.append(stored(width, twist))
            found = (line[0] - 8 * line[1] + 8 * line[2] - line[3]) / (12 * size)
            for arm, number in ((side, numbers[0]), (1 - side, numbers[1])):
                exact = share * (wrench @ by[:, arm, number] @ wrench) if number is not None else np.zeros(30)
                np.testing.assert_allclose(found[:, arm], exact, rtol=0, atol=1e-6 * np.abs(exact).max() + 1e-12)


@pytest.mark.parametrize("material", [VERO, BIRCH], ids=lambda one: one.name)
def test_derivatives_by_the_shapes_are_differences(material: Material) -> None:
    known, wrench = joints(30), pulls(1)[0]
    shape = cut.rest_shapes(known, material)

    def stored(moved: np.ndarray) -> np.ndarray:
        return (
            wrench
            @ added_compliance(CutArms.from_assembly(known, moved), THICKNESS, material, slopes=False)[0]
            @ wrench
        )

    yields = arm_compliances(known, material).table.reshape(-1, 6, 6)
    by = wrench @ cut.added_compliance_by_shape(known, yields, material) @ wrench
    assert by.shape == shape.shape
    # of stubs less is believed, which counts as given
    whole = cut.reduction_factors(
        CutArms.from_assembly(known, shape),
        yields,
        added_compliance(CutArms.from_assembly(known), THICKNESS, material)[0],
    )
    assert (whole == 1.0).mean() > 0.9
    for k, size in enumerate((1e-7, 1e-5, 1e-5, 1e-5)[: shape.shape[1]]):
        step = size * np.eye(shape.shape[1])[k]
        found = (stored(shape + step) - stored(shape - step)) / (2.0 * size)
        assert by[whole == 1.0, k] == pytest.approx(found[whole == 1.0], rel=1e-5, abs=1e-6 * np.abs(found).max())


def test_arms_alike_without_cut_are_those_of_the_table() -> None:
    known = joints(5)
    alike = replace(known, width=np.full_like(known.width, 0.001), cut=None)
    assert not added_compliance(CutArms.from_assembly(alike), THICKNESS, VERO)[0].any()
    # but thinner neighbours make an arm longer, and so softer in all ways
    thinner = np.full_like(known.width, 0.001)
    thinner[known.pairs, known.sides] = 0.0015
    softer = added_compliance(CutArms.from_assembly(replace(alike, width=thinner)), THICKNESS, VERO)[0]
    assert (
        np.linalg.eigvalsh(softer)[:, :3].min() > -1e-12 * softer.max()
        and (np.trace(softer, axis1=1, axis2=2) > 0).all()
    )


def test_root_of_a_straight_arm_is_a_shorter_cantilever() -> None:
    """Straight arms: the deflection of a cantilever grows with the cube of its length, and its slip with the length."""
    known = replace(joints(1), width=np.full((2, 4), 0.0012), twist=np.zeros(2), cut=None)
    lever = np.zeros((1, 2, 3))
    lever[:, 0, 0], lever[:, 1, 0] = 0.01, -0.01
    width = np.full((2, 4), 0.0012)
    width[[0, 1], known.sides[0]] = 0.001
    found = added_compliance(
        CutArms.from_assembly(replace(known, lever=lever).with_spirals(width, np.zeros(2))),
        THICKNESS,
        VERO,
    )[0]
    short, long = 0.01 - ROOT_DISTANCE * 0.0012, 0.01 - ROOT_DISTANCE * 0.001
    w, h = 0.001, THICKNESS
    slip = 1.2 * 2.0 * (1.0 + VERO.poisson) / (VERO.youngs * w * h)
    bend = 12.0 / (VERO.youngs * h * w**3)
    assert found[:, 1, 1] == pytest.approx(bend * (short**3 - long**3) / 3.0 + slip * (short - long), rel=1e-9)
    assert found[:, 5, 5] == pytest.approx(bend * (short - long), rel=1e-9)
    torsion = float(torsion_constant(np.array(h / w))[0]) * w**4
    assert found[:, 3, 3] == pytest.approx(
        2.0 * (1.0 + VERO.poisson) * (short - long) / (VERO.youngs * torsion), rel=1e-9
    )


@pytest.mark.parametrize("clockwise", [False, True])
def test_blended_end_is_that_of_the_drawn_arm(flat_grid: Callable[..., FlatPatches], clockwise: bool) -> None:
    """By fine sums along the centre lines that the drawings are made from, in a sheared grid with a seam."""
    rng, params = np.random.default_rng(4), SpiralParams(thickness=THICKNESS, clockwise=clockwise)
    flat = flat_grid(3, 2, move=lambda p: p @ np.array([[1.0, 0.0], [0.25, 0.9]]), cut=lambda x, y: x == 1.0)
    count = len(flat.corners)
    design = SpiralDesign(flat, params, rng.uniform(0.0007, 0.0018, (count, 4)), rng.uniform(0.0, 4.5, count))
    known = assembly_from_design(design)
    arms = CutArms.from_assembly(known)
    found = added_compliance(replace(arms, fillet=0.0 * arms.fillet, beside=arms.width), THICKNESS, VERO)[0]
    pure = design.arms.without_blends(design.arms.wind)
    drawn = design.arms
    t = np.broadcast_to((np.arange(4000) + 0.5) / 4000, (*drawn.radius.shape, 4000))
    total = [_beam_by_sums(one, t) for one in (drawn, pure)]
    for row, (spiral, side) in enumerate(zip(known.pairs.ravel(), known.sides.ravel(), strict=True)):
        angle = drawn.angle[spiral, side]
        c, s = np.cos(angle), np.sin(angle)
        axes = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        if clockwise:
            axes = axes * [1.0, -1.0, 1.0]
        turn = np.zeros((6, 6))
        turn[:3, :3], turn[3:, 3:] = axes, axes * (-1.0 if clockwise else 1.0)
        expected = turn.T @ (total[0][spiral, side] - total[1][spiral, side]) @ turn
        scale = np.sqrt(np.diag(turn.T @ total[1][spiral, side] @ turn))
        assert np.abs((found[row] - expected) / np.outer(scale, scale)).max() < 2e-5


def _beam_by_sums(arms: Arms, t: np.ndarray) -> np.ndarray:
    """(F, 4, 6, 6) compliance of the tips of arms held at their centres, in the patch's axes, by the midpoint rule."""
    point, speed, _ = centre_line(arms, t)
    width, h = width_at(arms, t)[0], THICKNESS
    tip = centre_line(arms, np.zeros((*t.shape[:2], 1)))[0]
    out = np.zeros((*t.shape[:2], 6, 6))
    pace = np.linalg.norm(speed, axis=-1)
    tangent = np.zeros((*t.shape, 3))
    tangent[..., :2] = speed / pace[..., None]
    aside = np.stack([-tangent[..., 1], tangent[..., 0], tangent[..., 2]], axis=-1)
    normal = np.zeros_like(tangent)
    normal[..., 2] = 1.0
    lever = np.zeros_like(tangent)
    lever[..., :2] = tip - point
    shear = VERO.youngs / (2.0 * (1.0 + VERO.poisson))
    ds = pace / t.shape[-1]
    torsion = torsion_constant(h / width)[0] * width**4
    for axis, turning, sliding in (
        (tangent, shear * torsion, VERO.youngs * width * h),
        (aside, VERO.youngs * width * h**3 / 12.0, shear * width * h / 1.2),
        (normal, VERO.youngs * h * width**3 / 12.0, shear * width * h / 1.2),
    ):
        # a force F at the tip turns the section by (lever x F) . axis
        moment = np.concatenate([np.cross(axis, lever), axis], axis=-1)
        force = np.concatenate([axis, np.zeros_like(axis)], axis=-1)
        out += np.einsum("fkn,fkni,fknj->fkij", ds / turning, moment, moment)
        out += np.einsum("fkn,fkni,fknj->fkij", ds / sliding, force, force)
    return out


def test_no_arm_yields_less_than_nothing() -> None:
    """Stubs between wide neighbours, wound beyond all that can be cut: the energy of every wrench stays positive."""
    rng = np.random.default_rng(2)
    known = replace(joints(400), cut=CutSettings(0.15, 0.001))
    lever = known.lever * rng.uniform(0.15, 1.0, (400, 2, 1))
    width = rng.uniform(0.0005, 0.003, known.width.shape)
    found = arm_compliances(replace(known, lever=lever).with_spirals(width, known.twist), VERO)
    unit = np.sqrt(np.einsum("esii->esi", found.table))
    assert np.linalg.eigvalsh(found.values / (unit[..., :, None] * unit[..., None, :])).min() > 1e-3
    assert (found.values != found.table).any()


def test_the_fade_from_the_table_to_stubs_has_the_slopes_of_its_values() -> None:
    """Arms of lengths from below the shortest to beyond the table's range."""
    ratio = np.linspace(0.6, 1.2, 7)[:, None] * np.array([cut.SHORTEST, cut.SCALE_RANGE[0]])
    width, n = np.full(ratio.size, 0.0014), ratio.size

    def factor(by_width: float, by_radius: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return cut._fade_factor(replace(known, width=width + by_width, radius=0.5 * ratio.ravel() * width + by_radius))

    known = CutArms.from_assembly(joints((n + 1) // 2)).subset(slice(n))
    step = 1e-9
    for k, way in enumerate(((step, 0.0), (0.0, step)), start=1):
        after, before = (factor(*(sign * x for x in way))[0] for sign in (1.0, -1.0))
        exact = factor(0.0, 0.0)[k]
        np.testing.assert_allclose((after - before) / (2.0 * step), exact, rtol=1e-5, atol=1e-5 * np.abs(exact).max())
    assert factor(0.0, 0.0)[0].min() == 0.0 and factor(0.0, 0.0)[0].max() == 1.0

"""The stiffness table: derivatives, symmetry, scaling, limits, and the beam that it corrects."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.materials import MATERIALS, find_material
from flexmaps.engine.mechanics.arms import beams, stiffness
from flexmaps.engine.mechanics.rods import rod_stiffness as stiffness_rods

SHEET = {"thickness": 0.002, "youngs": 2.6e9, "poisson": 0.33}


@pytest.fixture(scope="module")
def arms():
    rng = np.random.default_rng(5)
    scale, width = rng.uniform(0.011, 0.03, 200), rng.uniform(0.001, 0.002, 200)
    twist = rng.uniform(0.02, 0.97, 200) * np.minimum(stiffness.table_twist_limit(scale / width), 2 * np.pi)
    return scale, width, twist


def test_straight_slender_arm_is_a_cantilever():
    """End deflection F L^3 / (3 E I), stretch F L / (E A), twist M L / (G J); the arm starts at the hub's border."""
    s, w, h = 0.05, 0.001, 0.0008
    c = stiffness.table_tip_compliance([s], [w], [0.0], thickness=h, youngs=1e9, poisson=0.3).values[0]
    length = 0.5 * s - 0.35 * w
    assert c[1, 1] == pytest.approx(length**3 / (3 * 1e9 * h * w**3 / 12), rel=0.03)
    assert c[2, 2] == pytest.approx(length**3 / (3 * 1e9 * w * h**3 / 12), rel=0.03)
    assert c[0, 0] == pytest.approx(length / (1e9 * w * h), rel=0.03)
    ratio = h / w
    j = w * h**3 * (1 / 3 - 0.21 * ratio * (1 - ratio**4 / 12))
    assert c[3, 3] == pytest.approx(length / (1e9 / 2.6 * j), rel=0.04)


@pytest.mark.parametrize("name", ["scale", "width", "twist"])
def test_derivatives_are_exact(arms, name):
    position = ("scale", "width", "twist").index(name)
    step = 1e-6 * (np.ones(200) if name == "twist" else arms[position])
    sides = []
    for sign in (1, -1):
        moved = list(arms)
        moved[position] = arms[position] + sign * step
        sides.append(stiffness.table_tip_compliance(*moved, **SHEET).values)
    slope = (sides[0] - sides[1]) / (2 * step)[:, None, None]
    found = getattr(stiffness.table_tip_compliance(*arms, **SHEET), f"by_{name}")
    size = np.abs(slope).max(axis=0)
    assert (np.abs(found - slope) <= 1e-6 * size + 1e-30).all()


def test_compliances_are_positive_symmetric_and_mirrored(arms):
    values = stiffness.table_tip_compliance(*arms, **SHEET).values
    assert np.array_equal(values, values.swapaxes(1, 2))
    unit = np.array([1, 1, 1, 1e2, 1e2, 1e2])
    assert (np.linalg.eigvalsh(values / np.outer(unit, unit)) > 0).all()
    assert not values[:, [[0], [1], [5]], [[2, 3, 4]]].any()


def test_one_table_serves_every_size_and_modulus(arms):
    """Energies go with E h^3 f(s/h, w/h, twist): a sheet 3 times as thick, of twice the modulus, 3 times as large."""
    a = stiffness.table_tip_compliance(*arms, **SHEET).values
    b = stiffness.table_tip_compliance(
        3 * arms[0], 3 * arms[1], arms[2], thickness=0.006, youngs=5.2e9, poisson=0.33
    ).values
    unit = np.array([1, 1, 1, 1 / 3, 1 / 3, 1 / 3])
    assert np.allclose(b, a * np.outer(unit, unit) * 3 / 9 / 2 * 1.0, rtol=1e-9)


def test_more_twist_is_softer_and_more_width_stiffer():
    one = np.ones(20)
    soft = stiffness.table_tip_compliance(0.02 * one, 0.0015 * one, np.linspace(0, 6, 20), **SHEET).values[:, 2, 2]
    assert (np.diff(soft) > 0).all()
    stiff = stiffness.table_tip_compliance(0.02 * one, np.linspace(0.001, 0.002, 20), 2 * one, **SHEET).values[:, 2, 2]
    assert (np.diff(stiff) < 0).all()


@pytest.mark.parametrize(
    ("twist", "change"),
    [
        (math.nan, {}),
        (1.0, {"thickness": -0.002}),
        (1.0, {"youngs": 0.0}),
        (1.0, {"poisson": 0.45}),
        (1.0, {"poisson": 0.0}),
    ],
)
def test_what_is_no_arm_or_sheet_is_refused(twist, change):
    with pytest.raises(FlexMapsError):
        stiffness.table_tip_compliance([0.02, 0.02], [0.0015, 0.002], [1.0, twist], **{**SHEET, **change})


def test_error_names_the_arms():
    with pytest.raises(FlexMapsError) as found:
        stiffness.table_tip_compliance([0.02, 0.02, 0.011], [0.0015, 0.0015, math.nan], [1.0, 1.0, 6.0], **SHEET)
    assert found.value.faces == [2]


@pytest.fixture(scope="module")
def wild():
    """Arms of which most lie outside of the table in some way: s/w 1 to 1000, w/h 0.02 to 30, twists to 750 degrees."""
    rng = np.random.default_rng(11)
    width = SHEET["thickness"] * np.exp(rng.uniform(math.log(0.02), math.log(30.0), 400))
    return width * np.exp(rng.uniform(0.0, math.log(1000.0), 400)), width, rng.uniform(0.0, 13.0, 400)


@pytest.mark.parametrize("name", ["scale", "width", "twist"])
def test_outside_the_table_derivatives_stay_exact(wild, name):
    """Central differences; what is clipped at the table's edge no longer changes."""
    position = ("scale", "width", "twist").index(name)
    step = 1e-6 * (np.ones(400) if name == "twist" else wild[position])
    sides = []
    for sign in (1, -1):
        moved = list(wild)
        moved[position] = wild[position] + sign * step
        sides.append(stiffness.table_tip_compliance(*moved, **SHEET).values)
    found = stiffness.table_tip_compliance(*wild, **SHEET)
    slope = (sides[0] - sides[1]) / (2 * step)[:, None, None]
    diagonal = np.einsum("nii->ni", found.values)
    size = np.sqrt(diagonal[:, :, None] * diagonal[:, None]) / step[:, None, None] * 1e-6
    assert (np.abs(getattr(found, f"by_{name}") - slope) < 1e-5 * size).all()
    assert (np.linalg.eigvalsh(found.values / np.sqrt(diagonal[:, :, None] * diagonal[:, None])) > 1e-3).all()


def test_no_step_at_the_edges_of_the_table():
    """Values just inside and just outside agree, for every edge and at several twists."""
    for twist in (0.0, 1.0, 4.0, 10.0):
        for ratio, flatness in ((50.0, 0.7), (2.0, 0.7), (30.0, 0.3), (30.0, 3.0)):
            for across_ratio in (True, False):
                ends = []
                for f in (1.0 - 1e-9, 1.0 + 1e-9):
                    width = 0.002 * flatness * (1.0 if across_ratio else f)
                    arm = ([ratio * width * (f if across_ratio else 1.0)], [width], [twist])
                    ends.append(stiffness.table_tip_compliance(*arm, **SHEET).values)
                assert ends[0] == pytest.approx(ends[1], rel=1e-6, abs=1e-7 * np.abs(ends[0]).max())
    limit = float(stiffness.table_twist_limit(10.0))
    ends = [stiffness.table_tip_compliance([0.02], [0.002], [limit * f], **SHEET).values for f in (1 - 1e-9, 1 + 1e-9)]
    assert ends[0] == pytest.approx(ends[1], rel=1e-6)


def test_slender_arms_tend_to_the_curved_beam():
    """A cut-out of s/w 400 differs from Castigliano's beam by the hub's share alone, less than at 100."""
    apart = []
    for ratio in (100.0, 400.0):
        arm = np.array([ratio]), np.array([1.25]), np.array([4.0])
        beam = beams.beam_tip_compliance(arm[0], 1.0 / arm[1], arm[2], 0.33).values[:, [0, 2, 5]]
        table = stiffness.load_table(0.33)
        own = stiffness.blocks(*arm, table, 0.33).values[:, [0, 2, 5]]
        apart.append(float(np.abs(own / beam - 1.0).max()))
    assert apart[1] < 0.01 and apart[1] == pytest.approx(0.25 * apart[0], rel=0.1)


def test_what_lies_outside_is_told_by_spiral():
    scale, width = np.array([0.02, 0.02, 0.9, 0.02, 0.003]), np.array([0.0015, 0.0071, 0.002, 0.002, 0.002])
    twist = np.array([1.0, 0.0, 1.0, 4.0 * math.pi, 0.0])
    found = stiffness.beyond(scale, width, twist, 0.002, np.array([7, 6, 5, 4, 3]))
    assert {b.quantity.split(" / ")[0]: b.spirals.tolist() for b in found} == {
        "scale": [3, 5],
        "width": [6],
        "twist": [4],
    }
    assert "scale / width 2 to 400, here 450" in [str(b) for b in found]
    assert not stiffness.beyond(scale[:1], width[:1], twist[:1], 0.002, np.array([0]))


def test_table_carries_its_provenance_and_errors():
    table = stiffness.load_table(0.3)
    errors = table.provenance["held_out"]
    assert errors["spirals"] >= 48
    assert errors["compliance_median"] <= 0.015 and errors["compliance_95"] <= 0.05
    assert stiffness.TABLE.stat().st_size < 2_000_000


def test_broken_or_foreign_tables_are_refused(tmp_path):
    with pytest.raises(FlexMapsError, match="missing"):
        stiffness.load_table(0.3, tmp_path / "none.npz")
    other = tmp_path / "other.npz"
    np.savez(other, coefficients=np.zeros(1), pairs=np.zeros(1), provenance=json.dumps({"format": -1}))
    with pytest.raises(FlexMapsError, match="version"):
        stiffness.load_table(0.3, other)


def test_torsion_constant_against_tabled_values():
    """Timoshenko and Goodier, Theory of Elasticity, section 109: J / (a b^3)."""
    for ratio, factor in ((1.0, 0.1406), (2.0, 0.229), (4.0, 0.281), (10.0, 0.312)):
        assert float(beams.torsion_constant(np.array(ratio))[0]) == pytest.approx(factor * ratio, rel=2e-3)
        assert float(beams.torsion_constant(np.array(1 / ratio))[0]) == pytest.approx(factor / ratio**3, rel=2e-3)


def test_torsion_constant_against_the_whole_series():
    odd = 2.0 * np.arange(300) + 1.0
    height = np.geomspace(0.05, 20.0, 41)
    whole = height**3 * (
        1 / 3 - 64 / np.pi**5 * height * (np.tanh(0.5 * np.pi * odd / height[:, None]) / odd**5).sum(1)
    )
    value, by_height = beams.torsion_constant(height)
    np.testing.assert_allclose(value, whole, rtol=1e-6)
    step = 1e-5 * height
    ends = (beams.torsion_constant(height + sign * step)[0] for sign in (1.0, -1.0))
    np.testing.assert_allclose(by_height, np.subtract(*ends) / (2.0 * step), rtol=1e-6)


def test_materials_name_their_sources():
    for m in MATERIALS.values():
        assert m.source and 0 < m.poisson < 0.45 and 1e9 < m.youngs < 2e10 and 0 < m.strain_limit < 0.1
    with pytest.raises(FlexMapsError, match="pom"):
        find_material("steel")


# -- the paper's four parameters ----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["scale", "width", "twist"])
def test_rod_parameters_have_exact_derivatives(name):
    rng = np.random.default_rng(6)
    arms = [rng.uniform(0.015, 0.029, 60), rng.uniform(0.0011, 0.0019, 60), rng.uniform(0.1, 3.5, 60)]
    kind = {"thickness": 0.002, "youngs": 2.6e9, "model": "pair"}
    position = ("scale", "width", "twist").index(name)
    step = 1e-4 * arms[position]
    sides = []
    for sign in (1, -1):
        moved = list(arms)
        moved[position] = arms[position] + sign * step
        sides.append(stiffness_rods.rod_parameters(*moved, **kind).values)
    assert (sides[0] > 0).all()
    slope = (sides[0] - sides[1]) / (2 * step)[:, None]
    found = getattr(stiffness_rods.rod_parameters(*arms, **kind), f"by_{name}")
    assert np.allclose(found, slope, rtol=1e-4, atol=1e-5 * np.abs(slope).max(axis=0))


@pytest.mark.parametrize("name", ["scale", "width", "twist"])
def test_rod_parameters_outside_are_those_of_the_nearest_spiral(name):
    """Steady over the edges of the sampled region, and derivatives that are those of the values."""
    rng = np.random.default_rng(7)
    arms = [
        0.002 * np.exp(rng.uniform(0.5, 4.0, 80)),
        0.002 * np.exp(rng.uniform(-2.0, 1.0, 80)),
        rng.uniform(0, 12, 80),
    ]
    kind = {"thickness": 0.002, "youngs": 2.6e9}
    position, sides = ("scale", "width", "twist").index(name), []
    step = 1e-5 * np.maximum(arms[position], 1e-3)
    for sign in (1, -1):
        moved = list(arms)
        moved[position] = arms[position] + sign * step
        sides.append(stiffness_rods.rod_parameters(*moved, **kind).values)
    found = stiffness_rods.rod_parameters(*arms, **kind)
    slope = (sides[0] - sides[1]) / (2 * step)[:, None]
    error = np.abs(getattr(found, f"by_{name}") - slope) * step[:, None]
    assert (error < 1e-7 * found.values).all()
    inside = stiffness_rods.rod_parameters([0.03], [0.002], [1.0], **kind).values
    assert stiffness_rods.rod_parameters([0.09], [0.004], [1.0], **kind).values == pytest.approx(inside, rel=0.02)


def test_straight_cross_bends_like_its_arms():
    """Between two hubs a straight cross is a beam: the fitted bending stiffness is near E h w^3 / 12, torsion near G J."""
    found = stiffness_rods.rod_parameters([0.028], [0.0012], [0.0], thickness=0.002, youngs=1e9).values[0]
    assert 0.9 < found[1] / (1e9 * 0.002 * 0.0012**3 / 12) < 3.5
    assert 0.9 < found[2] / (1e9 * 0.0012 * 0.002**3 / 12) < 3.5
    torsion = 0.002 * 0.0012**3 * (1 / 3 - 0.21 * 0.6 * (1 - 0.6**4 / 12))
    assert found[3] == pytest.approx(1e9 / 2.6 * torsion, rel=0.15)


def test_unknown_rod_models_are_refused():
    with pytest.raises(FlexMapsError, match="pair"):
        stiffness_rods.load_network("beam")


def test_short_arms_go_on_like_beams() -> None:
    """Shorter than the table: steady where it begins, softer with length as beams are, derivatives exact."""
    given = {"thickness": 0.002, "youngs": 2.6e9, "poisson": 0.3}
    width, twist = np.array([0.002]), np.array([0.5])
    edge = 5.0 * width
    below, above = (
        stiffness.table_tip_compliance(edge * f, width, twist, **given).values for f in (1 - 1e-9, 1 + 1e-9)
    )
    assert below == pytest.approx(above, rel=1e-6)
    short = stiffness.table_tip_compliance(0.6 * edge, width, twist, **given)
    assert short.values[0, 2, 2] / above[0, 2, 2] == pytest.approx(0.6**3)
    assert short.values[0, 4, 4] / above[0, 4, 4] == pytest.approx(0.6)
    for name, k in (("by_scale", 0), ("by_width", 1), ("by_twist", 2)):
        at, h = [0.6 * edge, width, twist], [1e-7, 1e-8, 1e-4][k]
        ends = []
        for sign in (1.0, -1.0):
            moved = list(at)
            moved[k] = at[k] + sign * h
            ends.append(stiffness.table_tip_compliance(*moved, **given).values)
        slope = getattr(short, name)
        assert (ends[0] - ends[1]) / (2.0 * h) == pytest.approx(slope, rel=1e-5, abs=1e-7 * np.abs(slope).max())

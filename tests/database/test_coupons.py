"""What the formulas of the calibration sheet say, against solids of its strip and its spirals."""

from __future__ import annotations

import pytest
from flexmaps.database import coupons as solids
from flexmaps.engine.extras.calibrating import bending
from flexmaps.engine.extras.calibrating.coupons import GRAVITY, Coupons
from flexmaps.engine.extras.calibrating.sizes import choose_coupons
from flexmaps.engine.params import Settings, with_values

MATERIALS = (
    {},
    {"material.material": "birch", "spiral.thickness": 4},
    {"material.material": "pla", "spiral.thickness": 1},
)


@pytest.mark.parametrize("values", MATERIALS)
@pytest.mark.parametrize("times", [0.1, 2.0])
def test_strip(values: dict, times: float) -> None:
    """Up to a sag of a fifth of its length."""
    made = choose_coupons(with_values(Settings(), values))
    sag = bending.strip_sag(made, made.youngs, times * made.strip_load)
    assert sag == pytest.approx(solids.strip_sag(made, made.youngs, times * made.strip_load), rel=0.003)


@pytest.mark.parametrize(
    ("which", "values"),
    [
        pytest.param(which, values, marks=[] if which == number else pytest.mark.thorough)
        for which in (0, 1)
        for number, values in enumerate(MATERIALS)
    ],
)
def test_spirals(values: dict, which: int) -> None:
    """Their arms' ends are held in every point in the solid, and on the whole in the table: stiffer by that, as a real frame is or not."""
    made: Coupons = choose_coupons(with_values(Settings(), values))
    one = made.spirals[which]
    sag = one.load * GRAVITY / bending.spiral_stiffness(made, one.scale, one.width, one.twist, made.youngs)
    assert sag == pytest.approx(solids.spiral_sag(made, one, made.youngs, one.load), rel=0.025)
    assert sag > solids.spiral_sag(made, one, made.youngs, one.load)


def test_a_held_block_is_pulled_as_a_bar() -> None:
    """Poisson's ratio nearly 0: F L / (E A), by hand."""
    import numpy as np
    from flexmaps.database.solid import LOBATTO

    x, y, z = np.meshgrid(5.0 * LOBATTO, LOBATTO, LOBATTO, indexing="ij")
    nodes = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    number = np.arange(64).reshape(4, 4, 4)
    model = solids.Held(nodes, number[None], 1e-3, number[0].ravel())
    forces = np.zeros_like(nodes)
    share = np.outer([1, 5, 5, 1], [1, 5, 5, 1]) / 144.0
    forces[number[-1], 0] = 1e-6 * share
    assert model.solve(forces).displacement[number[-1], 0].mean() == pytest.approx(5e-6, rel=1e-3)

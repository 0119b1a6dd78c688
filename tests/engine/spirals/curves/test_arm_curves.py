"""Centre lines as complex numbers: their derivatives by the arms' parameters against differences."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.spirals.curves import blends
from flexmaps.engine.spirals.curves.arm_curves import CENTRE_X, CENTRE_Y, N_ARM_PARAMETERS, ArmCurves

COUNT, SHORTEST = 60, 0.15
# where the parameters of an arm stand among the arguments of ``curves``
PLACES = {
    blends.OWN_WIDTH: ("width", 0), blends.MATE_WIDTH: ("width", 1), blends.OWN_WIND: ("wind", 0), blends.MATE_WIND: ("wind", 1),
    blends.OWN_LEAN: ("lean", 0), blends.MATE_LEAN: ("lean", 1), blends.RADIUS: ("radius", None), blends.ANGLE: ("angle", None),
    CENTRE_X: ("centre", 1.0), CENTRE_Y: ("centre", 1j),
}  # fmt: skip


def curves(number: int = 0, step: float = 0.0) -> ArmCurves:
    """Arms unlike their mates, with a step of one parameter of each."""
    rng = np.random.default_rng(5)
    known = {
        "centre": rng.uniform(-0.05, 0.05, COUNT) + 1j * rng.uniform(-0.05, 0.05, COUNT),
        "radius": rng.uniform(0.005, 0.015, COUNT),
        "angle": rng.uniform(0.0, 6.0, COUNT),
        "width": rng.uniform(0.0008, 0.0025, (COUNT, 2)),
        "wind": rng.choice([-1.0, 1.0], (COUNT, 1)) * rng.uniform(0.0, 8.0, (COUNT, 2)),
        "lean": rng.uniform(-0.6, 0.6, (COUNT, 2)),
    }
    name, which = PLACES[number]
    if name == "centre":
        known[name] += step * which
    else:
        known[name][..., slice(None) if which is None else which] += step
    both = known["width"], known["wind"], known["lean"]
    return ArmCurves.from_arms(known["centre"], known["radius"], known["angle"], both, SHORTEST)


@pytest.mark.parametrize("number", range(N_ARM_PARAMETERS))
def test_derivatives_of_points_and_half_widths_are_differences(number: int) -> None:
    """At places within the blends and behind them, along all directions."""
    rng, i = np.random.default_rng(7), np.arange(COUNT)
    t, along = rng.uniform(0.0, 0.6, COUNT), np.exp(1j * rng.uniform(0.0, 6.0, COUNT))
    step = 1e-5 if PLACES[number][0] in ("wind", "lean", "angle") else 1e-7
    after, before = (curves(number, way * step) for way in (1.0, -1.0))
    points = (np.conj(along) * (after.points(i, t) - before.points(i, t))).real / (2.0 * step)
    halves = (after.evaluate(i, t)[3] - before.evaluate(i, t)[3]) / (2.0 * step)
    point, half = curves().point_and_width_vjp(i, t, along)
    for found, exact in ((points, point[:, number]), (halves, half[:, number])):
        np.testing.assert_allclose(found, exact, rtol=0, atol=1e-6 * max(float(np.abs(exact).max()), 1e-3))

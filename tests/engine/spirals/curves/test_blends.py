"""The blended ends of the arms in closed form: what they must do at the joint, and their derivatives by differences."""

import numpy as np
import pytest
from flexmaps.engine.spirals.curves import blends as module
from flexmaps.engine.spirals.curves.blends import blend_joints

NAMES = [
    "OWN_WIDTH", "MATE_WIDTH", "OWN_WIND", "MATE_WIND", "RADIUS", "ANGLE", "OWN_LEAN", "MATE_LEAN",
]  # fmt: skip


def _joints(count=400):
    rng = np.random.default_rng(3)
    sign = np.repeat(rng.choice([-1.0, 1.0], (count, 1)), 2, axis=1)
    return (
        rng.uniform(0.0008, 0.0025, (count, 2)),
        sign * rng.uniform(0.0, 8.0, (count, 2)),
        rng.uniform(-0.6, 0.6, (count, 2)),
        rng.uniform(0.005, 0.015, count),
        rng.uniform(0.0, 6.0, count),
        0.15,
    )


def _moved(numbers, number, step):
    moved = [np.array(x) for x in numbers]
    where = {0: (0, 0), 1: (0, 1), 2: (1, 0), 3: (1, 1), 4: (3,), 5: (4,), 6: (2, 0), 7: (2, 1)}[number]
    if len(where) == 2:
        moved[where[0]][:, where[1]] += step
    else:
        moved[where[0]] += step
    return moved


@pytest.mark.parametrize("value", ["slope", "width", "share"])
@pytest.mark.parametrize("number", range(module.N_BLEND_PARAMETERS), ids=NAMES)
def test_derivatives_agree_with_differences(number, value):
    numbers = _joints()
    step = 1e-7 if number in (0, 1, 4) else 1e-5
    after, before = (getattr(blend_joints(*_moved(numbers, number, s)), value) for s in (step, -step))
    exact = getattr(blend_joints(*numbers), f"{value}_by")[:, number]
    scale = max(np.abs(exact).max(), 1e-9)
    np.testing.assert_allclose((after - before) / (2 * step), exact, atol=1e-6 * scale)


def test_both_arms_of_a_joint_leave_it_in_one_direction():
    width, wind, lean, radius, angle, shortest = _joints()
    seen = []
    for own in (0, 1):
        order = [own, 1 - own]
        end = blend_joints(width[:, order], wind[:, order], lean[:, order], radius, angle, shortest)
        outward = radius * np.exp(1j * angle) * (1 - 1j * wind[:, own]) - end.slope
        seen.append(outward * np.exp(1j * (lean[:, own] - angle)))
    np.testing.assert_allclose(seen[0] / abs(seen[0]), seen[1] / abs(seen[1]), atol=1e-12)
    assert (np.angle(seen[0]).__abs__() < np.arccos(0.0995)).all()  # and across the edge


def test_alike_arms_in_squares_are_not_blended_and_unlike_ones_longer_with_their_turn():
    wind, zero = np.linspace(0.0, 6.28, 50), np.zeros((50, 2))
    width, radius = np.full((50, 2), 0.002), np.full(50, 0.01)
    same = blend_joints(width, np.stack([wind, wind], axis=1), zero, radius, zero[:, 0], 0.15)
    np.testing.assert_allclose(same.slope, 0.0, atol=1e-15)
    np.testing.assert_allclose(same.share, 0.15, rtol=1e-14)
    other = blend_joints(width, np.stack([0.0 * wind, wind], axis=1), zero, radius, zero[:, 0], 0.15)
    assert (np.diff(other.share) >= 0.0).all()
    assert other.share[-1] > 0.5

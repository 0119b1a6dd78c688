"""Bend points of arms against finite differences, and of a straight arm against its closed form."""

import numpy as np
import pytest
from flexmaps.engine.mechanics.arm_bend import bend_point


@pytest.mark.parametrize("share", [0.2, 0.5])
@pytest.mark.parametrize("twist", [5e-4, 0.01, 0.7, 3.0])
def test_slopes_are_those_of_the_points(twist, share):
    step = 1e-4
    ahead, behind = (bend_point(np.array([twist + way * step]), share)[0] for way in (1.0, -1.0))
    assert bend_point(np.array([twist]), share)[1] == pytest.approx((ahead - behind) / (2.0 * step), abs=2e-6)


def test_a_straight_arm_bends_where_its_moments_balance():
    # over a straight arm the weight is (1 - 2 share u)^2, whose integral from 0 to 1 is a third for a share of 1/2
    assert bend_point(np.zeros(1), 0.5)[0] == pytest.approx(np.array([[1.0 / 3.0, 0.0]]), abs=1e-9)

"""Goals of an exploration: how far measures are beyond their limits."""

import math

import pytest
from flexmaps.engine.extras.exploring.space import Goal


def test_shortfalls_are_shares_of_the_limit():
    assert Goal("mass", 2.0).shortfall({"mass": 3.0}) == pytest.approx(0.5)
    assert Goal("load", 2.0, most=False).shortfall({"load": 1.5}) == pytest.approx(0.25)
    assert Goal("mass", 2.0).shortfall({"mass": 2.0}) == Goal("load", 2.0, most=False).shortfall({"load": 2.0}) == 0.0


@pytest.mark.parametrize("most", [True, False])
def test_a_goal_without_its_measure_is_missed(most):
    assert Goal("load", 2.0, most=most).shortfall({}) == math.inf

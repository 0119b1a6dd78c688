"""Variables and goals of an exploration: places of values between 0 and 1, and distances of measures from their limits."""

from __future__ import annotations

import math

import pytest
from flexmaps.engine.extras.exploring.space import Goal, Variable


@pytest.mark.parametrize("count", [1, 2, 3, 49, 200])
def test_every_choice_is_the_value_at_its_own_share(count: int) -> None:
    """Rounding leads to no neighbour: 49 shares of 1/49 are less than 1."""
    variable = Variable("quads", choices=tuple(range(count)))
    assert [variable.at(variable.share(value)) for value in variable.choices] == list(variable.choices)


def test_numbers_lie_evenly_between_their_bounds() -> None:
    variable = Variable("edge", 10.0, 30.0)
    assert [variable.at(share) for share in (0.0, 0.25, 1.0)] == [10.0, 15.0, 30.0]
    assert [variable.share(value) for value in (5.0, 10.0, 15.0, 40.0)] == [0.0, 0.0, 0.25, 1.0]


def test_shortfalls_are_shares_of_the_limit() -> None:
    assert Goal("mass", 2.0).shortfall({"mass": 3.0}) == pytest.approx(0.5)
    assert Goal("load", 2.0, most=False).shortfall({"load": 1.5}) == pytest.approx(0.25)
    assert Goal("mass", 2.0).shortfall({"mass": 2.0}) == Goal("load", 2.0, most=False).shortfall({"load": 2.0}) == 0.0


@pytest.mark.parametrize("most", [True, False])
def test_a_goal_without_its_measure_is_missed(most: bool) -> None:
    assert Goal("load", 2.0, most=most).shortfall({}) == math.inf

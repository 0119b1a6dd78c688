"""Damping of the few hubs that turn otherwise than a step predicts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flexmaps.engine.optimisation.optimisers import damping_of_few, misled

from .test_composite import start

GAIN = 1e-4


def turns(seed: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Damping so far, and turns of 200 hubs that differ from the prediction as on an even surface."""
    rng = np.random.default_rng(seed)
    return np.zeros((200, 1)), 1e-3 * rng.uniform(0.5, 1.0, 200), 1e-2 * rng.uniform(0.5, 1.0, 200)


def test_one_hub_that_snaps_is_damped_alone() -> None:
    known, turned, predicted = turns()
    turned[17] = 0.3
    damping = damping_of_few(known, turned, predicted, GAIN)
    assert damping is not None
    assert np.flatnonzero(damping).tolist() == [17]
    # the turn that was predicted there costs at least a share of what the step was to gain, and no hub is nailed down
    cost = 0.5 * damping[17, 0] * max(predicted[17], 0.1 * turned[17]) ** 2
    assert cost == pytest.approx(GAIN)
    assert not known.any()


def test_a_hub_that_snaps_again_is_damped_more() -> None:
    known, turned, predicted = turns()
    turned[17] = 0.3
    once = damping_of_few(known, turned, predicted, GAIN)
    assert once is not None
    twice = damping_of_few(once, turned, predicted, 0.1 * GAIN)
    assert twice is not None and twice[17, 0] > 2.0 * once[17, 0]


def test_hubs_that_all_turn_otherwise_are_no_matter_of_a_place() -> None:
    known, turned, predicted = turns()
    assert damping_of_few(known, turned, predicted, GAIN) is None


def test_turns_that_were_not_predicted() -> None:
    """Of a pose that differs from the prediction by one hub's turn."""
    point = start()
    moves = np.zeros((point.problem.assembly.whole.size, 6))
    moves[:, 3:] = 0.02 * np.random.default_rng(2).normal(size=moves[:, 3:].shape)
    further = moves.copy()
    more = 0.1 * moves[5, 3:] / np.linalg.norm(moves[5, 3:])
    further[5, 3:] += more
    there = replace(point, equilibrium=replace(point.equilibrium, pose=point.equilibrium.pose.moved(further)))
    turned = misled(point, there, moves)
    assert turned[5] == pytest.approx(0.1, rel=1e-9)
    assert np.delete(turned, 5).max() < 1e-7

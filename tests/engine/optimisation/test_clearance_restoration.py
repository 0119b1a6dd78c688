"""Designs that are brought back to where they can be cut, and the narrowest gaps."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.optimisation.clearance_restoration import ClearanceProblem, narrowest_per_pair, restore_clearances
from flexmaps.engine.optimisation.polytope import LinearClearances
from flexmaps.engine.spirals.clearance.clearance_model import Clearances
from scipy.sparse import csr_array


def test_the_narrowest_gap_of_every_pair_of_arms_is_kept() -> None:
    """Arm 0, whose mate is arm 9, has gaps to arms 1 (at three places) and 2, and its own inner edge and winding."""
    arms = np.array([[0, 9, 1, 8], [0, 9, 2, 7], [0, 9, 1, 8], [0, 9, 0, 9], [0, 9, 1, 8], [0, 0, 0, 0]])
    value = np.array([0.3, 0.5, 0.1, 0.4, 0.2, 0.6])
    found = narrowest_per_pair(Clearances(value, csr_array(np.diag(value)), csr_array(np.diag(-value)), arms))
    assert sorted(found.value) == [0.1, 0.4, 0.5, 0.6]
    assert found.by_flat is not None
    for row, by, flat, pair in zip(
        found.value, found.by_design.toarray(), found.by_flat.toarray(), found.arms, strict=True
    ):
        assert by.sum() == row == -flat.sum()
        assert (arms[value == row] == pair).all()


def test_what_closes_is_brought_back_and_what_stays_closed_does_not_go() -> None:
    """Three coordinates; the first two may not be more than 1 together, and the third not beyond 0.5, of which the slope is wrong."""

    def linear_clearances(y: np.ndarray, quads: np.ndarray | None) -> LinearClearances:
        slopes = csr_array(np.array([[-1.0, -1.0, 0.0], [0.0, 0.0, 1.0]]))
        return LinearClearances.from_clearances(np.array([1.0 - y[0] - y[1], 0.5 - y[2]]), slopes)

    def spirals_with_closed_gaps(y: np.ndarray, quads: np.ndarray | None) -> np.ndarray:
        return np.array([y[0] + y[1] >= 1.0, y[0] + y[1] >= 1.0, y[2] > 0.5])

    feasible = np.array([0.2, 0.2, 0.3])
    found = restore_clearances(
        np.array([0.8, 0.6, 0.9]),
        feasible,
        ClearanceProblem(linear_clearances, spirals_with_closed_gaps, lambda share: share, 3, 3),
    )
    assert not spirals_with_closed_gaps(found, None).any()
    assert found[0] + found[1] == pytest.approx(1.0, abs=3e-3) and found[0] - found[1] == pytest.approx(0.2, abs=1e-6)
    assert 0.3 <= found[2] <= 0.5

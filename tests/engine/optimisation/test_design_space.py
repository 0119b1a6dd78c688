"""Limits of a space of designs: which twists and widths its design variables reach."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from flexmaps.engine.mechanics.assembly import assembly_from_design
from flexmaps.engine.optimisation.design_space import DesignSpace
from flexmaps.engine.params import SpiralParams
from flexmaps.engine.patches.flattening.flatten import FlatPatches
from flexmaps.engine.spirals.design import SpiralDesign

WHERE = np.array([True, False, True, False, False, False])


@pytest.fixture
def design(flat_grid: Callable[..., FlatPatches]) -> SpiralDesign:
    return SpiralDesign(flat_grid(3, 2), SpiralParams(), np.full((6, 4), 0.0012), np.full(6, 1.5))


@pytest.mark.parametrize("groups", [1, 4])
def test_limited_spirals_have_no_more_twist_than_in_the_design(design: SpiralDesign, groups: int) -> None:
    space = DesignSpace.from_design(design, assembly_from_design(design), groups)
    limited = space.with_twist_limits(design, WHERE)
    most = space.coordinates(design.width, design.twist)
    most = most.reshape(6, groups + 1)
    most[:, -1] = 1.0
    before, after = (one.width_and_twist(most.ravel()) for one in (space, limited))
    assert (before[1] > 2.0).all()
    assert after[0] == pytest.approx(design.width) and after[1][WHERE] == pytest.approx(1.5)
    np.testing.assert_array_equal(after[1][~WHERE], before[1][~WHERE])
    # a limit is never raised again, and the design itself stays in the space
    wound = SpiralDesign(design.flat, design.params, design.width, np.full(6, 1.8))
    np.testing.assert_array_equal(limited.with_twist_limits(wound, WHERE).twist_factor, limited.twist_factor)
    found = limited.width_and_twist(limited.coordinates(design.width, design.twist))
    assert found[0] == pytest.approx(design.width) and found[1] == pytest.approx(design.twist)

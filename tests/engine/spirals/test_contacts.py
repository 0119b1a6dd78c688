"""Places where outlines touch, made by hand."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from flexmaps.engine.patches.flattening.flatten import FlatPatches
from flexmaps.engine.spirals.contacts import find_contacts, nearest_quads
from flexmaps.engine.spirals.contours import Outline
from flexmaps.engine.spirals.curves.arcs import Curve


def ring(points: list[tuple[float, float]]) -> Curve:
    return Curve(np.array(points), np.zeros(len(points)))


def square(side: float, x: float = 0.0, y: float = 0.0) -> Curve:
    return ring([(x, y), (x + side, y), (x + side, y + side), (x, y + side)])


WHOLE = Outline(square(0.1), (square(0.02, 0.01, 0.01).reversed(), square(0.02, 0.05, 0.05).reversed()))


def test_outlines_with_holes_inside_have_no_contacts() -> None:
    assert find_contacts([]).shape == find_contacts([WHOLE]).shape == (0, 3)


def test_crossings_are_found_where_they_are_and_on_their_panel() -> None:
    across = Outline(square(0.1), (square(0.04, 0.08, 0.03).reversed(),))
    found = find_contacts([WHOLE, across])
    assert found[:, 0].tolist() == [1.0, 1.0]
    np.testing.assert_allclose(sorted(found[:, 1:].tolist()), [[0.1, 0.03], [0.1, 0.07]], atol=1e-9)
    assert len(find_contacts([WHOLE, across], contact_free=[1])) == 0
    two = Outline(square(0.1), (square(0.02, 0.01, 0.01).reversed(), square(0.02, 0.02, 0.02).reversed()))
    np.testing.assert_allclose(sorted(find_contacts([two])[:, 1:].tolist()), [[0.02, 0.03], [0.03, 0.02]], atol=1e-9)


def test_a_curve_that_crosses_itself_is_found_there() -> None:
    eight = ring([(0.0, 0.0), (0.1, 0.1), (0.1, 0.0), (0.0, 0.1)])
    np.testing.assert_allclose(find_contacts([Outline(eight, ())]), [[0.0, 0.05, 0.05]], atol=1e-9)


def test_a_hole_outside_its_panel_is_reported_on_the_outline() -> None:
    ((patch, x, y),) = find_contacts([WHOLE, Outline(square(0.1), (square(0.02, 0.2).reversed(),))])
    assert patch == 1.0 and (x, y) == (0.0, 0.0)


@pytest.mark.parametrize(("count", "wanted"), [(1, [5]), (3, [1, 4, 5])])
def test_the_nearest_quads_of_the_same_panel(
    flat_grid: Callable[..., FlatPatches], count: int, wanted: list[int]
) -> None:
    """A grid of 3 x 3 quads of 20 mm with a cut after two columns: beside the cut, quads across it don't count."""
    flat = flat_grid(3, 3, cut=lambda x, _: x == 2)
    patch = int(flat.layout.patch_of[5])
    found = nearest_quads(flat, np.array([[patch, 0.0399, 0.0501], [patch, 0.0399, 0.0499]]), count)
    assert set(wanted[-1:]) <= set(found.tolist()) and (flat.layout.patch_of[found] == patch).all()
    assert found.tolist() == sorted(found.tolist()) and len(found) >= count
    centre = flat.corners.mean(axis=1)
    (nearest,) = nearest_quads(flat, np.array([[patch, *centre[3]]]), 1)
    assert nearest == 3

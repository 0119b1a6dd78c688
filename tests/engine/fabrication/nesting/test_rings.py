"""Areas enclosed by drawn lines, against squares whose areas are known."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.fabrication.nesting.rings import SNAP_DISTANCE, enclosed_areas
from shapely import box

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
NEAR, FAR = 0.9 * SNAP_DISTANCE, 1.2 * SNAP_DISTANCE


def square(side: float, x: float = 0.0, y: float = 0.0) -> np.ndarray:
    return np.array([x, y]) + side * SQUARE


def areas(*lines: tuple[np.ndarray, bool]) -> list[float]:
    return [float(p.area) for p in enclosed_areas(lines)]


@pytest.mark.parametrize("x", [0.0, 7.0])
def test_a_line_closes_where_its_ends_are_within_the_snap_distance(x: float) -> None:
    line = np.array([x, 0.0]) + np.vstack([square(0.1), [[0.0, NEAR]]])
    assert areas((line, False)) == pytest.approx([0.01], rel=2e-3)
    assert areas((line + np.vstack([np.zeros((4, 2)), [[0.0, FAR - NEAR]]]), False)) == []
    assert areas((square(0.1, x), True)) == pytest.approx([0.01])


def test_single_lines_that_nearly_meet_enclose_their_area() -> None:
    sides = [np.stack([a, b]) for a, b in zip(square(0.1), np.roll(square(0.1), -1, axis=0), strict=True)]
    shifted = [np.array([0.5 * NEAR * (k % 2), 0.0]) + side for k, side in enumerate(sides)]
    assert areas(*((side, False) for side in shifted)) == pytest.approx([0.01], rel=2e-3)
    apart = [np.array([FAR * (k == 1), 0.0]) + side for k, side in enumerate(sides)]
    assert areas(*((side, False) for side in apart)) == []


def test_an_end_near_the_middle_of_another_line_is_joined_to_it() -> None:
    """Two legs and the bar between them enclose nothing; with a line below both legs they do."""
    legs = [np.array([[x, NEAR], [x, 0.2]]) for x in (0.0, 0.1)]
    bars = [np.array([[-0.05, 0.0], [0.15, 0.0]]), np.array([[0.0, 0.1], [0.1, 0.1]])]
    assert areas(*((line, False) for line in (*legs, bars[1]))) == []
    assert areas(*((line, False) for line in (*legs, *bars))) == pytest.approx([0.01], rel=3e-3)


def test_rings_inside_rings_are_holes_and_material_again() -> None:
    rings = [square(0.1), square(0.06, 0.02, 0.02), square(0.02, 0.04, 0.04), square(0.05, 0.2)]
    for order in (rings, rings[::-1]):
        first, second, third = enclosed_areas((ring, True) for ring in order)
        assert first.equals(box(0.0, 0.0, 0.1, 0.1) - box(0.02, 0.02, 0.08, 0.08))
        assert second.equals(box(0.2, 0.0, 0.25, 0.05)) and third.equals(box(0.04, 0.04, 0.06, 0.06))


def test_neighbours_that_touch_stay_two_pieces() -> None:
    for gap in (0.0, 0.5 * NEAR, -0.5 * NEAR):
        found = areas((square(0.1), True), (square(0.09, 0.1 + gap), True))
        assert found == pytest.approx([0.01, 0.0081])


def test_a_hole_across_the_outline_is_a_notch() -> None:
    (found,) = enclosed_areas([(square(0.1), True), (square(0.04, 0.08, 0.03), True)])
    assert found.equals(box(0.0, 0.0, 0.1, 0.1) - box(0.08, 0.03, 0.12, 0.07))
    # across the edge of another hole it makes that hole larger
    rings = (square(0.1), True), (square(0.06, 0.02, 0.02), True), (square(0.01, 0.075, 0.04), True)
    assert areas(*rings) == pytest.approx([0.01 - 0.0036 - 0.00005])


def test_lines_drawn_twice_count_once() -> None:
    shifted = (square(0.1, 0.4 * NEAR, 0.4 * NEAR), True)
    assert areas((square(0.1), True), shifted, (np.roll(square(0.1)[::-1], 1, axis=0), True)) == pytest.approx([0.01])
    assert areas((square(0.1), True), (square(0.1 - 4.0 * FAR, 2.0 * FAR, 2.0 * FAR), True)) == pytest.approx(
        [0.01 - (0.1 - 4.0 * FAR) ** 2]
    )


def test_a_line_that_crosses_itself_is_cut_along_its_outside() -> None:
    eight = 0.1 * np.array([[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]])
    assert areas((eight, True)) == pytest.approx([0.0025, 0.0025])
    looped = np.array(
        [[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.05, 0.1], [0.05, 0.05], [0.07, 0.05], [0.07, 0.12], [0.0, 0.12]]
    )
    assert areas((looped, True)) == pytest.approx([0.0100 + 0.07 * 0.02], rel=1e-9)


def test_points_and_lines_without_area_give_nothing() -> None:
    assert areas((SQUARE[:2], True), (SQUARE[:1], False), (SQUARE[[0, 1, 0]], True), (SQUARE[:2], False)) == []

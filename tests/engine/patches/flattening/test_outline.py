"""Simple outlines against shapely, isthmuses against rectangles."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.patches.flattening.outline import has_simple_outline, isthmus_width
from hypothesis import given, settings
from hypothesis import strategies as st


def as_quads(count: int) -> tuple[np.ndarray, np.ndarray]:
    """A closed polygon's sides as the outline sides of quads: corners (q, 4) and sides (q, 4)."""
    corners = np.zeros((count, 4), dtype=np.int64)
    corners[:, 0], corners[:, 1] = np.arange(count), (np.arange(count) + 1) % count
    sides = np.zeros((count, 4), dtype=bool)
    sides[:, 0] = True
    return corners, sides


@settings(max_examples=300, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 12), st.integers(0, 12)), min_size=4, max_size=9, unique=True))
def test_simple_is_what_shapely_calls_simple(corners: list[tuple[int, int]]) -> None:
    import shapely

    points = np.array([complex(*c) for c in corners])
    ring = shapely.LinearRing(corners)
    assert has_simple_outline(points, *as_quads(len(points))) == bool(ring.is_simple)


def test_what_rounding_cannot_tell_counts_as_touching() -> None:
    slit = np.array([0, 4, 4 + 2j, 2 + 2j, 2 + 1e-17j, 1 + 2j, 2j])
    assert not has_simple_outline(slit, *as_quads(len(slit)))
    slit[4] = 2 + 1e-3j
    assert has_simple_outline(slit, *as_quads(len(slit)))


@pytest.mark.parametrize(("length", "expected"), [(1, 0.4), (2, 1 / 3), (3, 1 / 4), (4, 1 / 5), (6, 1 / 7)])
def test_isthmus_of_rectangles(length: int, expected: float) -> None:
    steps = np.arange(10) / 10
    long = np.arange(10 * length) / 10
    outline = np.concatenate([long, length + 1j * steps, length - long + 1j, 1j * (1 - steps)])
    assert isthmus_width(outline) == pytest.approx(expected)


def test_a_gap_is_no_isthmus() -> None:
    # a U: the two legs come close outside, the arms are wide
    outline = np.array([0, 5, 5 + 3j, 2.6 + 3j, 2.6 + 2j, 2.4 + 2j, 2.4 + 3j, 3j], dtype=complex)
    fine = np.concatenate([a + (b - a) * np.arange(8) / 8 for a, b in zip(outline, np.roll(outline, -1), strict=True)])
    # the bridge under the gap is 2 wide with 9 behind it; the gap itself would give less than 0.1
    assert isthmus_width(fine) == pytest.approx(2 / 9)


def test_patches_side_by_side_are_looked_at_by_themselves() -> None:
    square = np.array([0, 1, 1 + 1j, 1j])
    points = np.concatenate([square, square + 0.5 + 0.5j])
    corners, sides, patch = np.arange(8).reshape(2, 4), np.ones((2, 4), dtype=bool), np.arange(2)
    assert has_simple_outline(points, corners, sides, patch)
    assert not has_simple_outline(points, corners, sides)
    points[[6, 7]] = points[[7, 6]]
    assert not has_simple_outline(points, corners, sides, patch)

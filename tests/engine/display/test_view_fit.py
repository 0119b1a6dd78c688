"""Views placed beside the bars that cover them, against projections by a matrix as OpenGL has it."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.display.view_fit import MARGIN, Rectangle, free_part, place_view
from scipy.spatial.transform import Rotation

VIEW = Rectangle(100, 50, 1180, 850)
SIDEBAR, TOOLBAR = Rectangle(820, 50, 1180, 820), Rectangle(100, 50, 156, 820)
HEADER, HIDDEN = Rectangle(100, 824, 1180, 850), Rectangle(1179, 50, 1180, 51)


def pixels(points, axes, location, distance, lens, perspective):
    """Project points as Blender does: its film of 36 mm spans the longer side of a view, twice as wide as a camera's."""
    seen = (points - location) @ axes.T - [0.0, 0.0, distance]
    size = np.array([VIEW.right - VIEW.left, VIEW.top - VIEW.bottom])
    half = 36.0 / lens * size / size.max()
    depth = -seen[:, 2:] if perspective else distance
    assert (np.asarray(depth) > 0).all()
    return (seen[:, :2] / (half * depth) + 1.0) / 2.0 * size + VIEW[:2]


@pytest.mark.parametrize("perspective", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_points_fill_the_free_part(perspective: bool, seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(20, 3)) * [1.0, 0.3, 2.0] + rng.normal(size=3)
    axes = Rotation.random(random_state=seed).as_matrix()
    free = free_part(VIEW, [("RIGHT", SIDEBAR), ("LEFT", TOOLBAR), ("TOP", HEADER), ("FLOAT", VIEW)])
    assert free == (156, 50, 820, 824)
    location, distance = place_view(points, axes, VIEW, free, 50.0, perspective)
    at = pixels(points, axes, location, distance, 50.0, perspective)
    size = np.array([free.right - free.left, free.top - free.bottom])
    low, high = (at.min(axis=0) - free[:2]) / size, (at.max(axis=0) - free[:2]) / size
    assert min(low.min(), (1.0 - high).min()) >= MARGIN - 1e-9
    assert (high - low).max() == pytest.approx(1.0 - 2.0 * MARGIN)  # as large as they can be
    assert low + high == pytest.approx(1.0, abs=1e-5)  # in the middle


def test_the_centre_of_rotation_is_at_the_depth_of_the_points() -> None:
    points = np.array([[0.0, 0.0, 3.0], [1.0, 2.0, 5.0]])
    location, _ = place_view(points, np.eye(3), VIEW, VIEW, 50.0, True)
    assert location[2] == 4.0


def test_a_single_point_gives_no_distance() -> None:
    assert place_view(np.ones((3, 3)), np.eye(3), VIEW, VIEW, 50.0, True)[1] == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("covers", "free"),
    [
        ([], VIEW),
        ([("RIGHT", HIDDEN)], (100, 50, 1179, 850)),
        ([("RIGHT", Rectangle(1180, 50, 1400, 850))], VIEW),  # beside the view
        ([("RIGHT", Rectangle(400, 50, 1180, 850))], VIEW),  # too little is left
        ([("BOTTOM", Rectangle(100, 50, 1180, 150))], (100, 150, 1180, 850)),
    ],
)
def test_bars_leave_a_part_free(covers: list[tuple[str, Rectangle]], free: Rectangle) -> None:
    assert free_part(VIEW, covers) == free

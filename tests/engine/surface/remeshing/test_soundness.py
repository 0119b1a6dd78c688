"""What is done to quads before they are judged: fillings of holes taken out, corners put back; and points to judge them by."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.surface.remeshing import soundness
from flexmaps.engine.surface.remeshing.bodies import target_surface
from flexmaps.engine.surface.remeshing.mend import TargetSurface, mesh_from_rows


def tube(around: int = 12, rings: int = 5) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """An open tube with quads over one end, which have no corners but those of the rim: vertices, tube and filling."""
    turns = 2 * np.pi * np.arange(around) / around
    circle = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    points = np.concatenate([np.column_stack([circle, np.full(around, 0.5 * k)]) for k in range(rings)])
    k, j = (g.ravel() for g in np.meshgrid(np.arange(rings - 1), np.arange(around), indexing="ij"))
    after = (j + 1) % around
    wall = np.stack([k * around + j, k * around + after, (k + 1) * around + after, (k + 1) * around + j], axis=1)
    end = np.arange(around // 2 - 1)
    return points, wall, np.stack([end + 1, end, around - 1 - end, around - 2 - end], axis=1)


def sheet(n: int = 6) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A flat strip of 2 x n quads with quads on its back, from rim to rim."""
    points = np.array([(x, y, 0) for x in range(n + 1) for y in range(3)], float)
    k = 3 * np.arange(n)[:, None]
    own = np.concatenate([np.column_stack([k + a, k + a + 3, k + a + 4, k + a + 1]) for a in (0, 1)])
    return points, own, np.column_stack([k, k + 2, k + 5, k + 3])


@pytest.mark.parametrize("filled", [tube(), sheet()], ids=["tube", "sheet"])
def test_an_open_side_that_was_filled_is_opened_again(filled: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    points, own, filling = filled
    target = target_surface(mesh_from_rows(points, np.concatenate([own[:, [0, 1, 2]], own[:, [0, 2, 3]]])))
    opened = soundness.reopen_holes(mesh_from_rows(points, np.concatenate([own, filling])), target)
    assert sorted(map(sorted, opened.corners.reshape(-1, 4).tolist())) == sorted(map(sorted, own.tolist()))


def triangle_target(points: np.ndarray) -> TargetSurface:
    return TargetSurface(np.column_stack([points, np.zeros(len(points))]), np.array([[0, 1, 2]]))


def test_one_large_triangle_has_points_all_over_it() -> None:
    """The mean of points of a triangle is its middle, and so many fall into each of the four into which its midpoints cut it."""
    corners = np.array([[0.0, 0.0], [6.0, 0.0], [1.0, 1.5]])
    points = triangle_target(corners).sample_points[:, :2]
    shares = np.linalg.solve((corners[1:] - corners[0]).T, (points - corners[0]).T).T
    shares = np.column_stack([1.0 - shares.sum(axis=1), shares])
    assert shares.min() >= 0.0 and shares.mean(axis=0) == pytest.approx(np.full(3, 1 / 3), abs=0.01)
    assert (shares > 0.5).mean(axis=0) == pytest.approx(np.full(3, 0.25), abs=0.01)


def test_border_vertices_are_put_onto_corners_that_were_cut_off() -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    whole = TargetSurface(square, np.array([[0, 1, 2], [0, 2, 3]]))
    n = np.linspace(0.0, 1.0, 6)
    x, y = (one.ravel() for one in np.meshgrid(n, n))
    k = (np.arange(5)[:, None] * 6 + np.arange(5)).ravel()
    rows = np.column_stack([k, k + 1, k + 7, k + 6])
    sound = np.column_stack([x, y, 0 * x])
    cut = sound.copy()
    cut[[0, 5, 30, 35]] += 0.06 * np.sign(0.5 - cut[[0, 5, 30, 35]]) * (1, 1, 0)
    made = soundness.snap_to_border_corners(mesh_from_rows(cut, rows), whole)
    assert made.vertices == pytest.approx(sound)

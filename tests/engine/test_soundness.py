"""Quads that fill holes are taken out again, before quads are judged."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.surface.remeshing import soundness
from flexmaps.engine.surface.remeshing.bodies import target_of
from flexmaps.engine.surface.remeshing.mend import of_rows


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
    target = target_of(of_rows(points, np.concatenate([own[:, [0, 1, 2]], own[:, [0, 2, 3]]])))
    opened = soundness.opened(of_rows(points, np.concatenate([own, filling])), target)
    assert sorted(map(sorted, opened.corners.reshape(-1, 4).tolist())) == sorted(map(sorted, own.tolist()))

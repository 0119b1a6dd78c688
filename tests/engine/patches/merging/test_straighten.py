"""Seams that a person would draw straight, on planar grids where the shortest cut is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from flexmaps.engine.params import LayoutParams
from flexmaps.engine.patches.flattening.flatten import FlatPatches
from flexmaps.engine.patches.merging.board import MergeBoard
from flexmaps.engine.patches.merging.straighten import natural_stops, straighten
from flexmaps.engine.progress import SILENT


def test_a_seam_with_a_step_becomes_straight(flat_grid: Callable[..., FlatPatches]) -> None:
    """Either half may slide to the other's line; the ends are farther away than a slide goes."""

    def stepped(x: float, y: float) -> bool:
        return (y < 2.0 and x == 12.0) or (y > 2.0 and x == 13.0) or (y == 2.0 and 12.0 < x < 13.0)

    layout = flat_grid(25, 4, cut=stepped).layout
    assert len(layout.patches) == 2 and layout.cut.sum() == 5
    board = MergeBoard(layout, LayoutParams())
    assert straighten(board, SILENT, darts=False)
    drawn = board.layout
    places = drawn.mesh.vertices[drawn.mesh.edges[drawn.cut]]
    assert drawn.cut.sum() == 4 and np.ptp(places[..., 0]) == 0.0
    assert not straighten(board, SILENT, darts=False)


def test_a_cut_may_end_at_its_corner_and_nowhere_on_a_straight_line(flat_grid: Callable[..., FlatPatches]) -> None:
    """Four edges to the right and two upwards, all inside a grid where every vertex has four edges."""
    mesh = flat_grid(7, 5, 1.0).layout.mesh
    way = np.array([[1.5, 2.0], [2.5, 2.0], [3.5, 2.0], [4.5, 2.0], [5.0, 2.5], [5.0, 3.5]])
    middles = mesh.vertices[mesh.edges].mean(axis=1)[:, :2]
    run = np.linalg.norm(middles - way[:, None], axis=2).argmin(axis=1)
    board = MergeBoard(flat_grid(7, 5, 1.0).layout, LayoutParams())
    assert natural_stops(board, run) == [0, 4, 6]
    assert natural_stops(board, run[:4]) == [0, 4]

"""Panels dissolved among their neighbours, on planar grids where the nearest neighbour is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from flexmaps.engine.params import LayoutParams
from flexmaps.engine.patches.flattening.flatten import FlatPatches
from flexmaps.engine.patches.layout import PatchLayout
from flexmaps.engine.patches.merging.board import MergeBoard
from flexmaps.engine.patches.merging.dissolve import _divide_among_neighbours, _pieces_across


def test_quads_amid_a_dissolved_panel_go_to_a_neighbour_too(flat_grid: Callable[..., FlatPatches]) -> None:
    """A panel of three by three quads between a left and a right half; no side of its middle quad lies at another panel."""

    def cut(x: float, y: float) -> bool:
        at_panel = (1 < y < 4 and x in (1, 4)) or (1 < x < 4 and y in (1, 4))
        return at_panel or (x == 3 and not 1 < y < 4)

    layout = flat_grid(5, 5, cut=cut).layout
    board = MergeBoard(layout, LayoutParams())
    middle = int(layout.patch_of[12])
    assert len(layout.patches) == 3 and len(layout.patches[middle]) == 9
    piece = board.pieces[int(board.piece_of[12])]
    ((opens, closes),) = _divide_among_neighbours(board, piece, _pieces_across(board, piece))
    after = layout.cut.copy()
    after[opens], after[closes] = False, True
    made = PatchLayout(layout.mesh, after)
    assert len(made.patches) == 2
    # nothing is cut within a panel
    one, two = layout.mesh.edge_quads[after].T
    assert (made.patch_of[one] != made.patch_of[two]).all()
    # the outer quads of the panel joined the half beside which they lie
    left, right = (
        made.patch_of[layout.mesh.centroids[:, 0].argmin()],
        made.patch_of[layout.mesh.centroids[:, 0].argmax()],
    )
    assert left != right and made.patch_of[11] in (left, right)
    np.testing.assert_array_equal(np.sort(np.concatenate(made.patches)), np.arange(25))

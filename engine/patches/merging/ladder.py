"""A series of layouts from many panels to few, in a single run of merging."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ...params import LayoutParams
from ...progress import SILENT, Progress
from ...surface.symmetry import Symmetry, preserved_by
from ...threads import one_thread
from ..layout import PatchLayout
from .board import Board
from .dissolve import dissolve
from .halve import leaves_plane
from .merge import LAST, effort_for, greedy
from .straighten import straighten, widen


@one_thread
def merge_in_steps(
    layout: PatchLayout,
    params: LayoutParams,
    shares: Sequence[float],
    symmetries: Sequence[Symmetry] = (),
    progress: Progress = SILENT,
    *,
    held: bool = False,
) -> list[PatchLayout]:
    """Merge patches greedily under rising distortion limits, each layout starting from the previous layout.

    This is much faster than ``merge``, which tries many strategies.

    Parameters
    ----------
    layout : layout to start from
    params : limits
    shares : shares of the distortion limit to use
    symmetries : symmetries of the mesh; the results keep the symmetries that ``layout`` has
    progress : called with the fraction done
    held : see ``merge``

    Returns
    -------
    a layout for every share, the smallest share first, up to the last layout before one that would stay flat
    """
    kept, effort, found = preserved_by(symmetries, layout.cut), effort_for(layout), list[PatchLayout]()
    for share in sorted(shares):
        limits = replace(params, distortion_limit=share * params.distortion_limit)
        board = Board(layout, limits, kept, effort, tick=lambda: progress(0.0))
        greedy(board, LAST, progress)
        straighten(board, progress, darts=True)
        widen(board)
        dissolve(board)
        if not (held or params.seamless or leaves_plane(board)):
            break
        layout = PatchLayout(layout.mesh, board.cut)
        found.append(layout)
    return found

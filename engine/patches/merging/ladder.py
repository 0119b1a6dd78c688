"""A series of layouts from many panels to few, in a single run of merging."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ...params import LayoutParams
from ...progress import SILENT, Progress
from ...surface.symmetry import Symmetry, preserved_by
from ...threads import one_thread
from ..layout import PatchLayout
from .board import MergeBoard
from .dissolve import dissolve_small
from .halve import needs_no_halving
from .merge import REPEAT_STRATEGY, merge_seams, work_budget
from .straighten import straighten, widen_necks


@one_thread
def merge_in_steps(
    layout: PatchLayout,
    params: LayoutParams,
    shares: Sequence[float],
    symmetries: Sequence[Symmetry] = (),
    progress: Progress = SILENT,
    *,
    has_supports: bool = False,
) -> list[PatchLayout]:
    """Merge patches greedily under rising distortion limits, each layout starting from the previous layout.

    This is much faster than ``merge``, which tries many strategies.

    Parameters
    ----------
    layout : layout to start from
    params : limits of the layout
    shares : shares of the distortion limit to use
    symmetries : symmetries of the mesh; the results keep the symmetries that ``layout`` has
    progress : called with the fraction done
    has_supports : see ``merge``

    Returns
    -------
    a layout for every share, the smallest share first; the list ends before the first layout that would stay flat
    """
    kept, effort, found = preserved_by(symmetries, layout.cut), work_budget(layout), list[PatchLayout]()
    for share in sorted(shares):
        limits = replace(params, distortion_limit=share * params.distortion_limit)
        board = MergeBoard(layout, limits, kept, effort, tick=lambda: progress(0.0))
        merge_seams(board, REPEAT_STRATEGY, progress)
        straighten(board, progress, darts=True)
        widen_necks(board)
        dissolve_small(board)
        if not (has_supports or params.seamless or needs_no_halving(board)):
            break
        layout = PatchLayout(layout.mesh, board.cut)
        found.append(layout)
    return found

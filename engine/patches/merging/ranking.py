"""Rank layouts of a surface: as few patches as possible, with as few faults as possible."""

from __future__ import annotations

import numpy as np

from ...params import LayoutParams
from ...progress import Progress
from ...surface.symmetry import Symmetry, preserved_by
from ..flattening.flatten import flatten, overlapping_patches, seam_mismatch
from ..layout import PatchLayout
from ..tracing.trace import middle_line
from .board import MergeBoard
from .straighten import fault_cost, seam_cost

# Largest difference in length of a seam edge's two flat sides, as a share of the edge, in a layout whose seams count as
# fitting; larger values accept more merges
MAX_MISMATCH = 0.1
# A layout with fewer symmetries replaces a more symmetric layout if it costs less than this share of that layout's cost;
# larger values give up symmetry for fewer patches
SYMMETRY_FACTOR = 0.5


class LayoutRanking:
    """Compares layouts of a surface.

    whole_group : symmetries of the surface
    """

    def __init__(self, whole_group: list[Symmetry]):
        self.whole_group = whole_group
        self._fitting: dict[bytes, bool] = {}

    def is_better(self, one: MergeBoard, two: MergeBoard, progress: Progress) -> bool:
        """Return whether layout ``one`` is clearly better than layout ``two``.

        A layout whose seams can be made to match is better than a layout whose seams cannot. Otherwise the cheaper layout
        is better; the cost is mainly the number of patches. If ``one`` has fewer symmetries, it must cost less than half
        of ``two``.
        """
        if (one.cut == two.cut).all():
            return False
        lost = len(preserved_by(self.whole_group, one.cut)) < len(preserved_by(self.whole_group, two.cut))
        a, b = cost_after_halving(one) + 0.01, (SYMMETRY_FACTOR if lost else 1.0) * cost_after_halving(two)
        if a < b:
            return self.can_match_seams(one, progress) or not self.can_match_seams(two, progress)
        return self.can_match_seams(one, progress) and not self.can_match_seams(two, progress)

    def is_poor(self, board: MergeBoard) -> bool:
        """Return whether a merged layout has necks or too small patches, so that other first cuts are worth trying."""
        sizes = np.array([len(quads) for quads in halve_long_patches(board.layout, board.params).patches])
        necks = sum(p.measures.isthmuses for p in board.pieces.values())
        return len(sizes) > 1 and (necks > 0 or sizes.min() < board.params.patch_min)

    def can_match_seams(self, board: MergeBoard, progress: Progress) -> bool:
        """Return whether both sides of all seams can be made equally long within the distortion limit."""
        key = np.packbits(board.cut).tobytes()
        if key not in self._fitting:
            self._fitting[key] = _can_match_seams(board, progress)
        return self._fitting[key]


def _can_match_seams(board: MergeBoard, progress: Progress) -> bool:
    """Flatten a layout and return whether seam mismatch, distortion and overlaps are within their limits."""
    if not board.cut.any():
        return all(p.flat.max_energy <= board.params.distortion_limit for p in board.pieces.values())
    flat = flatten(board.layout, board.params, progress, start=board.rotations())
    apart = seam_mismatch(flat)
    return bool(
        apart.max(initial=0.0) < MAX_MISMATCH
        and (not len(apart) or np.median(apart) < 0.3 * MAX_MISMATCH)
        and flat.energy.max() <= board.params.distortion_limit
        and not overlapping_patches(flat)
    )


def cost_after_halving(board: MergeBoard) -> float:
    """Return the cost of a layout after halving long patches: ``fault_cost`` plus a thousandth of ``seam_cost``."""
    pieces = board.pieces.values()
    more = len(halve_long_patches(board.layout, board.params).patches) - len(pieces)
    return more + fault_cost(board, pieces) + 1e-3 * seam_cost(board)


def layout_cost(board: MergeBoard) -> float:
    """Return the cost of a layout: number of patches and penalties, less for symmetry, plus length and corners of cuts.

    The reduction is 20 % for a mirror symmetry and up to 40 % for larger groups.
    """
    share = 0.6 + 0.4 / (1 + len(board.symmetries))
    return fault_cost(board, board.pieces.values()) * share + 1e-3 * seam_cost(board)


def halve_long_patches(layout: PatchLayout, params: LayoutParams) -> PatchLayout:
    """Return a layout in which patches less compact than allowed (long strips) are halved, repeatedly.

    A patch is not halved if its parts would be no more compact, or smaller than the smallest size.
    """
    for _ in range(20):
        cut = layout.cut.copy()
        for patch in np.flatnonzero(layout.compactness > params.compactness_limit * (1 + 1e-9)).tolist():
            line = middle_line(layout, patch)
            halves = layout.cut.copy()
            halves[line] = True
            tried = PatchLayout(layout.mesh, halves, layout.notes)
            parts = np.unique(tried.patch_of[layout.patches[patch]])
            small = min(len(tried.patches[n]) for n in parts)
            if (
                len(parts) > 1
                and small >= params.patch_min
                and (tried.compactness[parts] < layout.compactness[patch]).all()
            ):
                cut[line] = True
        if (cut == layout.cut).all():
            break
        layout = PatchLayout(layout.mesh, cut, layout.notes)
    return layout

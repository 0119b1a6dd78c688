"""Rank layouts of a surface: as few patches as possible, with as few faults as possible."""

from __future__ import annotations

import numpy as np

from ...params import LayoutParams
from ...progress import Progress
from ...surface.symmetry import Symmetry, keeping
from ..flattening.flatten import flatten, overlapping, seam_mismatch
from ..layout import PatchLayout
from ..tracing.trace import middle_line
from .board import Board
from .straighten import badness, drawing_cost

# Largest seam mismatch that the last merges may leave, as a share of an edge; 0.05 and 0.2 give the same on seven
# surfaces.
MISMATCH = 0.1
# An asymmetric layout must have less than this share of a symmetric layout's patches to replace it. Without the factor 2 of 30
# surfaces lose their symmetry for 20 > 12 and 14 > 12 patches
HALF = 0.5


class Ranking:
    """Compares layouts of a surface with given symmetries."""

    def __init__(self, whole_group: list[Symmetry]):
        self.whole_group = whole_group
        self._fitting: dict[bytes, bool] = {}

    def better(self, one: Board, two: Board, progress: Progress) -> bool:
        """Return whether layout ``one`` is clearly better than ``two``.

        A symmetric layout yields only to less than half as many patches.
        """
        if (one.cut == two.cut).all():
            return False
        lost = len(keeping(self.whole_group, one.cut)) < len(keeping(self.whole_group, two.cut))
        a, b = in_the_end(one) + 0.01, (HALF if lost else 1.0) * in_the_end(two)
        if a < b:
            return self.fits(one, progress) or not self.fits(two, progress)
        return self.fits(one, progress) and not self.fits(two, progress)

    def poor(self, board: Board) -> bool:
        """Return whether a merged layout is so poor that another way is worth trying."""
        sizes = np.array([len(quads) for quads in split_long(board.layout, board.params).patches])
        necks = sum(p.sketch.isthmuses for p in board.pieces.values())
        return len(sizes) > 1 and (necks > 0 or sizes.min() < board.params.patch_min)

    def fits(self, board: Board, progress: Progress) -> bool:
        """Return whether the seams' sides can still be made equally long within the distortion limit."""
        key = np.packbits(board.cut).tobytes()
        if key not in self._fitting:
            self._fitting[key] = _fits(board, progress)
        return self._fitting[key]


def _fits(board: Board, progress: Progress) -> bool:
    """Flatten a layout and check seam mismatch, distortion and overlaps."""
    if not board.cut.any():
        return all(p.flat.worst <= board.params.distortion_limit for p in board.pieces.values())
    flat = flatten(board.layout, board.params, progress, start=board.rotations())
    apart = seam_mismatch(flat)
    return bool(
        apart.max(initial=0.0) < MISMATCH
        and (not len(apart) or np.median(apart) < 0.3 * MISMATCH)
        and flat.energy.max() <= board.params.distortion_limit
        and not overlapping(flat)
    )


def in_the_end(board: Board) -> float:
    """Return the cost of a layout after its long patches are cut up: patches, faults, and drawing."""
    pieces = board.pieces.values()
    more = len(split_long(board.layout, board.params).patches) - len(pieces)
    return more + badness(board, pieces) + 1e-3 * drawing_cost(board)


def worth(board: Board) -> float:
    """Return the cost of a layout: patches and faults, reduced by up to 40 % for symmetry (a mirror: 20 %), plus the drawing of the cuts."""
    share = 0.6 + 0.4 / (1 + len(board.symmetries))
    return badness(board, board.pieces.values()) * share + 1e-3 * drawing_cost(board)


def split_long(layout: PatchLayout, params: LayoutParams) -> PatchLayout:
    """Halve patches less compact than allowed, as long as that helps: long strips that no merge absorbed."""
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

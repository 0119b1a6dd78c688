"""Which of several layouts of one surface is the best: as few patches as possible, with as little wrong with them."""

from __future__ import annotations

import numpy as np

from ...params import LayoutParams
from ...progress import Progress
from ...surface.symmetry import Symmetry, keeping
from ..flattening.flatten import flatten, overlapping, seam_mismatch
from ..layout import PatchLayout
from ..tracing.trace import middle_line
from .board import Board
from .straighten import LONG, badness, drawing_cost

# largest difference of a seam's sides that the last merges may leave, as a share of an edge; 0.05 and 0.2 give the same on seven
# surfaces
MISMATCH = 0.1
HALF = 0.5  # share of a symmetric layout's patches below which one without symmetry is better; chosen by eye
FEW = 40  # median quads a patch below which another way of laying out is tried; not measured


class Ranking:
    """Compares layouts of one surface with these symmetries."""

    def __init__(self, whole_group: list[Symmetry]):
        self.whole_group = whole_group
        self._fitting: dict[bytes, bool] = {}

    def better(self, one: Board, two: Board, progress: Progress) -> bool:
        """Is one layout better than another, and not only drawn a little otherwise?

        What is symmetric gives way only to less than half as many patches.
        """
        if (one.cut == two.cut).all():
            return False
        lost = len(keeping(self.whole_group, one.cut)) < len(keeping(self.whole_group, two.cut))
        a, b = in_the_end(one) + 0.01, (HALF if lost else 1.0) * in_the_end(two)
        if a < b:
            return self.fits(one, progress) or not self.fits(two, progress)
        return self.fits(one, progress) and not self.fits(two, progress)

    def poor(self, board: Board) -> bool:
        """Does a merged layout leave so much to be desired that another way is worth trying?"""
        sizes = np.array([len(quads) for quads in split_long(board.layout, board.params).patches])
        necks = sum(p.sketch.isthmuses for p in board.pieces.values())
        # what is symmetric would have to be beaten by half as many patches
        few = FEW * (HALF if keeping(self.whole_group, board.cut) else 1.0)
        return len(sizes) > 1 and (necks > 0 or sizes.min() < board.params.patch_min or float(np.median(sizes)) < few)

    def fits(self, board: Board, progress: Progress) -> bool:
        """Can the seams' sides still be brought to equal lengths, with so little distortion left to spend?"""
        key = np.packbits(board.cut).tobytes()
        if key not in self._fitting:
            self._fitting[key] = _fits(board, progress)
        return self._fitting[key]


def _fits(board: Board, progress: Progress) -> bool:
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
    """How much there is to a layout once its long patches are cut up: patches, what is wrong with them, and their drawing."""
    pieces, limit = board.pieces.values(), board.params.compactness_limit
    split = split_long(board.layout, board.params)
    total = len(split.patches) + badness(board, pieces) - len(pieces)
    # what is too long now is cut up then
    total += LONG * float(np.maximum(split.compactness - limit, 0.0).sum())
    total -= LONG * sum(max(p.sketch.compactness - limit, 0.0) for p in pieces)
    return total + 1e-3 * drawing_cost(board)


def worth(board: Board) -> float:
    """Patches, less what symmetry is worth: a mirror makes up for a fifth of them; then the drawing of the cuts."""
    share = 0.6 + 0.4 / (1 + len(board.symmetries))
    return badness(board, board.pieces.values()) * share + 1e-3 * drawing_cost(board)


def split_long(layout: PatchLayout, params: LayoutParams) -> PatchLayout:
    """Halve patches that are less compact than allowed, while that helps: long strips that no merge has taken in."""
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

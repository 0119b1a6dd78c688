"""Other layouts where the one of the fewest panels is predicted to stay far from the target: limits of distortion alone do not say how near a piece comes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ..errors import FlexMapsError
from ..params import ChooseParams
from ..patches.flattening.flatten import FlatPatches
from ..patches.flattening.report import forced_notes
from ..patches.layout import PatchLayout
from ..patches.merging.merge import merge
from ..progress import SILENT, Progress
from ..surface.curvature import is_flat
from ..threads import one_thread
from .judge import Idea, Piece, lay
from .lines import along_folds
from .predict import Start, predicted

SHARES = (0.5, 0.25)  # of the distortion limit, under which the surface is merged again
NEARER = 0.9  # of what is expected of another layout, from which this one is worth more panels; not measured
MOST = 2  # times the panels that the limits alone ask for
SEARCHED = 0.85  # of a prediction is left by a search: the median over 17 layouts of nine surfaces, of which it was 0.5 to 1.2 on all but one


@one_thread
def tightened(
    piece: Piece, begun: PatchLayout, flat: FlatPatches, params: ChooseParams, progress: Progress = SILENT
) -> FlatPatches:
    """Return a layout along folds, or one merged under tighter limits, where that is predicted to bring the piece as near as is wanted.

    Parameters
    ----------
    piece : the surface, how it is held, and what it is made of
    begun : the patches that ``flat`` was merged from
    flat : the layout that the limits of ``piece`` lead to
    params : the match that is wanted; where something else is, ``flat`` comes back

    Returns
    -------
    The first that holds the match, else the nearest of at most ``MOST`` times the panels, or ``flat`` itself. Its notes have
    ``expected_percent``, the distance (RMS) from the target that a search may leave, as a percentage of the size, and
    ``fewest_panels``, of ``flat``, where it is another.
    """
    if params.goal != "match" or piece.settings.simulate.model == "rod" or is_flat(piece.mesh):
        return flat
    progress(0.0, "Predicting the match")
    try:
        start = Start.from_layout(piece, flat, progress.quiet())
    except FlexMapsError:  # quads are too small for spirals, which the next stage tells
        return flat
    left = _expected(piece, flat, start, progress)
    if left == np.inf:
        return flat
    best, limits = flat, piece.settings.layout
    tries = _candidates(piece, begun, flat, progress.part(0.1, 1.0))
    while left > 0.01 * params.match and (one := next(tries, None)) is not None:
        fits = float(one.energy.max()) <= max(limits.distortion_limit, float(flat.energy.max()))
        if not fits or _panels(one) > MOST * _panels(flat) or np.array_equal(one.layout.cut, best.layout.cut):
            continue
        now = _expected(piece, one, start, progress)
        if now < NEARER * left:
            best, left = one, now
    notes = best.layout.notes
    if best is not flat:
        notes.pop("forced", None)
        notes |= forced_notes(best, limits) | {"fewest_panels": _panels(flat)}
    notes["expected_percent"] = 100.0 * left
    return best


def _candidates(piece: Piece, begun: PatchLayout, flat: FlatPatches, progress: Progress) -> Iterator[FlatPatches]:
    """The surface cut along its folds, then merged under tighter and tighter limits, until the next one may have too many panels."""
    for name, cut in along_folds(piece.mesh):
        laid = lay(piece, Idea(cut, name), progress=progress.quiet())
        if laid is not None:
            yield laid.flat
    limits, held = piece.settings.layout, piece.supports is not None and len(piece.supports) > 0
    last = flat
    for turn, share in enumerate(SHARES):
        if _panels(last) ** 2 > MOST * _panels(flat) ** 2:  # as many more again
            return
        part = progress.part(turn / len(SHARES), (turn + 1) / len(SHARES))
        last = merge(begun, replace(limits, distortion_limit=share * limits.distortion_limit), part, held=held)
        yield last


def _panels(flat: FlatPatches) -> int:
    return len(flat.layout.patches)


def _expected(piece: Piece, flat: FlatPatches, start: Start, progress: Progress) -> float:
    """What a search of a layout may leave of the distance from the target, as a share of the size; infinite where it takes no shape."""
    try:
        return SEARCHED * predicted(piece, flat, start, progress.quiet())
    except FlexMapsError:
        return np.inf

"""Replacement of the merged layout if it is predicted to stay far from the target.

Limits of distortion lead to few panels, but do not say how near to its target the piece comes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain, islice, zip_longest

import numpy as np

from ...errors import FlexMapsError
from ...optimisation.remedies import SOFTEST_LIMIT
from ...params import ChooseParams, LayoutParams
from ...patches.flattening.flatten import FlatPatches, flatten, with_corners
from ...patches.flattening.flattening_report import forced_notes, symmetry_kept
from ...patches.layout import PatchLayout, alone
from ...patches.merging.dissolve import without_crumbs
from ...patches.merging.merge import merge
from ...patches.splitting.split import split
from ...progress import SILENT, Progress
from ...surface.curvature import is_flat, relief
from ...surface.symmetry import keeping, symmetries
from ...threads import one_thread
from .drawn_cuts import along_folds, drop_images, equal_cuts
from .judge import Idea, LayoutProblem, lay_flat, panel_curvature, starting_spirals
from .predict import PredictionStart, predict
from .strain_forecast import strain_of_softest

SHARES = (0.5, 0.25)  # limits under which the surface is merged again, as shares of the distortion limit
# Largest ratio of the expected distances at which a layout replaces another one: 0.95 gives the same on four surfaces, 0.8 keeps tents in 2
# panels for 3
NEARER = 0.9
MOST = 2  # largest ratio of its panels to those of the layout that it replaces
# Steps that are added to the two of a prediction. With one, 30 of 51 layouts are within a factor of 1.5 of what a search reaches, and 6 on the wrong
# side of 1 %, with a rank correlation of 0.88; with none 23, 11 and 0.83; with two as many as with one, but three of 17 that miss 1 % are expected within it
FURTHER = 1
# Predictions begin with uniform spirals if these lower the expected distance to less than this share. Of 22 surfaces the share is 0.02 on one, which
# then ends as near as expected, and above 0.8 on all others
UNIFORM = 0.5
# Share of the wanted distance within which the expected one must lie. Of 16 surfaces three are expected at 0.92 to 0.96 %; two end at 0.76 and
# 0.78 %, and a head of 472 quads in 7 panels at 1.07 % with eight closed slots; in 12 panels it ends at 0.50 % with none
WANTED_SHARE = 0.9
# Largest expected distance that is kept, as a share of the distance of a flat piece: a prediction that begins with a flat piece stays flat, where
# searches come near with springs
RISEN = 0.95
# Most equal parts that are tried, most divisions that are laid flat, and most of those whose match is predicted: half and twice as many give the
# same on four surfaces, but tents keep 2 panels for 3 with one prediction.
# Layouts that may have more than PARTS panels are left out: of a head in 12 panels, no division into equal parts kept the limits
PARTS, LAID, PREDICTED = 8, 6, 3
# Factor on the limit of compactness for equal parts: strips of a square in four have 5, which is the default limit, of a curved square up to 5.4.
# Larger: longer strips. docs/tuning.md has the surfaces that it changes
STRIPS = 1.1

# Factors on the distortion limit within which panels below the smallest size may join a neighbour. Larger: fewer such panels; docs/tuning.md has
# the surfaces that it changes
LOOSER = 2.0, 4.0
PART = 0.2  # of the progress that is left, for each layout that is made and each that is predicted: there are 2 to 14
PREDICTING = "Predicting the match"


@one_thread
def tighten(
    piece: LayoutProblem, begun: PatchLayout, flat: FlatPatches, params: ChooseParams, progress: Progress = SILENT
) -> FlatPatches:
    """Return another layout if the present one is expected to miss the required match.

    The surface is cut along its folds, merged under tighter limits, or divided into equal parts. A layout along the folds also
    replaces one with more panels, if both are expected to meet the match. Panels below the smallest size join others beyond the distortion limit
    if the expected match does not suffer. Every connected body is a piece of its own, of its own size.

    Parameters
    ----------
    piece : the surface, how it is held, and what it is made of
    begun : the patches that ``flat`` was merged from
    flat : the present layout, merged under the limits in the settings of ``piece``
    params : the required match; with any other goal ``flat`` is returned

    Returns
    -------
    For every body the first layout that is expected within ``WANTED_SHARE`` of the match, else the one that is expected nearest; ``flat`` itself if no
    other is better. Layouts are compared with the cuts that their panels need to fit the sheet, and may then have at most ``MOST`` times as many panels
    as ``flat``; the returned layout is without these cuts. The notes of the layout have ``expected_percent``, the RMS distance from the target with
    which a search may end, as a percentage of the size; not where it cannot be predicted, or is that of a flat piece. If
    arms are likely to break, the notes have ``strain_softest`` (see ``strain_of_softest``) instead.
    """
    mesh = piece.mesh
    if params.goal != "match" or piece.settings.simulate.model == "rod" or is_flat(mesh):
        return flat
    improve = _tighten_bodies if mesh.body_of.any() else _tighten_body
    best, expected = improve(piece, begun, flat, params, progress.part(0.0, 0.95).rising())
    strain = strain_of_softest(piece, best, progress.part(0.95, 1.0).saying(PREDICTING).rising())
    if strain is not None and strain > SOFTEST_LIMIT:
        best.layout.notes["strain_softest"] = strain
    elif expected < RISEN * relief(mesh.centroids) / mesh.diagonal:
        best.layout.notes["expected_percent"] = 100.0 * expected
    return best


def _tighten_bodies(
    piece: LayoutProblem, begun: PatchLayout, flat: FlatPatches, params: ChooseParams, progress: Progress
) -> tuple[FlatPatches, float]:
    """Return a layout of several connected bodies, each as ``_tighten_body`` finds it, and the expected distance of all."""
    mesh, spirals = piece.mesh, starting_spirals(piece)  # from the curvature of all bodies, as in the search
    piece = replace(piece, spirals=spirals)
    cut, corners, squares = flat.layout.cut.copy(), flat.corners, 0.0
    ends = np.cumsum(np.bincount(mesh.body_of)) / len(mesh.quads)
    for body, end in enumerate(ends.tolist()):
        quads = np.flatnonzero(mesh.body_of == body)
        layout, edges = alone(flat.layout, quads)
        first = PatchLayout(layout.mesh, begun.cut[edges], origin=begun.origin)
        present, own = with_corners(layout, corners[quads]), piece.restrict_to(layout.mesh, quads)
        within = progress.part(end - len(quads) / len(mesh.quads), end)
        found, expected = _tighten_body(own, first, present, params, within)
        cut[edges], corners[quads] = found.layout.cut, found.corners
        squares += len(quads) * (expected * layout.mesh.diagonal) ** 2
    if (cut != flat.layout.cut).any():
        notes = {key: value for key, value in flat.layout.notes.items() if key != "forced"}
        flat = with_corners(PatchLayout(mesh, cut, notes, flat.layout.origin), corners)
        notes |= forced_notes(flat, _with_longer_strips(piece.settings.layout))
    return flat, float(np.sqrt(squares / len(mesh.quads))) / mesh.diagonal


def _tighten_body(
    piece: LayoutProblem, begun: PatchLayout, flat: FlatPatches, params: ChooseParams, progress: Progress
) -> tuple[FlatPatches, float]:
    """Return the best layout of one connected body, and its expected distance as a share of its size; infinite if none can be predicted."""
    if is_flat(piece.mesh):
        return flat, 0.0
    parts = progress.shares(PART)
    try:
        start = PredictionStart.from_layout(piece, flat, next(parts).saying(PREDICTING))
    except FlexMapsError:  # quads are too small for spirals; the next stage reports it
        return flat, np.inf
    best, fitted = flat, _fit_sheet(piece, flat, progress)
    left, most = _expected(piece, fitted, start, next(parts)), MOST * _panels(fitted)
    if left == np.inf:
        return flat, left
    limits, wanted = piece.settings.layout, WANTED_SHARE * 0.01 * params.match
    if left > wanted:  # a search begins with uniform spirals too
        uniform = start.with_uniform_spirals()
        from_uniform = _expected(piece, fitted, uniform, next(parts))
        if from_uniform < UNIFORM * left:
            start, left = uniform, from_uniform
    tries = _along_folds(piece, progress)
    if left > wanted:
        tighter = _under_tighter_limits(piece, begun, flat, most, parts)
        tries = chain(tries, tighter, islice(_in_equal_parts(piece, flat, most, parts), PREDICTED))
    for one in tries:
        other = _fit_sheet(piece, one, progress)
        fewer = _panels(other) < _panels(fitted)
        fits = float(one.energy.max()) <= max(limits.distortion_limit, float(flat.energy.max()))
        same = np.array_equal(other.layout.cut, fitted.layout.cut)
        if fits and not same and _panels(other) <= most and (fewer or left > wanted):
            now = _expected(piece, other, start, next(parts))
            if now < NEARER * left or (fewer and now <= wanted):
                best, fitted, left = one, other, now
        if left <= wanted:
            break
    best, left = _join_small(piece, best, start, left, wanted, parts)
    if best is not flat:
        notes = best.layout.notes
        notes.pop("forced", None)
        notes |= forced_notes(best, _with_longer_strips(limits)) | _symmetry_notes(best, symmetric=limits.symmetric)
    return best, left


def _join_small(
    piece: LayoutProblem,
    flat: FlatPatches,
    start: PredictionStart,
    left: float,
    wanted: float,
    parts: Iterator[Progress],
) -> tuple[FlatPatches, float]:
    """Return the layout with panels below the smallest size joined to more distorted ones where the match bears it, and its expected distance.

    left, wanted : expected and required distance; parts : of the progress
    """
    limits = piece.settings.layout
    if _smallest(flat) >= limits.patch_min:
        return flat, left
    kept = symmetries(piece.mesh, progress=next(parts).quiet()) if limits.symmetric else ()
    for factor in LOOSER:
        if _smallest(flat) >= limits.patch_min:
            break
        part, looser = next(parts), replace(limits, distortion_limit=factor * limits.distortion_limit)
        joined = without_crumbs(flat.layout, looser, kept, part.quiet())
        if joined is not flat.layout:
            other = flatten(joined, looser, part.quiet())
            now = _expected(piece, _fit_sheet(piece, other, part), start, part)
            if now <= max(left, wanted):
                flat, left = other, now
    return flat, left


def _smallest(flat: FlatPatches) -> int:
    """Return the number of quads of the smallest panel."""
    return min(len(quads) for quads in flat.layout.patches)


def _along_folds(piece: LayoutProblem, progress: Progress) -> Iterator[FlatPatches]:
    """Yield the surface cut along its folds, if it has any."""
    for name, cut in along_folds(piece.mesh):
        laid = lay_flat(piece, Idea(cut, name), progress=progress.quiet())
        if laid is not None:
            yield laid.flat


def _under_tighter_limits(
    piece: LayoutProblem, begun: PatchLayout, flat: FlatPatches, most: int, parts: Iterator[Progress]
) -> Iterator[FlatPatches]:
    """Yield layouts merged under ever tighter limits, small panels and necks joined to neighbours, until the next one may have too many panels.

    most : largest number of panels; parts : of the progress, one for each merge
    """
    limits, last = piece.settings.layout, flat
    kept = symmetries(piece.mesh, progress=next(parts).quiet()) if limits.symmetric else ()
    for share in SHARES:
        if _panels(last) ** 2 > most * _panels(flat):  # if it grew by as much again it would have more
            return
        part = next(parts)
        last = merge(
            begun, replace(limits, distortion_limit=share * limits.distortion_limit), part, held=piece.is_loaded
        )
        joined = without_crumbs(last.layout, limits, kept, part.quiet())
        yield last if joined is last.layout else flatten(joined, limits, part.quiet())


def _in_equal_parts(
    piece: LayoutProblem, flat: FlatPatches, most: int, parts: Iterator[Progress]
) -> Iterator[FlatPatches]:
    """Yield layouts of equal strips, rings or petals that keep all limits, with the limit of compactness raised by the factor ``STRIPS``.

    The least distorted layout of each number of panels is yielded, the fewest panels first. On smooth tubes and strips the first cuts may leave too few
    panels to come near the target, and tighter limits do not add any.

    most : largest number of panels; parts : of the progress
    """
    mesh, limits = piece.mesh, piece.settings.layout
    if most > PARTS:
        return
    progress = next(parts)
    curved = panel_curvature(flat.layout)
    found = symmetries(mesh, progress=progress.quiet()) if limits.symmetric else []
    sketches: dict[int, list[tuple[float, int, Idea]]] = {}  # by number of parts
    for number, (name, cut) in enumerate(drop_images(equal_cuts(mesh, most, found), found)):
        sketch = PatchLayout(mesh, cut)
        if len(sketch.patches) <= most:
            rated = round(panel_curvature(sketch), 9), number, Idea(cut, name)
            sketches.setdefault(len(sketch.patches), []).append(rated)
    # the least curved of each number of parts first, then the second of each
    ranked = [one for same in zip_longest(*map(sorted, sketches.values())) for one in same if one is not None]
    best: dict[int, FlatPatches] = {}
    for _, _, idea in progress.each(ranked[:LAID], "Dividing into equal parts"):
        laid = lay_flat(piece, idea, curved, progress.quiet())
        if laid is not None and not forced_notes(laid.flat, _with_longer_strips(limits)):
            known = best.get(laid.panels)
            if known is None or laid.flat.energy.max() < known.energy.max():
                best[laid.panels] = laid.flat
    yield from (best[panels] for panels in sorted(best))


def _with_longer_strips(limits: LayoutParams) -> LayoutParams:
    """Return the limits with the compactness that equal parts may have; notes on tightened layouts name only panels beyond it."""
    return replace(limits, compactness_limit=STRIPS * limits.compactness_limit)


def _symmetry_notes(flat: FlatPatches, *, symmetric: bool) -> dict[str, object]:
    """Return notes on the symmetries that a layout keeps; none if it has them, if the surface has no symmetry, or if it need not be symmetric."""
    layout = flat.layout
    if "symmetry" in layout.notes or not symmetric:
        return {}
    found = symmetries(layout.mesh)
    said, text = symmetry_kept(found, keeping(found, layout.cut))
    return said | {"symmetry": text} if found else {}


def _panels(flat: FlatPatches) -> int:
    return len(flat.layout.patches)


def _fit_sheet(piece: LayoutProblem, flat: FlatPatches, progress: Progress) -> FlatPatches:
    """Return a layout with the cuts that its panels need to fit the sheet; unchanged where quads alone do not fit."""
    try:
        return split(flat, piece.settings.layout, piece.settings.sheet, progress.quiet())
    except FlexMapsError:  # the next stage reports it
        return flat


def _expected(piece: LayoutProblem, flat: FlatPatches, start: PredictionStart, progress: Progress) -> float:
    """Return the RMS distance with which a search of a layout may end, as a share of the size; infinite without an equilibrium."""
    return predict(piece, flat, start, progress.saying(PREDICTING), further=FURTHER)

"""Replace the merged layout if it is predicted to stay too far from the target.

Merging under a distortion limit gives few panels, but does not tell how near the piece comes to its target.
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
from ...patches.layout import PatchLayout, sublayout
from ...patches.merging.dissolve import join_small_panels
from ...patches.merging.merge import merge
from ...patches.splitting.split import split_to_sheet
from ...progress import SILENT, Progress
from ...surface.curvature import is_flat, relief
from ...surface.symmetry import preserved_by, symmetries
from ...threads import one_thread
from .drawn_cuts import cuts_along_folds, drop_symmetric_images, equal_part_cuts
from .judge import CutPlan, LayoutProblem, flatten_cuts, panel_curvature, starting_spirals
from .predict import PredictionStart, predict
from .strain_forecast import strain_of_softest

DISTORTION_SHARES = (
    0.5,
    0.25,
)  # shares of the distortion limit under which the surface is merged again; smaller: more panels
# A layout replaces another if its expected distance from the target is below this multiple of the other's; larger: more
# panels
REPLACEMENT_RATIO = 0.9
MAX_PANEL_GROWTH = (
    2  # largest ratio of panels to those of the present layout; larger: nearer to the target, more panels
)
# Number of steps that a prediction extrapolates beyond its two Gauss-Newton steps. Larger: smaller expected distances;
# 0 predicts worse, 2 is sometimes too optimistic
EXTRA_STEPS = 1
# Predictions start from uniform spirals if these reduce the expected distance below this share of the distance with
# ``starting_spirals``; larger: more often
UNIFORM_RATIO = 0.5
# Largest expected distance of a layout, as a share of the required distance; larger: fewer panels, less certain
WANTED_SHARE = 0.9
# Largest expected distance to report, as a share of a flat piece's distance from the target; if it is larger, the
# predicted piece stayed nearly flat, and the figure would mislead
MAX_REPORTED_SHARE = 0.95
# Division into equal parts: largest number of panels, of divisions to flatten, and of divisions to predict; larger:
# more layouts, more time
MAX_EQUAL_PARTS, MAX_FLATTENED, MAX_PREDICTED = 8, 6, 3
# Factor on the compactness limit for equal parts; larger: longer strips. docs/tuning.md lists surfaces that need them
STRIP_FACTOR = 1.1

# Factors on the distortion limit up to which panels below the smallest size may join a neighbour; larger: fewer small
# panels. docs/tuning.md lists the surfaces that they change
LOOSE_FACTORS = 2.0, 4.0
PROGRESS_PART = 0.2  # share of the remaining progress for each layout that is made or predicted; only for the display
PREDICTING_TEXT = "Predicting the match"


@one_thread
def refine_merged(
    piece: LayoutProblem, begun: PatchLayout, flat: FlatPatches, params: ChooseParams, progress: Progress = SILENT
) -> FlatPatches:
    """Return another layout if the present one is expected to miss the required match.

    Cuts along the folds, merging under tighter limits and division into equal parts are tried in this order. A layout
    cut along the folds also replaces one with more panels if it is expected to meet the match. Panels below the
    smallest size may join neighbours beyond the distortion limit if the expected match does not suffer. Each connected
    body is treated as a piece of its own.

    Parameters
    ----------
    piece : the surface, its supports and forces, and the settings
    begun : the patches that ``flat`` was merged from
    flat : the present layout, merged under the limits in the settings of ``piece``
    params : goal and required match; ``flat`` is returned unless the goal is a match
    progress : called with the fraction done; may cancel

    Returns
    -------
    for each body the first layout whose expected distance is below ``WANTED_SHARE`` of the match, else the one with the
    least expected distance; ``flat`` itself if no other is better.

    Layouts are compared after panels that are too large for a sheet were cut. They may then have at most
    ``MAX_PANEL_GROWTH`` times as many panels as ``flat``. The returned layout does not contain these cuts.

    ``expected_percent`` is written to the notes of the layout: the RMS distance from the target that a search is
    expected to reach, as a percentage of the size. It is left out if it cannot be predicted or nearly equals a flat
    piece's distance. If arms are likely to break, ``strain_softest`` (see ``strain_of_softest``) is written instead.
    """
    mesh = piece.mesh
    if params.goal != "match" or piece.settings.simulate.model == "rod" or is_flat(mesh):
        return flat
    improve = _refine_bodies if mesh.body_of.any() else _refine_body
    best, expected = improve(piece, begun, flat, params, progress.part(0.0, 0.95).rising())
    strain = strain_of_softest(piece, best, progress.part(0.95, 1.0).saying(PREDICTING_TEXT).rising())
    if strain is not None and strain > SOFTEST_LIMIT:
        best.layout.notes["strain_softest"] = strain
    elif expected < MAX_REPORTED_SHARE * relief(mesh.centroids) / mesh.diagonal:
        best.layout.notes["expected_percent"] = 100.0 * expected
    return best


def _refine_bodies(
    piece: LayoutProblem, begun: PatchLayout, flat: FlatPatches, params: ChooseParams, progress: Progress
) -> tuple[FlatPatches, float]:
    """Apply ``_refine_body`` to each connected body; return the whole layout and its expected RMS distance from the
    target, a share of the whole surface's size."""
    mesh, spirals = piece.mesh, starting_spirals(piece)  # computed for all bodies together, as the search does
    piece = replace(piece, spirals=spirals)
    cut, corners, squares = flat.layout.cut.copy(), flat.corners, 0.0
    ends = np.cumsum(np.bincount(mesh.body_of)) / len(mesh.quads)
    for body, end in enumerate(ends.tolist()):
        quads = np.flatnonzero(mesh.body_of == body)
        layout, edges = sublayout(flat.layout, quads)
        first = PatchLayout(layout.mesh, begun.cut[edges], origin=begun.origin)
        present, own = with_corners(layout, corners[quads]), piece.restrict_to(layout.mesh, quads)
        within = progress.part(end - len(quads) / len(mesh.quads), end)
        found, expected = _refine_body(own, first, present, params, within)
        cut[edges], corners[quads] = found.layout.cut, found.corners
        squares += len(quads) * (expected * layout.mesh.diagonal) ** 2
    if (cut != flat.layout.cut).any():
        notes = {key: value for key, value in flat.layout.notes.items() if key != "forced"}
        flat = with_corners(PatchLayout(mesh, cut, notes, flat.layout.origin), corners)
        notes |= forced_notes(flat, _with_longer_strips(piece.settings.layout))
    return flat, float(np.sqrt(squares / len(mesh.quads))) / mesh.diagonal


def _refine_body(
    piece: LayoutProblem, begun: PatchLayout, flat: FlatPatches, params: ChooseParams, progress: Progress
) -> tuple[FlatPatches, float]:
    """Return the best layout of one connected body and its expected distance from the target.

    The distance is a share of the body's size, infinite if it cannot be predicted. See ``refine_merged``.
    """
    if is_flat(piece.mesh):
        return flat, 0.0
    parts = progress.shares(PROGRESS_PART)
    try:
        start = PredictionStart.from_layout(piece, flat, next(parts).saying(PREDICTING_TEXT))
    except FlexMapsError:  # quads are too small for spirals; the next stage reports this
        return flat, np.inf
    best, fitted = flat, _fit_sheet(piece, flat, progress)
    left, most = _predict_match(piece, fitted, start, next(parts)), MAX_PANEL_GROWTH * _count_panels(fitted)
    if left == np.inf:
        return flat, left
    limits, wanted = piece.settings.layout, WANTED_SHARE * 0.01 * params.match
    if left > wanted:  # searches try uniform spirals as a second start, so predictions do too
        uniform = start.with_uniform_spirals()
        from_uniform = _predict_match(piece, fitted, uniform, next(parts))
        if from_uniform < UNIFORM_RATIO * left:
            start, left = uniform, from_uniform
    tries = _along_folds(piece, progress)
    if left > wanted:
        tighter = _under_tighter_limits(piece, begun, flat, most, parts)
        tries = chain(tries, tighter, islice(_in_equal_parts(piece, flat, most, parts), MAX_PREDICTED))
    for one in tries:
        other = _fit_sheet(piece, one, progress)
        fewer = _count_panels(other) < _count_panels(fitted)
        fits = float(one.energy.max()) <= max(limits.distortion_limit, float(flat.energy.max()))
        same = np.array_equal(other.layout.cut, fitted.layout.cut)
        if fits and not same and _count_panels(other) <= most and (fewer or left > wanted):
            now = _predict_match(piece, other, start, next(parts))
            if now < REPLACEMENT_RATIO * left or (fewer and now <= wanted):
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
    """Join panels that are too small to neighbours under looser distortion limits, unless the match suffers.

    Parameters
    ----------
    piece : the surface and settings
    flat : the layout
    start : start of the predictions
    left, wanted : expected and required distance, shares of the size
    parts : successive parts of the progress

    Returns
    -------
    the layout, unchanged if nothing could be joined, and its expected distance
    """
    limits = piece.settings.layout
    if _min_panel_quads(flat) >= limits.patch_min:
        return flat, left
    kept = symmetries(piece.mesh, progress=next(parts).quiet()) if limits.symmetric else ()
    for factor in LOOSE_FACTORS:
        if _min_panel_quads(flat) >= limits.patch_min:
            break
        part, looser = next(parts), replace(limits, distortion_limit=factor * limits.distortion_limit)
        joined = join_small_panels(flat.layout, looser, kept, part.quiet())
        if joined is not flat.layout:
            other = flatten(joined, looser, part.quiet())
            now = _predict_match(piece, _fit_sheet(piece, other, part), start, part)
            if now <= max(left, wanted):
                flat, left = other, now
    return flat, left


def _min_panel_quads(flat: FlatPatches) -> int:
    """Return the number of quads of the smallest panel."""
    return min(len(quads) for quads in flat.layout.patches)


def _along_folds(piece: LayoutProblem, progress: Progress) -> Iterator[FlatPatches]:
    """Yield the layout cut along the folds of the surface, if it has folds."""
    for name, cut in cuts_along_folds(piece.mesh):
        laid = flatten_cuts(piece, CutPlan(cut, name), progress=progress.quiet())
        if laid is not None:
            yield laid.flat


def _under_tighter_limits(
    piece: LayoutProblem, begun: PatchLayout, flat: FlatPatches, most: int, parts: Iterator[Progress]
) -> Iterator[FlatPatches]:
    """Yield layouts merged under ever tighter distortion limits, until the next would have too many panels.

    begun : the patches from which merging starts; flat : the present layout
    most : largest number of panels; parts : successive parts of the progress
    """
    limits, last = piece.settings.layout, flat
    kept = symmetries(piece.mesh, progress=next(parts).quiet()) if limits.symmetric else ()
    for share in DISTORTION_SHARES:
        # if the number of panels grew by the same factor again, it would exceed the largest number
        if _count_panels(last) ** 2 > most * _count_panels(flat):
            return
        part = next(parts)
        last = merge(
            begun, replace(limits, distortion_limit=share * limits.distortion_limit), part, has_supports=piece.is_loaded
        )
        joined = join_small_panels(last.layout, limits, kept, part.quiet())
        yield last if joined is last.layout else flatten(joined, limits, part.quiet())


def _in_equal_parts(
    piece: LayoutProblem, flat: FlatPatches, most: int, parts: Iterator[Progress]
) -> Iterator[FlatPatches]:
    """Yield layouts of equal strips, rings or petals within all limits; that of compactness is ``STRIP_FACTOR`` larger.

    For each number of panels the least distorted layout is yielded, fewest panels first. Smooth tubes and strips need
    such layouts: tracing may give them too few patches to come near the target, and merging never adds patches.

    flat : the present layout; most : largest number of panels; parts : successive parts of the progress
    """
    mesh, limits = piece.mesh, piece.settings.layout
    if most > MAX_EQUAL_PARTS:
        return
    progress = next(parts)
    curved = panel_curvature(flat.layout)
    found = symmetries(mesh, progress=progress.quiet()) if limits.symmetric else []
    # by number of parts: curvature of the most curved panel, number in the order of making, and cuts of each division
    sketches: dict[int, list[tuple[float, int, CutPlan]]] = {}
    for number, (name, cut) in enumerate(drop_symmetric_images(equal_part_cuts(mesh, most, found), found)):
        sketch = PatchLayout(mesh, cut)
        if len(sketch.patches) <= most:
            rated = round(panel_curvature(sketch), 9), number, CutPlan(cut, name)
            sketches.setdefault(len(sketch.patches), []).append(rated)
    # first, for each number of parts, the division with the least curved panels; then the second best for each, etc.
    ranked = [one for same in zip_longest(*map(sorted, sketches.values())) for one in same if one is not None]
    best: dict[int, FlatPatches] = {}
    for _, _, idea in progress.each(ranked[:MAX_FLATTENED], "Dividing into equal parts"):
        laid = flatten_cuts(piece, idea, curved, progress.quiet())
        if laid is not None and not forced_notes(laid.flat, _with_longer_strips(limits)):
            known = best.get(laid.panels)
            if known is None or laid.flat.energy.max() < known.energy.max():
                best[laid.panels] = laid.flat
    yield from (best[panels] for panels in sorted(best))


def _with_longer_strips(limits: LayoutParams) -> LayoutParams:
    """Return a copy of the limits with the compactness limit multiplied by ``STRIP_FACTOR``."""
    return replace(limits, compactness_limit=STRIP_FACTOR * limits.compactness_limit)


def _symmetry_notes(flat: FlatPatches, *, symmetric: bool) -> dict[str, object]:
    """Return notes for users on the symmetries that a layout keeps.

    Empty if the layout already has such notes, if it need not be ``symmetric``, or if the surface has no symmetry.
    """
    layout = flat.layout
    if "symmetry" in layout.notes or not symmetric:
        return {}
    found = symmetries(layout.mesh)
    said, text = symmetry_kept(found, preserved_by(found, layout.cut))
    return said | {"symmetry": text} if found else {}


def _count_panels(flat: FlatPatches) -> int:
    return len(flat.layout.patches)


def _fit_sheet(piece: LayoutProblem, flat: FlatPatches, progress: Progress) -> FlatPatches:
    """Return the layout with cuts through panels that do not fit the sheet; unchanged if single quads do not fit."""
    try:
        return split_to_sheet(flat, piece.settings.layout, piece.settings.sheet, progress.quiet())
    except FlexMapsError:  # the next stage reports this
        return flat


def _predict_match(piece: LayoutProblem, flat: FlatPatches, start: PredictionStart, progress: Progress) -> float:
    """Predict the RMS distance that a search would reach, a share of the size; infinite without an equilibrium."""
    return predict(piece, flat, start, progress.saying(PREDICTING_TEXT), further=EXTRA_STEPS)

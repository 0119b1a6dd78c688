"""Nesting: lay the true shapes of the panels on equal sheets as tightly as a time limit permits, with spyrrow.

spyrrow (the sparrow algorithm of Gardeyn, Vanden Berghe and Wauters 2025) packs a strip of fixed height as short as it
can. ``sheet_search`` looks for sets of panels whose strip is no longer than a sheet. The quick packing is computed first and
returned if the search finds nothing better in time.
"""

from __future__ import annotations

import importlib.util
from dataclasses import replace

import numpy as np

from ...arrays import Float
from ...params import SheetParams
from ...progress import SILENT, Progress
from .odd import on_remnants
from .packing import Packing, pack, used_length
from .process import python
from .remnants import read
from .sheet_search import NestingSearch
from .strips import FINE_SECONDS

PATIENCE = 4  # successive orders without an improvement before the time per set is doubled
# Number of packings whose emptiest sheet is compacted in the end, and the share of the remaining time for compacting
# the best with fine outlines
TOPS, FINEST = 3, 0.5
# maximum number of panels for the search; with more, the quick packing fills sheets as well in the usual time
MANY = 400


def nest(shapes: list[Float[np.ndarray, "_ 2"]], params: SheetParams, progress: Progress = SILENT) -> Packing:
    """Lay closed outlines (M, 2), in metres, on as few sheets as found within ``params.nesting_seconds``.

    Remnants come first and are filled by
    ``odd``.

    The result is never worse than that of ``packing.pack``, which is returned where spyrrow is missing or finds nothing
    better. The seed makes the search repeatable as far as a limit in seconds can be.

    Parameters
    ----------
    shapes : closed outlines, metres; with their grain along x where they must lie along the sheet's
    params : size of the sheets, margin, spacing, remnants and time limit
    progress : called with the fraction done; may cancel
    """
    remnants = read(params.remnants, params.remnant_unit) if params.remnants.strip() else []
    if remnants:
        odd, rest = on_remnants(shapes, remnants, params, progress.part(0.0, 0.2))
        whole = replace(params, remnants="")
        return _append_sheets(
            odd, rest, nest([shapes[i] for i in rest], whole, progress.part(0.2, 1.0)) if rest else None
        )
    sheet = (params.sheet_width, params.sheet_height)
    rough = pack(shapes, sheet, params.margin, params.spacing, progress.part(0.0, 0.1), params.rotation)
    if params.nesting != "TRUE" or not available() or not 2 <= len(shapes) <= MANY:
        return rough
    search = NestingSearch(shapes, params, progress.part(0.1, 1.0))
    try:
        return _search_packings(search, rough)
    finally:
        search.finish()


def _append_sheets(odd: Packing, rest: list[int], whole: Packing | None) -> Packing:
    """Join a packing on remnants with whole sheets for the panels ``rest``."""
    if whole is None:
        return odd
    sheet, rotation, shift = odd.sheet.copy(), odd.rotation.copy(), odd.shift.copy()
    sheet[rest], rotation[rest], shift[rest] = len(odd.sizes) + whole.sheet, whole.rotation, whole.shift
    return Packing(sheet, rotation, shift, np.concatenate([odd.sizes, whole.sizes]), odd.remnants)


def _search_packings(search: NestingSearch, rough: Packing) -> Packing:
    """Return the best packing that the search finds, or the rough one."""
    shapes, params = search.shapes, search.params
    tops, idle = [(search.needed(rough), rough)], 0
    rng = np.random.default_rng(params.seed)
    # with the minimum number of sheets, other packings may leave a larger offcut
    while len(tops[0][1].sizes) - len(search.large) > 1 and search.going:
        search.tell(len(shapes))
        found = search.emptied(search.fill(rng, rough))
        need, idle = search.needed(found), idle + 1
        new = all(abs(need - known) > 1e-6 for known, _ in tops)
        if new and (len(tops) < TOPS or need < tops[-1][0]) and _keeps_distances(found, shapes, params):
            idle = 0 if need < tops[0][0] else idle
            tops = sorted([*tops, (need, found)], key=lambda one: one[0])[:TOPS]
        if idle == PATIENCE:
            idle = 0
            if not (search.strips.answered and search.harder()):
                break
    # packings on more sheets cannot become the best any more
    return _compact(search, rough, [one for _, one in tops if len(one.sizes) == len(tops[0][1].sizes)])


def _compact(search: NestingSearch, rough: Packing, tops: list[Packing]) -> Packing:
    """Compact the emptiest sheet of each packing and return the best packing.

    The emptiest sheet of the best packing is compacted again with fine outlines if time is left.
    """
    shapes, params, made = search.shapes, search.params, list[Packing]()
    last = FINEST * (1.0 - search.spent())
    last = last if last * params.nesting_seconds >= FINE_SECONDS else 0.0
    for number, one in enumerate(tops):
        if number and search.spent() >= 1.0 - last:
            break
        made.append(search.shortened(one, (1.0 - last - search.spent()) / (len(tops) - number)))
    best = _best([rough, *tops], made, shapes, params)
    if not last:
        return best
    return _best([best], [search.shortened(best, 1.0 - search.spent(), fine=True)], shapes, params)


def _best(known: list[Packing], made: list[Packing], shapes: list[np.ndarray], params: SheetParams) -> Packing:
    """Return the packing with the fewest sheets and the largest offcut; new packings must keep the required distances."""
    new = [one for one in made if all(one is not other for other in known) and _keeps_distances(one, shapes, params)]
    return min([*known, *new], key=lambda one: (len(one.sizes), _shortest(one, shapes)))


def available() -> bool:
    """Return whether spyrrow is installed, and a Python to run it in."""
    return importlib.util.find_spec("spyrrow") is not None and python() is not None


def _shortest(packing: Packing, shapes: list[np.ndarray]) -> float:
    """Return the used length in metres of the emptiest sheet."""
    return min(used_length(packing, shapes, k) for k in range(len(packing.sizes)))


def _keeps_distances(packing: Packing, shapes: list[np.ndarray], params: SheetParams) -> bool:
    """Return whether the true shapes keep the required distances exactly."""
    import shapely
    from shapely import affinity

    placed = []
    for i, shape in enumerate(shapes):
        turned = affinity.rotate(shapely.Polygon(shape), packing.rotation[i], origin=(0, 0), use_radians=True)
        placed.append(affinity.translate(turned, *packing.shift[i]))
        x0, y0, x1, y1 = placed[-1].bounds
        width, height = packing.sizes[packing.sheet[i]]
        if min(x0, y0, width - x1, height - y1) < params.margin - 1e-9:
            return False
    tree = shapely.STRtree(placed)
    one, two = tree.query(placed, predicate="dwithin", distance=max(params.spacing - 1e-9, 0.0))
    together = (one < two) & (packing.sheet[one] == packing.sheet[two])
    return not bool(together.any())

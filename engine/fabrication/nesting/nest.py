"""Nesting: the true shapes of the panels laid on sheets of one size as tightly as a time limit allows, by spyrrow.

spyrrow (the sparrow algorithm of Gardeyn, Vanden Berghe and Wauters 2025) packs a strip of fixed height as short as it
can. ``search`` finds sets of panels that fill a sheet: whose strip is no longer than the sheet. What the quick packing finds
is the first answer, so that there is one however short the time is.
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
from .process import Strip, python
from .remnants import read
from .search import Search
from .strips import FINE_SECONDS, TURN

PATIENCE = 4  # orders tried in a row without an improvement before sets are tried for longer
# packings whose emptiest sheet is drawn together in the end, and the share of the time left for doing the best one's by finer outlines
TOPS, FINEST = 3, 0.5
MANY = 400  # most panels that are searched for; the quick packing fills sheets with so many as well as time allows


def nest(shapes: list[Float[np.ndarray, "_ 2"]], params: SheetParams, progress: Progress = SILENT) -> Packing:
    """Lay closed outlines (M, 2), in metres, on as few sheets as found within ``params.nesting_seconds``.

    Those that are to lie along the grain are given with their grain along x.

    Never worse than ``packing.pack``, which it returns where spyrrow is missing or nothing better is found. The seed makes
    the search repeatable as far as a limit in seconds can be. Remnants come first, and are filled by ``odd``.
    """
    remnants = read(params.remnants, params.remnant_unit) if params.remnants.strip() else []
    if remnants:
        odd, rest = on_remnants(shapes, remnants, params, progress.part(0.0, 0.2))
        whole = replace(params, remnants="")
        return _both(odd, rest, nest([shapes[i] for i in rest], whole, progress.part(0.2, 1.0)) if rest else None)
    sheet = (params.sheet_width, params.sheet_height)
    rough = pack(shapes, sheet, params.margin, params.spacing, progress.part(0.0, 0.1), params.rotation)
    if params.nesting != "TRUE" or not available() or not 2 <= len(shapes) <= MANY:
        return rough
    search = Search(shapes, params, progress.part(0.1, 1.0))
    try:
        return _searched(search, rough)
    finally:
        search.finish()


def strip(
    shapes: list[Float[np.ndarray, "_ 2"]], params: SheetParams, seconds: float, progress: Progress = SILENT
) -> Strip | None:
    """Closed outlines (M, 2) in metres on one endless strip as high as a sheet less its margins, as short as is found in some seconds.

    None without spyrrow, or where a shape is larger than the sheet. The strip begins at 0.
    """
    if not available():
        return None
    search = Search(shapes, params, progress)
    try:
        return search.strip(max(TURN, round(seconds)))
    finally:
        search.finish()


def _both(odd: Packing, rest: list[int], whole: Packing | None) -> Packing:
    """Remnants, and after them whole sheets for the panels that found no room on those."""
    if whole is None:
        return odd
    sheet, rotation, shift = odd.sheet.copy(), odd.rotation.copy(), odd.shift.copy()
    sheet[rest], rotation[rest], shift[rest] = len(odd.sizes) + whole.sheet, whole.rotation, whole.shift
    return Packing(sheet, rotation, shift, np.concatenate([odd.sizes, whole.sizes]), odd.remnants)


def _searched(search: Search, rough: Packing) -> Packing:
    """The best packing that the search finds, or the rough one."""
    shapes, params = search.shapes, search.params
    tops, idle = [(search.needed(rough), rough)], 0
    rng = np.random.default_rng(params.seed)
    # on as few sheets as can be, others may leave a larger piece of the last one over
    while len(tops[0][1].sizes) - len(search.large) > 1 and search.going:
        search.tell(len(shapes))
        found = search.emptied(search.fill(rng, rough))
        need, idle = search.needed(found), idle + 1
        new = all(abs(need - known) > 1e-6 for known, _ in tops)
        if new and (len(tops) < TOPS or need < tops[-1][0]) and _sound(found, shapes, params):
            idle = 0 if need < tops[0][0] else idle
            tops = sorted([*tops, (need, found)], key=lambda one: one[0])[:TOPS]
        if idle == PATIENCE:
            idle = 0
            if not (search.strips.answered and search.harder()):
                break
    # those on more sheets cannot become the best any more
    return _drawn_together(search, rough, [one for _, one in tops if len(one.sizes) == len(tops[0][1].sizes)])


def _drawn_together(search: Search, rough: Packing, tops: list[Packing]) -> Packing:
    """The best packing once the panels of each one's emptiest sheet are drawn together, those of the best by finer outlines too."""
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
    """That with the fewest sheets and the largest rest of one of them, of the known packings and of those made that hold the asked distances."""
    new = [one for one in made if all(one is not other for other in known) and _sound(one, shapes, params)]
    return min([*known, *new], key=lambda one: (len(one.sizes), _shortest(one, shapes)))


def available() -> bool:
    """Whether spyrrow is installed here, and a Python that can be started to run it."""
    return importlib.util.find_spec("spyrrow") is not None and python() is not None


def _shortest(packing: Packing, shapes: list[np.ndarray]) -> float:
    """Metres that are used of the emptiest sheet."""
    return min(used_length(packing, shapes, k) for k in range(len(packing.sizes)))


def _sound(packing: Packing, shapes: list[np.ndarray], params: SheetParams) -> bool:
    """Whether the asked distances hold between the true shapes, exactly."""
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

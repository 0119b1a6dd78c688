"""Nesting: lay the true shapes of the panels on equal sheets as tightly as a time limit permits, with spyrrow.

spyrrow (the sparrow algorithm of Gardeyn, Vanden Berghe and Wauters 2025) packs a strip of fixed height as short as it
can. ``sheet_search`` looks for sets of panels whose strip is no longer than a sheet. The quick packing (``packing``) is
computed first and returned if the search finds nothing better in time.
"""

from __future__ import annotations

import importlib.util
from dataclasses import replace

import numpy as np

from ...arrays import Float
from ...params import SheetParams
from ...progress import SILENT, Progress
from ...workers import Workers, count_cores, python_path
from .packing import Packing, pack
from .remnant_packing import pack_on_remnants
from .remnants import read_remnants
from .sheet_search import SheetSearch

# maximum number of panels for the search; with more panels, the search gains nothing over the quick packing in the
# usual time limit
MAX_PANELS = 400
MAX_WORKERS = 8  # maximum number of worker processes; more are faster and take more memory


def nest(shapes: list[Float[np.ndarray, "_ 2"]], params: SheetParams, progress: Progress = SILENT) -> Packing:
    """Lay closed outlines on as few sheets as a search of ``params.nesting_seconds`` finds.

    Remnants are filled first (module ``remnant_packing``). The result is never worse than the quick packing of
    ``packing.pack``, which is returned where spyrrow is missing or finds nothing better. Equal seeds give equal
    results, except that a slower computer tries less within the time limit.

    Parameters
    ----------
    shapes : closed outlines (M, 2), metres; if panels must follow the sheet's grain, turned so that theirs lies along x
    params : size of the sheets, margin, spacing, remnants and time limit
    progress : called with the fraction done; may cancel
    """
    remnants = read_remnants(params.remnants, params.remnant_unit) if params.remnants.strip() else []
    if remnants:
        odd, rest = pack_on_remnants(shapes, remnants, params, progress.part(0.0, 0.2))
        whole = replace(params, remnants="")
        return _append_sheets(
            odd, rest, nest([shapes[i] for i in rest], whole, progress.part(0.2, 1.0)) if rest else None
        )
    sheet = (params.sheet_width, params.sheet_height)
    rough = pack(shapes, sheet, params.margin, params.spacing, progress.part(0.0, 0.1), params.rotation)
    if params.nesting != "TRUE" or not can_search() or not 2 <= len(shapes) <= MAX_PANELS:
        return rough
    with Workers(min(count_cores(), MAX_WORKERS)) as workers:
        return SheetSearch(shapes, params, workers, progress.part(0.1, 1.0)).find_best_packing(rough)


def _append_sheets(odd: Packing, rest: list[int], whole: Packing | None) -> Packing:
    """Join a packing on remnants (``odd``) with the packing of the panels ``rest`` on whole sheets (``whole``)."""
    if whole is None:
        return odd
    sheet, rotation, shift = odd.sheet.copy(), odd.rotation.copy(), odd.shift.copy()
    sheet[rest], rotation[rest], shift[rest] = len(odd.sizes) + whole.sheet, whole.rotation, whole.shift
    return Packing(sheet, rotation, shift, np.concatenate([odd.sizes, whole.sizes]), odd.remnants)


def can_search() -> bool:
    """Return whether spyrrow is installed, and a Python interpreter for its processes exists."""
    return importlib.util.find_spec("spyrrow") is not None and python_path() is not None

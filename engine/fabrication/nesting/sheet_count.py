"""Before nesting, refuse sheets that are far too small for their panels, and name a sufficient size."""

from __future__ import annotations

from collections.abc import Sequence
from math import floor

import numpy as np

from ...arrays import Float
from ...errors import FlexMapsError
from ...params import SheetParams

# Maximum ratio of the estimated number of sheets to the number needed by area alone; larger accepts more waste. On
# suitable sheets the ratio is at most 2
MAX_WASTE_RATIO = 3.0
FEW_SHEETS = 10  # number of sheets up to which any waste is accepted; larger refuses fewer designs
SIZE_STEP = 1.05  # factor between consecutive sheet sizes tried for the suggestion
SIZE_ROUNDING = 0.01  # metres; a suggested size is rounded up to a multiple of this


def refuse_many_sheets(shapes: Sequence[Float[np.ndarray, "_ 2"]], params: SheetParams) -> None:
    """Raise ``FlexMapsError`` if the panels would need many almost empty sheets.

    Parameters
    ----------
    shapes : closed outlines (M, 2), metres
    params : size of the sheets, margin and spacing
    """
    if params.many_sheets or params.remnants.strip() or not shapes:
        return
    boxes = np.array([np.ptp(points, axis=0) for points in shapes]) + params.spacing
    area = sum(_polygon_area(points) for points in shapes)
    size = np.array([params.sheet_width, params.sheet_height])
    count, needed = _sheets_in_rows(boxes, size, params), _sheets_by_area(area, size)
    if count <= max(FEW_SHEETS, MAX_WASTE_RATIO * needed):
        return
    larger = size
    while _sheets_in_rows(boxes, larger, params) > max(FEW_SHEETS, MAX_WASTE_RATIO * _sheets_by_area(area, larger)):
        larger = larger * SIZE_STEP
    width, height = 1e3 * np.ceil(larger / SIZE_ROUNDING - 1e-9) * SIZE_ROUNDING
    raise FlexMapsError(
        f"About {count} sheets of {size[0] * 1e3:g} x {size[1] * 1e3:g} mm would be cut where the panels' area needs {needed}: "
        f"sheets of {width:.0f} x {height:.0f} mm would do, or a piece of {floor(100 * (size / larger).min())} % of its size "
        "(a smaller --edge); to go on all the same, switch Many sheets on (--many-sheets)"
    )


def _polygon_area(points: Float[np.ndarray, "points 2"]) -> float:
    """Return the area of a polygon in m2."""
    x, y = points.T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def _sheets_by_area(area: float, size: Float[np.ndarray, " 2"]) -> int:
    """Return the number of sheets of ``size`` whose total area is at least ``area``, at least 1."""
    return max(1, int(np.ceil(area / size.prod())))


def _sheets_in_rows(boxes: Float[np.ndarray, "panels 2"], size: Float[np.ndarray, " 2"], params: SheetParams) -> int:
    """Estimate the number of sheets for boxes packed in rows, highest first.

    Each box lies with its longer side along the row, unless it is longer than the sheet is wide.

    Parameters
    ----------
    boxes : sides of every panel's bounding box plus the spacing, metres
    size : width and height of a sheet, metres
    params : margin and spacing
    """
    width, height = size - 2 * params.margin + params.spacing
    long, short = boxes.max(axis=1), boxes.min(axis=1)
    lies = long <= width
    across, up = np.where(lies, long, short), np.where(lies, short, long)
    shelves: list[list[float]] = []  # for every row: index of the sheet, height, remaining width
    left: list[float] = []  # remaining height of every sheet
    for k in np.argsort(-up, kind="stable").tolist():
        shelf = next((one for one in shelves if one[1] >= up[k] and one[2] >= across[k]), None)
        if shelf is None:
            sheet = next((s for s, room in enumerate(left) if room >= up[k]), len(left))
            if sheet == len(left):
                left.append(height)
            left[sheet] -= up[k]
            shelf = [sheet, float(up[k]), width]
            shelves.append(shelf)
        shelf[2] -= across[k]
    return len(left)

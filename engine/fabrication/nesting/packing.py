"""Pack panels on sheets quickly: a greedy search for places on a raster, with true outlines and quarter turns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Float, Int
from ...progress import SILENT, Progress
from .remnants import Remnant
from .sheet_raster import ShapeMask, SheetRaster

CELLS = 512  # raster cells along the longer side of a sheet; more cells pack tighter and take longer
# Maximum number of raster searches (10 ms each); panels left after that are packed in rows, faster but less tightly
TRIES = 500
ROUNDING_GAP = 1e-8  # metres added to the margin, so that rounding errors never rule out a panel that just fits


@dataclass(frozen=True, eq=False)
class Packing:
    """Positions of panels on sheets.

    sheet : index of the sheet on which each panel lies; -1 if it has none
    rotation, shift : each panel is rotated about the origin (radians) and then shifted (metres)
    sizes : width and height of every sheet, metres
    remnants : irregular pieces used as the first sheets; their ``sizes`` are their bounding boxes
    """

    sheet: Int[np.ndarray, " panels"]
    rotation: Float[np.ndarray, " panels"]
    shift: Float[np.ndarray, "panels 2"]
    sizes: Float[np.ndarray, "sheets 2"]
    remnants: tuple[Remnant, ...] = ()

    @property
    def sheet_areas(self) -> Float[np.ndarray, " sheets"]:
        """Area of every sheet in m2; the holes of remnants are not counted."""
        found = self.sizes.prod(axis=1)
        found[: len(self.remnants)] = [remnant.polygon.area for remnant in self.remnants]
        return found


def min_area_box(points: Float[np.ndarray, "points 2"]) -> tuple[float, Float[np.ndarray, " 2"]]:
    """Return the rotation (radians) that gives points the bounding box with the smallest area, and the box's two sides.

    The longer side lies along x and comes first.
    """
    from scipy.spatial import ConvexHull

    hull = points[ConvexHull(points).vertices]
    side = np.roll(hull, -1, axis=0) - hull
    angle = -np.arctan2(side[:, 1], side[:, 0])
    cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
    x = cos * hull[:, 0] - sin * hull[:, 1]
    y = sin * hull[:, 0] + cos * hull[:, 1]
    size = np.stack([np.ptp(x, axis=1), np.ptp(y, axis=1)], axis=1)
    area = size.prod(axis=1)
    best = int(np.flatnonzero(area <= area.min() * (1.0 + 1e-9))[0])
    turn = float(angle[best])
    if size[best, 0] < size[best, 1]:
        return turn + 0.5 * np.pi, size[best, ::-1]
    return turn, size[best]


def pack(
    shapes: list[Float[np.ndarray, "_ 2"]],
    sheet: tuple[float, float],
    margin: float,
    spacing: float,
    progress: Progress = SILENT,
    rotation: str = "FREE",
    cells: int = CELLS,
) -> Packing:
    """Lay closed outlines on few sheets, the largest bounding box first, each at the first free place of a raster.

    After ``TRIES`` searches for a free place, the remaining outlines go in rows of bounding boxes.

    Parameters
    ----------
    shapes : closed outlines (M, 2), metres
    sheet : width and height, metres; a larger shape gets a sheet of the size that it needs
    margin, spacing : metres kept free along the border of a sheet, and between shapes
    rotation : allowed rotations, see ``find_fitting_rotation``
    cells : raster cells along the longer side of a sheet; rounding may make a shape larger by two cells on every side
    """
    boxes = [preferred_box(shape, rotation) for shape in progress.part(0.0, 0.1).each(shapes, "packing")]
    order = sorted(range(len(shapes)), key=lambda i: -float(boxes[i][1].prod()))
    cell = max(sheet) / cells
    sheet_of, turned, shift = np.zeros(len(shapes), dtype=np.int64), np.zeros(len(shapes)), np.zeros((len(shapes), 2))
    open_sheets: list[SheetRaster] = []
    quarters = (0, 2) if rotation == "GRAIN" else (0, 1, 2, 3)
    tries, rest = 0, len(order)
    for done, i in enumerate(order):
        if tries >= TRIES:
            rest = done
            break
        turn, size = _rotation_and_box(shapes[i], *boxes[i], sheet, margin, cell, rotation)
        stamp = ShapeMask(shapes[i], turn, cell, 0.5 * spacing, quarters)
        place = None
        for number, opened in enumerate(open_sheets):
            progress(0.1 + 0.9 * done / len(order), "packing")
            if opened.may_fit(stamp):
                tries += 1
                found = opened.place(stamp)
                if found is not None:
                    place = number, found
                    break
        if place is None:
            tries, enough = tries + 1, _fitting_size(size, sheet, margin, cell, rotation)
            open_sheets.append(SheetRaster(enough, margin, 0.5 * spacing, cell))
            fresh = open_sheets[-1].place(stamp)
            assert fresh is not None  # a new sheet is always large enough
            place = len(open_sheets) - 1, fresh
        sheet_of[i], (turned[i], shift[i]) = place
    sizes = [s.size for s in open_sheets]
    if rest < len(order):
        left = order[rest:]
        small = [(shapes[i], *boxes[i]) for i in left]
        last = _pack_in_rows(small, sheet, margin, spacing, progress.part(0.9, 1.0), rotation)
        sheet_of[left], turned[left], shift[left] = len(sizes) + last.sheet, last.rotation, last.shift
        sizes += [(width, height) for width, height in last.sizes.tolist()]
    return Packing(sheet_of, turned, shift, np.array(sizes).reshape(-1, 2))


def _rotation_and_box(
    shape: np.ndarray,
    turn: float,
    size: np.ndarray,
    sheet: tuple[float, float],
    margin: float,
    cell: float,
    rotation: str,
) -> tuple[float, np.ndarray]:
    """Return the rotation (radians) with which a shape is packed by raster, and the sides of its bounding box then.

    shape : closed outline (M, 2), metres
    turn, size : preferred rotation and box (``preferred_box``), returned if they fit on the sheet or nothing else does
    sheet, margin : width and height of the sheet and its margin, metres
    cell : side of a raster cell, metres
    rotation : allowed rotations, see ``find_fitting_rotation``
    """
    if box_fits(size + 4.0 * cell, sheet, margin, rotation):
        return turn, size
    slanted = find_fitting_rotation(shape, sheet, margin + 2.0 * cell, rotation)
    turn = turn if slanted is None else slanted
    return turn, _box_sides(shape, turn)


def _pack_in_rows(
    boxed: list[tuple[np.ndarray, float, np.ndarray]],
    sheet: tuple[float, float],
    margin: float,
    spacing: float,
    progress: Progress,
    rotation: str,
) -> Packing:
    """Lay bounding boxes of shapes in rows, highest first, each in the first row with room (Coffman et al. 1980).

    boxed : every shape, its preferred rotation, and the sides of its bounding box then (``preferred_box``)
    """
    free = np.array(sheet) - 2.0 * margin
    laid: list[tuple[float, np.ndarray]] = []
    for done, (shape, turn, size) in enumerate(boxed):
        progress(0.5 * done / len(boxed), "packing in rows")
        if rotation != "GRAIN" and (size > free).any():
            turn, size = turn + 0.5 * np.pi, size[::-1]
        slanted = find_fitting_rotation(shape, sheet, margin + ROUNDING_GAP, rotation) if (size > free).any() else None
        laid.append((turn, size) if slanted is None else (slanted, _box_sides(shape, slanted)))
    count = len(boxed)
    where, shift, sizes = np.zeros(count, dtype=np.int64), np.zeros((count, 2)), []
    rows: list[list[float]] = []  # for every row: index of the sheet, height, lower edge, used length
    used: list[float] = []  # used height of every sheet
    for done, i in enumerate(sorted(range(count), key=lambda i: -float(laid[i][1][1]))):
        progress(0.5 + 0.5 * done / count, "packing in rows")
        turn, (wide, high) = laid[i]
        if wide > free[0] or high > free[1]:
            size = laid[i][1] if rotation == "GRAIN" else np.sort(laid[i][1])[::-1]
            sizes.append(_fitting_size(size, sheet, margin, 0.0, rotation))
            used.append(np.inf)
            rows.append([len(sizes) - 1, np.inf, margin, np.inf])
            row, turn = rows[-1], boxed[i][1]
            corner = np.array([margin, margin])
        else:
            row = next((r for r in rows if high <= r[1] and r[3] + wide <= free[0] + margin), [])
            if not row:
                on = next((k for k, top in enumerate(used) if top + high <= free[1] + margin), len(sizes))
                if on == len(sizes):
                    sizes.append(sheet)
                    used.append(margin)
                row = [on, high, used[on], margin]
                rows.append(row)
                used[on] += high + spacing
            corner = np.array([row[3], row[2]])
            row[3] += wide + spacing
        laid[i] = turn, laid[i][1]
        where[i], shift[i] = row[0], corner - (boxed[i][0] @ _rotation_matrix(turn)).min(axis=0)
    return Packing(where, np.array([turn for turn, _ in laid]), shift, np.array(sizes).reshape(-1, 2))


def preferred_box(points: Float[np.ndarray, "points 2"], rotation: str) -> tuple[float, Float[np.ndarray, " 2"]]:
    """Return the preferred rotation of a shape on a sheet, and the sides of its bounding box when rotated.

    The preferred rotation is 0 for "GRAIN"; otherwise the bounding box is the smallest (see ``min_area_box``).

    Parameters
    ----------
    points : metres
    rotation : allowed rotations, as in ``SheetParams``

    Returns
    -------
    Radians; width and height, metres
    """
    return (0.0, _box_sides(points, 0.0)) if rotation == "GRAIN" else min_area_box(points)


def find_fitting_rotation(points: np.ndarray, sheet: tuple[float, float], margin: float, rotation: str) -> float | None:
    """Return a rotation (radians) with which points fit on a sheet within its margin; None if there is none.

    Parameters
    ----------
    points : (M, 2), metres
    sheet : width and height, metres
    margin : metres
    rotation : "FREE" any angle; "QUARTER" smallest bounding box along x and y; "GRAIN" 0, as half a turn fits equally
    """
    turn = preferred_box(points, rotation)[0]
    quarters = np.array([0.0]) if rotation == "GRAIN" else np.array([0.0, 0.5 * np.pi])
    steps = np.radians(np.arange(0.0, 90.0)) if rotation == "FREE" else np.zeros(1)
    for angle in (turn + steps[:, None] + quarters).ravel().tolist():
        if (_box_sides(points, angle) <= np.array(sheet) - 2.0 * margin + 1e-9).all():
            return angle
    return None


def _box_sides(points: np.ndarray, turn: float) -> np.ndarray:
    """Return the sides of the bounding box of points after turning them by ``turn`` radians."""
    return np.ptp(points @ _rotation_matrix(turn), axis=0)


def _rotation_matrix(angle: float) -> np.ndarray:
    """Return the matrix (2, 2) by which points (M, 2) are multiplied to turn them by ``angle`` radians."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[cos, sin], [-sin, cos]])


def used_length(packing: Packing, shapes: list[Float[np.ndarray, "_ 2"]], index: int) -> float:
    """Return the distance in metres from the left border of a sheet to the right end of the shapes on it.

    Parameters
    ----------
    packing : positions of all shapes
    shapes : closed outlines (M, 2), metres, in the order of ``packing``
    index : number of the sheet, from 0
    """
    ends = [0.0]
    for i in np.flatnonzero(packing.sheet == index).tolist():
        cos, sin = np.cos(packing.rotation[i]), np.sin(packing.rotation[i])
        ends.append(float((shapes[i] @ [cos, -sin]).max() + packing.shift[i, 0]))
    return max(ends)


def fill_ratio(packing: Packing, shapes: list[Float[np.ndarray, "_ 2"]], area: float, margin: float) -> float:
    """Return the share of the sheets' area that shapes cover, without the largest offcut that can be cut from a sheet.

    An offcut is the part of a sheet to the right of all its shapes and their margin; remnants have none.

    Parameters
    ----------
    packing : positions of the shapes
    shapes : closed outlines (M, 2), metres
    area : total area of the shapes, m2
    margin : margin of the sheets, metres
    """
    whole = range(len(packing.remnants), len(packing.sizes))
    used = {k: used_length(packing, shapes, k) + margin for k in whole}
    spare = max(((packing.sizes[k, 0] - u) * packing.sizes[k, 1] for k, u in used.items()), default=0.0)
    return area / float(packing.sheet_areas.sum() - max(spare, 0.0))


def box_fits(size: Float[np.ndarray, " 2"], sheet: tuple[float, float], margin: float, rotation: str = "FREE") -> bool:
    """Return whether a box of the given size fits on a sheet within its margin, all in metres.

    The box may be turned by a quarter turn unless ``rotation`` is "GRAIN".
    """
    free = [x - 2.0 * margin + 1e-9 for x in sheet]
    if rotation == "GRAIN":
        return bool(size[0] <= free[0] and size[1] <= free[1])
    return bool(min(size) <= min(free) and max(size) <= max(free))


def _fitting_size(
    size: np.ndarray, sheet: tuple[float, float], margin: float, cell: float, rotation: str
) -> tuple[float, float]:
    """Return the width and height of a sheet on which a box of the given size fits: ``sheet``, enlarged if necessary.

    The box may be larger by two raster cells of side ``cell`` on every side; all lengths are in metres.
    """
    slack = 2.0 * margin + 4.0 * cell
    if box_fits(size + 4.0 * cell, sheet, margin, rotation):
        return sheet
    # round up to whole centimetres; the longer side of the sheet becomes its width, along which the longer side of the
    # box lies, and neither side of the sheet gets shorter
    wide, high = (np.ceil((x + slack) * 100.0 - 1e-9) / 100.0 for x in size)
    if rotation == "GRAIN":
        return max(wide, sheet[0]), max(high, sheet[1])
    return max(wide, *sheet), max(high, min(sheet))

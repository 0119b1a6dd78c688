"""Pack panels on sheets quickly: a greedy search for places on a raster, with true outlines and quarter turns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.fft import irfft2, next_fast_len, rfft2

from ...arrays import Float, Int
from ...progress import SILENT, Progress
from .remnants import Remnant

CELLS = 512  # raster cells along the longer side of a sheet; more cells pack tighter and take longer
# Maximum number of raster searches (10 ms each); panels left after that are packed in rows, faster but less tightly
TRIES = 500
ROUNDING_GAP = 1e-8  # metres added to the margin, so that rounding errors never rule out a panel that just fits


@dataclass(frozen=True, eq=False)
class Packing:
    """Positions of N shapes: index of the sheet, rotation about the origin in radians, then shift in metres.

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
    """Return the rotation (radians) with the smallest bounding box, longer side along x, and the sides of this box."""
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
    cells : raster cells along the longer side of a sheet; a shape may occupy two too many in each direction
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
    """Return a shape's rotation (radians) and box: its smallest box, or another if only another fits on the sheet."""
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

    boxed : every shape with the rotation and the sides of its smallest bounding box
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
    rotation : "FREE" any angle; "QUARTER" longer side of the smallest box along x or y; "GRAIN" no turn or half a turn
    """
    turn = preferred_box(points, rotation)[0]
    quarters = np.array([0.0]) if rotation == "GRAIN" else np.array([0.0, 0.5 * np.pi])
    steps = np.radians(np.arange(0.0, 90.0)) if rotation == "FREE" else np.zeros(1)
    for angle in (turn + steps[:, None] + quarters).ravel().tolist():
        if (_box_sides(points, angle) <= np.array(sheet) - 2.0 * margin + 1e-9).all():
            return angle
    return None


def _box_sides(points: np.ndarray, turn: float) -> np.ndarray:
    """Return the sides of the bounding box of points turned by an angle in radians."""
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
    """Return the share of the sheets' area that shapes cover, not counting the largest unused end of a sheet.

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
    """Return whether a box (metres) fits on a sheet within its margin, turned if needed unless "GRAIN"."""
    free = [x - 2.0 * margin + 1e-9 for x in sheet]
    if rotation == "GRAIN":
        return bool(size[0] <= free[0] and size[1] <= free[1])
    return bool(min(size) <= min(free) and max(size) <= max(free))


def _fitting_size(
    size: np.ndarray, sheet: tuple[float, float], margin: float, cell: float, rotation: str
) -> tuple[float, float]:
    """Return the size (metres) of a sheet on which a box fits: ``sheet``, enlarged if necessary."""
    slack = 2.0 * margin + 4.0 * cell
    if box_fits(size + 4.0 * cell, sheet, margin, rotation):
        return sheet
    # round up to whole centimetres; the longer side of the box lies along the sheet, which is never made smaller
    wide, high = (np.ceil((x + slack) * 100.0 - 1e-9) / 100.0 for x in size)
    if rotation == "GRAIN":
        return max(wide, sheet[0]), max(high, sheet[1])
    return max(wide, *sheet), max(high, min(sheet))


class ShapeMask:
    """Raster masks of a shape at each quarter turn, offset outwards by ``grow`` metres and the raster's error."""

    def __init__(self, shape: np.ndarray, turn: float, cell: float, grow: float, quarters: tuple[int, ...]):
        from shapely import Polygon

        self.turn, self.cell = turn, cell
        cos, sin = np.cos(turn), np.sin(turn)
        outline = Polygon(shape @ np.array([[cos, sin], [-sin, cos]])).buffer(0.0)
        coarse = 0.1 * cell
        # mark every cell that the shape touches: those whose centre is within half a cell diagonal of the shape
        grown = outline.simplify(coarse).buffer(grow + coarse + 0.7072 * cell, quad_segs=8)
        x0, y0, x1, y1 = grown.bounds
        self.origin = np.array([x0, y0])
        self.extent = np.array([x1 - x0, y1 - y0])
        columns, rows = (int(np.ceil(e / cell)) for e in self.extent)
        rings = [r for p in getattr(grown, "geoms", [grown]) for r in [p.exterior]]
        mask = _rasterise([(np.asarray(r.coords)[:-1] - self.origin) / cell for r in rings], columns, rows)
        self.masks = {k: np.ascontiguousarray(np.rot90(mask, -k)) for k in quarters}
        self.cell_count = int(mask.sum())
        self.box = cell * np.array([columns, rows])

    def placement_at(self, quarter: int, corner: np.ndarray) -> tuple[float, np.ndarray]:
        """Return the rotation (radians) and shift that put the lower left corner of mask ``quarter`` at ``corner``."""
        # it is enough to turn the raster's box: at quarter turns both have the same lower left corner
        points = np.array([[0.0, 0.0], self.box]) + self.origin
        cos, sin = [(1, 0), (0, 1), (-1, 0), (0, -1)][quarter]
        turned = points @ np.array([[cos, sin], [-sin, cos]], dtype=float)
        return self.turn + quarter * 0.5 * np.pi, corner - turned.min(axis=0)


class SheetRaster:
    """Raster of the occupied cells of one sheet; row 0 is at the bottom."""

    def __init__(
        self, size: tuple[float, float], margin: float, half: float, cell: float, remnant: Remnant | None = None
    ):
        self.size, self.cell = size, cell
        # shapes are grown by half of the spacing; this added strip may extend into the margin
        self.corner = np.array([margin - half, margin - half])
        columns, rows = (int(np.floor((x - 2.0 * (margin - half)) / cell + 1e-9)) for x in size)
        self.occupied = np.zeros((max(rows, 1), max(columns, 1)), dtype=bool)
        # a cell is free if it lies wholly inside the remnant; grown shapes must stay inside even without a margin
        if remnant is not None:
            within = remnant.polygon.buffer(min(half - margin, 0.0) - 0.7072 * cell)
            rings = [r for p in getattr(within, "geoms", [within]) if p for r in (p.exterior, *p.interiors)]
            parts = [(np.asarray(r.coords)[:-1] - self.corner) / cell for r in rings]
            self.occupied = ~_rasterise(parts, self.occupied.shape[1], self.occupied.shape[0])
        self._spectrum: np.ndarray | None = None
        self._rejected: list[tuple[np.ndarray, int]] = []  # boxes and cell counts of shapes that found no place

    def may_fit(self, stamp: ShapeMask) -> bool:
        """Return False if a shape not larger than this one, by box and cell count, has already found no place."""
        box = np.sort(stamp.box)
        return not any((box >= other).all() and stamp.cell_count >= cells for other, cells in self._rejected)

    def place(self, stamp: ShapeMask, try_half_turns: bool = False) -> tuple[float, np.ndarray] | None:
        """Put the shape where its right end is leftmost, then lowest; return rotation and shift, or None without room.

        try_half_turns : also try half turns on an empty sheet; on an empty rectangle they gain nothing
        """
        best: tuple[int, int, int, int] | None = None
        for quarter, mask in stamp.masks.items():
            rows, columns = (t - m + 1 for t, m in zip(self.occupied.shape, mask.shape, strict=True))
            if rows < 1 or columns < 1 or (quarter > 1 and not try_half_turns and not self.occupied.any()):
                continue
            free = self._overlap_counts(mask)[:rows, :columns] < 0.5
            column = int(free.any(axis=0).argmax())
            row = int(free[:, column].argmax())
            if not free[row, column]:
                continue
            found = (column + mask.shape[1], row, column, quarter)
            best = found if best is None else min(best, found)
        if best is None:
            self._rejected.append((np.sort(stamp.box), stamp.cell_count))
            return None
        _, row_, column_, quarter = best
        mask = stamp.masks[quarter]
        self.occupied[row_ : row_ + mask.shape[0], column_ : column_ + mask.shape[1]] |= mask
        self._spectrum = None
        return stamp.placement_at(quarter, self.corner + self.cell * np.array([column_, row_]))

    def _overlap_counts(self, mask: np.ndarray) -> np.ndarray:
        """Return how many occupied cells the mask overlaps at every offset, by FFT correlation."""
        shape = tuple(next_fast_len(n, real=True) for n in self.occupied.shape)
        if self._spectrum is None:
            self._spectrum = rfft2(self.occupied.astype(np.float32), shape)
        return irfft2(self._spectrum * np.conj(rfft2(mask.astype(np.float32), shape)), shape)


def _rasterise(rings: list[np.ndarray], columns: int, rows: int) -> np.ndarray:
    """Return a (rows, columns) mask of cells whose centres lie inside rings (M, 2) in cell units, by even-odd rule."""
    flips = np.zeros((rows, columns + 1), dtype=np.int32)
    for ring in rings:
        a, b = ring, np.roll(ring, -1, axis=0)
        low, high = np.minimum(a[:, 1], b[:, 1]), np.maximum(a[:, 1], b[:, 1])
        first = np.clip(np.ceil(low - 0.5).astype(int), 0, rows)
        last = np.clip(np.ceil(high - 0.5).astype(int), 0, rows)
        count = last - first
        which = np.repeat(np.arange(len(a)), count)
        row = first[which] + np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        share = (row + 0.5 - a[which, 1]) / (b[which, 1] - a[which, 1])
        x = a[which, 0] + share * (b[which, 0] - a[which, 0])
        np.add.at(flips, (row, np.clip(np.ceil(x - 0.5).astype(int), 0, columns)), 1)
    return (np.cumsum(flips[:, :-1], axis=1) % 2).astype(bool)

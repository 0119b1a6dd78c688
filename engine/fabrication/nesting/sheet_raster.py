"""Rasters of shapes and sheets, on which the quick packing looks for free places."""

from __future__ import annotations

import numpy as np
from scipy.fft import irfft2, next_fast_len, rfft2

from .remnants import Remnant


class ShapeMask:
    """Raster masks of a shape, one for each of the quarter turns ``quarters`` after a rotation by ``turn`` radians.

    The masks contain every cell that the shape touches after it was offset outwards by ``grow`` metres; the side of a
    cell is ``cell`` metres.
    """

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
        """Return the rotation (radians) and shift (metres) of the shape when one of its masks is laid on a sheet.

        quarter : number of quarter turns of the mask
        corner : (x, y) on the sheet of the mask's lower left corner, metres
        """
        # turn two opposite corners of the mask's box by the quarter turns, to find where its lower left corner goes
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
        # shapes are grown by ``half``, half of the spacing, and this added strip may extend into the margin
        self.corner = np.array([margin - half, margin - half])
        columns, rows = (int(np.floor((x - 2.0 * (margin - half)) / cell + 1e-9)) for x in size)
        self.occupied = np.zeros((max(rows, 1), max(columns, 1)), dtype=bool)
        # a cell is free if it lies wholly inside the remnant; the strip that is added to shapes may extend into the
        # margin, but not beyond the edge of the remnant where the margin is narrower
        if remnant is not None:
            within = remnant.polygon.buffer(min(half - margin, 0.0) - 0.7072 * cell)
            rings = [r for p in getattr(within, "geoms", [within]) if p for r in (p.exterior, *p.interiors)]
            parts = [(np.asarray(r.coords)[:-1] - self.corner) / cell for r in rings]
            self.occupied = ~_rasterise(parts, self.occupied.shape[1], self.occupied.shape[0])
        self._spectrum: np.ndarray | None = None
        self._rejected: list[tuple[np.ndarray, int]] = []  # boxes and cell counts of shapes that found no place

    def may_fit(self, stamp: ShapeMask) -> bool:
        """Return False if a shape with no larger box and no more cells has already found no place on this sheet."""
        box = np.sort(stamp.box)
        return not any((box >= other).all() and stamp.cell_count >= cells for other, cells in self._rejected)

    def place(self, stamp: ShapeMask, try_half_turns: bool = False) -> tuple[float, np.ndarray] | None:
        """Put the shape where its right end is leftmost, then lowest; return rotation and shift, or None without room.

        stamp : masks of the shape
        try_half_turns : whether to try two and three quarter turns also on an empty sheet, for irregular sheets; on an
            empty rectangle they gain nothing
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

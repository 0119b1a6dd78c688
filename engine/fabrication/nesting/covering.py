"""Polygons with few corners around others, for searches whose time grows with the number of corners."""

from __future__ import annotations

import heapq

import numpy as np

from ...arrays import Float

_Point = tuple[float, float]
# added square metres, corner, version of the corner's data, and its new position, or None if it is removed
_Change = tuple[float, int, int, _Point | None]


def covering(points: Float[np.ndarray, "corners 2"], count: int) -> Float[np.ndarray, "few 2"]:
    """Return a polygon with ``count`` corners around a simple polygon, counter-clockwise, with little added area.

    The smallest change comes first, as in the simplification of lines by Visvalingam and Whyatt (1993), but only
    outwards: a corner that points inwards is cut off by a line between its neighbours; a side between two corners that
    point outwards is removed by extending its neighbours until they meet. Changes that would make the outline cross
    itself are skipped, so more corners may remain.
    """
    ring = _SimplifiedOutline(points)
    while ring.left > count and (change := ring.least()) is not None:
        ring.make(*change)
    return ring.points()


class _SimplifiedOutline:
    """A closed outline from which corners are removed, and a queue of possible changes, least area first.

    Corners keep their index in the first outline, counter-clockwise; ``ends`` are the next corners. Removed corners and
    their ends are nan.
    """

    def __init__(self, points: Float[np.ndarray, "corners 2"]):
        x, y = points[:, 0], points[:, 1]
        turned = float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) < 0.0
        self.at = np.array(points[::-1] if turned else points, dtype=float)
        self.ends = np.roll(self.at, -1, axis=0)
        self.left = len(points)
        # tuples are faster than rows of arrays when read singly
        self.corners: list[_Point] = [(x, y) for x, y in self.at.tolist()]
        self.after = [*range(1, self.left), 0]
        self.before = [self.left - 1, *range(self.left - 1)]
        self.version = [0] * self.left  # version of a corner's data; changes of an older version are void
        self.changes: list[_Change] = []
        for corner in range(self.left):
            self._queue_change(corner)

    def points(self) -> Float[np.ndarray, "corners 2"]:
        """Return the remaining corners in order."""
        return self.at[np.isfinite(self.at[:, 0])]

    def least(self) -> tuple[int, _Point | None] | None:
        """Return the next valid change: a corner and its new position, or None if the corner itself is removed.

        With a new position the corner after it is removed. Return None without further changes.
        """
        while self.changes:
            _, corner, version, to = heapq.heappop(self.changes)
            if version == self.version[corner] and self._free(corner, to):
                return corner, to
        return None

    def make(self, corner: int, to: _Point | None) -> None:
        """Apply a change."""
        gone = corner if to is None else self.after[corner]
        before, after = self.before[gone], self.after[gone]
        if to is not None:
            self.corners[corner] = to
            self.at[corner] = self.ends[self.before[corner]] = to
        self.after[before], self.before[after] = after, before
        self.ends[before] = self.corners[after]
        self.at[gone] = self.ends[gone] = np.nan
        self.version[gone] = -1
        self.left -= 1
        first = self.before[before]
        for near in {self.before[first], first, before, after}:
            self._queue_change(near)

    def _turn(self, corner: int) -> float:
        """Return twice the signed area of a corner's triangle with its neighbours; positive where it points outwards."""
        (x0, y0), (x, y), (x1, y1) = (self.corners[k] for k in (self.before[corner], corner, self.after[corner]))
        return (x - x0) * (y1 - y) - (y - y0) * (x1 - x)

    def _queue_change(self, corner: int) -> None:
        """Add the change possible at a corner to the queue."""
        self.version[corner] += 1
        turn, following = self._turn(corner), self.after[corner]
        if turn <= 0.0:
            self._push(-0.5 * turn, corner, None)
        elif self._turn(following) > 0.0:
            (x0, y0), (x, y) = self.corners[self.before[corner]], self.corners[corner]
            (x1, y1), (x2, y2) = self.corners[following], self.corners[self.after[following]]
            bend = (x - x0) * (y1 - y2) - (y - y0) * (x1 - x2)
            if bend < 0.0:  # otherwise the lines diverge
                far = ((x1 - x) * (y1 - y2) - (y1 - y) * (x1 - x2)) / bend
                to = x + far * (x - x0), y + far * (y - y0)
                twice = abs((x1 - x) * (to[1] - y) - (y1 - y) * (to[0] - x))
                # weigh a sharp new corner by the square of its height: its area is small, but it obstructs other shapes
                square = twice**2 / ((x1 - x) ** 2 + (y1 - y) ** 2)
                self._push(max(0.5 * twice, square), corner, to)

    def _push(self, area: float, corner: int, to: _Point | None) -> None:
        """Add a change to the queue."""
        heapq.heappush(self.changes, (area, corner, self.version[corner], to))

    def _free(self, corner: int, to: _Point | None) -> bool:
        """Return whether no other part of the outline lies in the triangle that a change adds.

        For corners shared with the triangle the computed side is exactly 0, so they count neither as inside nor as
        crossing.
        """
        before, after = self.before[corner], self.after[corner]
        three = [before, corner, after] if to is None else [corner, -1, after]
        triangle = np.array([to if k < 0 else self.corners[k] for k in three])
        low, high = triangle.min(axis=0), triangle.max(axis=0)
        # test only sides whose bounding box overlaps the triangle's
        meets = ((self.at <= high) | (self.ends <= high)) & ((self.at >= low) | (self.ends >= low))
        near = meets.all(axis=1)
        own = 4 if to is None else 3  # sides that share a corner with the triangle, two of which may bend back into it
        if np.count_nonzero(near) == own:
            next_to = self.at[[self.before[before], self.after[after]]]
            if to is not None or not ((next_to >= low) & (next_to <= high)).all(axis=1).any():
                return True
        start, end = self.at[near], self.ends[near]
        along = np.roll(triangle, -1, axis=0) - triangle

        def sides(points: np.ndarray) -> np.ndarray:
            """Return on which side of the triangle's three lines points lie, as distance times length."""
            off = points[:, None] - triangle
            return along[:, 0] * off[..., 1] - along[:, 1] * off[..., 0]

        from_start, from_end = sides(start), sides(end)
        if ((from_start > 0.0).all(axis=1) | (from_start < 0.0).all(axis=1)).any():
            return False
        span = (end - start)[:, None]
        off = triangle - start[:, None]
        across = span[..., 0] * off[..., 1] - span[..., 1] * off[..., 0]
        crossed = (from_start * from_end < 0.0) & (across * np.roll(across, -1, axis=1) < 0.0)
        return not crossed[:, [2] if to is None else [0, 1]].any()

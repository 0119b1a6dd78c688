"""The closed loops of a patch's outline: one round a disk, and one more round every hole of the surface in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Bool, Float, Int, Num

NEXT = np.array([1, 2, 3, 0])  # the corner after each of a quad
PREVIOUS = np.array([3, 0, 1, 2])  # the corner before each of a quad
SQUARE = 4.0  # perimeter over the root of the area
OPEN = 1.0  # radians: how much curvature a hole may stand for before a patch round it has to be cut open


@dataclass(frozen=True, eq=False)
class Loops:
    """Where the flat vertices of one patch lie on its outline.

    loop : the loop that a flat vertex lies on; where : its position along it; both -1 for inner ones
    lengths : edges of every loop
    """

    loop: Int[np.ndarray, " vertices"]
    where: Int[np.ndarray, " vertices"]
    lengths: Int[np.ndarray, " loops"]

    def __len__(self) -> int:
        return len(self.lengths)

    def vertices(self, number: int) -> Int[np.ndarray, " length"]:
        """The flat vertices of one loop, in order, the patch on their left."""
        mine = np.flatnonzero(self.loop == number)
        return mine[np.argsort(self.where[mine])]

    def turning(
        self, corners: Int[np.ndarray, "quads 4"], angles: Float[np.ndarray, "quads 4"]
    ) -> Float[np.ndarray, " loops"]:
        """Radians: total geodesic curvature of every loop, from the angles at the corners.

        2 pi round a flat disk, -2 pi round a hole in a flat patch, 0 round a tube.
        """
        inner = np.bincount(corners.ravel(), weights=angles.ravel(), minlength=len(self.loop))
        on = self.loop >= 0
        return np.bincount(self.loop[on], weights=np.pi - inner[on], minlength=len(self))

    def mere_holes(
        self,
        corners: Int[np.ndarray, "quads 4"],
        angles: Float[np.ndarray, "quads 4"],
        border: Bool[np.ndarray, "quads 4"],
    ) -> bool:
        """Are all loops but one holes of the surface, such as a flat patch could have? What is round a tube is none.

        border : sides on the border of the surface. A cut that floats inside the patch is no hole, and neither
        is another patch within this one.
        """
        if len(self) < 2:
            return True
        turning = self.turning(corners, angles)
        hole = np.arange(len(self)) != np.argmax(turning)
        own = np.bincount(self.loop[corners[border]], minlength=len(self)) > 0
        return bool((own & (np.abs(turning + 2 * np.pi) < OPEN))[hole].all())


def loops_of(corners: Int[np.ndarray, "quads 4"], sides: Bool[np.ndarray, "quads 4"]) -> Loops:
    """The loops of a patch from its corners, as flat vertices, and the sides on its outline."""
    count = int(corners.max()) + 1
    following = np.full(count, -1, dtype=np.int64)
    following[corners[sides]] = corners[:, NEXT][sides]
    loop, where = np.full(count, -1, dtype=np.int64), np.full(count, -1, dtype=np.int64)
    step, seen = following.tolist(), (following < 0).tolist()
    lengths: list[int] = []
    for first in np.flatnonzero(following >= 0).tolist():
        if seen[first]:
            continue
        walk, vertex = [], first
        while vertex >= 0 and not seen[vertex]:
            seen[vertex] = True
            walk.append(vertex)
            vertex = step[vertex]
        loop[walk], where[walk] = len(lengths), np.arange(len(walk))
        lengths.append(len(walk))
    return Loops(loop, where, np.array(lengths, dtype=np.int64))


def counted(
    lengths: Num[np.ndarray, " loops"],
    border: Num[np.ndarray, " loops"],
    area: Float[np.ndarray, " loops"] | float,
) -> Num[np.ndarray, " loops"]:
    """Metres: what loops count in how compact a patch is, from their lengths, the border in them, and the patch's area.

    Border beyond that of a square of the same area counts no more: there the surface itself is narrow, and cutting a ribbon
    into many short panels makes none of them any wider.
    """
    return lengths - np.maximum(border - SQUARE * np.sqrt(area), 0.0)


def perimeter(
    sides: Bool[np.ndarray, "quads 4"],
    corners: Int[np.ndarray, "quads 4"],
    loops: Loops,
    lengths: Float[np.ndarray, "quads 4"],
    border: Bool[np.ndarray, "quads 4"],
    area: float,
) -> float:
    """Metres that the outline of a patch counts: its longest loop, for holes that the surface has cost no compactness.

    lengths : metres of the sides; border : sides on the border of the surface; area : square metres
    """
    loop = loops.loop[corners[sides]]
    all_ = np.bincount(loop, weights=lengths[sides], minlength=len(loops))
    own = np.bincount(loop, weights=np.where(border, lengths, 0.0)[sides], minlength=len(loops))
    return float(counted(all_, own, area).max(initial=0.0))

"""Closed loops of a patch's outline: the outer loop, and a loop round every hole of the surface in the patch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Bool, Float, Int, Num

NEXT = np.array([1, 2, 3, 0])  # number of the corner after corner k of a quad
PREVIOUS = np.array([3, 0, 1, 2])  # number of the corner before corner k of a quad
SQUARE = 4.0  # perimeter / sqrt(area) of a square
# Largest integral curvature, radians, that a surface filling a hole would have, for a patch to be flattened with this
# hole; with more, the patch is cut open there. Larger values cut less and distort more.
OPEN = 1.0


@dataclass(frozen=True, eq=False)
class OutlineLoops:
    """Positions of a patch's flat vertices on the loops of its outline.

    loop : loop of every flat vertex; -1 for inner vertices
    position : position of every flat vertex along its loop, in edges; -1 for inner vertices
    lengths : number of edges of every loop
    """

    loop: Int[np.ndarray, " vertices"]
    position: Int[np.ndarray, " vertices"]
    lengths: Int[np.ndarray, " loops"]

    def __len__(self) -> int:
        return len(self.lengths)

    def vertices(self, number: int) -> Int[np.ndarray, " length"]:
        """Return the flat vertices of a loop in order, the patch on their left."""
        mine = np.flatnonzero(self.loop == number)
        return mine[np.argsort(self.position[mine])]

    def total_curvature(
        self, corners: Int[np.ndarray, "quads 4"], angles: Float[np.ndarray, "quads 4"]
    ) -> Float[np.ndarray, " loops"]:
        """Return the total geodesic curvature of every loop, radians, from the angles of the quads at its vertices.

        It is 2 pi round a flat disk, -2 pi round a hole in a flat patch and 0 round a tube.

        Parameters
        ----------
        corners : flat vertices of the patch's quads
        angles : angles at the corners of these quads, radians
        """
        inner = np.bincount(corners.ravel(), weights=angles.ravel(), minlength=len(self.loop))
        on = self.loop >= 0
        return np.bincount(self.loop[on], weights=np.pi - inner[on], minlength=len(self))

    def has_only_holes(
        self,
        corners: Int[np.ndarray, "quads 4"],
        angles: Float[np.ndarray, "quads 4"],
        border: Bool[np.ndarray, "quads 4"],
    ) -> bool:
        """Return whether all loops but the outer loop go round holes of the surface, as in a flat patch.

        The opening of a tube is not such a hole, nor is a loop without border edges, round an inner cut or another patch.

        Parameters
        ----------
        corners : flat vertices of the patch's quads
        angles : angles at the corners of these quads, radians
        border : mask of the quads' sides on the border of the surface
        """
        if len(self) < 2:
            return True
        turning = self.total_curvature(corners, angles)
        hole = np.arange(len(self)) != np.argmax(turning)
        own = np.bincount(self.loop[corners[border]], minlength=len(self)) > 0
        return bool((own & (np.abs(turning + 2 * np.pi) < OPEN))[hole].all())


def loops_of(corners: Int[np.ndarray, "quads 4"], sides: Bool[np.ndarray, "quads 4"]) -> OutlineLoops:
    """Return the loops of a patch's outline.

    Parameters
    ----------
    corners : flat vertices of the patch's quads
    sides : mask of the quads' sides on the outline
    """
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
    return OutlineLoops(loop, where, np.array(lengths, dtype=np.int64))


def compactness_lengths(
    lengths: Num[np.ndarray, " loops"],
    border: Num[np.ndarray, " loops"],
    area: Float[np.ndarray, " loops"] | float,
) -> Num[np.ndarray, " loops"]:
    """Return the lengths of loops that count for compactness, metres.

    The excess of a loop's border over the perimeter of a square of the patch's area does not count: there the surface
    itself is narrow, and cutting a ribbon into short panels does not make the panels wider.

    Parameters
    ----------
    lengths : lengths of the loops, metres
    border : length of the surface's border in each loop, metres
    area : area of each loop's patch, square metres
    """
    return lengths - np.maximum(border - SQUARE * np.sqrt(area), 0.0)


def perimeter(
    sides: Bool[np.ndarray, "quads 4"],
    corners: Int[np.ndarray, "quads 4"],
    loops: OutlineLoops,
    lengths: Float[np.ndarray, "quads 4"],
    border: Bool[np.ndarray, "quads 4"],
    area: float,
) -> float:
    """Return the perimeter of a patch that counts for compactness, metres: the length of its longest loop.

    Parameters
    ----------
    sides : mask of the quads' sides on the outline
    corners, loops : flat vertices of the quads, and their loops
    lengths : lengths of the sides, metres
    border : mask of the sides on the border of the surface
    area : area of the patch, square metres
    """
    loop = loops.loop[corners[sides]]
    all_ = np.bincount(loop, weights=lengths[sides], minlength=len(loops))
    own = np.bincount(loop, weights=np.where(border, lengths, 0.0)[sides], minlength=len(loops))
    return float(compactness_lengths(all_, own, area).max(initial=0.0))

"""Whole assemblies of spirals: which arms meet, and the plans that the coarse models are compared on.

All spirals of an assembly have one size. Lengths are in arm widths. Arm k of a spiral points along the k-th quarter turn
of its patch's x axis; flat patches and seams between patches in different planes are the same thing, for every spiral
keeps the rest shape of its own patch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..engine.arrays import Int
from ..engine.errors import FlexMapsError
from .geometry import QUARTER

ARMS = 4  # of a spiral
EAST, NORTH, WEST, SOUTH = range(ARMS)


@dataclass(frozen=True, eq=False)
class Plan:
    """Spirals and the joints between their arms.

    cells : column and row of every spiral in its patch
    pairs : the two spirals of every joint
    arms : in 0-3, the arm of either that ends there
    """

    cells: Int[np.ndarray, "spirals 2"]
    patch: Int[np.ndarray, " spirals"]
    pairs: Int[np.ndarray, "joints 2"]
    arms: Int[np.ndarray, "joints 2"]

    def __post_init__(self) -> None:
        ends = self.pairs * ARMS + self.arms
        if len(np.unique(ends)) != ends.size:
            raise FlexMapsError("An arm of the assembly ends in two joints")

    @property
    def count(self) -> int:
        return len(self.cells)

    def at(self, patch: int, column: int, row: int) -> int:
        """Number of the spiral in that cell of that patch."""
        return int(np.flatnonzero((self.patch == patch) & (self.cells == (column, row)).all(axis=1))[0])


def direction(arm: np.ndarray | int) -> np.ndarray:
    """(..., 2) unit vector of arms in the flat frame of their patch."""
    z = QUARTER ** np.asarray(arm)
    return np.stack([z.real, z.imag], axis=-1).round(15)


def grid(columns: int, rows: int) -> Plan:
    """One flat patch; spirals row by row."""
    return patches([(columns, rows)], [])


def patches(sizes: list[tuple[int, int]], seams: list[tuple[tuple[int, int], tuple[int, int]]]) -> Plan:
    """Several rectangular patches, joined side to side.

    sizes : columns and rows of every patch
    seams : ((patch, side), (patch, side)): a side is EAST, NORTH, WEST or SOUTH and is run through with the patch on its
        left hand; the second one is run through backwards, as neighbours on an oriented surface are
    """
    cells: list[tuple[int, int]] = []
    patch: list[int] = []
    first: list[int] = []
    for p, (columns, rows) in enumerate(sizes):
        first.append(len(cells))
        cells += [(i, j) for j in range(rows) for i in range(columns)]
        patch += [p] * (columns * rows)
    pairs: list[tuple[int, int]] = []
    arms: list[tuple[int, int]] = []
    for p, (columns, rows) in enumerate(sizes):
        for j in range(rows):
            for i in range(columns):
                own = first[p] + j * columns + i
                if i + 1 < columns:
                    pairs.append((own, own + 1))
                    arms.append((EAST, WEST))
                if j + 1 < rows:
                    pairs.append((own, own + columns))
                    arms.append((NORTH, SOUTH))
    for (p, side), (q, other) in seams:
        left = [first[p] + k for k in _side(sizes[p], side)]
        right = [first[q] + k for k in _side(sizes[q], other)]
        if len(left) != len(right):
            raise FlexMapsError("The two sides of a seam have different numbers of spirals")
        pairs += list(zip(left, right[::-1]))
        arms += [(side, other)] * len(left)
    return Plan(np.array(cells), np.array(patch), np.array(pairs).reshape(-1, 2), np.array(arms).reshape(-1, 2))


def _side(size: tuple[int, int], side: int) -> list[int]:
    """The cells along a side of a patch, in the counter-clockwise order of its outline."""
    number = np.arange(size[0] * size[1]).reshape(size[1], size[0])
    return [number[:, -1], number[-1, ::-1], number[::-1, 0], number[0]][side].tolist()


def dome(n: int) -> Plan:
    """Three square patches of n x n spirals around a corner: a quarter turn of the full angle is missing there.

    Patch p's north side is joined to patch p + 1's west side, with the corner at the north-west of every patch.
    """
    return patches([(n, n)] * 3, [((p, NORTH), ((p + 1) % 3, WEST)) for p in range(3)])


def box(n: int) -> Plan:
    """A floor of n x n spirals and four walls of the same size, joined to it and to each other: five sides of a cube.

    Patch 0 is the floor; wall 1 + k stands on its side k (EAST, NORTH, WEST, SOUTH) by its own south side.
    """
    seams = [((0, k), (1 + k, SOUTH)) for k in range(ARMS)]
    seams += [((1 + k, WEST), (1 + (k + 1) % ARMS, EAST)) for k in range(ARMS)]
    return patches([(n, n)] * 5, seams)

"""The layout of patches: one boolean per edge says where the surface is cut (FlexMaps section 4).

Merging, opening, closing and hand edits all flip runs of edges. A patch may keep cuts inside itself: that is how a
sphere becomes one patch.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from .mesh import QuadMesh


@dataclass(frozen=True, eq=False)
class PatchLayout:
    """A quad mesh and where it is cut.

    mesh : the surface
    cut : (E,) bool, True where the surface is cut; border edges are never marked
    """

    mesh: QuadMesh
    cut: np.ndarray

    @cached_property
    def joined(self) -> np.ndarray:
        """(J,) int: inner edges that are not cut."""
        return np.flatnonzero(~self.cut & ~self.mesh.border)

    @cached_property
    def patch_of(self) -> np.ndarray:
        """(F,) int: the patch of every quad, numbered 0.. by the smallest quad in it."""
        n = len(self.mesh.quads)
        a, b = self.mesh.edge_quads[self.joined].T
        labels = connected_components(coo_array((np.ones(len(a)), (a, b)), shape=(n, n)), directed=False)[1]
        _, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
        rank = np.empty(len(first), dtype=np.int64)
        rank[np.argsort(first)] = np.arange(len(first))
        return rank[inverse]

    @cached_property
    def patches(self) -> tuple[np.ndarray, ...]:
        """One int array of quads per patch, ascending."""
        order = np.argsort(self.patch_of, kind="stable")
        counts = np.bincount(self.patch_of)
        return tuple(np.split(order, np.cumsum(counts)[:-1]))

    @cached_property
    def flat_corners(self) -> np.ndarray:
        """(F, 4) int: the flat vertex of every quad corner.

        Corners of two quads are one flat vertex where the quads share an uncut edge. Numbered 0..P-1.
        """
        mesh = self.mesh
        (qa, qb), (ka, kb) = mesh.edge_quads[self.joined].T, mesh.edge_sides[self.joined].T
        # side k of one quad runs against side k' of the other: corner k meets corner k'+1, k+1 meets k'
        a = np.concatenate([4 * qa + ka, 4 * qa + (ka + 1) % 4])
        b = np.concatenate([4 * qb + (kb + 1) % 4, 4 * qb + kb])
        n = 4 * len(mesh.quads)
        labels = connected_components(coo_array((np.ones(len(a)), (a, b)), shape=(n, n)), directed=False)[1]
        return labels.reshape(-1, 4)

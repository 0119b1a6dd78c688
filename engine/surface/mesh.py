"""Polygon meshes as they come in, and the quad mesh with its topology that everything else works on."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ..arrays import Bool, Float, Int

TOPOLOGY = ("_edges", "_edge_uses", "border", "neighbours", "valence", "on_border", "dual", "dual_edges", "body_of")


@dataclass(frozen=True, eq=False)
class PolygonMesh:
    """Any polygon mesh, unchecked: what a file or Blender gives.

    vertices : (V, 3) float, metres (or unit-less, before scaling)
    corners : (C,) int, vertex index of every face corner, face after face
    sizes : (F,) int, number of corners of every face
    left_out : sentences about what its file holds beside, for ``check`` to pass on
    cured : codes and sentences of faults that were mended when it was read, for ``check`` to pass on
    """

    vertices: np.ndarray
    corners: np.ndarray
    sizes: np.ndarray
    left_out: tuple[str, ...] = ()
    cured: tuple[tuple[str, str], ...] = ()

    def kept(self, faces: Bool[np.ndarray, " faces"]) -> PolygonMesh:
        """The same vertices with some of the faces."""
        if faces.all():
            return self
        return replace(self, corners=self.corners[np.repeat(faces, self.sizes)], sizes=self.sizes[faces])

    def in_order(self) -> PolygonMesh:
        """The same polygons with vertices and faces numbered by where they lie, so that one shape has one numbering.

        Blender's own primitives are numbered otherwise every time that they are made.
        """
        order = np.lexsort(self.vertices.T[::-1])
        rank = np.empty(len(order), np.int64)
        rank[order] = np.arange(len(order))
        corners, sizes = rank[self.corners], self.sizes.astype(np.int64)
        starts = np.cumsum(sizes) - sizes
        low = np.minimum.reduceat(corners, starts)
        at = np.arange(len(corners)) - np.repeat(starts, sizes)
        lowest = np.where(corners == np.repeat(low, sizes), at, len(corners))
        shift = np.minimum.reduceat(lowest, starts)
        turned = corners[np.repeat(starts, sizes) + (at + np.repeat(shift, sizes)) % np.repeat(sizes, sizes)]
        faces = np.lexsort((turned[starts + 2], turned[starts + 1], turned[starts]))
        sizes = sizes[faces]
        begins = np.cumsum(sizes) - sizes
        places = np.repeat(starts[faces] - begins, sizes) + np.arange(len(turned))
        return replace(self, vertices=self.vertices[order], corners=turned[places], sizes=sizes)

    @classmethod
    def of(cls, mesh: QuadMesh) -> PolygonMesh:
        """A quad mesh as polygons."""
        return cls(mesh.vertices, mesh.quads.ravel(), np.full(len(mesh.quads), 4))


@dataclass(frozen=True, eq=False)
class QuadMesh:
    """A clean quad mesh: manifold, consistently oriented, no degenerate quads. Made by ``check.as_quad_mesh``.

    vertices : metres
    quads : vertex indices, counter-clockwise seen from outside

    Side k of a quad runs from its corner k to its corner (k+1) % 4. Edges are numbered by ascending vertex pair.
    """

    vertices: Float[np.ndarray, "vertices 3"]
    quads: Int[np.ndarray, "quads 4"]

    def moved(self, vertices: Float[np.ndarray, "vertices 3"]) -> QuadMesh:
        """The same quads with other vertex positions, metres; the topology is shared, not computed again."""
        other = QuadMesh(np.asarray(vertices, dtype=float), self.quads)
        for name in TOPOLOGY:
            if name in self.__dict__:
                other.__dict__[name] = self.__dict__[name]
        return other

    # -- topology ------------------------------------------------------------------------------------------------

    @cached_property
    def _edges(self) -> tuple[np.ndarray, np.ndarray]:
        sides = np.stack([self.quads, np.roll(self.quads, -1, axis=1)], axis=2).reshape(-1, 2)
        low, high = sides.min(axis=1).astype(np.int64), sides.max(axis=1).astype(np.int64)
        keys, of_side = np.unique(low * len(self.vertices) + high, return_inverse=True)
        pairs = np.stack([keys // len(self.vertices), keys % len(self.vertices)], axis=1)
        return pairs, of_side.reshape(-1, 4)

    @property
    def edges(self) -> Int[np.ndarray, "edges 2"]:
        """The vertices of every edge, the smaller index first."""
        return self._edges[0]

    @property
    def quad_edges(self) -> Int[np.ndarray, "quads 4"]:
        """The edge under side k of every quad."""
        return self._edges[1]

    @property
    def edge_quads(self) -> Int[np.ndarray, "edges 2"]:
        """The quads on both sides of every edge; -1 where there is none.

        Column 0 is the quad that runs along the edge from its smaller to its larger vertex, if there is one.
        """
        return self._edge_uses[0]

    @property
    def edge_sides(self) -> Int[np.ndarray, "edges 2"]:
        """Which side (0-3) of the quads in ``edge_quads`` lies on the edge; -1 where there is none."""
        return self._edge_uses[1]

    @cached_property
    def _edge_uses(self) -> tuple[np.ndarray, np.ndarray]:
        quads = np.full((len(self.edges), 2), -1, dtype=np.int64)
        sides = np.full((len(self.edges), 2), -1, dtype=np.int64)
        face, side = np.divmod(np.arange(self.quads.size), 4)
        edge = self.quad_edges.ravel()
        column = (self.quads.ravel() > np.roll(self.quads, -1, axis=1).ravel()).astype(np.int64)
        quads[edge, column] = face
        sides[edge, column] = side
        return quads, sides

    @cached_property
    def neighbours(self) -> Int[np.ndarray, "quads 4"]:
        """The quad across every side; -1 at the border."""
        pair = self.edge_quads[self.quad_edges]
        own = np.arange(len(self.quads))[:, None]
        return np.where(pair[..., 0] == own, pair[..., 1], pair[..., 0])

    @cached_property
    def border(self) -> Bool[np.ndarray, " edges"]:
        """Edges with a quad on one side only."""
        return (self.edge_quads < 0).any(axis=1)

    @cached_property
    def valence(self) -> Int[np.ndarray, " vertices"]:
        """Number of edges at every vertex."""
        return np.bincount(self.edges.ravel(), minlength=len(self.vertices))

    @cached_property
    def on_border(self) -> Bool[np.ndarray, " vertices"]:
        """Vertices on the border."""
        mask = np.zeros(len(self.vertices), dtype=bool)
        mask[self.edges[self.border].ravel()] = True
        return mask

    @property
    def irregular(self) -> Bool[np.ndarray, " vertices"]:
        """Inner vertices without 4 edges. Border vertices with other than 3 are irregular but for valence 2."""
        inner = ~self.on_border & (self.valence != 4) & (self.valence > 0)
        return inner | (self.on_border & (self.valence > 3))

    @cached_property
    def dual(self) -> Int[np.ndarray, "joints 2"]:
        """Pairs of quads that share an edge; row d belongs to ``dual_edges[d]``."""
        return self.edge_quads[self.dual_edges]

    @cached_property
    def dual_edges(self) -> Int[np.ndarray, " joints"]:
        """The edges that are not on the border."""
        return np.flatnonzero(~self.border)

    @cached_property
    def body_of(self) -> Int[np.ndarray, " quads"]:
        """The connected body that every quad belongs to."""
        n = len(self.quads)
        a, b = self.dual.T
        return connected_components(coo_array((np.ones(len(a)), (a, b)), shape=(n, n)), directed=False)[1]

    # -- geometry ------------------------------------------------------------------------------------------------

    @cached_property
    def edge_lengths(self) -> Float[np.ndarray, " edges"]:
        """Metres."""
        return np.linalg.norm(self.vertices[self.edges[:, 1]] - self.vertices[self.edges[:, 0]], axis=1)

    @cached_property
    def median_edge(self) -> float:
        """Median edge length, metres."""
        return float(np.median(self.edge_lengths))

    @cached_property
    def centroids(self) -> Float[np.ndarray, "quads 3"]:
        """Metres: mean of the four corners; the target positions of the spirals' centres."""
        return self.vertices[self.quads].mean(axis=1)

    @cached_property
    def area_vectors(self) -> Float[np.ndarray, "quads 3"]:
        """Square metres: half the cross product of the diagonals; its length is the (projected) area."""
        p = self.vertices[self.quads]
        return 0.5 * np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])

    @cached_property
    def areas(self) -> Float[np.ndarray, " quads"]:
        """Square metres."""
        return np.linalg.norm(self.area_vectors, axis=1)

    @cached_property
    def normals(self) -> Float[np.ndarray, "quads 3"]:
        """Unit normals."""
        return self.area_vectors / np.maximum(self.areas, 1e-300)[:, None]

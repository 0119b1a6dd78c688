"""Polygon meshes of any kind, as read from files, and checked quad meshes with their topology."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..arrays import Bool, Float, Int
from ..components import components

TOPOLOGY_CACHES = (
    "_edges",
    "_edge_uses",
    "border",
    "neighbours",
    "valence",
    "on_border",
    "dual",
    "dual_edges",
    "body_of",
)


@dataclass(frozen=True, eq=False)
class PolygonMesh:
    """Any polygon mesh, unchecked, as a file or Blender gives it.

    vertices : (V, 3) float, metres (or in the file's unit, before scaling)
    corners : (C,) int, vertex index of every face corner, face after face
    sizes : (F,) int, number of corners of every face
    left_out : messages about data of the file that were not read; ``check`` reports them
    repairs : codes and messages of faults that were repaired on reading; ``check`` reports them
    """

    vertices: np.ndarray
    corners: np.ndarray
    sizes: np.ndarray
    left_out: tuple[str, ...] = ()
    repairs: tuple[tuple[str, str], ...] = ()

    @property
    def starts(self) -> Int[np.ndarray, " faces"]:
        """Index of the first corner of every face."""
        return np.cumsum(self.sizes) - self.sizes

    @property
    def face_of(self) -> Int[np.ndarray, " corners"]:
        """Face of every corner."""
        return np.repeat(np.arange(len(self.sizes)), self.sizes)

    @property
    def next_corner(self) -> Int[np.ndarray, " corners"]:
        """Index of the next corner of the same face, for every corner."""
        after, ends = np.arange(1, len(self.corners) + 1), np.cumsum(self.sizes)
        after[ends - 1] = ends - self.sizes
        return after

    @property
    def centres(self) -> Float[np.ndarray, "faces 3"]:
        """Mean of every face's corners."""
        corners = np.asarray(self.vertices, float)[self.corners]
        return np.add.reduceat(corners, self.starts, axis=0) / self.sizes[:, None]

    def subset(self, faces: Bool[np.ndarray, " faces"]) -> PolygonMesh:
        """Return a mesh with only the masked faces; all vertices stay."""
        if faces.all():
            return self
        return replace(self, corners=self.corners[np.repeat(faces, self.sizes)], sizes=self.sizes[faces])

    def with_canonical_order(self) -> PolygonMesh:
        """Return this mesh with vertices and faces numbered by position, so that equal shapes have equal numbering.

        Blender numbers its own primitives differently every time it makes them.
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
    def from_quads(cls, mesh: QuadMesh) -> PolygonMesh:
        """Return a quad mesh as a polygon mesh."""
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

    def with_vertices(self, vertices: Float[np.ndarray, "vertices 3"]) -> QuadMesh:
        """Return these quads with other vertex positions, metres; topology that is already computed is reused."""
        other = QuadMesh(np.asarray(vertices, dtype=float), self.quads)
        for name in TOPOLOGY_CACHES:
            if name in self.__dict__:
                other.__dict__[name] = self.__dict__[name]
        return other

    # -- topology ------------------------------------------------------------------------------------------------

    @cached_property
    def _edges(self) -> tuple[np.ndarray, np.ndarray]:
        """Vertex pairs of all edges, and the edge index of every side of every quad."""
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
        """The edge of side k of every quad."""
        return self._edges[1]

    @property
    def edge_quads(self) -> Int[np.ndarray, "edges 2"]:
        """The quads on both sides of every edge; -1 where there is none.

        Column 0 is the quad that runs along the edge from its smaller to its larger vertex, if there is one.
        """
        return self._edge_uses[0]

    @property
    def edge_sides(self) -> Int[np.ndarray, "edges 2"]:
        """Side number (0-3) of the edge within each quad of ``edge_quads``; -1 where there is none."""
        return self._edge_uses[1]

    @cached_property
    def _edge_uses(self) -> tuple[np.ndarray, np.ndarray]:
        """The arrays ``edge_quads`` and ``edge_sides``."""
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
        """Mask of the border edges, which have a quad on only one side."""
        return (self.edge_quads < 0).any(axis=1)

    @cached_property
    def valence(self) -> Int[np.ndarray, " vertices"]:
        """Number of edges at every vertex."""
        return np.bincount(self.edges.ravel(), minlength=len(self.vertices))

    @cached_property
    def on_border(self) -> Bool[np.ndarray, " vertices"]:
        """Mask of the vertices on the border."""
        mask = np.zeros(len(self.vertices), dtype=bool)
        mask[self.edges[self.border].ravel()] = True
        return mask

    @property
    def irregular(self) -> Bool[np.ndarray, " vertices"]:
        """Mask of irregular vertices: inner vertices without exactly 4 edges, border vertices with more than 3 edges."""
        inner = ~self.on_border & (self.valence != 4) & (self.valence > 0)
        return inner | (self.on_border & (self.valence > 3))

    @cached_property
    def dual(self) -> Int[np.ndarray, "joints 2"]:
        """Pairs of quads that share an edge; row d belongs to ``dual_edges[d]``."""
        return self.edge_quads[self.dual_edges]

    @cached_property
    def dual_edges(self) -> Int[np.ndarray, " joints"]:
        """Indices of the edges that are not on the border."""
        return np.flatnonzero(~self.border)

    @cached_property
    def body_of(self) -> Int[np.ndarray, " quads"]:
        """Number of the connected body of every quad."""
        return components(len(self.quads), *self.dual.T)

    @property
    def body_count(self) -> int:
        """Number of connected bodies."""
        return int(self.body_of.max()) + 1

    # -- geometry ------------------------------------------------------------------------------------------------

    @cached_property
    def edge_lengths(self) -> Float[np.ndarray, " edges"]:
        """Length of every edge, metres."""
        return np.linalg.norm(self.vertices[self.edges[:, 1]] - self.vertices[self.edges[:, 0]], axis=1)

    @cached_property
    def diagonal(self) -> float:
        """Diagonal of the bounding box of all vertices, metres; deviations in per cent are shares of it."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)))

    @cached_property
    def median_edge(self) -> float:
        """Median edge length, metres."""
        return float(np.median(self.edge_lengths))

    @cached_property
    def centroids(self) -> Float[np.ndarray, "quads 3"]:
        """Mean of the four corners of every quad, metres: the target position of the spiral's centre."""
        return self.vertices[self.quads].mean(axis=1)

    @cached_property
    def area_vectors(self) -> Float[np.ndarray, "quads 3"]:
        """Half the cross product of every quad's diagonals, square metres; its length is the projected area."""
        p = self.vertices[self.quads]
        return 0.5 * np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])

    @cached_property
    def areas(self) -> Float[np.ndarray, " quads"]:
        """Projected area of every quad, square metres."""
        return np.linalg.norm(self.area_vectors, axis=1)

    @cached_property
    def normals(self) -> Float[np.ndarray, "quads 3"]:
        """Unit normal of every quad."""
        return self.area_vectors / np.maximum(self.areas, 1e-300)[:, None]

"""Constraints on vertices while a mesh is regularised: they stay on its surface, border, creases and corners."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Bool, Float, Int
from ...components import components
from ..mesh import QuadMesh
from ..triangle_tree import TriangleTree

# Largest move of a vertex per round, as a share of the shortest edge at the vertex (present or original length, whichever
# is shorter). Larger: fewer rounds; from 0.5 the ends of an edge could pass each other.
STEP = 0.3
# Angle, radians, by which a line (border or crease) must turn at a vertex for a fixed corner. Larger: fewer fixed
# corners, more vertices slide along the line.
TURN = np.radians(50.0)
# Smallest angle between the normals of two faces at a crease, radians. Larger: fewer creases are preserved.
CREASE = np.radians(80.0)
CREASE_EDGES = 6  # smallest number of connected sharp edges that make a crease; larger: more sharp edges count as noise


def triangulate_at_centroids(mesh: QuadMesh) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and triangles of a quad mesh, each quad split into four triangles round its centroid.

    Unlike a split into two triangles, this prefers neither diagonal.
    """
    middle = len(mesh.vertices) + np.arange(len(mesh.quads))
    triangles = np.stack([mesh.quads, np.roll(mesh.quads, -1, axis=1), np.repeat(middle[:, None], 4, axis=1)], axis=2)
    return np.concatenate([mesh.vertices, mesh.centroids]), np.ascontiguousarray(
        triangles.reshape(-1, 3), dtype=np.int64
    )


def _vertex_normals(mesh: QuadMesh, points: np.ndarray) -> Float[np.ndarray, "vertices 3"]:
    """Return unit vertex normals, area-weighted means of the quads' normals, for vertices at ``points``."""
    p = points[mesh.quads]
    vectors = np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])
    total = np.zeros_like(points)
    np.add.at(total, mesh.quads, vectors[:, None, :])
    return total / np.maximum(np.linalg.norm(total, axis=1), 1e-300)[:, None]


def _shortest_edges(mesh: QuadMesh, points: np.ndarray) -> Float[np.ndarray, " vertices"]:
    """Return the length of the shortest edge at every vertex, metres, for vertices at ``points``."""
    shortest = np.full(len(points), np.inf)
    np.minimum.at(shortest, mesh.edges, np.linalg.norm(np.diff(points[mesh.edges], axis=1), axis=2))
    return shortest


@dataclass(frozen=True, eq=False)
class VertexConstraints:
    """Surface, lines (border and creases) and corners of the original mesh, on which vertices must stay.

    mesh : the original mesh
    surface : the original surface as triangles, with a search tree
    shortest : original length of the shortest edge at every vertex, metres
    is_fixed : mask of vertices that do not move
    sliding : vertices that may move along a line
    before, after : neighbours of the sliding vertices on their line
    line_edges : edges of the lines, as pairs of vertices
    """

    mesh: QuadMesh
    surface: TriangleTree
    shortest: Float[np.ndarray, " vertices"]
    is_fixed: Bool[np.ndarray, " vertices"]
    sliding: Int[np.ndarray, " sliding"]
    before: Int[np.ndarray, " sliding"]
    after: Int[np.ndarray, " sliding"]
    line_edges: Int[np.ndarray, "lines 2"]

    @classmethod
    def from_mesh(cls, mesh: QuadMesh, boundary: bool) -> VertexConstraints:
        """Build the constraints of a mesh; with ``boundary``, border vertices stay on the border."""
        shortest = _shortest_edges(mesh, mesh.vertices)
        line_edges = mesh.edges[_feature_edges(mesh, boundary)]
        fixed, sliding, before, after = _classify_line_vertices(mesh, line_edges)
        return cls(
            mesh, TriangleTree(*triangulate_at_centroids(mesh)), shortest, fixed, sliding, before, after, line_edges
        )

    def move_towards(self, start: np.ndarray, wanted: np.ndarray) -> Float[np.ndarray, "vertices 3"]:
        """Return positions moved from ``start`` towards ``wanted``, on the surface and on the lines.

        Moves are shortened so that no edge is reversed. All positions are in metres.
        """
        step = wanted - start
        normal = _vertex_normals(self.mesh, start)
        step -= np.einsum("vi,vi->v", step, normal)[:, None] * normal
        tangent = start[self.after] - start[self.before]
        tangent /= np.maximum(np.linalg.norm(tangent, axis=1), 1e-300)[:, None]
        step[self.sliding] = np.einsum("si,si->s", step[self.sliding], tangent)[:, None] * tangent
        step[self.is_fixed] = 0.0
        length = np.linalg.norm(step, axis=1)
        longest = STEP * np.minimum(self.shortest, _shortest_edges(self.mesh, start))
        step *= np.minimum(1.0, longest / np.maximum(length, 1e-300))[:, None]
        _, face, found = self.surface.closest(start + step)
        # on a thin part the nearest point may lie on its other side: such vertices do not move
        beyond = np.einsum("vi,vi->v", self.surface.normals[face], normal) < 0
        found[beyond] = start[beyond]
        if len(self.sliding):
            import igl

            found[self.sliding] = igl.point_mesh_squared_distance(
                (start + step)[self.sliding], self.mesh.vertices, self.line_edges
            )[2]
        found[self.is_fixed] = start[self.is_fixed]
        return found


def _feature_edges(mesh: QuadMesh, boundary: bool) -> Int[np.ndarray, " lines"]:
    """Return indices of the edges of creases and, with ``boundary``, of the border."""
    a, b = mesh.dual.T
    sharp = mesh.dual_edges[np.einsum("di,di->d", mesh.normals[a], mesh.normals[b]) < np.cos(CREASE)]
    if len(sharp):
        ends = mesh.edges[sharp]
        part = components(len(mesh.vertices), *ends.T)[ends[:, 0]]
        sharp = sharp[np.bincount(part)[part] >= CREASE_EDGES]
    return np.union1d(np.flatnonzero(mesh.border), sharp) if boundary else sharp


def _classify_line_vertices(
    mesh: QuadMesh, line_edges: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Classify the vertices on lines.

    Returns
    -------
    mask of fixed vertices (ends, crossings and corners of lines); sliding vertices; their neighbours before and after
    on the line
    """
    n = len(mesh.vertices)
    ends = np.concatenate([line_edges, line_edges[:, ::-1]])
    ends = ends[np.lexsort((ends[:, 1], ends[:, 0]))]
    count = np.bincount(ends[:, 0], minlength=n)
    first = np.searchsorted(ends[:, 0], np.flatnonzero(count == 2))
    sliding = np.flatnonzero(count == 2)
    before, after = ends[first, 1], ends[np.minimum(first + 1, len(ends) - 1), 1] if len(ends) else first
    incoming, outgoing = mesh.vertices[sliding] - mesh.vertices[before], mesh.vertices[after] - mesh.vertices[sliding]
    cosine = np.einsum("si,si->s", incoming, outgoing)
    cosine /= np.maximum(np.linalg.norm(incoming, axis=1) * np.linalg.norm(outgoing, axis=1), 1e-300)
    straight = cosine > np.cos(TURN)
    fixed = (count > 0) & (count != 2)
    fixed[sliding[~straight]] = True
    return fixed, sliding[straight], before[straight], after[straight]


# -- distances ---------------------------------------------------------------------------------------------------------


def sample_points(mesh: QuadMesh) -> np.ndarray:
    """Return the vertices and the quads' centroids, (V + F, 3): points to measure distances from."""
    return np.concatenate([mesh.vertices, mesh.centroids])


def distances(mesh: QuadMesh, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, " points"]:
    """Return the distances from points to the surface of a quad mesh, metres."""
    import igl

    return np.sqrt(igl.point_mesh_squared_distance(points, *triangulate_at_centroids(mesh))[0])

"""Make the quads squarer without leaving the surface, before they are flattened.

Every quad pulls its corners towards the square that fits it best; every vertex goes to the mean of what its quads want
and back onto the surface (after Pietroni et al. 2015, Bouaziz et al. 2012). Vertices of the border and of sharp creases
stay on these lines, their corners stay where they are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from .mesh import QuadMesh
from .params import RegulariseParams
from .progress import SILENT, Progress
from .symmetry import symmetries

STEP = 0.3  # longest move of a vertex in one round, relative to the edges at it
MOMENTUM = 0.5  # share of the last move that goes on: twice as far in the same number of rounds
EVERY = 5  # rounds after which spoilt quads are looked for
TURN = np.radians(50.0)  # a line that turns more than this at a vertex has a corner there
CREASE = np.radians(80.0)  # faces that meet at a larger angle than this have a crease between them
CREASE_EDGES = 6  # fewest edges in a row of creases that counts: single sharp edges are noise
WORSE = 0.02  # how much a quad's square energy may grow for the good of the others
SYMMETRY = 0.01  # how far a mirrored vertex may be off, relative to the median edge
WARP = 0.15  # how far corners may lie off their quad's plane, relative to its shortest side: more cannot be flattened
DEVIATION = 0.3  # how far the new mesh may leave a vertex or middle of the old one, relative to the edges there


def square_energy(corners: np.ndarray) -> np.ndarray:
    """How far quads (F, 4, 3) are from a square of the same area: 0 for a square, (F,).

    Mean over the four corner triangles of (s1-1)^2 + (s2-1)^2 of the map from the square, as ``FlatPatches.square``, but
    in space.
    """
    along, against = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    area = 0.5 * np.linalg.norm(normal, axis=1)
    cross = np.cross(along, against)
    # a corner that is turned over counts with its sign
    double = np.linalg.norm(cross, axis=2) * np.sign(np.einsum("fki,fi->fk", cross, normal))
    square = np.maximum(area, 1e-300)[:, None]
    squares = ((along**2).sum(axis=2) + (against**2).sum(axis=2)) / square
    sums = np.sqrt(np.maximum(squares + 2 * double / square, 0.0))
    return (squares - 2 * sums + 2).mean(axis=1)


def regularise(mesh: QuadMesh, params: RegulariseParams, progress: Progress = SILENT) -> QuadMesh:
    """The same quads, squarer: vertices moved along the surface, the border and the creases of ``mesh``.

    No quad is turned over or becomes much worse, and no part of the surface is lost: where a move would do so it is
    taken back, in the worst case all of them. ``params.boundary`` False lets border vertices slide freely over the
    surface. A symmetric mesh stays symmetric.
    """
    if params.iterations == 0:
        return mesh
    guide = _Guide.of(mesh, params.boundary)
    points = before = mesh.vertices
    anchor = np.zeros(len(points))
    for done in range(params.iterations):
        progress(0.9 * done / params.iterations, "regularise")
        if done % EVERY == EVERY - 1:
            anchor = _anchored(mesh, points, anchor)
        pull = _pull(mesh, points)
        hold = anchor[:, None]
        wanted = points + (pull + hold * (mesh.vertices - points)) / (1 + hold) + MOMENTUM * (points - before)
        points, before = guide.back(points, wanted), points
    progress(0.9, "regularise")
    points = _symmetric(mesh, _unwarped(mesh, _guarded(mesh, points, guide)))
    better = square_energy(points[mesh.quads]).mean() < square_energy(mesh.vertices[mesh.quads]).mean()
    return mesh.moved(points) if better else mesh


def deviation(mesh: QuadMesh, other: QuadMesh) -> float:
    """Largest distance between two surfaces with the same quads, metres: from the vertices and middles of each to the other."""
    return float(max(_distances(mesh, _samples(other)).max(), _distances(other, _samples(mesh)).max()))


# -- one round -------------------------------------------------------------------------------------------------------


def _pull(mesh: QuadMesh, points: np.ndarray) -> np.ndarray:
    """(V, 3) metres: from every vertex to the mean of the corners that its quads want it to be."""
    corners = points[mesh.quads]
    squares = _best_squares(corners)
    # distances relative to the quad's size are what counts: without the weight large quads crush small neighbours
    diagonals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    area = np.linalg.norm(diagonals, axis=1)
    weight = np.repeat(1.0 / np.maximum(area, 1e-3 * np.median(area)), 4)
    at = mesh.quads.ravel()
    total = np.stack(
        [np.bincount(at, weight * squares[..., k].ravel(), minlength=len(points)) for k in range(3)], axis=1
    )
    return total / np.maximum(np.bincount(at, weight, minlength=len(points)), 1e-300)[:, None] - points


def _best_squares(corners: np.ndarray) -> np.ndarray:
    """(F, 4, 3): the corners of the square nearest to every quad (F, 4, 3) in the sense of least squares.

    The diagonals G = (d1, d2) of a square are orthogonal and equally long; the nearest such pair is
    s Q with the polar factor Q = G (G^T G)^-1/2 and s the mean singular value.
    """
    middle = corners.mean(axis=1)
    first, second = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    a, b = np.einsum("fi,fi->f", first, first), np.einsum("fi,fi->f", second, second)
    c = np.einsum("fi,fi->f", first, second)
    root = np.sqrt(np.maximum(a * b - c * c, 0.0))  # s1 s2
    # for 2 x 2 matrices (G^T G)^-1/2 = [[b + root, -c], [-c, a + root]] / (root * (s1 + s2))
    factor = 0.25 / np.maximum(root, 1e-12 * (a + b) + 1e-300)  # half a diagonal of (s1 + s2) / 2 Q
    one = ((b + root)[:, None] * first - c[:, None] * second) * factor[:, None]
    two = ((a + root)[:, None] * second - c[:, None] * first) * factor[:, None]
    return np.stack([middle - one, middle - two, middle + one, middle + two], axis=1)


def _fan(mesh: QuadMesh) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of the surface: every quad as four triangles round its middle, which favours no diagonal."""
    middle = len(mesh.vertices) + np.arange(len(mesh.quads))
    triangles = np.stack([mesh.quads, np.roll(mesh.quads, -1, axis=1), np.repeat(middle[:, None], 4, axis=1)], axis=2)
    return np.concatenate([mesh.vertices, mesh.centroids]), np.ascontiguousarray(
        triangles.reshape(-1, 3), dtype=np.int64
    )


def _vertex_normals(mesh: QuadMesh, points: np.ndarray) -> np.ndarray:
    """(V, 3) unit, weighted by area."""
    p = points[mesh.quads]
    vectors = np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])
    total = np.zeros_like(points)
    np.add.at(total, mesh.quads, vectors[:, None, :])
    return total / np.maximum(np.linalg.norm(total, axis=1), 1e-300)[:, None]


@dataclass(frozen=True, eq=False)
class _Guide:
    """Where the vertices may go: the surface of the mesh as it came, its lines (border and creases) and their corners.

    reach : (V,) metres, the longest step of every vertex
    fixed : (V,) bool; sliding : (S,) int, vertices on a line; before, after : (S,) int, their neighbours on it
    line_edges : (L, 2) int, the lines
    """

    mesh: QuadMesh
    tree: object
    vertices: np.ndarray
    triangles: np.ndarray
    normals: np.ndarray
    reach: np.ndarray
    fixed: np.ndarray
    sliding: np.ndarray
    before: np.ndarray
    after: np.ndarray
    line_edges: np.ndarray

    @classmethod
    def of(cls, mesh: QuadMesh, boundary: bool) -> _Guide:
        import igl

        vertices, triangles = _fan(mesh)
        tree = igl.AABB()
        tree.init(vertices, triangles)
        a, b, c = vertices[triangles.T]
        normals = np.cross(b - a, c - a)
        normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
        shortest = np.full(len(mesh.vertices), np.inf)
        np.minimum.at(shortest, mesh.edges, mesh.edge_lengths[:, None])
        line_edges = mesh.edges[_lines(mesh, boundary)]
        fixed, sliding, before, after = _along(mesh, line_edges)
        return cls(mesh, tree, vertices, triangles, normals, STEP * shortest, fixed, sliding, before, after, line_edges)

    def back(self, start: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """(V, 3) metres: ``wanted`` brought back to the surface and the lines, no further than ``reach`` from ``start``."""
        step = wanted - start
        normal = _vertex_normals(self.mesh, start)
        step -= np.einsum("vi,vi->v", step, normal)[:, None] * normal
        tangent = start[self.after] - start[self.before]
        tangent /= np.maximum(np.linalg.norm(tangent, axis=1), 1e-300)[:, None]
        step[self.sliding] = np.einsum("si,si->s", step[self.sliding], tangent)[:, None] * tangent
        step[self.fixed] = 0.0
        length = np.linalg.norm(step, axis=1)
        step *= np.minimum(1.0, self.reach / np.maximum(length, 1e-300))[:, None]
        _, face, found = self.tree.squared_distance(self.vertices, self.triangles, start + step)  # type: ignore[attr-defined]
        # on a thin part the nearest point may lie on the far side
        found[np.einsum("vi,vi->v", self.normals[face], normal) < 0] = start[
            np.einsum("vi,vi->v", self.normals[face], normal) < 0
        ]
        if len(self.sliding):
            import igl

            found[self.sliding] = igl.point_mesh_squared_distance(
                (start + step)[self.sliding], self.mesh.vertices, self.line_edges
            )[2]
        found[self.fixed] = start[self.fixed]
        return found


def _lines(mesh: QuadMesh, boundary: bool) -> np.ndarray:
    """(L,) int: edges of the border and of creases."""
    a, b = mesh.dual.T
    sharp = mesh.dual_edges[np.einsum("di,di->d", mesh.normals[a], mesh.normals[b]) < np.cos(CREASE)]
    if len(sharp):
        ends = mesh.edges[sharp]
        n = len(mesh.vertices)
        part = connected_components(coo_array((np.ones(len(ends)), ends.T), shape=(n, n)), directed=False)[1][
            ends[:, 0]
        ]
        sharp = sharp[np.bincount(part)[part] >= CREASE_EDGES]
    return np.union1d(np.flatnonzero(mesh.border), sharp) if boundary else sharp


def _along(mesh: QuadMesh, line_edges: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Fixed vertices (V,) bool: ends, crossings and corners of lines; the sliding ones, and their neighbours along the line."""
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


def _anchored(mesh: QuadMesh, points: np.ndarray, anchor: np.ndarray) -> np.ndarray:
    """(V,): how strongly every vertex is held where it was; more where quads are spoilt, less elsewhere."""
    bad = _spoilt(mesh, mesh.moved(points))
    near = np.zeros(len(points), dtype=bool)
    near[mesh.quads[bad]] = True
    return np.where(near, np.minimum(2 * anchor + 0.2, 10.0), 0.8 * anchor)


# -- guard -----------------------------------------------------------------------------------------------------------


def _guarded(mesh: QuadMesh, points: np.ndarray, guide: _Guide) -> np.ndarray:
    """Take moves back, more and more and in a wider and wider round, until nothing is worse than allowed."""
    share = np.ones(len(points))
    current = points
    for _ in range(40):
        bad = _spoilt(mesh, mesh.moved(current))
        if not bad.any():
            return current
        near = np.zeros(len(points), dtype=bool)
        near[mesh.quads[bad]] = True
        share[near] *= 0.5
        share[share < 0.1] = 0.0
        # spread, so that the next quads do not tear
        spread = share[mesh.quads].min(axis=1)
        softer = np.ones(len(points))
        np.minimum.at(softer, mesh.quads, 0.5 * (1 + spread)[:, None])
        share = np.minimum(share, softer)
        current = guide.back(mesh.vertices, mesh.vertices + share[:, None] * (points - mesh.vertices))
    return mesh.vertices


def _unwarped(mesh: QuadMesh, points: np.ndarray) -> np.ndarray:
    """Press warped quads flat, where it must be off the surface, until no corner is further than WARP off its plane.

    A quad much more warped than that cannot be flattened within any useful distortion. Border vertices stay.
    """
    signs = np.array([1.0, -1.0, 1.0, -1.0])
    for _ in range(100):
        p = points[mesh.quads]
        normal = np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])
        normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
        # all four corners are equally far from the plane, alternately above and below
        off = 0.25 * np.einsum("k,fki,fi->f", signs, p, normal)
        allowed = WARP * np.linalg.norm(np.roll(p, -1, axis=1) - p, axis=2).min(axis=1)
        excess = np.sign(off) * np.maximum(np.abs(off) - 0.9 * allowed, 0.0) * (np.abs(off) > allowed)
        if not excess.any():
            break
        step = np.zeros_like(points)
        np.add.at(step, mesh.quads, -0.5 * excess[:, None, None] * signs[:, None] * normal[:, None, :])
        step[mesh.on_border] = 0.0
        points = points + step
    return points


def _symmetric(mesh: QuadMesh, points: np.ndarray) -> np.ndarray:
    """Moves averaged over the symmetries of ``mesh``: ties between nearest points break them by a hair."""
    moves = points - mesh.vertices
    group = symmetries(mesh, tolerance=SYMMETRY)
    total = moves + sum(moves[s.vertices] @ s.matrix for s in group)
    return mesh.vertices + total / (1 + len(group))


def _spoilt(mesh: QuadMesh, moved: QuadMesh) -> np.ndarray:
    """(F,) bool: quads of the old mesh that became much worse or that the new mesh leaves."""
    before, after = square_energy(mesh.vertices[mesh.quads]), square_energy(moved.vertices[mesh.quads])
    worse = after > before + np.maximum(WORSE, 0.3 * before)
    size = np.sqrt(mesh.areas)
    corner = _distances(moved, _samples(mesh))
    n = len(mesh.vertices)
    away = np.maximum(corner[:n][mesh.quads].max(axis=1), corner[n:]) > DEVIATION * size
    return worse | away


def _samples(mesh: QuadMesh) -> np.ndarray:
    return np.concatenate([mesh.vertices, mesh.centroids])


def _distances(mesh: QuadMesh, points: np.ndarray) -> np.ndarray:
    """(n,) metres: from points (n, 3) to the surface."""
    import igl

    return np.sqrt(igl.point_mesh_squared_distance(points, *_fan(mesh))[0])

"""Make the triangles of a surface even in size, and smooth the surface, for cross fields and maps."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, diags_array

from ...arrays import Bool, Int
from .field import Triangles

# Largest distance by which smoothing may move a point of a line (border or fold), in mean side lengths of the line;
# points that would move farther are corners and stay. A right angle would move by 1.8, a zigzag by 0.5. Larger: corners
# are rounded off.
MAX_SMOOTHING_MOVE = 1.2
# Largest number of triangles, as a multiple of the number needed for the wanted side length; meshes with more are
# simplified first. Larger: slower, closer to the given surface.
MAX_GROWTH = 1.3


def equalise_triangles(mesh: Triangles, longest: float, fold: float) -> Triangles:
    """Return a mesh with triangles of about one size: simplify a dense mesh, then subdivide it until no side is too long.

    If a side of the result joins two points on borders or folds, it is itself part of a border or fold
    (``Triangles.feature_sides``), unless four rounds of subdivision don't reach that.

    Parameters
    ----------
    mesh : triangles, metres
    longest : largest length of a side, metres
    fold : angle between the normals of two triangles from which their common side is a fold, radians
    """
    vertices, corners = mesh.vertices, mesh.corners
    needed = int(MAX_GROWTH * mesh.areas.sum() / (0.43 * (0.7 * longest) ** 2))
    if len(corners) > needed:
        vertices, corners = simplify_triangles(vertices, corners, needed)
    for _ in range(40):
        mesh = Triangles(vertices, corners)
        long = np.abs(mesh.side_vectors).ravel() > longest
        if not long.any():
            break
        vertices, corners = _halve_edges(mesh, _mark_both_sides(mesh, long))
    for _ in range(4):
        mesh = Triangles(vertices, corners)
        bad = _chords_between_lines(mesh, mesh.feature_sides(fold))
        if not bad.any():
            break
        vertices, corners = _halve_edges(mesh, bad)
    return Triangles(vertices, corners)


def simplify_triangles(vertices: np.ndarray, corners: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Simplify a mesh to about ``count`` triangles by edge collapses (Garland and Heckbert 1997).

    Parameters
    ----------
    vertices, corners : (N, 3) points and (T, 3) vertex indices of a triangle mesh
    count : number of triangles to aim for

    Returns
    -------
    Points and triangles of the simplified mesh
    """
    import igl

    found = igl.qslim(np.ascontiguousarray(vertices, float), np.ascontiguousarray(corners, np.int64), count)
    v, f = (found[1], found[2]) if isinstance(found[0], bool | np.bool_) else (found[0], found[1])
    return np.asarray(v, float), np.asarray(f, np.int64)


def _mark_both_sides(mesh: Triangles, sides: np.ndarray) -> np.ndarray:
    """Return a mask of sides that contains, for every masked side, also the neighbouring triangle's side on its edge."""
    other = mesh.opposite
    return sides | ((other >= 0) & sides[other])


def _chords_between_lines(mesh: Triangles, lines: np.ndarray) -> np.ndarray:
    """Return a mask of sides that join two points on lines but are not part of a line.

    A triangle with such a side could have all its corners on one grid line, and so no area in the map.

    lines : mask of the sides on borders and folds
    """
    start = mesh.corners.ravel()
    end = np.roll(mesh.corners, -1, axis=1).ravel()
    on = np.zeros(len(mesh.vertices), dtype=bool)
    on[start[lines]] = on[end[lines]] = True
    return on[start] & on[end] & ~lines


def _halve_edges(mesh: Triangles, sides: np.ndarray) -> tuple[np.ndarray, Int[np.ndarray, "triangles 3"]]:
    """Halve the edges of masked sides, and split their triangles into two to four; return vertices and triangles.

    sides : mask of sides; it must contain both sides of an edge
    """
    other, count = mesh.opposite, len(mesh.vertices)
    first = sides & ((other < 0) | (np.arange(len(other)) < other))
    number = np.full(len(other), -1)
    number[first] = count + np.arange(first.sum())
    second = sides & ~first
    number[second] = number[other[second]]
    start, end = mesh.corners.ravel(), np.roll(mesh.corners, -1, axis=1).ravel()
    vertices = np.concatenate([mesh.vertices, 0.5 * (mesh.vertices[start[first]] + mesh.vertices[end[first]])])
    m, how = number.reshape(-1, 3), (number.reshape(-1, 3) >= 0)
    t = mesh.corners
    made = [t[how.sum(axis=1) == 0]]
    three = how.all(axis=1)
    a, b, c = t[three].T
    ab, bc, ca = m[three].T
    made += [np.stack(x, axis=1) for x in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    for k in range(3):
        one = (how.sum(axis=1) == 1) & how[:, k]
        a, b, c = np.roll(t[one], -k, axis=1).T
        ab = m[one, k]
        made += [np.stack([a, ab, c], 1), np.stack([ab, b, c], 1)]
        two = (how.sum(axis=1) == 2) & ~how[:, k]  # sides k + 1 and k + 2 are halved
        a, b, c = np.roll(t[two], -k, axis=1).T
        bc, ca = m[two, (k + 1) % 3], m[two, (k + 2) % 3]
        made.append(np.stack([bc, c, ca], axis=1))
        one_way, other_way = vertices[a] - vertices[bc], vertices[b] - vertices[ca]
        # split the remaining quad along its shorter diagonal
        shorter = (np.linalg.norm(one_way, axis=1) < np.linalg.norm(other_way, axis=1))[:, None]
        made.append(np.where(shorter, np.stack([a, b, bc], 1), np.stack([a, b, ca], 1)))
        made.append(np.where(shorter, np.stack([a, bc, ca], 1), np.stack([b, bc, ca], 1)))
    return vertices, np.concatenate(made)


def smooth_surface(mesh: Triangles, lines: Bool[np.ndarray, " sides"], strength: float) -> Triangles:
    """Smooth a surface, so that a cross field follows its shape and not noise smaller than a triangle.

    Points move towards the mean of their neighbours, points on lines towards the mean of their neighbours on the line;
    points where lines meet, end or turn do not move.

    Parameters
    ----------
    mesh : triangles, metres
    lines : mask of sides on the border and on folds
    strength : weight of the neighbours' mean, where the point's own position weighs 1
    """
    from scipy.sparse import coo_array

    start, end, count = mesh.corners.ravel(), np.roll(mesh.corners, -1, axis=1).ravel(), len(mesh.vertices)

    def adjacency_matrix(sides: np.ndarray) -> csr_array:
        """Return the adjacency matrix of the vertices that these sides join."""
        a, b = np.r_[start[sides], end[sides]], np.r_[end[sides], start[sides]]
        found = coo_array((np.ones(len(a)), (a, b)), shape=(count, count)).tocsr()
        found.data[:] = 1.0  # an edge of two triangles was counted twice
        return found

    along = adjacency_matrix(lines)
    passed = along.sum(axis=1) == 2
    drawn = _smooth_points(mesh.vertices, along, passed, strength)
    size = np.abs(mesh.side_vectors[lines.reshape(-1, 3)]).mean() if lines.any() else 1.0
    passed &= np.linalg.norm(drawn - mesh.vertices, axis=1) < MAX_SMOOTHING_MOVE * size
    inner = along.sum(axis=1) == 0
    around = adjacency_matrix(np.ones(len(start), dtype=bool))
    near = diags_array(inner.astype(float)) @ around + diags_array(passed.astype(float)) @ along
    return Triangles(_smooth_points(mesh.vertices, near, inner | passed, strength), mesh.corners)


def _smooth_points(points: np.ndarray, near: csr_array, moving: np.ndarray, strength: float) -> np.ndarray:
    """Return points moved towards the mean of their neighbours, in one implicit (backward Euler) step.

    points : positions, (V, 3)
    near : adjacency matrix, (V, V)
    moving : mask of points that move; the others stay
    strength : weight of the mean, where the point's own position weighs 1
    """
    from scipy.sparse import eye_array
    from scipy.sparse.linalg import splu

    weight = np.where(moving, strength, 0.0)
    mean = diags_array(weight / np.maximum(near.sum(axis=1), 1.0)) @ near
    return splu((eye_array(len(points)) + diags_array(weight) - mean).tocsc()).solve(points)

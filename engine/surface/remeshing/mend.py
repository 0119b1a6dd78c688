"""Repair folded, degenerate, thin or warped quads that a remesher made.

The corners of such quads are moved along the target surface; quads that stay folded or thin are collapsed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...arrays import Bool, Float, Int
from ...tolerances import DOUBLE_TOL, SINGLE_TOL
from ..checking.check import findings
from ..checking.topology import non_manifold_vertices, sides_of
from ..mesh import PolygonMesh
from ..triangle_tree import TriangleTree
from .regularise import best_squares

# Sets of codes of findings about quads (see the table in ``check``), from the worst to the least bad
FOLDED = {"zero-edge", "zero-area", "crossed", "repeated-vertex", "duplicate-faces"}
USELESS = FOLDED | {"thin"}  # quads without room for a spiral
POOR = USELESS | {"concave", "warped"}
ROUNDS = 6  # largest number of rounds of moving corners and collapsing quads; more: slower, rarely better
# Quads with a half diagonal below this share of the median are enlarged to this share. Larger: more room in small quads,
# less in their neighbours.
MIN_SIZE = 0.7
# Smallest angle between the normals of two triangles at a sharp edge, degrees: above the 30 of round surfaces with few
# triangles, below the 90 of boxes and rims. Larger: fewer edges are preserved.
SHARP_ANGLE = 50.0
MOVES = 12  # number of times that every corner moves per round; more: slower, rarely better


@dataclass(frozen=True, eq=False)
class TargetSurface(TriangleTree):
    """A triangle surface onto which points are projected; metres."""

    @cached_property
    def area(self) -> float:
        """Total area, square metres."""
        a, b, c = self.vertices[self.triangles.T]
        return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())

    def nearest(
        self, points: Float[np.ndarray, "points 3"]
    ) -> tuple[Float[np.ndarray, "points 3"], Float[np.ndarray, "points 3"]]:
        """Return the surface points nearest to ``points``, and the surface's unit normals there."""
        _, triangle, found = self.closest(points)
        return found, self.normals[triangle]

    @cached_property
    def border_edges(self) -> Int[np.ndarray, "border 2"]:
        """Edges with only one triangle, as pairs of vertices."""
        sides = np.sort(np.stack([self.triangles, np.roll(self.triangles, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
        edges, uses = np.unique(sides, axis=0, return_counts=True)
        return np.ascontiguousarray(edges[uses == 1])

    @cached_property
    def border_corners(self) -> Int[np.ndarray, " corners"]:
        """Vertices where the border turns by more than ``SHARP_ANGLE``."""
        ends = self.border_edges.ravel()
        others = self.border_edges[:, ::-1].ravel()
        order = np.argsort(ends, kind="stable")
        vertices, first, uses = np.unique(ends[order], return_index=True, return_counts=True)
        vertices, first = vertices[uses == 2], first[uses == 2]
        to = self.vertices[others[order]]
        a, b = (to[first + k] - self.vertices[vertices] for k in (0, 1))
        size = np.maximum(np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1), 1e-300)
        return vertices[-np.einsum("ni,ni->n", a, b) / size < np.cos(np.radians(SHARP_ANGLE))]

    def distances_to_border(self, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, " points"]:
        """Return the distances from points to the border, metres; infinite if the surface is closed."""
        if not len(self.border_edges):
            return np.full(len(points), np.inf)
        import igl

        return np.sqrt(igl.point_mesh_squared_distance(points, self.vertices, self.border_edges)[0])

    @cached_property
    def sharp_edges(self) -> Int[np.ndarray, "sharp 2"]:
        """Edges at which the normals of the two triangles differ by more than ``SHARP_ANGLE``, as pairs of vertices."""
        sides = np.stack([self.triangles, np.roll(self.triangles, -1, axis=1)], axis=2).reshape(-1, 2)
        edges, at, uses = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True, return_counts=True)
        order = np.argsort(at.reshape(-1), kind="stable")
        first = (np.cumsum(uses) - uses)[uses == 2]
        one, two = self.normals[order[first] // 3], self.normals[order[first + 1] // 3]
        turned = np.einsum("ni,ni->n", one, two) < np.cos(np.radians(SHARP_ANGLE))
        return np.ascontiguousarray(edges[uses == 2][turned])

    @cached_property
    def sample_points(self) -> Float[np.ndarray, "points 3"]:
        """4000 points, evenly distributed by area (R2 sequence, Roberts 2018).

        If only one point falls into a triangle, it is moved to the triangle's centroid.
        """
        a, b, c = self.vertices[self.triangles.T]
        area = np.cumsum(np.linalg.norm(np.cross(b - a, c - a), axis=1))
        k = np.arange(4000)
        at = np.minimum(np.searchsorted(area, (k + 0.5) / 4000 * area[-1]), len(area) - 1)
        u, v = np.mod(0.5 + k[:, None] * (0.7548776662466927, 0.5698402909980532), 1.0).T
        u, v = np.where(u + v > 1.0, (1.0 - u, 1.0 - v), (u, v))
        alone = np.bincount(at)[at] == 1
        u[alone] = v[alone] = 1.0 / 3.0
        return np.ascontiguousarray(a[at] + u[:, None] * (b - a)[at] + v[:, None] * (c - a)[at])

    def project_to_sharp_edges(
        self, points: Float[np.ndarray, "points 3"]
    ) -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, "points 3"]]:
        """Return the distances from points to the sharp edges, metres, and the nearest points on these edges.

        Without sharp edges the distances are infinite and the nearest points are the points themselves.
        """
        if not len(self.sharp_edges):
            return np.full(len(points), np.inf), points
        import igl

        squared, _, there = igl.point_mesh_squared_distance(points, self.vertices, self.sharp_edges)[:3]
        return np.sqrt(squared), np.asarray(there).reshape(-1, 3)

    def distances(self, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, " points"]:
        """Return the distances from points to the surface, metres."""
        return np.sqrt(self.closest(points)[0])


def mend_quads(quads: PolygonMesh, target: TargetSurface) -> PolygonMesh:
    """Return a mesh with poor quads repaired as far as possible; ``check.findings`` reports quads that stay poor.

    Parameters
    ----------
    quads : quad mesh with at most two faces per edge
    target : surface on which corners move
    """
    best = quads = _without_doublets(quads)
    fewest = _poor_faces(best)
    for done in range(ROUNDS):
        if not len(fewest[-1]):
            break
        poor = fewest[-1] if quads is best else _poor_faces(quads)[-1]
        # averaging neighbours unfolds quads but narrows them; fitting squares widens them again
        quads = move_corners(quads, poor, target, neighbour_mean_move if done % 2 == 0 else square_fit_move)
        found = _poor_faces(quads)
        if len(found[1]):
            collapsed = _collapse_quads(quads, found[1], target)
            if collapsed is not None:
                quads, found = collapsed, _poor_faces(collapsed)
        if tuple(map(len, found)) < tuple(map(len, fewest)):
            best, fewest = quads, found
    return best


def _poor_faces(quads: PolygonMesh) -> tuple[np.ndarray, ...]:
    """Return the faces with findings in ``FOLDED``, in ``USELESS`` and in ``POOR``, as three arrays of indices."""
    found = findings(quads)
    none = np.zeros(0, int)
    return tuple(
        np.unique(np.concatenate([none, *(np.asarray(f.faces, int) for f in found if f.code in codes)]))
        for codes in (FOLDED, USELESS, POOR)
    )


# -- moving corners ----------------------------------------------------------------------------------------------------

Move = Callable[[np.ndarray], np.ndarray]  # maps vertex positions (V, 3) to target positions


def neighbour_mean_move(quads: PolygonMesh, links: Int[np.ndarray, "links 2"]) -> Move:
    """Return a function that moves every vertex to the mean of its neighbours.

    Parameters
    ----------
    quads : quad mesh
    links : pairs of a vertex and one of its neighbours; a pair moves only its first vertex
    """
    count = len(quads.vertices)
    degree = np.maximum(np.bincount(links[:, 0], minlength=count), 1)[:, None]

    def target_positions(points: np.ndarray) -> np.ndarray:
        return _sum_by_index(links[:, 0], points[links[:, 1]], count) / degree

    return target_positions


def square_fit_move(quads: PolygonMesh, links: np.ndarray) -> Move:
    """Return a function that moves every vertex to its mean position in the squares that best fit its quads.

    Small squares are enlarged, see ``MIN_SIZE``.

    Parameters
    ----------
    quads : quad mesh
    links : not used; only makes this function interchangeable with ``neighbour_mean_move``
    """
    corners, count = quads.corners.reshape(-1, 4), len(quads.vertices)
    degree = np.maximum(np.bincount(corners.ravel(), minlength=count), 1)[:, None]

    def target_positions(points: np.ndarray) -> np.ndarray:
        squares = best_squares(points[corners])
        middle = squares.mean(axis=1, keepdims=True)
        size = np.linalg.norm(squares[:, 0] - middle[:, 0], axis=1)
        usual = np.median(size)
        # limit the enlargement of quads shrunk to a point, whose orientation is only rounding error
        larger = np.maximum(MIN_SIZE * usual / np.maximum(size, SINGLE_TOL * usual + 1e-300), 1.0)[:, None, None]
        return _sum_by_index(corners.ravel(), (middle + larger * (squares - middle)).reshape(-1, 3), count) / degree

    return target_positions


def _sum_by_index(
    at: Int[np.ndarray, " points"], values: Float[np.ndarray, "points 3"], count: int
) -> Float[np.ndarray, "vertices 3"]:
    """Return for every vertex v of ``count`` vertices the sum of all rows ``values[i]`` with ``at[i]`` = v."""
    return np.stack([np.bincount(at, values[:, k], minlength=count) for k in range(3)], axis=1)


def move_corners(
    quads: PolygonMesh, poor: np.ndarray, target: TargetSurface, make_move: Callable[[PolygonMesh, np.ndarray], Move]
) -> PolygonMesh:
    """Return a mesh with the corners of poor quads, and of two rings of quads round them, moved along the surface.

    Border corners move along the border. Corners do not move on sharp edges and where the border turns sharply.

    Parameters
    ----------
    quads : quad mesh
    poor : indices of the quads to improve
    target : surface on which corners move
    make_move : ``neighbour_mean_move`` or ``square_fit_move``: makes the function that returns the wanted positions
    """
    corners = quads.corners.reshape(-1, 4)
    points, sides = np.array(quads.vertices, float), sides_of(quads)
    near = np.zeros(len(points), bool)
    near[corners[poor]] = True
    for _ in range(2):
        near[corners[near[corners].any(axis=1)]] = True
    on_border = np.zeros(len(points), bool)
    border = sides.edges[np.bincount(sides.edge, minlength=len(sides.edges)) == 1]
    on_border[border] = True
    links = np.concatenate([sides.edges[~on_border[sides.edges].all(axis=1)], border])
    links = np.concatenate([links, links[:, ::-1]])
    links = links[~on_border[links[:, 0]] | on_border[links[:, 1]]]  # border vertices follow border neighbours only
    moving = near & (np.bincount(links[:, 0], minlength=len(points)) > 1) & ~line_corners(points, border)
    moving &= target.project_to_sharp_edges(points)[0] > DOUBLE_TOL
    inner, outer = np.flatnonzero(moving & ~on_border), np.flatnonzero(moving & on_border)
    line, wish = points.copy(), make_move(quads, links)
    _, normals = target.nearest(points)
    for _ in range(MOVES):
        wanted = wish(points)
        found, there = target.nearest(wanted[inner])
        # on a thin part the nearest point may lie on its other side: skip such moves
        same_side = np.einsum("ni,ni->n", there, normals[inner]) > -0.5
        points[inner[same_side]], normals[inner[same_side]] = found[same_side], there[same_side]
        if len(outer):
            import igl

            points[outer] = igl.point_mesh_squared_distance(wanted[outer], line, border)[2]
    return PolygonMesh(points, quads.corners, quads.sizes)


def line_corners(points: np.ndarray, border: np.ndarray) -> Bool[np.ndarray, " vertices"]:
    """Return a mask of vertices where lines of edges turn by more than 50 degrees or branch.

    points : vertex positions, (V, 3)
    border : edges of the border or of other lines, as pairs of vertices
    """
    sums = np.zeros_like(points)
    directions = points[border[:, 1]] - points[border[:, 0]]
    directions /= np.maximum(np.linalg.norm(directions, axis=1), 1e-300)[:, None]
    np.add.at(sums, border[:, 0], directions)
    np.add.at(sums, border[:, 1], -directions)
    count = np.bincount(border.ravel(), minlength=len(points))
    # the two unit vectors from a corner along the line, which turns by t, have a sum of length 2 sin(t / 2)
    return (count > 2) | ((count == 2) & (np.linalg.norm(sums, axis=1) > 2 * np.sin(np.radians(25.0))))


# -- removing quads ----------------------------------------------------------------------------------------------------


def _without_doublets(quads: PolygonMesh) -> PolygonMesh:
    """Return a mesh in which two quads that share two adjacent sides are merged, without the vertex between these sides."""
    for _ in range(100):
        sides, corners = sides_of(quads), quads.corners.reshape(-1, 4)
        ends = sides.edges[np.bincount(sides.edge, minlength=len(sides.edges)) == 2]
        inner = np.bincount(ends.ravel(), minlength=len(quads.vertices))
        every = np.bincount(sides.edges.ravel(), minlength=len(quads.vertices))
        doublets = np.flatnonzero((inner == 2) & (every == 2))
        if not len(doublets):
            return quads
        gone, used = np.zeros(len(corners), bool), np.zeros(len(corners), bool)
        corners = corners.copy()
        for vertex in doublets:
            faces = np.flatnonzero((corners == vertex).any(axis=1))
            if len(faces) != 2 or used[faces].any():
                continue
            first, second = corners[faces]
            opposite = second[(np.flatnonzero(second == vertex)[0] + 2) % 4]
            if opposite in first:  # the two quads coincide and touch no others
                continue
            corners[faces[0]] = np.where(first == vertex, opposite, first)
            gone[faces[1]], used[faces] = True, True
        if not gone.any():
            return quads
        quads = mesh_from_rows(quads.vertices, corners[~gone])
    return quads


def _collapse_quads(quads: PolygonMesh, folded: np.ndarray, target: TargetSurface) -> PolygonMesh | None:
    """Collapse quads by merging two opposite corners, where the mesh stays sound; return None if no quad could collapse.

    folded : indices of the quads to collapse
    target : surface onto which the merged corner is projected
    """
    points, corners = np.array(quads.vertices, float), quads.corners.reshape(-1, 4).copy()
    sides = sides_of(quads)
    on_border = np.zeros(len(points), bool)
    on_border[sides.edges[np.bincount(sides.edge, minlength=len(sides.edges)) == 1]] = True
    kept, touched, done = np.ones(len(corners), bool), np.zeros(len(points), bool), False
    for face in folded:
        quad = corners[face]
        if touched[quad].any():
            continue
        valence = np.array([(corners[kept] == v).any(axis=1).sum() for v in quad])
        for k in np.argsort(valence[:2] + valence[2:]):  # first the diagonal whose corners have fewer quads
            a, c = quad[k], quad[k + 2]
            if on_border[a] and on_border[c]:
                continue
            stay, go = (a, c) if on_border[a] else (c, a)
            trial = np.where(corners == go, stay, corners)
            trial_kept = kept.copy()
            trial_kept[face] = False
            if not _is_sound(points, trial[trial_kept]):
                continue
            if not on_border[stay]:
                points[stay] = target.nearest(0.5 * (points[a] + points[c])[None])[0][0]
            around = (corners == go).any(axis=1) | (corners == stay).any(axis=1)
            touched[corners[around]] = True
            corners, kept, done = trial, trial_kept, True
            break
    return _without_doublets(mesh_from_rows(points, corners[kept])) if done else None


def _is_sound(points: np.ndarray, corners: np.ndarray) -> bool:
    """Return whether no quad repeats a corner, no edge has three quads and no vertex has two fans of quads.

    points, corners : vertex positions, and the four vertices of every quad
    """
    row = np.sort(corners, axis=1)
    if (row[:, 1:] == row[:, :-1]).any():
        return False
    mesh = mesh_from_rows(points, corners)
    sides = sides_of(mesh)
    return bool(np.bincount(sides.edge).max() <= 2) and not len(non_manifold_vertices(mesh, sides))


def mesh_from_rows(points: Float[np.ndarray, "vertices 3"], rows: Int[np.ndarray, "quads points"]) -> PolygonMesh:
    """Make a mesh of faces with equally many corners, one row of vertex indices per face; drop unused points."""
    used, fresh = np.unique(rows, return_inverse=True)
    return PolygonMesh(
        np.asarray(points, float)[used], fresh.reshape(-1).astype(np.int64), np.full(len(rows), rows.shape[1])
    )

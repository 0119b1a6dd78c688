"""Mends quads that a remesher left folded, without length, thin or far from flat: moves their corners over the surface that
they stand for, and takes out those that no move can save."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ...arrays import Bool, Float, Int
from ..checking.check import findings
from ..checking.topology import sides_of, split_vertices
from ..mesh import PolygonMesh
from .regularise import best_squares

FOLDED = {"zero-edge", "zero-area", "crossed", "repeated-vertex", "duplicate-faces"}
USELESS = FOLDED | {"thin"}  # no spiral has room in them
POOR = USELESS | {"concave", "warped"}
ROUNDS = 6  # of moving and taking out; not measured
SMALL = 0.7  # of the median quad's side: the least that a corner is to be drawn to
SIZELESS = 1e-6  # of the median quad's side: quads that are smaller have no size
# degrees between two triangles from which their edge is one of the shape: between those of round surfaces of few triangles,
# 30 and less, and those of boxes and rims, 90
SHARP = 50.0
ON_SHARP = 1e-9  # metres at the size that bodies are remeshed at, 2: rounding errors of a corner that was put onto a sharp edge
MOVES = 12  # of every corner in a round; not measured


@dataclass(frozen=True, eq=False)
class Target:
    """A surface of triangles that points are brought back to; metres."""

    vertices: Float[np.ndarray, "vertices 3"]
    triangles: Int[np.ndarray, "triangles 3"]

    @cached_property
    def _tree(self) -> Any:
        import igl

        tree = igl.AABB()
        tree.init(self.vertices, self.triangles)
        return tree

    @cached_property
    def _normals(self) -> np.ndarray:
        a, b, c = self.vertices[self.triangles.T]
        normals = np.cross(b - a, c - a)
        return normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]

    @cached_property
    def area(self) -> float:
        a, b, c = self.vertices[self.triangles.T]
        return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())

    def nearest(
        self, points: Float[np.ndarray, "points 3"]
    ) -> tuple[Float[np.ndarray, "points 3"], Float[np.ndarray, "points 3"]]:
        """The nearest points of the surface and its unit normals there."""
        _, triangle, found = self._tree.squared_distance(self.vertices, self.triangles, np.ascontiguousarray(points))
        return np.asarray(found).reshape(-1, 3), self._normals[np.asarray(triangle).ravel()]

    @cached_property
    def border(self) -> Int[np.ndarray, "border 2"]:
        """The edges of one triangle only."""
        sides = np.sort(np.stack([self.triangles, np.roll(self.triangles, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
        edges, uses = np.unique(sides, axis=0, return_counts=True)
        return np.ascontiguousarray(edges[uses == 1])

    @cached_property
    def border_corners(self) -> Int[np.ndarray, " corners"]:
        """Vertices at which the border turns by more than ``SHARP``."""
        ends = self.border.ravel()
        others = self.border[:, ::-1].ravel()
        order = np.argsort(ends, kind="stable")
        vertices, first, uses = np.unique(ends[order], return_index=True, return_counts=True)
        vertices, first = vertices[uses == 2], first[uses == 2]
        to = self.vertices[others[order]]
        a, b = (to[first + k] - self.vertices[vertices] for k in (0, 1))
        size = np.maximum(np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1), 1e-300)
        return vertices[-np.einsum("ni,ni->n", a, b) / size < np.cos(np.radians(SHARP))]

    def to_border(self, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, " points"]:
        """Metres: from points to the border; infinite where there is none."""
        if not len(self.border):
            return np.full(len(points), np.inf)
        import igl

        return np.sqrt(igl.point_mesh_squared_distance(points, self.vertices, self.border)[0])

    @cached_property
    def sharp(self) -> Int[np.ndarray, "sharp 2"]:
        """The edges at which two triangles turn by more than ``SHARP``."""
        sides = np.stack([self.triangles, np.roll(self.triangles, -1, axis=1)], axis=2).reshape(-1, 2)
        edges, at, uses = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True, return_counts=True)
        order = np.argsort(at.reshape(-1), kind="stable")
        first = (np.cumsum(uses) - uses)[uses == 2]
        one, two = self._normals[order[first] // 3], self._normals[order[first + 1] // 3]
        turned = np.einsum("ni,ni->n", one, two) < np.cos(np.radians(SHARP))
        return np.ascontiguousarray(edges[uses == 2][turned])

    @cached_property
    def samples(self) -> Float[np.ndarray, "points 3"]:
        """4000 points, evenly by area: the middles of small triangles, and many points of large ones (R2, Roberts 2018)."""
        a, b, c = self.vertices[self.triangles.T]
        area = np.cumsum(np.linalg.norm(np.cross(b - a, c - a), axis=1))
        k = np.arange(4000)
        at = np.minimum(np.searchsorted(area, (k + 0.5) / 4000 * area[-1]), len(area) - 1)
        u, v = np.mod(0.5 + k[:, None] * (0.7548776662466927, 0.5698402909980532), 1.0).T
        u, v = np.where(u + v > 1.0, (1.0 - u, 1.0 - v), (u, v))
        alone = np.bincount(at)[at] == 1
        u[alone] = v[alone] = 1.0 / 3.0
        return np.ascontiguousarray(a[at] + u[:, None] * (b - a)[at] + v[:, None] * (c - a)[at])

    def onto_sharp(
        self, points: Float[np.ndarray, "points 3"]
    ) -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, "points 3"]]:
        """Metres: from points to the sharp edges, and the nearest points there; infinite where there are none."""
        if not len(self.sharp):
            return np.full(len(points), np.inf), points
        import igl

        squared, _, there = igl.point_mesh_squared_distance(points, self.vertices, self.sharp)[:3]
        return np.sqrt(squared), np.asarray(there).reshape(-1, 3)

    def distances(self, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, " points"]:
        """Metres: from points to the surface."""
        return np.sqrt(np.asarray(self._tree.squared_distance(self.vertices, self.triangles, points)[0]).ravel())


def mended(quads: PolygonMesh, target: Target) -> PolygonMesh:
    """The quads with their poor ones mended as far as it goes; ``check.findings`` tells what is left.

    quads : faces of four corners, at most two at an edge
    """
    best = quads = _without_doublets(quads)
    fewest = _poor(best)
    for done in range(ROUNDS):
        if not len(fewest[-1]):
            break
        poor = fewest[-1] if quads is best else _poor(quads)[-1]
        # the middles of neighbours unfold what is folded, but squeeze quads; squares make them broad
        quads = moved(quads, poor, target, to_middles if done % 2 == 0 else to_squares)
        found = _poor(quads)
        if len(found[1]):
            collapsed = _collapsed(quads, found[1], target)
            if collapsed is not None:
                quads, found = collapsed, _poor(collapsed)
        if tuple(map(len, found)) < tuple(map(len, fewest)):
            best, fewest = quads, found
    return best


def _poor(quads: PolygonMesh) -> tuple[np.ndarray, ...]:
    """Faces that make the mesh unfit, those with the ones in which no spiral has room, and those with all poor ones."""
    found = findings(quads)
    none = np.zeros(0, int)
    return tuple(
        np.unique(np.concatenate([none, *(np.asarray(f.faces, int) for f in found if f.code in codes)]))
        for codes in (FOLDED, USELESS, POOR)
    )


# -- moving --------------------------------------------------------------------------------------------------------------

Wish = Callable[[np.ndarray], np.ndarray]  # from all vertices (V, 3) to where they are to go


def to_middles(quads: PolygonMesh, links: Int[np.ndarray, "links 2"]) -> Wish:
    """Every vertex to the mean of its neighbours, along the directed ``links`` from it to them."""
    count = len(quads.vertices)
    degree = np.maximum(np.bincount(links[:, 0], minlength=count), 1)[:, None]

    def wish(points: np.ndarray) -> np.ndarray:
        return _summed(links[:, 0], points[links[:, 1]], count) / degree

    return wish


def to_squares(quads: PolygonMesh, links: np.ndarray) -> Wish:
    """Every vertex to the mean of the corners of the squares nearest to its quads; of quads that are small, of larger ones."""
    corners, count = quads.corners.reshape(-1, 4), len(quads.vertices)
    degree = np.maximum(np.bincount(corners.ravel(), minlength=count), 1)[:, None]

    def wish(points: np.ndarray) -> np.ndarray:
        squares = best_squares(points[corners])
        middle = squares.mean(axis=1, keepdims=True)
        size = np.linalg.norm(squares[:, 0] - middle[:, 0], axis=1)
        usual = np.median(size)
        # a quad without size has no directions in which it could grow, but for rounding errors
        larger = np.maximum(SMALL * usual / np.maximum(size, SIZELESS * usual + 1e-300), 1.0)[:, None, None]
        return _summed(corners.ravel(), (middle + larger * (squares - middle)).reshape(-1, 3), count) / degree

    return wish


def _summed(
    at: Int[np.ndarray, " points"], values: Float[np.ndarray, "points 3"], count: int
) -> Float[np.ndarray, "vertices 3"]:
    """The sums of values by their place ``at``, one for each of ``count`` places."""
    return np.stack([np.bincount(at, values[:, k], minlength=count) for k in range(3)], axis=1)


def moved(
    quads: PolygonMesh, poor: np.ndarray, target: Target, way: Callable[[PolygonMesh, np.ndarray], Wish]
) -> PolygonMesh:
    """Corners of poor quads, and two rings round them, drawn along the surface to where ``way`` wants them.

    Corners on the border move along it; where it turns sharply they stay, and so do those on sharp edges of the surface.
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
    links = links[~on_border[links[:, 0]] | on_border[links[:, 1]]]  # what is on the border follows the border alone
    moving = near & (np.bincount(links[:, 0], minlength=len(points)) > 1) & ~line_corners(points, border)
    moving &= target.onto_sharp(points)[0] > ON_SHARP
    inner, outer = np.flatnonzero(moving & ~on_border), np.flatnonzero(moving & on_border)
    line, wish = points.copy(), way(quads, links)
    _, normals = target.nearest(points)
    for _ in range(MOVES):
        wanted = wish(points)
        found, there = target.nearest(wanted[inner])
        same_side = np.einsum("ni,ni->n", there, normals[inner]) > -0.5  # on a thin part the far side may be nearer
        points[inner[same_side]], normals[inner[same_side]] = found[same_side], there[same_side]
        if len(outer):
            import igl

            points[outer] = igl.point_mesh_squared_distance(wanted[outer], line, border)[2]
    return PolygonMesh(points, quads.corners, quads.sizes)


def line_corners(points: np.ndarray, border: np.ndarray) -> Bool[np.ndarray, " vertices"]:
    """Where a line of edges, such as the border, turns by more than 50 degrees, or meets itself."""
    sums = np.zeros_like(points)
    directions = points[border[:, 1]] - points[border[:, 0]]
    directions /= np.maximum(np.linalg.norm(directions, axis=1), 1e-300)[:, None]
    np.add.at(sums, border[:, 0], directions)
    np.add.at(sums, border[:, 1], -directions)
    count = np.bincount(border.ravel(), minlength=len(points))
    # two unit vectors away from a corner that turns by the angle t have a sum of length 2 sin(t / 2)
    return (count > 2) | ((count == 2) & (np.linalg.norm(sums, axis=1) > 2 * np.sin(np.radians(25.0))))


# -- taking out ----------------------------------------------------------------------------------------------------------


def _without_doublets(quads: PolygonMesh) -> PolygonMesh:
    """Two quads that share two sides become one: the corner between these sides goes."""
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
            if opposite in first:  # the two quads lie upon each other, and nothing else hangs on them
                continue
            corners[faces[0]] = np.where(first == vertex, opposite, first)
            gone[faces[1]], used[faces] = True, True
        if not gone.any():
            return quads
        quads = of_rows(quads.vertices, corners[~gone])
    return quads


def _collapsed(quads: PolygonMesh, folded: np.ndarray, target: Target) -> PolygonMesh | None:
    """Without folded quads: of each, two opposite corners become one, if the mesh is then as sound; ``None`` if none could go."""
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
        for k in np.argsort(valence[:2] + valence[2:]):  # the two that have the fewer quads
            a, c = quad[k], quad[k + 2]
            if on_border[a] and on_border[c]:
                continue
            stay, go = (a, c) if on_border[a] else (c, a)
            trial = np.where(corners == go, stay, corners)
            trial_kept = kept.copy()
            trial_kept[face] = False
            if not _sound(points, trial[trial_kept]):
                continue
            if not on_border[stay]:
                points[stay] = target.nearest(0.5 * (points[a] + points[c])[None])[0][0]
            around = (corners == go).any(axis=1) | (corners == stay).any(axis=1)
            touched[corners[around]] = True
            corners, kept, done = trial, trial_kept, True
            break
    return _without_doublets(of_rows(points, corners[kept])) if done else None


def _sound(points: np.ndarray, corners: np.ndarray) -> bool:
    """Whether no quad has a corner twice, no edge a third quad, and no vertex two fans."""
    row = np.sort(corners, axis=1)
    if (row[:, 1:] == row[:, :-1]).any():
        return False
    mesh = of_rows(points, corners)
    sides = sides_of(mesh)
    return bool(np.bincount(sides.edge).max() <= 2) and not len(split_vertices(mesh, sides))


def of_rows(points: Float[np.ndarray, "vertices 3"], rows: Int[np.ndarray, "quads points"]) -> PolygonMesh:
    """Faces of equally many corners, rows of points, without the points that belong to none."""
    used, fresh = np.unique(rows, return_inverse=True)
    return PolygonMesh(
        np.asarray(points, float)[used], fresh.reshape(-1).astype(np.int64), np.full(len(rows), rows.shape[1])
    )

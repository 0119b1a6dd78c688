"""Building blocks of the surfaces: regular grids, grids round a pole, polygons divided into quads, tubes, noise."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh
from scipy.spatial import ConvexHull, Delaunay

Place = Callable[[np.ndarray, np.ndarray], Sequence[np.ndarray]]  # x, y and z from two parameters


# -- regular grids -----------------------------------------------------------------------------------------------------


def sheet(place: Place, u: np.ndarray, v: np.ndarray, closed: tuple[bool, bool] = (False, False)) -> QuadMesh:
    """A grid over the parameters ``u`` and ``v``; where it is ``closed``, the last row joins the first."""
    across, along = np.meshgrid(u, v, indexing="ij")
    index = np.arange(across.size).reshape(across.shape)
    for axis in (0, 1):
        if closed[axis]:
            index = np.concatenate([index, index.take([0], axis=axis)], axis=axis)
    return QuadMesh(_points(place, across.ravel(), along.ravel()), _cells(index))


def polar(place: Place, radii: np.ndarray, sectors: int, two_poles: bool = False) -> QuadMesh:
    """Rings of ``sectors`` quads (an even number) round a pole at ``radii[0]``, where ``sectors`` / 2 quads meet.

    ``place`` is called with the radius and the angle. With ``two_poles`` the last radius is a pole too.
    """
    angles = np.arange(sectors) * 2 * np.pi / sectors
    rings = radii[1:-1] if two_poles else radii[1:]
    r, a = np.meshgrid(rings, angles, indexing="ij")
    index = np.arange(r.size).reshape(r.shape)
    index = np.concatenate([index, index[:, :1]], axis=1)
    ends = [radii[0], radii[-1]] if two_poles else [radii[0]]
    points = _points(place, np.append(r.ravel(), ends), np.append(a.ravel(), np.zeros(len(ends))))
    quads = [_cells(index), _fan(index[0], r.size)]
    if two_poles:
        quads.append(_fan(index[-1], r.size + 1)[:, ::-1])
    return QuadMesh(points, np.concatenate(quads))


def star(sectors: int, size: int, place: Place, power: float = 3.0) -> QuadMesh:
    """``sectors`` squares of ``size`` x ``size`` quads round one vertex; ``place`` is called with x and y of a unit disk.

    The larger ``power``, the rounder is the whole, and the flatter the outer corner of every square.
    """
    steps = np.arange(size + 1.0) / size
    i, j = (a.ravel() for a in np.meshgrid(steps, steps, indexing="ij"))
    # a sector ends between an arc and two sides of a rhomb, so that narrow ones are not drawn out
    share = np.arctan2(j, i) / (np.pi / 2)
    radius = (i**power + j**power) ** (1.0 / power)
    index = np.arange(len(i)).reshape(size + 1, size + 1)
    points, quads = [], []
    for k in range(sectors):
        angle = 2 * np.pi * (k + share) / sectors
        points.append(np.stack([radius * np.cos(angle), radius * np.sin(angle), 0 * angle], axis=1))
        quads.append(_cells(index) + k * len(i))
    flat = shapes.weld_quads(np.concatenate(points), np.concatenate(quads))
    return flat.with_vertices(_points(place, flat.vertices[:, 0], flat.vertices[:, 1]))


def without_quads(mesh: QuadMesh, gone: np.ndarray) -> QuadMesh:
    """The mesh without some quads, (F,) bool, and without the vertices that only they used."""
    used, corners = np.unique(mesh.quads[~gone], return_inverse=True)
    return QuadMesh(mesh.vertices[used], corners.reshape(-1, 4))


def _points(place: Place, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.stack(np.broadcast_arrays(*place(u, v)), axis=-1).astype(float)


def _cells(index: np.ndarray) -> np.ndarray:
    return np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1, 4)


def _fan(ring: np.ndarray, pole: int) -> np.ndarray:
    """Quads of two sides of a ring (its first vertex again at its end) and the pole."""
    return np.stack([np.full(len(ring) // 2, pole), ring[:-1:2], ring[1::2], ring[2::2]], axis=1)


# -- along a curve -----------------------------------------------------------------------------------------------------


def frames(curve: np.ndarray, closed: bool, turns: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors (n, 3) across a curve (n, 3) that turn as little as they can, and ``turns`` times besides.

    On a closed curve what they turn by itself is spread evenly, so that they close.
    """
    ahead = np.roll(curve, -1, axis=0) - np.roll(curve, 1, axis=0) if closed else np.gradient(curve, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    one = np.zeros_like(curve)
    one[0] = _across(np.eye(3)[np.argmin(np.abs(ahead[0]))], ahead[0])
    for k in range(1, len(curve)):
        one[k] = _across(one[k - 1], ahead[k])
    two = np.cross(ahead, one)
    share = np.arange(len(curve)) / (len(curve) if closed else len(curve) - 1)
    spare = 0.0
    if closed:
        again = _across(one[-1], ahead[0])
        spare = -np.arctan2(again @ two[0], again @ one[0])
    angle = (share * (2 * np.pi * turns + spare))[:, None]
    return np.cos(angle) * one + np.sin(angle) * two, np.cos(angle) * two - np.sin(angle) * one


def tube(curve: np.ndarray, radius: float | np.ndarray, sectors: int, closed: bool) -> QuadMesh:
    """A tube round a curve (n, 3); ``radius`` one for all or (n,)."""
    one, two = frames(curve, closed)
    wide = np.broadcast_to(np.asarray(radius, float), len(curve))

    def place(k: np.ndarray, a: np.ndarray) -> Sequence[np.ndarray]:
        k = k.astype(int)
        spoke = np.cos(a)[:, None] * one[k] - np.sin(a)[:, None] * two[k]
        return list((curve[k] + wide[k, None] * spoke).T)

    return sheet(place, np.arange(len(curve)), np.arange(sectors) * 2 * np.pi / sectors, (closed, True))


def ribbon(curve: np.ndarray, width: float, rows: int, closed: bool, turns: float = 0.0) -> QuadMesh:
    """A strip along a curve; with half a turn on a closed curve it has only one side."""
    one, _ = frames(curve, closed, turns)
    offsets = np.linspace(-0.5, 0.5, rows + 1) * width
    index = np.arange(len(curve) * (rows + 1)).reshape(len(curve), rows + 1)
    if closed:
        last = index[:1, ::-1] if round(2 * turns) % 2 else index[:1]
        index = np.concatenate([index, last])
    points = curve[:, None] + offsets[None, :, None] * one[:, None]
    return QuadMesh(points.reshape(-1, 3), _cells(index))


def _across(vector: np.ndarray, ahead: np.ndarray) -> np.ndarray:
    rest = vector - (vector @ ahead) * ahead
    return rest / np.linalg.norm(rest)


# -- quads from polygons -----------------------------------------------------------------------------------------------

Polygons = tuple[np.ndarray, list[list[int]]]  # vertices (V, 3) and the corners of every face


def divide_polygons(polygons: Polygons, smooth: bool) -> QuadMesh:
    """Cut every n-gon into n quads: by Catmull and Clark's rule (1978), or, not ``smooth``, with all points where they are."""
    points, faces = polygons
    centres = np.array([points[f].mean(axis=0) for f in faces])
    beside: dict[tuple[int, int], list[int]] = {}
    for n, face in enumerate(faces):
        for a, b in _sides(face):
            beside.setdefault((min(a, b), max(a, b)), []).append(n)
    number = {pair: k for k, pair in enumerate(beside)}
    middles = np.array([0.5 * (points[a] + points[b]) for a, b in beside])
    at_edge, moved = middles.copy(), points.copy()
    if smooth:
        around: list[list[np.ndarray]] = [[] for _ in points]
        rims: list[list[np.ndarray]] = [[] for _ in points]
        for (a, b), k in number.items():
            near = beside[a, b]
            for vertex in (a, b):
                (around if len(near) == 2 else rims)[vertex].append(middles[k])
            if len(near) == 2:
                at_edge[k] = 0.5 * middles[k] + 0.25 * centres[near].sum(axis=0)
        at_faces: list[list[np.ndarray]] = [[] for _ in points]
        for n, face in enumerate(faces):
            for vertex in face:
                at_faces[vertex].append(centres[n])
        for k in range(len(points)):
            if rims[k]:
                moved[k] = 0.5 * points[k] + 0.25 * np.sum(rims[k], axis=0)
            elif around[k]:
                n = len(around[k])
                moved[k] = (np.mean(at_faces[k], axis=0) + 2 * np.mean(around[k], axis=0) + (n - 3) * points[k]) / n
    first_edge, first_face = len(points), len(points) + len(middles)
    quads = []
    for n, face in enumerate(faces):
        edges = [first_edge + number[min(a, b), max(a, b)] for a, b in _sides(face)]
        quads += [[v, edges[k], first_face + n, edges[k - 1]] for k, v in enumerate(face)]
    return QuadMesh(np.concatenate([moved, at_edge, centres]), np.array(quads))


def _sides(face: list[int]) -> list[tuple[int, int]]:
    return list(zip(face, [*face[1:], face[0]]))


def dual(points: np.ndarray, triangles: np.ndarray) -> Polygons:
    """A polygon round every inner vertex of triangles, through their centres: three polygons meet at every vertex."""
    following = {(int(t[k]), int(t[k - 2])): n for n, t in enumerate(triangles) for k in range(3)}
    ring: list[dict[int, int]] = [{} for _ in points]
    for n, t in enumerate(triangles):
        for k in range(3):
            ring[t[k]][n] = following.get((int(t[k]), int(t[k - 1])), -1)
    faces = []
    for own in ring:
        if own and -1 not in own.values():
            face = [next(iter(own))]
            while own[face[-1]] != face[0]:
                face.append(own[face[-1]])
            faces.append(face)
    centres = points[triangles].mean(axis=1)
    used, corners = np.unique(np.concatenate([np.array(f) for f in faces]), return_inverse=True)
    ends = np.cumsum([len(f) for f in faces])[:-1]
    return centres[used], [list(map(int, f)) for f in np.split(corners.ravel(), ends)]


def triangles_of(points: np.ndarray, triangles: np.ndarray) -> Polygons:
    """Triangles as polygons."""
    return points, [list(map(int, t)) for t in triangles]


def icosphere(steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Points and 20 * 4^steps triangles of a unit sphere."""
    golden = (1 + 5**0.5) / 2
    third = [[0, a, b] for a in (-1, 1) for b in (-golden, golden)]
    points = np.concatenate([np.roll(third, k, axis=1) for k in range(3)])
    return _refined(points, _outwards(points, ConvexHull(points).simplices), steps)


def octasphere(steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Points and 8 * 4^steps triangles of a unit sphere."""
    points = np.concatenate([np.eye(3), -np.eye(3)])
    return _refined(points, _outwards(points, ConvexHull(points).simplices), steps)


def _refined(points: np.ndarray, triangles: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
    for _ in range(steps):
        sides = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
        pairs, which = np.unique(sides, axis=0, return_inverse=True)
        a, b, c = len(points) + which.reshape(3, -1)
        points = np.concatenate([points, points[pairs].mean(axis=1)])
        x, y, z = triangles.T
        triangles = np.concatenate([np.stack(t, axis=1) for t in ((x, a, c), (a, y, b), (c, b, z), (a, b, c))])
    return points / np.linalg.norm(points, axis=1, keepdims=True), triangles


def scattered_ball(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Irregular triangles of a unit sphere: points of a Fibonacci spiral, each moved at random."""
    k = np.arange(count) + 0.5
    z, a = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    points = np.stack([np.sqrt(1 - z**2) * np.cos(a), np.sqrt(1 - z**2) * np.sin(a), z], axis=1)
    points += np.random.default_rng(seed).normal(scale=0.45 / np.sqrt(count), size=points.shape)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    return points, _outwards(points, ConvexHull(points).simplices)


def scattered_square(side: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Irregular triangles of the square [-1, 1]^2, about 2 side^2 of them; points (n, 3) with z = 0."""
    x, y = np.meshgrid(np.linspace(-1, 1, side + 1), np.linspace(-1, 1, side + 1), indexing="ij")
    shift = np.random.default_rng(seed).uniform(-0.6, 0.6, (2, side + 1, side + 1)) / side
    x = x + np.where(np.abs(x) < 1, shift[0], 0) * (np.abs(y) < 1)
    y = y + np.where(np.abs(y) < 1, shift[1], 0) * (np.abs(x) < 1)
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    triangles = Delaunay(points).simplices
    p = points[triangles]
    (ax, ay), (bx, by) = (p[:, 1] - p[:, 0]).T, (p[:, 2] - p[:, 0]).T
    area = ax * by - ay * bx
    triangles = np.where((area > 0)[:, None], triangles, triangles[:, ::-1])[np.abs(area) > 1e-3 / side**2]
    return np.column_stack([points, np.zeros(len(points))]), triangles


def _outwards(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    p = points[triangles]
    inwards = np.einsum("ij,ij->i", np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), p.mean(axis=1)) < 0
    return np.where(inwards[:, None], triangles[:, ::-1], triangles)


def triangle_mesh(points: np.ndarray, triangles: np.ndarray) -> PolygonMesh:
    """Triangles as they come from a file."""
    return PolygonMesh(points, triangles.ravel().astype(np.int64), np.full(len(triangles), 3))


def triangulate(mesh: QuadMesh) -> PolygonMesh:
    """Cut every quad into two triangles."""
    return triangle_mesh(mesh.vertices, np.concatenate([mesh.quads[:, [0, 1, 2]], mesh.quads[:, [0, 2, 3]]]))


# -- shaping -----------------------------------------------------------------------------------------------------------


def noise(points: np.ndarray, seed: int, length: float, octaves: int = 1) -> np.ndarray:
    """(n,) smooth random values of about unit size at points (n, d), with features of a given ``length``."""
    random = np.random.default_rng(seed)
    total = np.zeros(len(points))
    for k in range(octaves):
        waves = random.normal(size=(12, points.shape[1])) * 2**k * 2.0 / length
        total += 0.5**k * np.cos(points @ waves.T + random.uniform(0, 2 * np.pi, 12)).sum(axis=1) / np.sqrt(6)
    return total


def smooth(mesh: QuadMesh, steps: int) -> QuadMesh:
    """The mesh after some steps of Catmull and Clark."""
    for _ in range(steps):
        mesh = shapes.subdivide(mesh)
    return mesh


def soap_film(mesh: QuadMesh) -> QuadMesh:
    """The mesh with its inner vertices at the mean of their neighbours: nearly a minimal surface in the same border."""
    from scipy.sparse import coo_array, diags_array
    from scipy.sparse.linalg import spsolve

    n, (a, b) = len(mesh.vertices), mesh.edges.T
    beside = coo_array((np.ones(2 * len(a)), (np.append(a, b), np.append(b, a))), shape=(n, n)).tocsr()
    inner = np.flatnonzero(~mesh.on_border)
    rest = np.flatnonzero(mesh.on_border)
    matrix = (diags_array(beside.sum(axis=1)) - beside).tocsr()[inner]
    found = mesh.vertices.copy()
    found[inner] = spsolve(matrix[:, inner].tocsc(), -matrix[:, rest] @ found[rest])
    return mesh.with_vertices(found)


def project_onto(mesh: QuadMesh, value: Callable[[np.ndarray], np.ndarray], steps: int = 20) -> QuadMesh:
    """The mesh moved onto the surface where ``value`` of points (n, 3) is zero, along its slope (Newton's method)."""
    points = mesh.vertices.copy()
    size = 1e-5 * float(np.ptp(points))
    for _ in range(steps):
        slope = np.stack([(value(points + d) - value(points - d)) / (2 * size) for d in size * np.eye(3)], axis=1)
        points -= (value(points) / np.maximum((slope**2).sum(axis=1), 1e-9))[:, None] * slope
    return mesh.with_vertices(points)

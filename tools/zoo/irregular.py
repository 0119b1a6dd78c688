"""Families with corners, creases, holes, handles and irregular vertices: blocks, roofs, plates, branches, divided polygons."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh

from . import pieces
from .smooth import steps, turn

Shape = Callable[[np.ndarray], np.ndarray]  # points (n, 3) to points

# -- right-angled blocks and handles -----------------------------------------------------------------------------------

# cells of a body seen from above, one level after another from below; '#' is filled
BLOCKS = {
    "cube": ["#"],
    "l": ["###\n#..\n#.."],
    "stairs": ["####", "###.", "##..", "#..."],
    "castle": ["###\n###\n###", "###\n#.#\n###", "#.#\n...\n#.#"],
    "cross": ["...\n.#.\n...", ".#.\n###\n.#.", "...\n.#.\n..."],
    "frame": ["###\n#.#\n###", "#.#\n...\n#.#", "###\n#.#\n###"],
    "tetris": ["##.\n.##", "...\n.#."],
}


def filled(name: str, finer: int = 1) -> np.ndarray:
    """(n, m, k) bool: the cells of a block, each cut into ``finer`` cubed ones."""
    levels = [np.array([[c == "#" for c in row] for row in level.split("\n")]) for level in BLOCKS[name]]
    return np.kron(np.stack(levels, axis=2), np.ones((finer,) * 3, dtype=bool))


def block(name: str, finer: int) -> QuadMesh:
    """The outside of a block: right angles everywhere."""
    return shapes.voxels(filled(name, finer))


def rounded(name: str, finer: int, rounds: int) -> QuadMesh:
    """A block, divided and rounded by Catmull and Clark's rule."""
    return pieces.smooth(block(name, finer), rounds)


def handles(genus: int, rounds: int = 2) -> QuadMesh:
    """A smooth solid with that many holes: a slab of cubes, subdivided."""
    cells = np.ones((2 * genus + 1, 3, 1), dtype=bool)
    cells[1::2, 1] = False
    return pieces.smooth(shapes.voxels(cells), rounds)


def open_box(side: int, depth: int) -> QuadMesh:
    """A box without lid."""
    box = shapes.voxels(np.ones((side, side, depth), dtype=bool))
    return pieces.without_quads(box, box.centroids[:, 2] > depth - 0.25)


def channel(length: int, side: int) -> QuadMesh:
    """A gutter of three walls."""
    box = shapes.voxels(np.ones((length, side, side), dtype=bool))
    x, _, z = box.centroids.T
    return pieces.without_quads(box, (z > side - 0.25) | (x < 0.25) | (x > length - 0.25))


def branches(arms: str, finer: int, rounds: int, reach: int = 2) -> QuadMesh:
    """Tubes that meet, their ends open: ``arms`` names the directions, of x, X, y, Y, z and Z."""
    cells = np.zeros((2 * reach + 1,) * 3, dtype=bool)
    cells[reach, reach, reach] = True
    for arm in arms:
        axis, sign = "xyz".index(arm.lower()), 1 if arm.isupper() else -1
        for k in range(1, reach + 1):
            at = [reach] * 3
            at[axis] += sign * k
            cells[tuple(at)] = True
    mesh = shapes.voxels(np.kron(cells, np.ones((finer,) * 3, dtype=bool)))
    middle = mesh.centroids
    size = (2 * reach + 1) * finer
    gone = np.zeros(len(middle), dtype=bool)
    for arm in arms:
        axis = "xyz".index(arm.lower())
        gone |= middle[:, axis] > size - 0.25 if arm.isupper() else middle[:, axis] < 0.25
    return pieces.smooth(pieces.without_quads(mesh, gone), rounds)


def schwarz_p(rounds: int) -> QuadMesh:
    """A cell of Schwarz's P surface: six tubes that meet, moved onto cos x + cos y + cos z = 0."""
    mesh = branches("xXyYzZ", 1, rounds, reach=1)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    cell = mesh.with_vertices((mesh.vertices - 0.5 * (low + high)) / (high - low) * 2 * np.pi)
    return pieces.project_onto(cell, lambda p: np.cos(p).sum(axis=1))


# -- folded and creased ------------------------------------------------------------------------------------------------


def folded(side: int, rows: int, folds: int, height: float) -> QuadMesh:
    """A roof of straight folds: one fold is a gable, more are an accordion."""
    return pieces.sheet(
        lambda x, y: (x, y, height * np.abs((folds * x + 1) % 2 - 1)),
        steps(-1, 1, side) if folds % 2 else steps(0, 2, side),
        steps(-1, 1, rows),
    )


def miura(columns: int, rows: int, finer: int, lean: float, height: float) -> QuadMesh:
    """Miura's fold: zigzags both ways, each facet ``finer`` quads wide."""

    def zigzag(t: np.ndarray) -> np.ndarray:
        return np.abs((t / finer + 1) % 2 - 1)

    return pieces.sheet(
        lambda i, j: (i / finer + 0.0 * j, j / finer + lean * zigzag(i), height * zigzag(j)),
        np.arange(columns * finer + 1.0),
        np.arange(rows * finer + 1.0),
    )


def pyramid(side: int, height: float) -> QuadMesh:
    """A hip roof over a square: four planes and their creases."""
    u = steps(-1, 1, side)
    return pieces.sheet(lambda x, y: (x, y, height * (1 - np.maximum(np.abs(x), np.abs(y)))), u, u)


def tents(side: int, height: float) -> QuadMesh:
    """Four hypars over the quarters of a square, creased along its middle lines."""
    u = steps(-1, 1, side)
    return pieces.sheet(lambda x, y: (x, y, height * np.abs(x) * np.abs(y)), u, u)


def sawtooth(side: int, rows: int, teeth: int, height: float) -> QuadMesh:
    """A shed roof: slow rises and steep falls."""
    share = 0.8

    def tooth(x: np.ndarray) -> np.ndarray:
        t = np.mod(x * teeth, 1.0 + 1e-12)
        return np.where(t < share, t / share, (1 - t) / (1 - share))

    x = np.unique(np.round(np.concatenate([(k + np.linspace(0, 1, side + 1)) / teeth for k in range(teeth)]), 9))
    return pieces.sheet(lambda x, y: (x, y, height * tooth(x)), x, steps(0, rows / (side * teeth), rows))


def creased_dome(side: int, height: float) -> QuadMesh:
    """Two shells that meet in a crease along the diagonal of a cross vault."""
    u = steps(-1, 1, side)
    return pieces.sheet(lambda x, y: (x, y, height * (1 - np.minimum(np.abs(x), np.abs(y)) ** 2)), u, u)


# -- perforated --------------------------------------------------------------------------------------------------------


def perforated(side: int, period: int, bulge: float) -> QuadMesh:
    """A plate, bulged or flat, without every ``period``-th quad both ways."""
    u = steps(-1, 1, side)
    plate = pieces.sheet(lambda x, y: (x, y, bulge * (2 - x**2 - y**2)), u, u)
    i, j = np.divmod(np.arange(side * side), side)
    return pieces.without_quads(plate, (i % period == period // 2) & (j % period == period // 2))


def perforated_tube(sectors: int, rings: int, period: int) -> QuadMesh:
    """A tube with windows."""
    tube = pieces.sheet(lambda z, a: (np.cos(a), np.sin(a), z), steps(0, 2.4, rings), turn(sectors), (False, True))
    i, j = np.divmod(np.arange(len(tube.quads)), sectors)
    return pieces.without_quads(tube, (i % period == period // 2) & (j % period == period // 2))


def oculus(size: int, hole: float, low: float = 0.0) -> QuadMesh:
    """A dome of a blown-up cube with an opening at its top."""
    dome = shapes.cubesphere(size)
    z = dome.centroids[:, 2] / np.linalg.norm(dome.centroids, axis=1)
    return pieces.without_quads(dome, (z < low) | (z > np.cos(np.radians(hole))))


def feet(size: int, count: int) -> QuadMesh:
    """A dome whose rim is cut out in arches, so that it stands on ``count`` feet."""
    dome = shapes.cubesphere(size)
    x, y, z = dome.centroids.T / np.linalg.norm(dome.centroids, axis=1)
    arch = 0.12 + 0.42 * np.sin(0.5 * count * (np.arctan2(y, x) + np.pi / 4)) ** 2
    return largest(pieces.without_quads(dome, z < arch))


def largest(mesh: QuadMesh) -> QuadMesh:
    """Return the largest body after removing quads attached by a corner only."""
    while True:
        free = (mesh.neighbours < 0).sum(axis=1) >= 3
        fans = np.bincount(mesh.edges[mesh.border].ravel(), minlength=len(mesh.vertices)) > 2
        gone = free | fans[mesh.quads].any(axis=1) | (mesh.body_of != np.argmax(np.bincount(mesh.body_of)))
        if not gone.any():
            return mesh
        mesh = pieces.without_quads(mesh, gone)


# -- polygons divided into quads ---------------------------------------------------------------------------------------


def thirds(polygons: pieces.Polygons, shape: Shape | None = None) -> QuadMesh:
    """Cut every triangle into three quads: irregular vertices everywhere."""
    mesh = pieces.divide_polygons(polygons, smooth=False)
    return mesh if shape is None else mesh.with_vertices(shape(mesh.vertices))


def catmull_clark(polygons: pieces.Polygons, rounds: int, shape: Shape | None = None) -> QuadMesh:
    """Subdivide polygons by Catmull and Clark's rule."""
    mesh = pieces.smooth(pieces.divide_polygons(polygons, smooth=True), rounds - 1)
    return mesh if shape is None else mesh.with_vertices(shape(mesh.vertices))


def ball_triangles(steps_: int) -> pieces.Polygons:
    """An icosphere."""
    return pieces.triangles_of(*pieces.icosphere(steps_))


def octa_triangles(steps_: int) -> pieces.Polygons:
    """A refined octahedron."""
    return pieces.triangles_of(*pieces.octasphere(steps_))


def random_ball(count: int, seed: int) -> pieces.Polygons:
    """Random triangles of a sphere."""
    return pieces.triangles_of(*pieces.scattered_ball(count, seed))


def random_cells(count: int, seed: int) -> pieces.Polygons:
    """Random polygons of a sphere, mostly of five to seven corners."""
    return pieces.dual(*pieces.scattered_ball(count, seed))


def random_square(side: int, seed: int) -> pieces.Polygons:
    """Random triangles of a square."""
    return pieces.triangles_of(*pieces.scattered_square(side, seed))


def random_patches(side: int, seed: int) -> pieces.Polygons:
    """Random polygons that fill most of a square."""
    return pieces.dual(*pieces.scattered_square(side, seed))


def octagon_ring(around: int, across: int, ratio: float) -> pieces.Polygons:
    """A coarse torus of triangles."""
    u, v = np.meshgrid(turn(around), turn(across), indexing="ij")
    radius = 1 + ratio * np.cos(v)
    points = np.stack([radius * np.cos(u), radius * np.sin(u), ratio * np.sin(v)], axis=-1).reshape(-1, 3)
    faces = []
    for i in range(around):
        for j in range(across):
            a, b, c, d = ((i + p) % around * across + (j + q) % across for p, q in ((0, 0), (1, 0), (1, 1), (0, 1)))
            faces += [[a, b, c], [a, c, d]]
    return points, faces


def hill(height: float) -> Shape:
    """Points of a square lifted onto a hill."""
    return lambda p: np.column_stack([p[:, :2], height * np.cos(np.pi * p[:, 0] / 2.4) * np.cos(np.pi * p[:, 1] / 2.4)])


def saddled(height: float) -> Shape:
    """Points of a square lifted onto a saddle."""
    return lambda p: np.column_stack([p[:, :2], height * (p[:, 0] ** 2 - p[:, 1] ** 2)])


def on_ball(p: np.ndarray) -> np.ndarray:
    """Points moved onto the unit sphere."""
    return p / np.linalg.norm(p, axis=1, keepdims=True)


def potato(seed: int, depth: float, length: float = 1.4) -> Shape:
    """Points moved onto a ball with random bumps."""

    def shape(p: np.ndarray) -> np.ndarray:
        unit = on_ball(p)
        return unit * (1 + depth * pieces.noise(unit, seed, length))[:, None]

    return shape


# -- triangles for the remesh ------------------------------------------------------------------------------------------


def rough_ball(seed: int, depth: float, length: float) -> PolygonMesh:
    """Triangles of a ball with random bumps."""
    points, triangles = pieces.icosphere(4)
    return pieces.triangle_mesh(potato(seed, depth, length)(points), triangles)


def rough_land(seed: int, height: float) -> PolygonMesh:
    """Random triangles of hills, open."""
    points, triangles = pieces.scattered_square(40, seed)
    points[:, 2] = height * pieces.noise(points[:, :2], seed, 0.9)
    return pieces.triangle_mesh(points, triangles)

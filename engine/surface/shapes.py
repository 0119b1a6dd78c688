"""Built-in surfaces for the demo, for tests and for experiments.

Every shape is a function, without required arguments, that returns a QuadMesh of arbitrary size; ``make`` scales it to
an edge length.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..errors import FlexMapsError
from .mesh import QuadMesh


def make(name: str, edge: float = 0.02) -> QuadMesh:
    """Return a built-in surface.

    Parameters
    ----------
    name : one of ``NAMES``
    edge : median edge length, metres

    Raises
    ------
    FlexMapsError : no surface has this name
    """
    if name not in BUILDERS:
        raise FlexMapsError(f"There is no shape '{name}'; the shapes are {', '.join(NAMES)}")
    mesh = BUILDERS[name]()
    return mesh.with_vertices(mesh.vertices * (edge / mesh.median_edge))


# -- building blocks -------------------------------------------------------------------------------------------------


def _grid(columns: int, rows: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a grid of ``columns`` x ``rows`` quads: u and v of every vertex, from -1 to 1, and the quads' vertices."""
    u, v = np.meshgrid(np.linspace(-1, 1, columns + 1), np.linspace(-1, 1, rows + 1), indexing="ij")
    index = np.arange(u.size).reshape(u.shape)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1)
    return u.ravel(), v.ravel(), quads.reshape(-1, 4)


def weld_quads(vertices: np.ndarray, quads: np.ndarray) -> QuadMesh:
    """Make a quad mesh; merge vertices at equal positions and drop unused vertices.

    Parameters
    ----------
    vertices : (V, 3), any unit
    quads : (Q, 4) vertex indices
    """
    size = np.ptp(vertices, axis=0).max()
    _, first, same = np.unique(np.round(vertices / (size * 1e-7)), axis=0, return_index=True, return_inverse=True)
    used, corners = np.unique(first[same.ravel()][quads], return_inverse=True)
    return QuadMesh(vertices[used], corners.reshape(-1, 4))


def subdivide(mesh: QuadMesh) -> QuadMesh:
    """Subdivide a mesh once (Catmull and Clark 1978); borders become cubic B-splines."""
    p, inner = mesh.vertices, ~mesh.border
    faces = mesh.centroids
    ends = p[mesh.edges]
    middles = ends.mean(axis=1)
    points = middles.copy()
    points[inner] = 0.5 * middles[inner] + 0.25 * faces[mesh.edge_quads[inner]].sum(axis=1)
    count = len(p)
    n = mesh.valence[:, None].astype(float)
    face_mean, middle_mean = np.zeros_like(p), np.zeros_like(p)
    np.add.at(face_mean, mesh.quads, faces[:, None, :])
    np.add.at(middle_mean, mesh.edges, middles[:, None, :])
    moved = (face_mean / n + 2 * middle_mean / n + (n - 3) * p) / n
    rim = np.zeros_like(p)
    np.add.at(rim, mesh.edges[mesh.border], middles[mesh.border][:, None, :])
    moved[mesh.on_border] = 0.5 * p[mesh.on_border] + 0.25 * rim[mesh.on_border]
    at_edge = count + mesh.quad_edges
    at_face = count + len(mesh.edges) + np.arange(len(mesh.quads))
    quads = np.stack(
        [mesh.quads, at_edge, np.broadcast_to(at_face[:, None], (len(mesh.quads), 4)), np.roll(at_edge, 1, axis=1)],
        axis=2,
    )
    return QuadMesh(np.concatenate([moved, points, faces]), quads.reshape(-1, 4))


# -- shapes ----------------------------------------------------------------------------------------------------------


def quad() -> QuadMesh:
    """A single square."""
    return QuadMesh(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), np.array([[0, 1, 2, 3]]))


def cubesphere(n: int = 5) -> QuadMesh:
    """A unit sphere of 6 n^2 quads: the faces of a cube, divided by equal angles and projected onto the sphere."""
    u, v, quads = _grid(n, n)
    face = np.stack([np.tan(u * np.pi / 4), np.tan(v * np.pi / 4), np.ones_like(u)], axis=1)
    sides = [np.roll(face, k, axis=1) for k in range(3)] + [-np.roll(face, k, axis=1) for k in range(3)]
    vertices = np.concatenate(sides)
    vertices /= np.linalg.norm(vertices, axis=1)[:, None]
    all_quads = [quads + k * len(u) if k < 3 else quads[:, ::-1] + k * len(u) for k in range(6)]
    return weld_quads(vertices, np.concatenate(all_quads))


def dome(n: int = 8) -> QuadMesh:
    """The upper half of a sphere, of 3 n^2 quads; ``n`` must be even."""
    sphere = cubesphere(n)
    return weld_quads(sphere.vertices, sphere.quads[sphere.centroids[:, 2] > 0])


def torus(around: int = 30, across: int = 12, ratio: float = 0.4) -> QuadMesh:
    """A torus; its tube's centre line has the radius 1.

    Parameters
    ----------
    around : number of quads along the centre line
    across : number of quads round the tube
    ratio : radius of the tube
    """
    u, v, quads = _grid(around, across)
    radius = 1 + ratio * np.cos(np.pi * v)
    vertices = np.stack([radius * np.cos(np.pi * u), radius * np.sin(np.pi * u), ratio * np.sin(np.pi * v)], axis=1)
    return weld_quads(vertices, quads)


def vault(n: int = 18) -> QuadMesh:
    """A square shell that stands on its four corners, with arches between them."""
    u, v, quads = _grid(n, n)
    return QuadMesh(np.stack([u, v, 0.25 * (2 - u**2 - v**2)], axis=1), quads)


def saddle(n: int = 14) -> QuadMesh:
    """A square piece of a hyperbolic paraboloid."""
    u, v, quads = _grid(n, n)
    return QuadMesh(np.stack([u, v, 0.45 * (u**2 - v**2)], axis=1), quads)


def strip(length: int = 36, width: int = 3) -> QuadMesh:
    """A narrow open strip that winds like a spiral staircase.

    Parameters
    ----------
    length : number of quads along the strip
    width : number of quads across the strip
    """
    u, v, quads = _grid(length, width)
    angle, radius = 0.75 * np.pi * u, 1 + v * width / length * 2.0
    return QuadMesh(np.stack([radius * np.cos(angle), radius * np.sin(angle), 0.7 * u], axis=1), quads)


def three_holes(steps: int = 2) -> QuadMesh:
    """A smooth solid with three holes: a slab of cubes, subdivided ``steps`` times."""
    filled = np.ones((7, 3, 1), dtype=bool)
    filled[1::2, 1] = False
    mesh = voxels(filled)
    for _ in range(steps):
        mesh = subdivide(mesh)
    return mesh


def voxels(filled: np.ndarray) -> QuadMesh:
    """The outer surface of a set of unit cubes, with normals outwards; ``filled`` is a mask (nx, ny, nz)."""
    padded = np.pad(filled, 1)
    vertices: list[np.ndarray] = []
    quads: list[np.ndarray] = []
    for axis in range(3):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        for step in (-1, 1):
            bare = np.argwhere(padded & ~np.roll(padded, -step, axis=axis))
            corner = np.repeat(bare[:, None, :] - 1.0, 4, axis=1)
            corner[:, :, axis] += step > 0
            ring = [0, 1, 1, 0] if step > 0 else [0, 0, 1, 1]
            corner[:, :, first] += ring
            corner[:, :, second] += [0, 0, 1, 1] if step > 0 else [0, 1, 1, 0]
            quads.append(np.arange(4 * len(bare)).reshape(-1, 4) + 4 * sum(len(q) for q in quads))
            vertices.append(corner.reshape(-1, 3))
    return weld_quads(np.concatenate(vertices), np.concatenate(quads))


def two_bodies() -> QuadMesh:
    """A sphere and a smaller sphere beside it."""
    one, two = cubesphere(5), cubesphere(4)
    vertices = np.concatenate([one.vertices, 0.8 * two.vertices + [2.2, 0, 0]])
    return QuadMesh(vertices, np.concatenate([one.quads, two.quads + len(one.vertices)]))


def demo(n: int = 12) -> QuadMesh:
    """A canopy on three feet: a dome in the middle, with edges that flare upwards between the feet.

    It has 3 n^2 quads round a vertex of valence 3: an eighth of a cubesphere, flattened and raised again by a formula.
    The Gaussian curvature is positive round the top and negative towards the edges.
    """
    u, v, quads = _grid(n, n)
    face = np.stack([np.tan((1 - u) * np.pi / 8), np.tan((1 - v) * np.pi / 8), np.ones_like(u)], axis=1)
    points = np.concatenate([np.roll(face, k, axis=1) for k in range(3)])
    mesh = weld_quads(
        points / np.linalg.norm(points, axis=1)[:, None],
        np.concatenate([quads + k * len(u) for k in range(3)]),
    )
    to_top = np.array([[1, 1, 1], [1, -1, 0], [1, 1, -2]]) / np.sqrt([[3], [2], [6]])
    top, x, y = to_top @ mesh.vertices.T
    radius = np.arccos(np.clip(top, -1, 1)) / np.arccos(np.sqrt(1 / 3))  # 1 at the feet
    angle = np.arctan2(y, x) - np.pi / 6  # 0 towards a foot
    leg = np.cos(3 * angle)
    height = 0.62 * (1 - radius**2) + 0.58 * (1 - leg * radius**3.3)
    reach = radius * (1 - 0.05 * radius**2 * (1 + leg))
    angle = angle + 0.3 * np.sin(3 * angle) * radius**4  # broader feet
    return mesh.with_vertices(np.stack([reach * np.cos(angle), reach * np.sin(angle), height], axis=1))


BUILDERS: dict[str, Callable[[], QuadMesh]] = {
    f.__name__: f for f in (demo, cubesphere, dome, torus, vault, saddle, strip, three_holes, two_bodies, quad)
}
NAMES = tuple(BUILDERS)

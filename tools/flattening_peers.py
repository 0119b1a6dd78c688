"""libigl's ARAP and SLIM on the patches of a layout, as peers of our flattening; libigl has no constraints between patches."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from flexmaps.engine.patches.flattening.flatten import FlatPatches
from flexmaps.engine.patches.flattening.triangles import corner_triangles, quad_energy

Method = Callable[[np.ndarray, np.ndarray], np.ndarray]


def peers(flat: FlatPatches) -> dict[str, dict[str, float]]:
    """Return the largest energy and the seconds of libigl's ARAP and SLIM on the same patches."""
    return {name: _peer(flat, method) for name, method in (("libigl ARAP", igl_arap), ("libigl SLIM", igl_slim))}


def _peer(flat: FlatPatches, method: Method) -> dict[str, float]:
    """Flatten every patch by a method from its vertices and corners, and return the largest energy of a quad and the seconds."""
    mesh, layout = flat.layout.mesh, flat.layout
    worst, seconds = 0.0, 0.0
    tri = corner_triangles(mesh)
    for quads in layout.patches:
        labels, corners = np.unique(layout.flat_corners[quads], return_inverse=True)
        corners = corners.reshape(-1, 4)
        vertices = np.zeros((len(labels), 3))
        vertices[corners] = mesh.vertices[mesh.quads[quads]]
        started = time.process_time()
        points = method(vertices, corners)
        seconds += time.process_time() - started
        u = (points[:, 0] + 1j * points[:, 1])[corners]
        d = np.roll(u, -1, axis=1) - u
        before = np.roll(d, 1, axis=1)
        own = tri.subset(quads)
        a, b = own.along * d + own.against * before, own.along_bar * d + own.against_bar * before
        worst = max(worst, float(quad_energy(own, np.abs(a), np.abs(b)).max()))
    return {"energy_max": round(worst, 4), "seconds": round(seconds, 2)}


def _triangles(corners: np.ndarray) -> np.ndarray:
    """Return two triangles for every quad."""
    return np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]]).astype(np.int64)


def _disk_start(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Tutte's embedding on a circle of the patch's area."""
    import igl

    loop = igl.boundary_loop(triangles)
    circle = igl.map_vertices_to_circle(np.asfortranarray(vertices), loop.astype(np.int32))
    area = (
        0.5
        * np.linalg.norm(
            np.cross(
                vertices[triangles[:, 1]] - vertices[triangles[:, 0]],
                vertices[triangles[:, 2]] - vertices[triangles[:, 0]],
            ),
            axis=1,
        ).sum()
    )
    circle = np.asarray(circle)[:, :2] * np.sqrt(area / np.pi)
    return np.asarray(igl.harmonic(vertices, triangles, loop.astype(np.int64), np.ascontiguousarray(circle), 1))


def igl_arap(vertices: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """libigl's ARAP parametrisation of one patch, from Tutte's embedding, 100 iterations."""
    import igl

    triangles = _triangles(corners)
    points = _disk_start(vertices, triangles)
    data = igl.ARAPData()
    data.max_iter = 100
    data.energy = igl.ARAP_ENERGY_TYPE_ELEMENTS
    held = np.array([triangles[0, 0]], dtype=np.int32)
    igl.arap_precomputation(vertices, triangles, 2, held, data)
    return np.asarray(igl.arap_solve(points[held], data, points))


def igl_slim(vertices: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """libigl's SLIM with the symmetric Dirichlet energy, from Tutte's embedding, 30 iterations."""
    import igl

    triangles = _triangles(corners)
    start = np.zeros((len(vertices), 3))
    start[:, :2] = _disk_start(vertices, triangles)
    data = igl.slim_precompute(
        np.asfortranarray(vertices),
        np.asfortranarray(triangles.astype(np.int32)),
        np.asfortranarray(start[:, :2]),
        igl.SYMMETRIC_DIRICHLET,
        np.zeros(0, dtype=np.int32),
        np.asfortranarray(np.zeros((0, 2))),
        0.0,
    )
    return np.asarray(igl.slim_solve(data, 30))[:, :2]

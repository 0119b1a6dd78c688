"""Triangle meshes of known shapes."""

from __future__ import annotations

import igl
import numpy as np
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.quadrangulation.field import Triangles


def grid(columns: int, rows: int, position) -> Triangles:
    """Points u, v from 0 to 1, triangles of alternating diagonals, equal points merged."""
    u, v, quads = shapes._grid(columns, rows)
    q = np.where((np.arange(len(quads)) % 2)[:, None] == 1, np.roll(quads, 1, axis=1), quads)
    u, v = 0.5 * (u + 1), 0.5 * (v + 1)
    points, where = np.unique(np.round(np.stack(position(u, v), axis=1), 9) + 0.0, axis=0, return_inverse=True)
    return Triangles(points, where.ravel()[np.concatenate([q[:, [0, 1, 2]], q[:, [0, 2, 3]]])])


def icosphere(levels: int = 3) -> Triangles:
    points, triangles = igl.icosahedron()
    points, triangles = igl.loop(points, triangles, levels)
    return Triangles(points / np.linalg.norm(points, axis=1)[:, None], triangles.astype(np.int64))


def ellipsoid() -> Triangles:
    sphere = icosphere(3)
    return Triangles(sphere.vertices * [1.0, 1.5, 2.5], sphere.corners)


def torus() -> Triangles:
    def place(u, v):
        around, along = 2 * np.pi * u, 2 * np.pi * v
        ring = 2 + 0.7 * np.cos(around)
        return ring * np.cos(along), ring * np.sin(along), 0.7 * np.sin(around)

    return grid(24, 60, place)


def barrel() -> Triangles:
    return grid(40, 20, lambda u, v: (np.cos(2 * np.pi * u), np.sin(2 * np.pi * u), 3 * v))


def cube() -> Triangles:
    mesh = shapes.cubesphere(4)
    points = np.tan(np.pi / 4 * mesh.vertices / np.abs(mesh.vertices).max(axis=1)[:, None])
    q = mesh.quads
    return Triangles(points, np.concatenate([q[:, [0, 1, 2]], q[:, [0, 2, 3]]]))

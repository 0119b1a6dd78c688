"""A copy of an object's mesh as plain arrays, for stages that run off Blender's main thread."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...engine.arrays import Bool, Float, Int
from ...engine.surface.mesh import PolygonMesh


@dataclass(frozen=True, eq=False)
class ObjectSurface:
    """Copy of an object's mesh as plain arrays, which other threads may read.

    uid : Blender's id of the object for this session, which survives renaming
    polygons : faces in the engine's order; metres, world axes, corners counter-clockwise seen from outside
    positions : the mesh's own vertices in the object's frame, float32
    edge_vertices : vertex indices of Blender's edges
    seams : UV seams in the order of Blender's edges
    loops : index of Blender's corner for every corner of ``polygons``
    to_metres : matrix from the object's frame to metres in world axes
    values : FlexMaps' attributes by name, without the prefix, in Blender's order
    invalid_faces : indices of the faces whose width or twist is out of its bounds
    keyed_positions : vertices moved by the user's shape keys, in the object's frame
    """

    uid: int
    polygons: PolygonMesh
    positions: Float[np.ndarray, "vertices 3"]
    edge_vertices: Int[np.ndarray, "edges 2"]
    seams: Bool[np.ndarray, " edges"]
    loops: Int[np.ndarray, " corners"]
    to_metres: Float[np.ndarray, "4 4"]
    values: dict[str, np.ndarray]
    invalid_faces: Int[np.ndarray, " invalid"]
    keyed_positions: Float[np.ndarray, "vertices 3"]

    @cached_property
    def edge_of(self) -> Int[np.ndarray, " edges"]:
        """Return the index of Blender's edge for every edge of the engine, which sorts edges by their vertex pair."""
        corners = self.polygons.corners
        engine = _keys(np.stack([corners, corners[self.polygons.next_corner]], axis=1), len(self.positions))
        blender = _keys(self.edge_vertices, len(self.positions))
        order = np.argsort(blender)
        return order[np.searchsorted(blender, np.unique(engine), sorter=order)]

    def is_same_mesh(self, other: ObjectSurface) -> bool:
        """Return whether vertices, faces and seams equal those of another copy."""
        a, b = self.polygons, other.polygons
        pairs = [(a.vertices, b.vertices), (a.corners, b.corners), (a.sizes, b.sizes), (self.seams, other.seams)]
        return all(x.shape == y.shape and bool((x == y).all()) for x, y in pairs)


def _keys(pairs: Int[np.ndarray, "pairs 2"], n: int) -> Int[np.ndarray, " pairs"]:
    return pairs.min(axis=1).astype(np.int64) * n + pairs.max(axis=1)

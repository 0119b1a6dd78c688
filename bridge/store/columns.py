"""Read properties of all vertices, edges, corners or faces of a Blender mesh as numpy arrays."""

from __future__ import annotations

import bpy
import numpy as np

from ...engine.arrays import Float

# property of mesh elements -> numpy type, numbers per element
PROPERTIES: dict[str, tuple[type, int]] = {
    "co": (np.float32, 3),
    "vertex_index": (np.int32, 1),
    "edge_index": (np.int32, 1),
    "vertices": (np.int32, 2),
    "use_seam": (np.bool_, 1),
    "select": (np.bool_, 1),
    "hide": (np.bool_, 1),
    "loop_start": (np.int32, 1),
    "loop_total": (np.int32, 1),
    "area": (np.float32, 1),
}


def column(items: bpy.types.bpy_prop_collection, name: str) -> np.ndarray:
    """Return a property of all elements as an array, (N,) or (N, 2 or 3).

    Parameters
    ----------
    items : vertices, edges, loops or polygons of a mesh, or the points of a shape key
    name : a key of ``PROPERTIES``; "vertices" are the indices of an edge's two vertices
    """
    kind, width = PROPERTIES[name]
    values: np.ndarray = np.empty(len(items) * width, kind)
    items.foreach_get(name, values)
    return values if width == 1 else values.reshape(-1, width)


def read_weights(mesh: bpy.types.Mesh, group: int) -> Float[np.ndarray, " vertices"]:
    """Return the weights of a vertex group, 0 for vertices outside it.

    Parameters
    ----------
    mesh : Blender's mesh, outside edit mode
    group : index of the vertex group
    """
    return np.array([next((g.weight for g in v.groups if g.group == group), 0.0) for v in mesh.vertices], np.float32)

"""Holds, forces and drag targets of single spirals, as face attributes.

flexmaps_held    face   1 where a spiral is held, in addition to the supports' vertex group
flexmaps_pull    face   force on a spiral in newtons and world axes, in addition to the vertex group's force
flexmaps_wish    face   offset of the drag target from the quad's centre in the target, in the object's frame; 0 is none

Vertex groups would not do: neighbouring quads share vertices.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
import numpy as np

from ...engine.arrays import Float, Int
from . import attributes

if TYPE_CHECKING:
    from .surface import ObjectSurface

HELD, PULL, WISH = "held", "pull", "wish"
NAMES = (HELD, PULL, WISH)
PREFIXED = {name: attributes.PREFIX + name for name in NAMES}


def held_quads(surface: ObjectSurface) -> Int[np.ndarray, " held"]:
    """Return the indices of the quads that are marked as held in the attribute flexmaps_held."""
    return np.flatnonzero(surface.values.get(HELD, np.zeros(0)) > 0.5)


def read_forces(surface: ObjectSurface) -> Float[np.ndarray, "quads 3"] | None:
    """Return the forces marked on single quads, newtons in world axes; None if there are none."""
    forces = surface.values.get(PULL)
    return None if forces is None or not forces.any() else forces.astype(float)


def read_wishes(surface: ObjectSurface) -> Float[np.ndarray, "quads 3"]:
    """Return the offset from every quad's centre to its drag target, metres in world axes; 0 where there is none."""
    offsets = surface.values.get(WISH, np.zeros((len(surface.polygons.sizes), 3)))
    return offsets.astype(float) @ surface.to_metres[:3, :3].T


def read(obj: bpy.types.Object, name: str) -> Float[np.ndarray, "quads ..."]:
    """Return the stored values of one of the attributes ``NAMES``; zeros where it is missing or damaged.

    Parameters
    ----------
    obj : the mesh object
    name : ``HELD``, ``PULL`` or ``WISH``
    """
    with attributes.readable_mesh(obj) as mesh:
        values, count = attributes.read(mesh, attributes.PREFIX + name), len(mesh.polygons)
    shape = (count,) if name == HELD else (count, 3)
    return np.zeros(shape) if values is None or values.shape != shape else values.astype(float)


def write(obj: bpy.types.Object, name: str, values: Float[np.ndarray, "quads ..."]) -> None:
    """Store the values of one of the attributes ``NAMES``; remove the attribute if all are zero.

    Parameters
    ----------
    obj : the mesh object
    name : ``HELD``, ``PULL`` or ``WISH``
    values : (F,) for ``HELD``, else (F, 3)
    """
    if not values.any():
        attributes.remove(obj, attributes.PREFIX + name)
    else:
        kind = "FLOAT" if name == HELD else "FLOAT_VECTOR"
        attributes.write(obj, attributes.PREFIX + name, "FACE", kind, values)


def write_wishes(
    obj: bpy.types.Object, to_metres: Float[np.ndarray, "4 4"], offsets: Float[np.ndarray, "quads 3"]
) -> None:
    """Store drag targets from offsets in metres and world axes.

    Parameters
    ----------
    obj : the mesh object
    to_metres : matrix from the object's frame to metres
    offsets : (F, 3), metres in world axes
    """
    write(obj, WISH, offsets @ np.linalg.inv(to_metres[:3, :3]).T)

"""What a hand holds, pulls and wishes of single spirals, on the mesh's faces; vertex groups cannot tell one quad from its neighbours.

flexmaps_held    face   1 where a spiral is held, beside those of the supports' vertex group
flexmaps_pull    face   newtons in world axes that pull at a spiral, beside the group's force
flexmaps_wish    face   where Optimise shall bring its middle: from that of its quad in the target, in the object's own frame; 0 is no wish
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
import numpy as np

from ...engine.arrays import Float, Int
from . import attributes

if TYPE_CHECKING:
    from .surface import Surface

HELD, PULL, WISH = "held", "pull", "wish"
NAMES = (HELD, PULL, WISH)
PREFIXED = {name: attributes.PREFIX + name for name in NAMES}


def held(surface: Surface) -> Int[np.ndarray, " held"]:
    """The quads that are held."""
    return np.flatnonzero(surface.values.get(HELD, np.zeros(0)) > 0.5)


def pulls(surface: Surface) -> Float[np.ndarray, "quads 3"] | None:
    """Newtons on every quad; None without any."""
    found = surface.values.get(PULL)
    return None if found is None or not found.any() else found.astype(float)


def wishes(surface: Surface) -> Float[np.ndarray, "quads 3"]:
    """Metres in world axes from every quad's middle to where it is wished; 0 where nothing is."""
    found = surface.values.get(WISH, np.zeros((len(surface.polygons.sizes), 3)))
    return found.astype(float) @ surface.to_metres[:3, :3].T


def read(obj: bpy.types.Object, name: str) -> Float[np.ndarray, "quads ..."]:
    """The values as they are stored; zeros where there are none."""
    with attributes.readable(obj) as mesh:
        found, count = attributes.get(mesh, attributes.PREFIX + name), len(mesh.polygons)
    shape = (count,) if name == HELD else (count, 3)
    return np.zeros(shape) if found is None or found.shape != shape else found.astype(float)


def write(obj: bpy.types.Object, name: str, values: Float[np.ndarray, "quads ..."]) -> None:
    """Store them; where all are 0, nothing is left of them."""
    if not values.any():
        attributes.remove(obj, attributes.PREFIX + name)
    else:
        kind = "FLOAT" if name == HELD else "FLOAT_VECTOR"
        attributes.put(obj, attributes.PREFIX + name, "FACE", kind, values)


def from_metres(
    obj: bpy.types.Object, to_metres: Float[np.ndarray, "4 4"], offsets: Float[np.ndarray, "quads 3"]
) -> None:
    """Store wishes that are given in metres and world axes."""
    write(obj, WISH, offsets @ np.linalg.inv(to_metres[:3, :3]).T)

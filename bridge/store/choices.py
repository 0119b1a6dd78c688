"""Layouts compared by *Choose*, stored on the mesh's edges, so that the user can switch to another layout later."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np

from ...engine.arrays import Bool
from ...engine.errors import FlexMapsError
from . import attributes
from .surface import ObjectSurface

NAME = attributes.PREFIX + "choices"


def write_cuts(obj: bpy.types.Object, surface: ObjectSurface, cuts: Sequence[Bool[np.ndarray, " edges"]]) -> None:
    """Store where every layout cuts: bit k of an edge's integer is set where layout k cuts the edge.

    Parameters
    ----------
    obj : the mesh object
    surface : its surface
    cuts : for each layout a flag for every edge, in the engine's order
    """
    bits = np.zeros(len(surface.edge_vertices), dtype=np.int64)
    for k, cut in enumerate(cuts):
        bits[surface.edge_of] |= cut.astype(np.int64) << k
    attributes.write(obj, NAME, "EDGE", "INT", bits)


def read_cuts(surface: ObjectSurface, number: int) -> Bool[np.ndarray, " edges"]:
    """Return which edges a layout cuts, in the engine's order.

    Parameters
    ----------
    surface : the surface with its attributes
    number : index of the layout, from 0

    Raises
    ------
    FlexMapsError where the mesh holds no layouts.
    """
    bits = surface.values.get(NAME.removeprefix(attributes.PREFIX))
    if bits is None:
        raise FlexMapsError("The layouts that were compared are not on this mesh any more; press Choose again")
    return (bits[surface.edge_of].astype(np.int64) >> number & 1).astype(bool)

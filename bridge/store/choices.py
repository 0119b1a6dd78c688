"""The layouts that were compared, on the edges of the mesh, so that another one can be taken later."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np

from ...engine.arrays import Bool
from ...engine.errors import FlexMapsError
from . import attributes
from .surface import Surface

NAME = attributes.PREFIX + "choices"


def write(obj: bpy.types.Object, surface: Surface, cuts: Sequence[Bool[np.ndarray, " edges"]]) -> None:
    """Note where every layout cuts, in the engine's order of edges: bit k of an edge's number stands for layout k."""
    bits = np.zeros(len(surface.pairs), dtype=np.int64)
    for k, cut in enumerate(cuts):
        bits[surface.edge_of] |= cut.astype(np.int64) << k
    attributes.put(obj, NAME, "EDGE", "INT", bits)


def cuts_of(surface: Surface, number: int) -> Bool[np.ndarray, " edges"]:
    """Where a layout cuts, in the engine's order of edges; raises ``FlexMapsError`` where there are none."""
    bits = surface.values.get(NAME.removeprefix(attributes.PREFIX))
    if bits is None:
        raise FlexMapsError("The layouts that were compared are not on this mesh any more; press Choose again")
    return (bits[surface.edge_of].astype(np.int64) >> number & 1).astype(bool)

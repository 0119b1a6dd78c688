"""Polygons of tips, and the walls beside their sockets."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...arrays import Complex, Float
from .joined_arms import to_points


def wall_thicknesses(
    sockets: Sequence[np.ndarray], left: Complex[np.ndarray, "n points"], right: Complex[np.ndarray, "n points"]
) -> Float[np.ndarray, " n"]:
    """Return the minimum distance (n,) in metres between every socket and the edges of its arm.

    sockets : complex points on the end curve of every socket
    left, right : (n, M) complex points of the arms' edges
    """
    import shapely

    if not len(sockets):
        return np.empty(0)
    owner = np.repeat(np.arange(len(sockets)), [len(line) for line in sockets])
    lines = shapely.linestrings(to_points(np.concatenate(sockets)), indices=owner)
    return np.minimum(*(shapely.distance(lines, shapely.linestrings(to_points(e))) for e in (left, right)))


def make_polygons(rings: Sequence[np.ndarray]) -> list[Any]:
    """Return shapely polygons of complex rings; None for rings that touch themselves."""
    import shapely

    if not len(rings):
        return []
    owner = np.repeat(np.arange(len(rings)), [len(ring) for ring in rings])
    made = shapely.polygons(shapely.linearrings(to_points(np.concatenate(rings)), indices=owner))
    return [p if valid else None for p, valid in zip(made.tolist(), shapely.is_valid(made).tolist(), strict=True)]

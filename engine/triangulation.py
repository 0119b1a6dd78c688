"""Triangulate flat polygons with holes, using given points as corners."""

from __future__ import annotations

from typing import Any

import numpy as np

from .arrays import Float, Int


def triangulate(polygons: list[Any], known: Float[np.ndarray, "known 2"]) -> Int[np.ndarray, "triangles 3"]:
    """Triangulate polygons; return counter-clockwise triangles as indices into ``known``.

    Parameters
    ----------
    polygons : shapely polygons, which may have holes
    known : points (n, 2), among them all corners of the polygons, in any order
    """
    import shapely

    parts = [shapely.get_coordinates(shapely.constrained_delaunay_triangles(one)).reshape(-1, 4, 2) for one in polygons]
    corners = np.concatenate(parts)[:, :3]
    triangles = _places(known, corners.reshape(-1, 2)).reshape(-1, 3)
    assert triangles.min() >= 0  # corners of the triangles are exactly those of the polygons
    a, b, c = known[triangles].transpose(1, 0, 2)
    clockwise = (b - a)[:, 0] * (c - a)[:, 1] < (b - a)[:, 1] * (c - a)[:, 0]
    triangles[clockwise] = triangles[clockwise, ::-1]
    return triangles


def _places(known: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return, for every point (n, 2), the index of the exactly equal point in ``known``; -1 if there is none."""
    # adding zero turns -0.0 into 0.0; complex numbers sort by both parts
    keys, wanted = (np.ascontiguousarray(some + 0.0).view(complex).ravel() for some in (known, points))
    order = np.argsort(keys)
    place = np.minimum(np.searchsorted(keys[order], wanted), len(keys) - 1)
    return np.where(keys[order][place] == wanted, order[place], -1)

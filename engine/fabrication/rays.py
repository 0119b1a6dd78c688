"""How far one sees from points in given directions before a wall is in the way."""

from __future__ import annotations

import numpy as np


def first_hit(origin: np.ndarray, way: np.ndarray, view: float, start: np.ndarray, along: np.ndarray) -> np.ndarray:
    """(N,) metres to the nearest wall that a ray meets, at most ``view``.

    origin : (N,) complex, metres; way : (N,) complex, unit directions
    start, along : (S,) complex, metres: where the straight walls begin, and from there to their ends
    """
    import shapely

    seen = np.full(len(origin), view)
    rays = _lines(origin, origin + view * way)
    walls = _lines(start, start + along)
    low, high = rays.min(axis=(0, 1)), rays.max(axis=(0, 1))
    inside = ((walls.max(axis=1) >= low) & (walls.min(axis=1) <= high)).all(axis=1)
    start, along = start[inside], along[inside]
    ray, wall = shapely.STRtree(shapely.linestrings(walls[inside])).query(shapely.linestrings(rays))
    cross = (way[ray].conj() * along[wall]).imag
    to = start[wall] - origin[ray]
    with np.errstate(divide="ignore", invalid="ignore"):
        far, share = (to.conj() * along[wall]).imag / cross, (to.conj() * way[ray]).imag / cross
    hit = (far >= 0.0) & (share >= 0.0) & (share <= 1.0)
    np.minimum.at(seen, ray[hit], far[hit])
    return seen


def _lines(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(N, 2, 2) from complex ends (N,) each."""
    ends = np.stack([a, b], axis=1)
    return np.stack([ends.real, ends.imag], axis=-1)

"""Outlines made ready for a search of places: few points, and no bays into which nothing fits."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...arrays import Float

STRAYS = (1e-4, 2e-4, 4e-4, 8e-4, 1.6e-3)  # metres by which shapes may be simplified, outwards only
POINTS = 80  # most points that a simplified shape should have: spyrrow takes a second to read a few hundred
# share of a bay's width in a first round, and metres by which outlines may stray between the rounds: on 21 panels of 180 quads with
# 12,500 points each 0.9 s instead of 9.7 s, and shapes whose areas differ by 3 in 10,000
SLOT, COARSE = 0.125, 8e-5

# share of a sheet less its margin that the convex hulls of panels cover which just fit on it, on average, and its standard deviation:
# 102 random sets of 2 to 8 panels of four pieces, each packed for 2 s. Hulls tell more than areas do, and as much as both
HULLS, SPREAD = 0.786, 0.039


def simplified(
    shape: Float[np.ndarray, "points 2"], bay: float, strays: tuple[float, ...] = STRAYS
) -> Float[np.ndarray, "simple 2"]:
    """A coarser outline round a shape, in metres, without bays that are narrower than twice ``bay``.

    strays : metres by which it may lie outside, the first that leaves at most ``POINTS`` points, or the last
    """
    import shapely

    outline = shapely.Polygon(shape)
    closed = outline.simplify(COARSE)
    # first the slots alone: what is left has few points, and closing both at once gives the same
    for radius in (SLOT * bay, bay):
        closed = _largest(closed.buffer(radius, quad_segs=4).buffer(-radius, quad_segs=4)).simplify(COARSE)
    # buffers round corners off by less than they should: the outline itself makes up for it
    largest = _largest(closed.union(outline))
    for stray in strays:
        grown = largest.simplify(0.9 * stray).buffer(stray, join_style="mitre")
        if len(grown.exterior.coords) <= POINTS:
            break
    return np.asarray(grown.exterior.coords)[:-1]


def grown_area(shape: Float[np.ndarray, "points 2"], distance: float) -> float:
    """Square metres of a shape and all that lies within ``distance`` metres of it."""
    import shapely

    return float(shapely.Polygon(shape).buffer(distance).area)


def hull_area(points: Float[np.ndarray, "points 2"]) -> float:
    """Square metres of the convex hull of points."""
    from scipy.spatial import ConvexHull

    return float(ConvexHull(points).volume)  # what it calls volume is the area in the plane


def _largest(shape: Any) -> Any:
    """The largest part of a shape of shapely's, without its holes."""
    import shapely

    return shapely.Polygon(max(getattr(shape, "geoms", [shape]), key=lambda part: part.area).exterior)

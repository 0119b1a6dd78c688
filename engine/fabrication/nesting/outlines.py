"""Outlines made ready for a search of places: few points, and no bays into which nothing fits."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...arrays import Float
from .covering import covering

# share of a bay's width in a first round, and metres by which outlines may stray between the rounds: on 21 panels of 180 quads with
# 12,500 points each 0.9 s instead of 9.7 s, and shapes whose areas differ by 3 in 10,000
SLOT, COARSE = 0.125, 8e-5
ARC = 4  # sides by which a quarter of a circle is drawn
STRAY = 5e-5  # metres outwards by which an outline may stray before corners are counted

# share of a sheet less its margin that the convex hulls of panels cover which just fit on it, on average, and its standard deviation:
# 105 random sets of 2 to 8 panels of three pieces, each packed for 2 s. Hulls tell more than areas do, and as much as both
HULLS, SPREAD = 0.82, 0.035


def grown(
    shape: Float[np.ndarray, "points 2"], distance: float, bay: float, corners: int
) -> Float[np.ndarray, "simple 2"]:
    """A polygon round all that lies within ``distance`` metres of a shape, with about so many corners.

    Bays that are narrower than twice ``bay`` metres are closed.
    """
    import shapely

    outline = shapely.Polygon(shape)
    closed = outline.simplify(COARSE)
    # first the slots alone: what is left has few points, and closing both at once gives the same
    for radius in (SLOT * bay, bay):
        closed = _largest(closed.buffer(radius, quad_segs=ARC).buffer(-radius, quad_segs=ARC)).simplify(COARSE)
    # buffers round corners off by less than they should: the outline itself makes up for it
    largest = _largest(closed.union(outline))
    # GEOS leaves out corners that matter by less than a hundredth of the distance, and the sides of an arc lie inside it
    far = (1.02 * distance + STRAY) / math.cos(0.25 * math.pi / ARC)
    around = largest.simplify(0.1 * STRAY).buffer(far + 0.1 * STRAY, quad_segs=ARC).simplify(STRAY)
    return covering(np.asarray(_largest(around).exterior.coords)[:-1], corners)


def hull_area(points: Float[np.ndarray, "points 2"]) -> float:
    """Square metres of the convex hull of points."""
    from scipy.spatial import ConvexHull

    return float(ConvexHull(points).volume)  # what it calls volume is the area in the plane


def _largest(shape: Any) -> Any:
    """The largest part of a shape of shapely's, without its holes."""
    import shapely

    return shapely.Polygon(max(getattr(shape, "geoms", [shape]), key=lambda part: part.area).exterior)

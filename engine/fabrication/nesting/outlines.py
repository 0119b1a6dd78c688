"""Simplify outlines for nesting: no bays into which no panel fits, and few points; spyrrow simplifies them further."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...arrays import Float

# Share of a bay's width closed in a first round, and tolerance in metres between the rounds: 21 panels of 180 quads
# with 12,500 points each take 0.9 s instead of 9.7 s, and areas differ by 3 in 10,000
SLOT, COARSE = 0.125, 8e-5
ARC = 4  # sides per quarter circle
STRAY = 5e-5  # metres by which an outline may grow when it is simplified

# Share of a sheet (without its margin) covered by the convex hulls of panels that just fit on it: mean and standard
# deviation of 105 random sets of 2 to 8 panels of three pieces, each packed for 2 s. Hulls predict better than areas,
# and as well as both together
HULLS, SPREAD = 0.82, 0.035


def grow_outline(shape: Float[np.ndarray, "points 2"], distance: float, bay: float) -> Float[np.ndarray, "simple 2"]:
    """Return a counter-clockwise polygon around all points within ``distance`` metres of a shape.

    Bays narrower than twice ``bay`` metres are closed.
    """
    import shapely

    outline = shapely.Polygon(shape)
    closed = outline.simplify(COARSE)
    # close the slots first, which leaves few points; the result is the same as closing everything at once
    for radius in (SLOT * bay, bay):
        closed = _largest(closed.buffer(radius, quad_segs=ARC).buffer(-radius, quad_segs=ARC)).simplify(COARSE)
    # buffers fall short at rounded corners: the union with the outline makes up for it
    largest = _largest(closed.union(outline))
    # Enlarge the distance by 2 %, because GEOS omits small corners of a buffer, and for the chords of an arc, which lie
    # inside it
    far = (1.02 * distance + STRAY) / math.cos(0.25 * math.pi / ARC)
    around = largest.simplify(0.1 * STRAY).buffer(far + 0.1 * STRAY, quad_segs=ARC).simplify(STRAY)
    ring = shapely.geometry.polygon.orient(_largest(around)).exterior
    return np.asarray(ring.coords)[:-1]


def hull_area(points: Float[np.ndarray, "points 2"]) -> float:
    """Return the area of the convex hull of points in m2."""
    from scipy.spatial import ConvexHull

    return float(ConvexHull(points).volume)  # in the plane, scipy's volume is the area


def _largest(shape: Any) -> Any:
    """Return the largest part of a shapely shape, without its holes."""
    import shapely

    return shapely.Polygon(max(getattr(shape, "geoms", [shape]), key=lambda part: part.area).exterior)

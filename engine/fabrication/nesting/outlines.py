"""Simplify outlines for nesting: close concave bays too narrow for any panel, and leave few points."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...arrays import Float

# ``grow_outline`` closes bays in two rounds, narrow ones first, which is ten times as fast as closing all at once.
# FIRST_BAY_SHARE: width up to which the first round closes bays, as a share of that of the second round.
# COARSE_TOLERANCE: tolerance in metres of the simplification after each round; larger is faster and less exact
FIRST_BAY_SHARE, COARSE_TOLERANCE = 0.125, 8e-5
SIDES_PER_QUARTER = 4  # sides per quarter circle of rounded corners in buffers; more are more exact and slower
MAX_GROWTH = 5e-5  # metres by which an outline may grow when it is simplified; larger: fewer points, larger gaps

# Measured on sets of panels that just fit on a sheet: mean and standard deviation of the total area of the panels'
# convex hulls, as a share of the sheet without its margin. Larger values make the search try larger sets
MEAN_HULL_SHARE, HULL_SHARE_DEVIATION = 0.82, 0.035


def grow_outline(shape: Float[np.ndarray, "points 2"], distance: float, bay: float) -> Float[np.ndarray, "simple 2"]:
    """Return a simplified counter-clockwise polygon around all points within ``distance`` metres of a shape.

    Concave bays narrower than twice ``bay`` metres are closed.
    """
    import shapely

    outline = shapely.Polygon(shape)
    closed = outline.simplify(COARSE_TOLERANCE)
    # close narrow slots first, which leaves few points for the second round; the result equals that of a single round
    for radius in (FIRST_BAY_SHARE * bay, bay):
        closed = _largest(
            closed.buffer(radius, quad_segs=SIDES_PER_QUARTER).buffer(-radius, quad_segs=SIDES_PER_QUARTER)
        ).simplify(COARSE_TOLERANCE)
    # buffering outwards and inwards cuts a little off rounded corners; the union with the outline restores them
    largest = _largest(closed.union(outline))
    # enlarge the distance by 2 %, because GEOS omits small corners of a buffer, and divide it by a cosine, because the
    # sides that replace a rounded corner lie inside its arc
    far = (1.02 * distance + MAX_GROWTH) / math.cos(0.25 * math.pi / SIDES_PER_QUARTER)
    around = (
        largest.simplify(0.1 * MAX_GROWTH)
        .buffer(far + 0.1 * MAX_GROWTH, quad_segs=SIDES_PER_QUARTER)
        .simplify(MAX_GROWTH)
    )
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

"""Lines with rounded corners, and outlines around convex hulls, as curves of arcs."""

from __future__ import annotations

import numpy as np

from ...arrays import Float
from ...spirals.curves.arcs import Curve
from ...tolerances import SINGLE_TOL

CORNER_RADIUS = 0.0006  # radius of the outer corners of feet and planks, metres; larger is less sharp to the touch


def round_corners(
    points: Float[np.ndarray, "n 2"], radius: Float[np.ndarray, " n"] | float, *, closed: bool = True
) -> Curve:
    """Return a polyline with corners rounded by arcs.

    An arc replaces at most half of a side; its radius is reduced if necessary.

    Parameters
    ----------
    points : metres
    radius : radius of the arcs, metres, for all corners or for each; 0 keeps a corner sharp
    closed : whether the last point is joined to the first; the ends of an open line stay
    """
    points, radius = np.asarray(points, dtype=float), np.broadcast_to(radius, len(points))
    nodes: list[np.ndarray] = []
    bulges: list[float] = []
    for k, (point, r) in enumerate(zip(points, radius, strict=True)):
        before, after = points[k - 1] - point, points[(k + 1) % len(points)] - point
        inner = closed or 0 < k < len(points) - 1
        if r <= 0.0 or not inner:
            nodes.append(point)
            bulges.append(0.0)
            continue
        sides = np.linalg.norm(before), np.linalg.norm(after)
        before, after = before / sides[0], after / sides[1]
        turn = np.pi - np.arccos(np.clip(before @ after, -1.0, 1.0))
        if turn < SINGLE_TOL:
            nodes.append(point)
            bulges.append(0.0)
            continue
        left = before[1] * after[0] - before[0] * after[1] > 0.0  # ``before`` points back to the previous point
        reach = min(r * np.tan(0.5 * turn), 0.499 * min(sides))
        nodes += [point + reach * before, point + reach * after]
        bulges += [(1.0 if left else -1.0) * np.tan(0.25 * turn), 0.0]
    return Curve(np.array(nodes), np.array(bulges), closed=closed)


def hull_outline(points: Float[np.ndarray, "n 2"], margin: float) -> Curve:
    """Return the outline ``margin`` metres around the convex hull of points, counter-clockwise, with round corners."""
    import shapely

    ring = shapely.get_coordinates(shapely.orient_polygons(shapely.convex_hull(shapely.multipoints(points))))[:-1]
    way = np.roll(ring, -1, axis=0) - ring
    way /= np.linalg.norm(way, axis=1)[:, None]
    out = margin * np.column_stack([way[:, 1], -way[:, 0]])
    before = np.roll(out, 1, axis=0)
    turn = np.arctan2(before[:, 0] * out[:, 1] - before[:, 1] * out[:, 0], (before * out).sum(axis=1))
    nodes = np.stack([ring + before, ring + out], axis=1).reshape(-1, 2)
    return Curve(nodes, np.stack([np.tan(0.25 * turn), np.zeros(len(ring))], axis=1).ravel())

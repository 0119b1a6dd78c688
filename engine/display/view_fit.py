"""Fit a 3D view so that points fill the part of it that no bar covers."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from ..arrays import Float

# Blender's constant, millimetres: along its longer side a 3D view shows the length SENSOR / lens on either side of its
# middle, at distance 1.
SENSOR = 36.0
MARGIN = 0.06  # gap on each side of the points, as a share of the free part; larger: smaller objects; by eye
# Smallest free share of a view's width and height that is used; if less is free, objects would be dots, so the whole
# view is used
LEAST_FREE = 0.3
BISECTIONS = 20  # number of bisections for equal gaps on both sides; 10 are exact to a pixel; more: slower


class Rectangle(NamedTuple):
    """Rectangle in a window, pixels."""

    left: float
    bottom: float
    right: float
    top: float


def free_part(view: Rectangle, covers: Iterable[tuple[str, Rectangle]]) -> Rectangle:
    """Return the part of a view that the bars at its sides leave free; the whole view if they leave too little.

    Parameters
    ----------
    view : rectangle of the 3D view
    covers : side to which each bar is attached (LEFT, RIGHT, BOTTOM or TOP; others are ignored), and its rectangle
    """
    left, bottom, right, top = view
    for side, bar in covers:
        wide = min(bar.right, view.right) - max(bar.left, view.left)
        high = min(bar.top, view.top) - max(bar.bottom, view.bottom)
        if wide <= 0 or high <= 0:  # the bar lies beside the view
            continue
        if side == "LEFT":
            left = max(left, bar.right)
        elif side == "RIGHT":
            right = min(right, bar.left)
        elif side == "BOTTOM":
            bottom = max(bottom, bar.top)
        elif side == "TOP":
            top = min(top, bar.bottom)
    share = min((right - left) / (view.right - view.left), (top - bottom) / (view.top - view.bottom))
    return Rectangle(left, bottom, right, top) if share >= LEAST_FREE else view


def place_view(
    points: Float[np.ndarray, "points 3"],
    axes: Float[np.ndarray, "3 3"],
    view: Rectangle,
    free: Rectangle,
    lens: float,
    perspective: bool,
) -> tuple[Float[np.ndarray, " 3"], float]:
    """Return the centre of rotation and the distance of a view in which points just fill its free part.

    In perspective, each side of the free part is a plane through the eye, and the points p must lie between all four.
    Let x run to the right and z towards the eye. For an eye at (x, z) the plane on the right, of slope a, demands ``x +
    a z >= max(p_x + a p_z)``, the plane on the left, of slope b, ``x + b z <= min(p_x + b p_z)``; together they give
    the smallest z. Bisection then finds the x with equal gaps on both sides.

    Parameters
    ----------
    points : the points to be seen, in any unit of length
    axes : rows are the view's directions to the right, upwards and towards the eye
    view, free : rectangles of the 3D view and of its free part
    lens : focal length, millimetres
    perspective : whether the view is in perspective; orthographic otherwise

    Returns
    -------
    location, distance : centre of rotation, in the middle of the view at the mean depth of the points; its distance
        from the eye, in the unit of the points, 0 for a single point
    """
    seen = points @ axes.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    scale = 2.0 * SENSOR / lens / max(view.right - view.left, view.top - view.bottom)  # size of a pixel at distance 1
    middle = np.array([(view.left + view.right) / 2.0, (view.bottom + view.top) / 2.0])
    corners = np.array([[free.left, free.bottom], [free.right, free.top]])
    gap = MARGIN * (corners[1] - corners[0])
    lower, upper = scale * (corners + np.array([gap, -gap]) - middle)
    depth = (low[2] + high[2]) / 2.0
    if not perspective:
        distance = float(((high - low)[:2] / (upper - lower)).max())
        across = (low + high)[:2] / 2.0 - distance * (lower + upper) / 2.0
        return np.append(across, depth) @ axes, distance
    least = (seen[:, :2] + lower * seen[:, 2:]).min(axis=0)
    most = (seen[:, :2] + upper * seen[:, 2:]).max(axis=0)
    eye = float(((most - least) / (upper - lower)).max())
    one, other = most - upper * eye, least - lower * eye  # bounds of the eye's position across the view
    for _ in range(BISECTIONS):
        across = (one + other) / 2.0
        slopes = (seen[:, :2] - across) / np.maximum(eye - seen[:, 2:], 1e-12)
        above = slopes.min(axis=0) + slopes.max(axis=0) > lower + upper
        one, other = np.where(above, across, one), np.where(above, other, across)
    return np.append(across, depth) @ axes, eye - depth

"""Make Blender curves from arrays: round lines through points, and outlines of circular arcs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import bpy
import numpy as np

from ...engine.arrays import Float, Int

if TYPE_CHECKING:
    from ...engine.spirals.curves.arcs import Curve


def make_lines(name: str, polylines: list[Float[np.ndarray, "_ 3"]], radius: float, sides: int = 8) -> bpy.types.Curve:
    """Make a curve of round lines along polylines; a polyline with equal first and last points is closed.

    Parameters
    ----------
    name : name of the curve
    polylines : points of each, (N, 3), metres
    radius : metres
    sides : number of sides of the cross-section, even and at least 4
    """
    curve = bpy.data.curves.new(name, "CURVE")
    curve.dimensions = "3D"
    curve.bevel_depth = radius
    curve.bevel_resolution = sides // 2 - 2
    for points in polylines:
        closed = len(points) > 2 and bool((points[0] == points[-1]).all())
        points = points[:-1] if closed else points
        spline = curve.splines.new("POLY")
        spline.points.add(len(points) - 1)
        spline.points.foreach_set("co", np.c_[points, np.ones(len(points))].astype(np.float32).ravel())
        spline.use_cyclic_u = closed
    return curve


def join_chains(pairs: Int[np.ndarray, "edges 2"]) -> list[Int[np.ndarray, " _"]]:
    """Join edges (vertex pairs) into chains of vertices; chains end at vertices of one, or of more than two edges."""
    import shapely

    ends = np.stack([pairs, np.zeros_like(pairs)], axis=-1)  # use vertex indices as coordinates
    merged = shapely.line_merge(shapely.multilinestrings(shapely.linestrings(ends)))
    return [shapely.get_coordinates(line)[:, 0].astype(int) for line in shapely.get_parts(merged)]


def make_outlines(name: str, curves: Sequence[Curve]) -> bpy.types.Curve:
    """Convert closed curves of circular arcs to Blender's Bezier curves, without thickness."""
    made = bpy.data.curves.new(name, "CURVE")
    made.dimensions = "2D"
    made.fill_mode = "NONE"
    made.resolution_u = 3
    for curve in curves:
        spline = made.splines.new("BEZIER")
        spline.bezier_points.add(len(curve.points) - 1)
        for attribute, values in zip(("co", "handle_left", "handle_right"), to_bezier(curve), strict=True):
            flat = np.c_[values, np.zeros(len(values))].astype(np.float32)
            spline.bezier_points.foreach_set(attribute, flat.ravel())
        spline.use_cyclic_u = True
    return made


def to_bezier(
    curve: Curve,
) -> tuple[Float[np.ndarray, "knots 2"], Float[np.ndarray, "knots 2"], Float[np.ndarray, "knots 2"]]:
    """Return knots, left and right handles of the Bezier curve that approximates a closed curve of circular arcs.

    A 90-degree arc deviates from the circle by 0.03 % of its radius.
    """
    a, b = curve.points, np.roll(curve.points, -1, axis=0)
    # an arc's tangents make half the arc's angle with the chord; handle length = 4/3 tan(angle / 4) radius
    quarter = np.arctan(curve.bulge)
    chord = (b - a)[:, 0] + 1j * (b - a)[:, 1]
    length = np.where(
        np.abs(quarter) > 1e-9, 2.0 * curve.bulge / (3.0 * np.sin(np.where(quarter == 0, 1, 2 * quarter))), 1 / 3
    )
    out = chord * length * np.exp(-2j * quarter)
    into = chord * length * np.exp(2j * quarter)
    right = a + np.stack([out.real, out.imag], axis=1)
    left = np.roll(b - np.stack([into.real, into.imag], axis=1), 1, axis=0)
    return a, left, right

"""Blender curves from arrays: round lines through points, and the exact outlines of arcs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import bpy
import numpy as np

from ...engine.arrays import Float, Int

if TYPE_CHECKING:
    from ...engine.spirals.curves.arcs import Curve


def lines(name: str, polylines: list[Float[np.ndarray, "_ 3"]], radius: float, sides: int = 8) -> bpy.types.Curve:
    """Make a curve of round lines, one a polyline, closed where the first and last point are equal.

    Parameters
    ----------
    name : name of the curve
    polylines : (N, 3) points each, metres
    radius : metres
    sides : sides of the section, an even number of at least 4
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


def chains(pairs: Int[np.ndarray, "edges 2"]) -> list[Int[np.ndarray, " _"]]:
    """Join edges, vertex pairs, into chains of vertices that end where more or fewer than two edges meet."""
    import shapely

    ends = np.stack([pairs, np.zeros_like(pairs)], axis=-1)  # the number of a vertex stands for its place
    merged = shapely.line_merge(shapely.multilinestrings(shapely.linestrings(ends)))
    return [shapely.get_coordinates(line)[:, 0].astype(int) for line in shapely.get_parts(merged)]


def drawing(name: str, curves: Sequence[Curve]) -> bpy.types.Curve:
    """Draw closed curves of arcs as Blender's Bezier curves, without thickness."""
    made = bpy.data.curves.new(name, "CURVE")
    made.dimensions = "2D"
    made.fill_mode = "NONE"
    made.resolution_u = 3
    for curve in curves:
        spline = made.splines.new("BEZIER")
        spline.bezier_points.add(len(curve.points) - 1)
        for attribute, values in zip(("co", "handle_left", "handle_right"), bezier(curve), strict=True):
            flat = np.c_[values, np.zeros(len(values))].astype(np.float32)
            spline.bezier_points.foreach_set(attribute, flat.ravel())
        spline.use_cyclic_u = True
    return made


def bezier(
    curve: Curve,
) -> tuple[Float[np.ndarray, "knots 2"], Float[np.ndarray, "knots 2"], Float[np.ndarray, "knots 2"]]:
    """Return knots, left and right handles of a closed curve of arcs; a 90-degree arc deviates by 0.03 % of its radius."""
    a, b = curve.points, np.roll(curve.points, -1, axis=0)
    # an arc's tangents lean from its chord by half its angle; handle length = 4/3 tan(angle / 4) radius
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

"""Plot of load factor against deflection."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from ... import colours
from ...display.drawing import INK, Dots, Drawing, Line, Text, format_colours, tick_values
from ...display.plots import ACCENT, CURVE, Axes

WIDTH, HEIGHT = 520, 340  # size of the plot, pixels
AXIS_RATIO = 1.06  # ratio of an axis' length to its largest value; larger: more margin
LEGEND_WIDTH = 118.0  # space for the names beside the curves, pixels
MAX_SHOWN_FACTOR = (
    3.0  # largest load factor on the axis, unless the piece snaps at a larger one; larger: the curves look flatter
)


def plot_load_paths(block: Mapping[str, Any]) -> Drawing:
    """Plot the load factor against the deflection of the hub that moves most, one curve per load.

    Dots mark where the piece snaps; a dashed line marks the factor 1.

    Parameters
    ----------
    block : the ``structure`` block of report.json
    """
    outcomes = [one for one in block["outcomes"] if len(one["curve"]) > 1]
    drawing = Drawing("How far the piece gives way as its loads rise", WIDTH, HEIGHT)
    if not outcomes:
        return drawing
    curves = [np.array(one["curve"]) for one in outcomes]
    wide, tall = _axis_ends(outcomes, curves)
    axes = Axes(drawing, (0.0, AXIS_RATIO * wide), (0.0, AXIS_RATIO * tall), right=LEGEND_WIDTH)
    axes.draw_frame("Deflection (mm)", "Factor of the load", tick_values(0.0, wide), tick_values(0.0, tall))
    looks = format_colours(np.clip(colours.patch_colours(len(outcomes)), 0.0, 1.0) ** (1 / 2.2))
    for row, (one, curve, look) in enumerate(zip(outcomes, curves, looks, strict=True)):
        inside = _clip_to_plot(curve, wide, tall)
        points = axes.to_pixels(inside[:, 1], inside[:, 0])
        drawing.add(Line(points, look, 2.2))
        if one["critical"] is not None and one["critical"] <= AXIS_RATIO * tall:
            highest = curve[np.abs(curve[:, 0] - one["critical"]).argmin()]
            if highest[1] <= AXIS_RATIO * wide:
                drawing.add(Dots(axes.to_pixels(highest[[1]], highest[[0]]), 4.5, ACCENT))
        y = axes.top + 12.0 + 18.0 * row
        drawing.add(Line(np.array([[WIDTH - LEGEND_WIDTH + 8, y - 4], [WIDTH - LEGEND_WIDTH + 28, y - 4]]), look, 2.2))
        drawing.add(Text((WIDTH - LEGEND_WIDTH + 34, y), one["name"], 11.5, INK))
    one_load = axes.to_pixels(np.array([0.0, AXIS_RATIO * wide]), np.array([1.0, 1.0]))
    drawing.add(Line(one_load, CURVE, 1.2, 4.0))
    return drawing


def _axis_ends(outcomes: Sequence[Mapping[str, Any]], curves: Sequence[np.ndarray]) -> tuple[float, float]:
    """Return the ends of the axes: largest deflection, mm, and largest factor.

    The axis of factors includes 1 and the critical factors, but ends at ``MAX_SHOWN_FACTOR`` or, if that is larger, at
    the lowest critical factor.
    """
    highest = [one["critical"] for one in outcomes if one["critical"] is not None]
    tall = min(
        max([1.2, *(1.1 * value for value in highest)]),
        MAX_SHOWN_FACTOR * 1.0 if not highest else max(MAX_SHOWN_FACTOR, min(highest)),
    )
    at_load = [float(np.interp(min(tall, c[:, 0].max()), *_up_to_peak(c))) for c in curves]
    return max(*at_load, 1e-6, 0.0) * 1.5, tall


def _up_to_peak(curve: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the factors and deflections of a curve up to its largest factor."""
    part = curve[: 1 + int(curve[:, 0].argmax())]
    return part[:, 0], part[:, 1]


def _clip_to_plot(curve: np.ndarray, wide: float, tall: float) -> np.ndarray:
    """Return the curve (load factor, deflection) up to the point where it leaves the plot.

    wide, tall : deflection and load factor at the ends of the axes, before the margin ``AXIS_RATIO``
    """
    out = [curve[0]]
    for before, after in pairwise(curve):
        share = 1.0
        for value, step, end in (
            (after[1], after[1] - before[1], AXIS_RATIO * wide),
            (after[0], after[0] - before[0], AXIS_RATIO * tall),
        ):
            if value > end:
                share = min(share, 1.0 - (value - end) / max(step, 1e-300))
        share = min(share, before[1] / max(before[1] - after[1], 1e-300)) if after[1] < 0.0 else share
        out.append(before + max(share, 0.0) * (after - before))
        if share < 1.0:
            break
    return np.array(out)

"""Plots of a run: progress of the optimisation, distribution of errors, maps of the flat patches and of the shape."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .. import colours
from ..arrays import Float, Int
from .drawing import (
    GREY,
    GRID,
    INK,
    Dots,
    Drawing,
    FilledShapes,
    Line,
    Strokes,
    Text,
    colour_bar,
    colour_by_scale,
    colour_key,
    format_tick,
    log_tick_values,
    parse_colour,
    tick_values,
)

CURVE, ACCENT = "#2e8599", "#d9622b"
LIGHT_CURVE, PALE = "#fab840", "#9e9e9e"  # colours of curves and axes that are readable on dark and on light paper
LOG_RATIO = 8.0  # ratio of largest to smallest value above which a scale is logarithmic; chosen by eye
WIDTH, HEIGHT = 520, 320  # size of a plot, pixels
VIEW_DIRECTION = np.array([0.9, -1.0, 0.85])  # direction from the surface to the viewer in ``draw_shape_map``


@dataclass(frozen=True, eq=False)
class Axes:
    """Axes of a plot: map values to pixels, and draw ticks, grid, names and units.

    x, y : smallest and largest value on each axis
    left, right, top, bottom : margins, pixels
    is_logarithmic : whether the y axis is logarithmic
    """

    drawing: Drawing
    x: tuple[float, float]
    y: tuple[float, float]
    left: float = 74.0
    right: float = 20.0
    top: float = 44.0
    bottom: float = 52.0
    is_logarithmic: bool = False

    def to_pixels(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Map values to pixels.

        Parameters
        ----------
        x, y : (n,) values

        Returns
        -------
        (n, 2) pixels
        """
        low, high = self.y
        if self.is_logarithmic:
            share = np.log(np.asarray(y) / low) / np.log(high / low)
        else:
            share = (np.asarray(y, dtype=float) - low) / (high - low)
        across = (np.asarray(x, dtype=float) - self.x[0]) / max(self.x[1] - self.x[0], 1e-30)
        wide = self.drawing.width - self.left - self.right
        tall = self.drawing.height - self.top - self.bottom
        return np.stack([self.left + wide * across, self.top + tall * (1.0 - share)], axis=-1)

    def draw_frame(self, x_name: str, y_name: str, x_ticks: Sequence[float], y_ticks: Sequence[float]) -> None:
        """Draw title, grid, ticks and names, before the curves.

        Parameters
        ----------
        x_name, y_name : names of the axes, with units
        x_ticks, y_ticks : values of the ticks
        """
        d = self.drawing
        base, end = d.height - self.bottom, d.width - self.right
        d.add(Text((self.left, 22), d.title, 14, INK, is_bold=True))
        for value in y_ticks:
            y = float(self.to_pixels(np.array(self.x[0]), np.array(value))[1])
            d.add(
                Line(np.array([[self.left, y], [end, y]]), GRID),
                Text((self.left - 8, y + 4), format_tick(value), 11.5, anchor="end"),
            )
        d.add(Line(np.array([[self.left, base], [end, base]]), GREY))
        for value in x_ticks:
            x = float(self.to_pixels(np.array(value), np.array(self.y[0]))[0])
            d.add(
                Line(np.array([[x, base], [x, base + 4]]), GREY),
                Text((x, base + 18), format_tick(value), 11.5, anchor="middle"),
            )
        d.add(Text((0.5 * (self.left + end), d.height - 12), x_name, 12, anchor="middle"))
        d.add(Text((16, 0.5 * (self.top + base)), y_name, 12, anchor="middle", is_vertical=True))


def plot_history(values: Sequence[float], title: str, name: str) -> Drawing:
    """Plot a quantity over the steps of a run.

    The scale begins at zero, or is logarithmic if the values span a wide range.

    Parameters
    ----------
    values : value at the start and after every step; values that are not finite are dropped
    title, name : title of the plot; name of the quantity, with its unit
    """
    found = np.asarray([v for v in values if np.isfinite(v)], dtype=float)
    drawing = Drawing(title, WIDTH, HEIGHT)
    span, logarithmic = _value_range(found)
    axes = Axes(drawing, (0.0, max(len(found) - 1.0, 1.0)), span, is_logarithmic=logarithmic)
    marks = log_tick_values(*span) if logarithmic else tick_values(*span)
    steps = [t for t in tick_values(0.0, max(len(found) - 1.0, 1.0), 8) if t == round(t)]
    axes.draw_frame("Step", name, steps, marks)
    points = axes.to_pixels(np.arange(len(found)), found)
    drawing.add(Line(points, CURVE, 2.2), Dots(points[1:-1], 2.4, CURVE), Dots(points[[0, -1]], 4.0, ACCENT))
    drawing.add(Text((float(points[0, 0]) + 9, float(points[0, 1]) - 5), f"{found[0]:.3g}", 11.5, INK))
    if len(found) > 1:
        end = points[-1]
        drawing.add(Text((float(end[0]) - 2, float(end[1]) - 9), f"{found[-1]:.3g}", 11.5, INK, "end"))
    return drawing


def _value_range(values: Float[np.ndarray, " steps"]) -> tuple[tuple[float, float], bool]:
    """Return the ends of a scale for values, and whether it should be logarithmic."""
    low, high = float(values.min()), float(values.max())
    if low > 0.0 and high > LOG_RATIO * low:
        return (low / 1.15, high * 1.15), True
    return (0.0, 1.08 * high if high > 0.0 else 1.0), False


def draw_sparkline(values: Sequence[float], size: float) -> Drawing:
    """Draw the curve of ``plot_history`` without text, readable on dark and on light backgrounds.

    Parameters
    ----------
    values : one value per step; only positive, finite values are drawn
    size : side of the square picture, pixels
    """
    drawing, margin = Drawing("", size, size), 0.05 * size
    low, high = 0.7 * margin, size - 0.7 * margin
    drawing.add(Line(np.array([[low, low], [low, high], [high, high]]), PALE))
    found = np.asarray([v for v in values if np.isfinite(v) and v > 0.0], dtype=float)
    if not len(found):
        return drawing
    span, logarithmic = _value_range(found)
    ends = (0.0, max(len(found) - 1.0, 1.0))
    axes = Axes(drawing, ends, span, margin, margin, margin, margin, logarithmic)
    points = axes.to_pixels(np.arange(len(found)), found)
    base = points * [1.0, 0.0] + [0.0, size - margin]
    below = np.stack([points[:-1], points[1:], base[1:], base[:-1]], axis=1)
    drawing.add(FilledShapes(below, np.tile(parse_colour(LIGHT_CURVE), (len(below), 1)), 0.18))
    drawing.add(Line(points, LIGHT_CURVE, 3.0), Dots(points[1:-1], 1.5, LIGHT_CURVE))
    drawing.add(Dots(points[-1:], 4.5, LIGHT_CURVE))
    return drawing


def plot_histogram(
    values: np.ndarray,
    title: str,
    name: str,
    marks: Sequence[tuple[float, str]] = (),
) -> Drawing:
    """Plot how many spirals have which value.

    Parameters
    ----------
    values : one value per spiral
    title, name : title of the plot; name of the quantity, with its unit
    marks : values to mark with a line, and their names, e.g. the root mean square
    """
    values = np.asarray(values, dtype=float)
    drawing = Drawing(title, WIDTH, HEIGHT)
    high = max(float(values.max()), *(v for v, _ in marks), 1e-9) * 1.02
    counts, edges = np.histogram(values, bins=28, range=(0.0, high))
    axes = Axes(drawing, (0.0, high), (0.0, 1.12 * max(counts.max(), 1)), top=58.0)
    whole = [t for t in tick_values(0.0, 1.1 * counts.max(), 4) if t == round(t)]
    axes.draw_frame(name, "Spirals", tick_values(0.0, high, 6), whole)
    gap = 0.08 * (edges[1] - edges[0])
    boxes = []
    for count, a, b in zip(counts.tolist(), edges[:-1], edges[1:]):
        if count:
            boxes.append(axes.to_pixels(np.array([a + gap, b - gap, b - gap, a + gap]), np.array([0, 0, count, count])))
    drawing.add(FilledShapes(np.array(boxes), np.tile(parse_colour(CURVE), (len(boxes), 1))))
    for value, text in marks:
        x = float(axes.to_pixels(np.array(value), np.array(0.0))[0])
        y = axes.top - 4
        drawing.add(Line(np.array([[x, y], [x, HEIGHT - axes.bottom]]), ACCENT, 1.4, 4.0))
        anchor = "end" if x > 0.75 * WIDTH else "start"
        drawing.add(Text((x, y - 4), text, 11.5, ACCENT, anchor))
    return drawing


def plot_bars(rows: Sequence[tuple[str, float]], title: str, unit: str, width: float = 520) -> Drawing:
    """Plot named amounts as horizontal bars.

    Parameters
    ----------
    rows : names and amounts
    title, unit : title of the plot; unit of the amounts
    width : width of the plot, pixels
    """
    drawing = Drawing(title, width, 44 + 24 * len(rows) + 8)
    drawing.add(Text((16, 22), title, 14, INK, is_bold=True))
    left, right = 110.0, 70.0
    largest = max((v for _, v in rows), default=0.0) or 1.0
    for k, (name, value) in enumerate(rows):
        y = 44.0 + 24 * k
        long = (width - left - right) * value / largest
        box = np.array([[[left, y], [left + long, y], [left + long, y + 14], [left, y + 14]]])
        drawing.add(FilledShapes(box, parse_colour(CURVE)[None]))
        drawing.add(Text((left - 8, y + 11.5), name, 12, anchor="end"))
        drawing.add(Text((left + long + 6, y + 11.5), f"{value:.3g} {unit}", 11.5))
    return drawing


# -- maps --------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Colouring:
    """Colours of a map's quads, and their key, which is a colour scale or a list of entries.

    fills : (F, 3) sRGB
    unit, scale, low, high : unit, colours (n, 3) and end values of the scale; no scale if None
    rows : colour "#rrggbb" and text of each entry
    """

    title: str
    fills: np.ndarray
    unit: str = ""
    scale: np.ndarray | None = None
    low: float = 0.0
    high: float = 1.0
    rows: tuple[tuple[str, str], ...] = ()

    @classmethod
    def from_values(
        cls, title: str, values: np.ndarray, unit: str, scale: np.ndarray, low: float, high: float
    ) -> Colouring:
        """Colour values by a scale.

        Parameters
        ----------
        title, unit : title of the map; unit of the values
        values : (F,) values of the quads
        scale : (n, 3) sRGB colours, evenly spaced from ``low`` to ``high``
        low, high : values at the ends of the scale
        """
        return cls(title, colour_by_scale(values, low, high, scale), unit, scale, low, high)


def draw_flat_map(corners: np.ndarray, sides: np.ndarray, colouring: Colouring) -> Drawing:
    """Draw the flat patches from above.

    Parameters
    ----------
    corners : (F, 4, 2) corners of the quads, y up, in any unit
    sides : (F, 4) mask of the sides that are drawn as outlines
    colouring : colours of the quads
    """
    drawing, placed = _fit_to_page(corners * np.array([1.0, -1.0]), colouring)
    order = np.lexsort(colouring.fills.T)  # group equal colours; the order is free, as no quad covers another
    drawing.add(FilledShapes(placed[order], colouring.fills[order]))
    return _add_key(drawing, placed, sides, colouring)


def draw_shape_map(vertices: np.ndarray, quads: np.ndarray, sides: np.ndarray, colouring: Colouring) -> Drawing:
    """Draw a surface in space with soft shading, in parallel projection obliquely from above.

    Parameters
    ----------
    vertices, quads : (V, 3) positions in any unit; (F, 4) vertex indices
    sides : (F, 4) mask of the sides that are drawn as lines
    colouring : colours of the quads
    """
    eye = VIEW_DIRECTION / np.linalg.norm(VIEW_DIRECTION)
    right = np.cross([0.0, 0.0, 1.0], eye)
    right /= np.linalg.norm(right)
    up = np.cross(eye, right)
    corners = vertices[quads]
    points = np.stack([corners @ right, -(corners @ up)], axis=-1)
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    facing = np.where(normal @ eye < 0.0, -1.0, 1.0)
    lit = 0.80 + 0.20 * (facing[:, None] * normal) @ colours.LIGHT
    order = np.argsort(corners.mean(axis=1) @ eye)
    drawing, placed = _fit_to_page(points, colouring)
    shades = np.clip(colouring.fills * lit[:, None], 0.0, 1.0)
    # draw far quads first, and the lines of a quad before quads that cover it
    for chunk in np.array_split(order, min(len(order), 24)):
        drawing.add(FilledShapes(placed[chunk], shades[chunk]))
        drawing.add(_outlines(placed[chunk], sides[chunk]))
    return _add_key(drawing, placed[:0], sides[:0], colouring)


def _fit_to_page(points: Float[np.ndarray, "quads 4 2"], colouring: Colouring) -> tuple[Drawing, np.ndarray]:
    """Return an empty drawing of the height that a map and its key need, and the map's points scaled to its pixels."""
    low, high = points.reshape(-1, 2).min(axis=0), points.reshape(-1, 2).max(axis=0)
    size, room = np.maximum(high - low, 1e-30), WIDTH - 32 - _key_width(colouring)
    factor = min(room / size[0], 0.8 * WIDTH / size[1])
    height = max(float(factor * size[1]), 120.0)
    drawing = Drawing(colouring.title, WIDTH, height + 60 + _key_height(colouring))
    spare = 0.5 * (np.array([room, height]) - factor * size)
    return drawing, (points - low) * factor + spare + np.array([16.0, 44.0])


def patch_fills(patch: Int[np.ndarray, " quads"]) -> Float[np.ndarray, "quads 3"]:
    """Return the colours (F, 3) sRGB of quads by their patch."""
    looks = colours.to_hexadecimal(colours.patch_colours(int(patch.max()) + 1))
    return np.array([parse_colour(name) for name in looks])[patch]


def draw_thumbnail(
    vertices: np.ndarray, quads: np.ndarray, sides: np.ndarray, patch: Int[np.ndarray, " quads"], size: float
) -> Drawing:
    """Draw coloured patches like ``draw_shape_map``, without text.

    Parameters
    ----------
    vertices, quads, sides : see ``draw_shape_map``
    patch : patch of every quad
    size : side of the square picture, pixels
    """
    large = draw_shape_map(vertices, quads, sides, Colouring("", patch_fills(patch)))
    body = [item for item in large.items if not isinstance(item, Text)]
    shown = np.concatenate([item.points.reshape(-1, 2) for item in body if isinstance(item, FilledShapes)])
    low, high = shown.min(axis=0), shown.max(axis=0)
    factor = 0.94 * size / max(float((high - low).max()), 1e-30)
    shift = 0.5 * (size - factor * (high + low))
    drawing = Drawing("", size, size)
    for item in body:
        if isinstance(item, FilledShapes):
            drawing.add(FilledShapes(item.points * factor + shift, item.fills))
        elif isinstance(item, Strokes):
            drawing.add(Strokes(item.ends * factor + shift, item.colour, item.width))
    return drawing


def plot_proposals(rows: Sequence[tuple[float, float, str]], chosen: int) -> Drawing:
    """Plot the proposals by number of joints and distance, with their names; highlight the chosen proposal.

    Parameters
    ----------
    rows : number of joints, RMS distance in per cent, and name of each proposal
    chosen : index of the chosen proposal
    """
    drawing = Drawing("Layouts that were compared", WIDTH, HEIGHT)
    joints, rms = np.array([row[0] for row in rows], dtype=float), np.array([row[1] for row in rows], dtype=float)
    span, logarithmic = _value_range(rms)
    axes = Axes(drawing, (0.0, 1.12 * max(float(joints.max()), 1.0)), span, is_logarithmic=logarithmic)
    rms_ticks = log_tick_values(*span) if logarithmic else tick_values(*span)
    axes.draw_frame("Joints", "RMS distance (%)", tick_values(*axes.x), rms_ticks)
    points = axes.to_pixels(joints, rms)
    drawing.add(Dots(points, 4.0, CURVE), Dots(points[[chosen]], 6.0, ACCENT))
    for point, (_, _, name) in zip(points, rows, strict=True):
        drawing.add(Text((float(point[0]) + 8, float(point[1]) - 6), name, 11.5, INK))
    return drawing


def _key_width(colouring: Colouring) -> float:
    """Return the width of the colour scale at the right, pixels."""
    return 84.0 if colouring.scale is not None else 0.0


def _key_height(colouring: Colouring) -> float:
    """Return the height of the key's entries at the bottom, pixels."""
    return 20.0 * ((len(colouring.rows) + 1) // 2)


def _outlines(placed: np.ndarray, sides: np.ndarray) -> Strokes:
    """Return lines along the masked sides of quads."""
    return Strokes(np.stack([placed[sides], np.roll(placed, -1, axis=1)[sides]], axis=1), INK, 0.9)


def _add_key(drawing: Drawing, placed: np.ndarray, sides: np.ndarray, colouring: Colouring) -> Drawing:
    """Add outlines, title and key to a map."""
    drawing.add(_outlines(placed, sides))
    drawing.add(Text((16, 22), colouring.title, 14, INK, is_bold=True))
    if colouring.scale is not None:
        tall = min(drawing.height - 90, 220.0)
        at = (drawing.width - _key_width(colouring) + 14, 62.0)
        drawing.add(*colour_bar(at, (14, tall), colouring.scale, colouring.low, colouring.high, colouring.unit))
    drawing.add(*colour_key((16, drawing.height - _key_height(colouring) - 4), colouring.rows))
    return drawing

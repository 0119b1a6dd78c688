"""Drawings of plots and maps: lists of shapes, written as SVG here and rendered to pixels in ``raster.py``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from itertools import pairwise

import numpy as np

from .. import MARK, colours
from ..arrays import Float
from ..tolerances import SINGLE_TOL

INK, GREY, GRID, PAPER = "#262b33", "#6b7280", "#e4e7eb", "#ffffff"
FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"
# Number of shades of a colour scale. Smaller: smaller SVG files, as shapes of equal colour become one path.
SHADES = 96
SEAM_WIDTH = 0.5  # width of the outline of filled shapes, pixels, which closes hairlines between neighbours


@dataclass(frozen=True, eq=False)
class FilledShapes:
    """Convex filled shapes, drawn in their order.

    points : corners, pixels
    fills : colours, sRGB in [0, 1]
    opacity : opacity of every shape
    """

    points: Float[np.ndarray, "shapes corners 2"]
    fills: Float[np.ndarray, "shapes 3"]
    opacity: float = 1.0


@dataclass(frozen=True, eq=False)
class Line:
    """A polyline through points (n, 2); lengths in pixels. ``dash`` is the length of dashes, 0 for a solid line."""

    points: np.ndarray
    colour: str = INK
    width: float = 1.0
    dash: float = 0.0


@dataclass(frozen=True, eq=False)
class Strokes:
    """Many straight lines of one colour and width, given by their ends (N, 2, 2); lengths in pixels."""

    ends: np.ndarray
    colour: str = INK
    width: float = 1.0


@dataclass(frozen=True, eq=False)
class Dots:
    """Filled circles of one radius and colour, with centres (n, 2); lengths in pixels."""

    points: np.ndarray
    radius: float
    colour: str = INK


@dataclass(frozen=True)
class Text:
    """A line of text.

    position : point on the baseline, pixels
    size : font size, pixels
    anchor : part of the text at that point: "start", "middle" or "end"
    is_vertical : whether the text is rotated to read upwards
    """

    position: tuple[float, float]
    text: str
    size: float = 12.0
    colour: str = GREY
    anchor: str = "start"
    is_bold: bool = False
    is_vertical: bool = False


Item = FilledShapes | Line | Strokes | Dots | Text


@dataclass(frozen=True, eq=False)
class Drawing:
    """A picture of ``width`` by ``height`` pixels, x to the right and y down."""

    title: str
    width: float
    height: float
    items: list[Item] = field(default_factory=list)

    def add(self, *items: Item) -> None:
        """Append items; later items cover earlier items."""
        self.items.extend(items)


def parse_colour(colour: str) -> np.ndarray:
    """Return the sRGB components (3,), in [0, 1], of a colour "#rrggbb"."""
    return np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0


def to_svg(drawing: Drawing) -> str:
    """Return the drawing as a self-contained SVG document, which may also be placed in a web page."""
    w, h = f"{drawing.width:g}", f"{drawing.height:g}"
    title = escape(drawing.title)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {w} {h}" width="{w}" height="{h}" role="img"'
        f' aria-label="{title}" font-family="{FONT}"><title>{title}</title><metadata>{MARK}</metadata>'
    ]
    for item in drawing.items:
        lines += _item_svg(item)
    return "\n".join([*lines, "</svg>"]) + "\n"


def _item_svg(item: Item) -> list[str]:
    """Return the SVG elements of an item."""
    if isinstance(item, FilledShapes):
        return _shapes_svg(item)
    if isinstance(item, Strokes):
        if not len(item.ends):
            return []
        path = "".join(_path_data(pair) for pair in item.ends)
        width = f"{item.width:g}"
        return [f'<path d="{path}" fill="none" stroke="{item.colour}" stroke-width="{width}" stroke-linecap="round"/>']
    if isinstance(item, Line):
        dash = f' stroke-dasharray="{item.dash:g}"' if item.dash else ""
        return [
            f'<path d="{_path_data(item.points)}" fill="none" stroke="{item.colour}" stroke-width="{item.width:g}"'
            f' stroke-linejoin="round" stroke-linecap="round"{dash}/>'
        ]
    if isinstance(item, Dots):
        return [f'<circle cx="{x:.2f}" cy="{y:.2f}" r="{item.radius:g}" fill="{item.colour}"/>' for x, y in item.points]
    x, y = item.position
    turn = f' transform="rotate(-90 {x:.2f} {y:.2f})"' if item.is_vertical else ""
    weight = ' font-weight="600"' if item.is_bold else ""
    return [
        f'<text x="{x:.2f}" y="{y:.2f}" font-size="{item.size:g}" fill="{item.colour}" text-anchor="{item.anchor}"'
        f"{weight}{turn}>{escape(item.text)}</text>"
    ]


def _shapes_svg(item: FilledShapes) -> list[str]:
    """Return the SVG paths of shapes; consecutive shapes of equal colour share a path."""
    names = format_colours(item.fills)
    veil = f' opacity="{item.opacity:g}"' if item.opacity < 1.0 else ""
    lines, k = [], 0
    while k < len(names):
        end = k + 1
        while end < len(names) and names[end] == names[k]:
            end += 1
        path = "".join(_path_data(p) + "Z" for p in item.points[k:end])
        lines.append(
            f'<path d="{path}" fill="{names[k]}" stroke="{names[k]}" stroke-width="{SEAM_WIDTH:g}" stroke-linejoin="round"{veil}/>'
        )
        k = end
    return lines


def _path_data(points: np.ndarray) -> str:
    """Return SVG path data of a polyline."""
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in np.asarray(points).tolist())


def format_colours(srgb: np.ndarray) -> list[str]:
    """Return colours (N, 3), sRGB in [0, 1], as "#rrggbb"."""
    return [f"#{r:02x}{g:02x}{b:02x}" for r, g, b in np.round(255 * np.clip(srgb, 0, 1)).astype(int).tolist()]


def colour_by_scale(values: np.ndarray, low: float, high: float, scale: np.ndarray) -> np.ndarray:
    """Map values to colours on a scale of ``SHADES`` shades.

    Parameters
    ----------
    values : (N,) values
    low, high : values at the ends of the scale
    scale : (n, 3) sRGB colours, evenly spaced along the scale

    Returns
    -------
    (N, 3) sRGB
    """
    span = high - low
    share = np.clip((np.asarray(values, dtype=float) - low) / span, 0.0, 1.0) if span > 0 else np.zeros(len(values))
    share = np.round(share * (SHADES - 1)) / (SHADES - 1)
    return colours.interpolate_scale(share, scale)


def tick_values(low: float, high: float, count: int = 5) -> list[float]:
    """Return about ``count`` tick values between low and high: multiples of 1, 2 or 5 times a power of ten.

    Parameters
    ----------
    low, high : ends of the axis
    count : wanted number of ticks
    """
    span = high - low
    if not np.isfinite(span) or span <= 0:
        return [float(low)]
    raw = span / count
    power = 10.0 ** np.floor(np.log10(raw))
    step = power * next((m for m in (1, 2, 5) if m * power >= raw * 0.999), 10)
    first = np.ceil(low / step - SINGLE_TOL)
    return [float(k * step) + 0.0 for k in np.arange(first, np.floor(high / step + SINGLE_TOL) + 1)]


def log_tick_values(low: float, high: float) -> list[float]:
    """Return tick values of a logarithmic axis: powers of ten, and multiples of these if there are fewer than three.

    Parameters
    ----------
    low, high : ends of the axis, above 0
    """
    powers = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    for factors in ((1,), (1, 2, 5), (1, 1.5, 2, 3, 5, 7)):
        found = sorted(f * p for p in powers.tolist() for f in factors if low * 0.999 <= f * p <= high * 1.001)
        if len(found) >= 3:
            return found
    return tick_values(low, high, 4)


def format_tick(value: float) -> str:
    """Format a tick value with no more digits than needed."""
    return f"{value:.6g}" if abs(value) < 1e5 else f"{value:.1e}"


def colour_bar(
    at: tuple[float, float], size: tuple[float, float], scale: np.ndarray, low: float, high: float, unit: str
) -> list[Item]:
    """Return an upright colour bar with ticks at its right and the unit above.

    Parameters
    ----------
    at, size : upper left corner; width and height; pixels
    scale : (n, 3) sRGB colours, evenly spaced from bottom to top
    low, high, unit : values at the ends; their unit
    """
    (x, y), (width, height) = at, size
    share = np.linspace(1.0, 0.0, SHADES + 1)
    edges = y + height * np.linspace(0.0, 1.0, SHADES + 1)
    boxes = np.array([[[x, a], [x + width, a], [x + width, b], [x, b]] for a, b in pairwise(edges)])
    items: list[Item] = [FilledShapes(boxes, colour_by_scale(share[1:], 0.0, 1.0, scale))]
    if unit:
        items.append(Text((x - 4, y - 10), unit, 12))
    if high <= low:
        return [*items, Text((x + width + 8, y + height), format_tick(low), 11.5)]
    for value in tick_values(low, high, 5):
        place = y + height * (1.0 - (value - low) / (high - low))
        items.append(Line(np.array([[x + width, place], [x + width + 4, place]]), GREY))
        items.append(Text((x + width + 8, place + 4), format_tick(value), 11.5))
    return items


def colour_key(
    at: tuple[float, float], rows: Sequence[tuple[str, str]], columns: int = 2, wide: float = 240
) -> list[Item]:
    """Return a colour key: a coloured square and a text for each entry, row by row.

    Parameters
    ----------
    at : upper left corner, pixels
    rows : colour "#rrggbb" and text of each entry
    columns, wide : number of columns; width of a column, pixels
    """
    items: list[Item] = []
    for k, (colour, text) in enumerate(rows):
        x, y = at[0] + wide * (k % columns), at[1] + 20 * (k // columns)
        box = np.array([[[x, y], [x + 12, y], [x + 12, y + 12], [x, y + 12]]])
        items += [FilledShapes(box, parse_colour(colour)[None]), Text((x + 18, y + 10.5), text, 11.5)]
    return items

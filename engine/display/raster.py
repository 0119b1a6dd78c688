"""Render drawings to pixels with numpy; letters are triangulated glyphs of any font."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..arrays import Float
from .drawing import PAPER, SEAM_WIDTH, Dots, Drawing, FilledShapes, Item, Line, Strokes, Text, parse_colour

PIXEL_SCALE = 2  # pixels of the picture per pixel of the drawing; larger: letters stay sharp when enlarged, slower
SUBPIXELS = 2  # subpixels per pixel in both directions, for antialiasing; larger: smoother edges, slower
MISSING_GLYPH = "?"  # replaces letters without a glyph

# a dot is drawn as a polygon with 24 corners, which deviates from a circle of 9 pixels by 0.04 pixels
_ANGLES = np.linspace(0.0, 2 * np.pi, 24, endpoint=False)
_CIRCLE = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)  # corners of a dot of radius 1

Glyphs = dict[str, tuple[np.ndarray, float]]  # triangles (N, 3, 2) of every letter at size 1, and its advance


def render_drawing(drawing: Drawing, glyphs: Glyphs, paper: str | None = PAPER) -> Float[np.ndarray, "rows columns 4"]:
    """Render a drawing to sRGB with premultiplied alpha, in [0, 1], the top row first.

    Any thread can call this function, as it does not use Blender.

    Parameters
    ----------
    drawing : drawing to render
    glyphs : glyphs of a font
    paper : background colour "#rrggbb"; None for a transparent background
    """
    factor = PIXEL_SCALE * SUBPIXELS
    rows, columns = round(drawing.height * PIXEL_SCALE), round(drawing.width * PIXEL_SCALE)
    canvas = np.zeros((rows * SUBPIXELS, columns * SUBPIXELS, 4), np.float32)
    if paper is not None:
        canvas[:] = _opaque_colour(paper)
    for item in drawing.items:
        for points, colour in _polygons(item, glyphs):
            _fill_polygon(canvas, points * factor, colour)
    return canvas.reshape(rows, SUBPIXELS, columns, SUBPIXELS, 4).mean(axis=(1, 3))


def _opaque_colour(colour: str) -> Float[np.ndarray, " 4"]:
    """Return a colour "#rrggbb" as sRGB with alpha 1."""
    return np.append(parse_colour(colour), 1.0)


def _polygons(item: Item, letters: Glyphs) -> Iterable[tuple[np.ndarray, np.ndarray]]:
    """Return convex polygons (n, 2), in pixels of the drawing, with their premultiplied colours (4,)."""
    if isinstance(item, FilledShapes):
        middle = item.points.mean(axis=1, keepdims=True)
        apart = item.points - middle
        distance = np.linalg.norm(apart, axis=2, keepdims=True)
        grown = middle + apart * (1.0 + 0.5 * SEAM_WIDTH / np.maximum(distance, SEAM_WIDTH))
        return zip(grown, item.opacity * np.c_[item.fills, np.ones(len(item.fills))])
    colour = _opaque_colour(item.colour)
    if isinstance(item, Text):
        return ((triangle, colour) for triangle in _text_triangles(item, letters))
    if isinstance(item, Dots):
        return ((centre + item.radius * _CIRCLE, colour) for centre in item.points)
    lines = item.ends if isinstance(item, Strokes) else _dashes(item)
    return ((_line_rectangle(a, b, item.width), colour) for a, b in lines)


def _text_triangles(item: Text, letters: Glyphs) -> np.ndarray:
    """Return the triangles of a text at its position, in pixels of the drawing."""
    parts, length = [np.zeros((0, 3, 2))], 0.0
    for letter in item.text:
        shape, width = letters[letter if letter in letters else MISSING_GLYPH]
        parts.append(shape + np.array([length, 0.0]))
        length += width
    triangles = np.concatenate(parts)
    size = 1.05 * item.size  # the factor converts the height of letters to the size of the font
    shift = {"start": 0.0, "middle": 0.5, "end": 1.0}[item.anchor] * length
    x, y = size * (triangles[..., 0] - shift), -size * triangles[..., 1]
    if item.is_vertical:
        x, y = y, -x
    placed = np.stack([x, y], axis=-1) + np.array(item.position)
    if item.is_bold:
        return np.concatenate([placed, placed + np.array([0.45, 0.0])])
    return placed


def _line_rectangle(a: np.ndarray, b: np.ndarray, width: float) -> np.ndarray:
    """Return a straight line from a to b as a rectangle, longer by half the width at both ends."""
    along = (b - a) / max(float(np.linalg.norm(b - a)), 1e-12) * 0.5 * width
    across = np.array([-along[1], along[0]])
    return np.array([a - along + across, a - along - across, b + along - across, b + along + across])


def _dashes(item: Line) -> Iterable[tuple[np.ndarray, np.ndarray]]:
    """Yield the ends of a polyline's segments, or of its dashes."""
    for a, b in zip(item.points[:-1], item.points[1:]):
        if not item.dash:
            yield a, b
            continue
        count = max(int(np.linalg.norm(b - a) / (2 * item.dash)), 1)
        for k in range(count):
            yield a + (b - a) * k / count, a + (b - a) * (k + 0.5) / count


def _fill_polygon(canvas: np.ndarray, points: np.ndarray, colour: np.ndarray) -> None:
    """Paint a convex polygon (n, 2), in pixels of the canvas, in place."""
    height, width = canvas.shape[:2]
    low = np.maximum(np.floor(points.min(axis=0)).astype(int), 0)
    high = np.minimum(np.ceil(points.max(axis=0)).astype(int) + 1, [width, height])
    if (high <= low).any():
        return
    x = np.arange(low[0], high[0]) + 0.5
    y = (np.arange(low[1], high[1]) + 0.5)[:, None]
    ring: list[list[float]] = points.tolist()
    sides = list(zip(ring, ring[1:] + ring[:1]))
    sign = 1.0 if sum(px * qy - py * qx for (px, py), (qx, qy) in sides) >= 0.0 else -1.0
    inside = np.ones((len(y), len(x)), bool)
    for (px, py), (qx, qy) in sides:
        inside &= sign * (qx - px) * (y - py) >= sign * (qy - py) * (x - px)
    canvas[low[1] : high[1], low[0] : high[0]][inside] = colour

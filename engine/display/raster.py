"""Drawings as pixels: shapes are filled by numpy, letters come as triangles of any font."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..arrays import Float
from .drawing import PAPER, SEAM, Dots, Drawing, Item, Line, Shapes, Strokes, Text, rgb

SCALE = 2  # pixels of the picture for one of the drawing, so that letters of 11 pixels can be read when enlarged
FINE = 2  # smaller ones, both ways, for one of the picture: soft edges
UNKNOWN = "?"  # stands for a letter that is not among the given ones

_ANGLES = np.linspace(0.0, 2 * np.pi, 24, endpoint=False)  # 24 corners: a dot of 9 pixels strays by 0.04 of them
_CIRCLE = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)  # the corners of a dot of radius 1

Glyphs = dict[str, tuple[np.ndarray, float]]  # of every letter its triangles (N, 3, 2) at size 1 and how far it goes


def pixels(drawing: Drawing, letters: Glyphs, paper: str | None = PAPER) -> Float[np.ndarray, "rows columns 4"]:
    """sRGB with alpha in [0, 1], premultiplied, the uppermost row first; ``None`` for transparent paper.

    Needs no Blender, so any thread can.
    """
    factor = SCALE * FINE
    rows, columns = round(drawing.height * SCALE), round(drawing.width * SCALE)
    canvas = np.zeros((rows * FINE, columns * FINE, 4), np.float32)
    if paper is not None:
        canvas[:] = _opaque(paper)
    for item in drawing.items:
        for points, colour in _polygons(item, letters):
            _fill(canvas, points * factor, colour)
    return canvas.reshape(rows, FINE, columns, FINE, 4).mean(axis=(1, 3))


def _opaque(colour: str) -> Float[np.ndarray, " 4"]:
    return np.append(rgb(colour), 1.0)


def _polygons(item: Item, letters: Glyphs) -> Iterable[tuple[np.ndarray, np.ndarray]]:
    """Convex polygons (n, 2), pixels of the drawing, with their colours (4,), sRGB with alpha, premultiplied."""
    if isinstance(item, Shapes):
        middle = item.points.mean(axis=1, keepdims=True)
        apart = item.points - middle
        distance = np.linalg.norm(apart, axis=2, keepdims=True)
        grown = middle + apart * (1.0 + 0.5 * SEAM / np.maximum(distance, SEAM))
        return zip(grown, item.opacity * np.c_[item.fills, np.ones(len(item.fills))])
    colour = _opaque(item.colour)
    if isinstance(item, Text):
        return ((triangle, colour) for triangle in _placed(item, letters))
    if isinstance(item, Dots):
        return ((centre + item.radius * _CIRCLE, colour) for centre in item.points)
    lines = item.ends if isinstance(item, Strokes) else _dashes(item)
    return ((_stroke(a, b, item.width), colour) for a, b in lines)


def _placed(item: Text, letters: Glyphs) -> np.ndarray:
    """The triangles of a text where it stands; letters have their height, so the size of a font is a little more."""
    parts, length = [np.zeros((0, 3, 2))], 0.0
    for letter in item.text:
        shape, width = letters[letter if letter in letters else UNKNOWN]
        parts.append(shape + np.array([length, 0.0]))
        length += width
    triangles = np.concatenate(parts)
    size = 1.05 * item.size
    shift = {"start": 0.0, "middle": 0.5, "end": 1.0}[item.anchor] * length
    x, y = size * (triangles[..., 0] - shift), -size * triangles[..., 1]
    if item.turned:
        x, y = y, -x
    placed = np.stack([x, y], axis=-1) + np.array(item.at)
    if item.bold:
        return np.concatenate([placed, placed + np.array([0.45, 0.0])])
    return placed


def _stroke(a: np.ndarray, b: np.ndarray, width: float) -> np.ndarray:
    along = (b - a) / max(float(np.linalg.norm(b - a)), 1e-12) * 0.5 * width
    across = np.array([-along[1], along[0]])
    return np.array([a - along + across, a - along - across, b + along - across, b + along + across])


def _dashes(item: Line) -> Iterable[tuple[np.ndarray, np.ndarray]]:
    for a, b in zip(item.points[:-1], item.points[1:]):
        if not item.dash:
            yield a, b
            continue
        count = max(int(np.linalg.norm(b - a) / (2 * item.dash)), 1)
        for k in range(count):
            yield a + (b - a) * k / count, a + (b - a) * (k + 0.5) / count


def _fill(canvas: np.ndarray, points: np.ndarray, colour: np.ndarray) -> None:
    """Paint a convex polygon (n, 2), in pixels of the canvas."""
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

"""Drawings as pixels, for Blender's image editor: shapes are filled by numpy, letters come from Blender's own font."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache

import bpy
import numpy as np

from ...engine.display.drawing import PAPER, SEAM, Dots, Drawing, Item, Line, Shapes, Strokes, Text, rgb

SCALE = 2  # pixels of the picture for one of the drawing
FINE = 2  # smaller ones, both ways, for one of the picture: soft edges

LETTERS = "".join(map(chr, range(32, 127))) + "\N{DEGREE SIGN}\N{PLUS-MINUS SIGN}\N{MULTIPLICATION SIGN}\N{EN DASH}"
UNKNOWN = "?"  # stands for any other
ROW = 2.0  # between two letters' baselines in the sheet that they are read from, in sizes of the font
APART = 8  # spaces between a letter and the mark that tells how far it goes

Glyphs = dict[str, tuple[np.ndarray, float]]


@cache
def glyphs() -> Glyphs:
    """Of every letter its triangles (N, 3, 2) at size 1 and how far it goes; on Blender's main thread.

    All are set as one text, a row each, with a mark behind: making an object for each would hold the window up.
    """
    triangles = _set("\n".join(letter + " " * APART + "|" for letter in ("", *LETTERS)))
    middle = triangles.mean(axis=1)
    row = np.floor((0.75 * ROW - middle[:, 1]) / ROW).astype(int)
    marks = middle[:, 0] > 0.25 * APART  # a space is 0.3 wide, and no letter as wide as seven of them
    ends = np.full(len(LETTERS) + 1, np.inf)
    np.minimum.at(ends, row[marks], triangles[marks][..., 0].min(axis=1))
    found = {}
    for k, letter in enumerate(LETTERS, 1):
        own = triangles[(row == k) & ~marks]
        found[letter] = own + np.array([0.0, ROW * k]), float(ends[k] - ends[0])
    return found


def _set(text: str) -> np.ndarray:
    """(N, 3, 2) triangles of a text in Blender's own font, size 1, the first baseline at y = 0."""
    data = bpy.data.curves.new(".flexmaps text", "FONT")
    obj = bpy.data.objects.new(".flexmaps text", data)
    try:
        data.body, data.size, data.resolution_u, data.space_line = text, 1.0, 3, ROW
        mesh = obj.to_mesh()
        mesh.calc_loop_triangles()
        points, corners = np.empty(3 * len(mesh.vertices)), np.empty(3 * len(mesh.loop_triangles), np.int32)
        mesh.vertices.foreach_get("co", points)
        mesh.loop_triangles.foreach_get("vertices", corners)
        obj.to_mesh_clear()
    finally:
        bpy.data.objects.remove(obj)
        bpy.data.curves.remove(data)
    return points.reshape(-1, 3)[corners.reshape(-1, 3), :2]


def pixels(drawing: Drawing, letters: Glyphs) -> np.ndarray:
    """(rows, columns, 3) sRGB in [0, 1], the uppermost row first; needs no Blender, so any thread can."""
    factor = SCALE * FINE
    size = (round(drawing.height * SCALE) * FINE, round(drawing.width * SCALE) * FINE)
    canvas = np.empty((*size, 3), np.float32)
    canvas[:] = rgb(PAPER)
    for item in drawing.items:
        for points, colour in _polygons(item, letters):
            _fill(canvas, points * factor, colour)
        if isinstance(item, Dots):
            for centre in item.points:
                _disc(canvas, centre * factor, item.radius * factor, rgb(item.colour))
    rows, columns = size[0] // FINE, size[1] // FINE
    return canvas.reshape(rows, FINE, columns, FINE, 3).mean(axis=(1, 3))


def image(name: str, shown: np.ndarray) -> bpy.types.Image:
    """A picture of that name in the file, with these pixels; one that is there is painted over."""
    height, width = shown.shape[:2]
    made = bpy.data.images.get(name)
    if made is None or made.source not in {"GENERATED", "FILE"}:
        made = bpy.data.images.new(name, width, height)
    if tuple(made.size) != (width, height):
        made.scale(width, height)
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = shown[::-1]
    made.pixels.foreach_set(rgba.ravel())
    made.update()
    made.pack()  # or it is lost when the file is saved
    return made


def _polygons(item: Item, letters: Glyphs) -> Iterable[tuple[np.ndarray, np.ndarray]]:
    """Convex polygons (n, 2), pixels of the drawing, with their colours."""
    if isinstance(item, Shapes):
        middle = item.points.mean(axis=1, keepdims=True)
        apart = item.points - middle
        reach = np.linalg.norm(apart, axis=2, keepdims=True)
        return zip(middle + apart * (1.0 + 0.5 * SEAM / np.maximum(reach, SEAM)), item.fills)
    if isinstance(item, Strokes):
        return ((_stroke(a, b, item.width), rgb(item.colour)) for a, b in item.ends)
    if isinstance(item, Line):
        return ((_stroke(a, b, item.width), rgb(item.colour)) for a, b in _dashes(item))
    if isinstance(item, Text):
        return ((triangle, rgb(item.colour)) for triangle in _placed(item, letters))
    return ()


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


def _disc(canvas: np.ndarray, centre: np.ndarray, radius: float, colour: np.ndarray) -> None:
    angle = np.linspace(0.0, 2 * np.pi, 24, endpoint=False)
    _fill(canvas, centre + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1), colour)

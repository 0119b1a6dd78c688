"""Helpers for drawings: letters of Blender's own font as triangles, and images stored in the file from pixels."""

from __future__ import annotations

from functools import cache

import bpy
import numpy as np

from ...engine.arrays import Float
from ...engine.display.raster import Glyphs

# characters that drawings can use
LETTERS = "".join(map(chr, range(32, 127))) + "\N{DEGREE SIGN}\N{PLUS-MINUS SIGN}\N{MULTIPLICATION SIGN}\N{EN DASH}"
# line spacing, in font sizes, of the text that ``glyphs`` makes; has to be large enough that rows do not overlap
LINE_SPACING = 2.0
MARK_SPACES = 8  # spaces between a letter and the mark "|" that measures its advance; together wider than any letter


@cache
def glyphs() -> Glyphs:
    """Return triangles (N, 3, 2) at font size 1 and advance width of every letter; for Blender's main thread only.

    All letters are set as one text, each on a row of its own with a mark at the end, because one object per letter
    would block the window.
    """
    triangles = _text_triangles("\n".join(letter + " " * MARK_SPACES + "|" for letter in ("", *LETTERS)))
    middle = triangles.mean(axis=1)
    row = np.floor((0.75 * LINE_SPACING - middle[:, 1]) / LINE_SPACING).astype(int)
    marks = middle[:, 0] > 0.25 * MARK_SPACES  # a space is about 0.3 wide, and no letter is as wide as seven spaces
    ends = np.full(len(LETTERS) + 1, np.inf)
    np.minimum.at(ends, row[marks], triangles[marks][..., 0].min(axis=1))
    letters = {}
    for k, letter in enumerate(LETTERS, 1):
        own = triangles[(row == k) & ~marks]
        letters[letter] = own + np.array([0.0, LINE_SPACING * k]), float(ends[k] - ends[0])
    return letters


def _text_triangles(text: str) -> np.ndarray:
    """Return triangles (N, 3, 2) of a text in Blender's own font at size 1; the first baseline is at y = 0."""
    data = bpy.data.curves.new(".flexmaps text", "FONT")
    obj = bpy.data.objects.new(".flexmaps text", data)
    try:
        data.body, data.size, data.resolution_u, data.space_line = text, 1.0, 3, LINE_SPACING
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


def store_image(name: str, pixels: Float[np.ndarray, "rows columns 4"]) -> bpy.types.Image:
    """Store pixels as an image in the .blend file; overwrite an existing image of this name.

    Parameters
    ----------
    name : name of the image
    pixels : (rows, columns, 4), from 0 to 1, top row first
    """
    height, width = pixels.shape[:2]
    made = bpy.data.images.get(name)
    if made is None or made.source not in {"GENERATED", "FILE"}:
        made = bpy.data.images.new(name, width, height, alpha=True)
    if tuple(made.size) != (width, height):
        made.scale(width, height)
    made.pixels.foreach_set(pixels[::-1].ravel())
    made.update()
    made.pack()  # unpacked pixels are lost when the file is saved
    return made

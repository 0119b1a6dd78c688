"""What drawings need of Blender: the letters of its own font as triangles, and images of the file that show their pixels."""

from __future__ import annotations

from functools import cache

import bpy
import numpy as np

from ...engine.arrays import Float
from ...engine.display.raster import Glyphs

# the letters that drawings can have
LETTERS = "".join(map(chr, range(32, 127))) + "\N{DEGREE SIGN}\N{PLUS-MINUS SIGN}\N{MULTIPLICATION SIGN}\N{EN DASH}"
ROW = 2.0  # between two letters' baselines in the text that they are read from, in sizes of the font
APART = 8  # spaces between a letter and the mark that tells how far it goes: more than any letter is wide


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


def image(name: str, pixels: Float[np.ndarray, "rows columns 4"]) -> bpy.types.Image:
    """A picture of that name in the file, with these pixels, the uppermost row first; one that is there is painted over."""
    height, width = pixels.shape[:2]
    made = bpy.data.images.get(name)
    if made is None or made.source not in {"GENERATED", "FILE"}:
        made = bpy.data.images.new(name, width, height, alpha=True)
    if tuple(made.size) != (width, height):
        made.scale(width, height)
    made.pixels.foreach_set(pixels[::-1].ravel())
    made.update()
    made.pack()  # or it is lost when the file is saved
    return made

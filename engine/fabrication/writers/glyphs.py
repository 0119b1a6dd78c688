"""Outlines of letters that the standard fonts of PDF readers lack.

Helvetica need not be embedded and has the letters of western Europe. Other letters are drawn from outlines that are
registered in ``outlines_by_run`` beforehand (``bridge/hosts/letters.py`` takes them from Blender's font); letters
without outlines become question marks.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np

from ...arrays import Float


@dataclass(frozen=True, eq=False)
class GlyphOutlines:
    """The outlines of a run of letters at font size 1, which begins at x = 0 on the baseline y = 0.

    width : length of the run
    splines : closed cubic Bezier splines, to be filled by the non-zero rule; a row holds the handle before a node, the
        node, and the handle after it
    """

    width: float
    splines: tuple[Float[np.ndarray, "nodes 3 2"], ...]


outlines_by_run: dict[
    str, GlyphOutlines
] = {}  # outlines by run of letters; filled on the main thread before a job begins, read-only after


@cache  # called for every letter of every page
def is_in_helvetica(text: str) -> bool:
    """Return whether Helvetica has all letters of a text."""
    try:
        text.encode("cp1252")
    except UnicodeEncodeError:
        return False
    return True


def split_runs(text: str) -> Iterator[str]:
    """Split a text into runs of letters that Helvetica has and runs of letters that it lacks."""
    run = ""
    for letter in text:
        if run and is_in_helvetica(letter) != is_in_helvetica(run[-1]):
            yield run
            run = ""
        run += letter
    if run:
        yield run


def glyph_operators(run: GlyphOutlines, x: float, y: float, size: float) -> str:
    """Return the PDF operators that draw the outlines at (x, y), with font size ``size``, all in units of the page."""
    parts = []
    for spline in run.splines:
        nodes = spline * size + [x, y]
        before, point, after = nodes.transpose(1, 0, 2)
        parts.append(f"{point[0, 0]:.5g} {point[0, 1]:.5g} m")
        rows = np.concatenate([after, np.roll(before, -1, axis=0), np.roll(point, -1, axis=0)], axis=1).tolist()
        parts += [f"{a:.6g} {b:.6g} {c:.6g} {d:.6g} {e:.6g} {f:.6g} c" for a, b, c, d, e, f in rows]
    return " ".join(parts)

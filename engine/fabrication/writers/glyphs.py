"""Letters that the fonts of every reader lack, drawn as outlines.

Helvetica, which needs no embedding, has the letters of western Europe. Runs of others are drawn from outlines that whoever has a
font gave before (Blender has one for most scripts, see ``bridge/hosts/letters.py``); without any they become question marks.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np

from ...arrays import Float


@dataclass(frozen=True, eq=False)
class Outlines:
    """A run of letters of size 1, from x = 0 on along y = 0: its length, and closed cubic splines.

    splines : of every node the handle before it, the node and the handle after it; filled by the non-zero rule
    """

    width: float
    splines: tuple[Float[np.ndarray, "nodes 3 2"], ...]


known: dict[str, Outlines] = {}  # by run; filled on the main thread before a job begins, only read afterwards


@cache  # asked of every letter of every page
def plain(text: str) -> bool:
    """Whether Helvetica has all letters of a text."""
    try:
        text.encode("cp1252")
    except UnicodeEncodeError:
        return False
    return True


def runs(text: str) -> Iterator[str]:
    """A text in runs of letters that Helvetica has, and of letters that it lacks."""
    run = ""
    for letter in text:
        if run and plain(letter) != plain(run[-1]):
            yield run
            run = ""
        run += letter
    if run:
        yield run


def path(run: Outlines, x: float, y: float, size: float) -> str:
    """The operators that lay the outlines at (x, y), all in units of the page."""
    parts = []
    for spline in run.splines:
        nodes = spline * size + [x, y]
        before, point, after = nodes.transpose(1, 0, 2)
        parts.append(f"{point[0, 0]:.5g} {point[0, 1]:.5g} m")
        rows = np.concatenate([after, np.roll(before, -1, axis=0), np.roll(point, -1, axis=0)], axis=1).tolist()
        parts += [f"{a:.6g} {b:.6g} {c:.6g} {d:.6g} {e:.6g} {f:.6g} c" for a, b, c, d, e, f in rows]
    return " ".join(parts)

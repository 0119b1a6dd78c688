"""How wide words are in Blender's font, and sentences broken into lines of the sidebar."""

from __future__ import annotations

from functools import lru_cache

import blf
import bpy

# pixels at an interface scale of 1, read off pictures of the sidebar: what tabs, frames and a box take of a line, and the sidebar's
# width where no window tells it
FRAMES, UNKNOWN = 66, 291


def lines(text: str, width: float, most: int) -> list[str]:
    """A sentence in at most so many lines of a width in pixels; a longer word, such as a path, goes on in the next line."""
    found: list[str] = []
    for word in text.split():
        if found and wide(f"{found[-1]} {word}") <= width:
            found[-1] += f" {word}"
            continue
        while len(word) > 1 and wide(word) > width:
            fits = next((k for k in range(len(word) - 1, 1, -1) if wide(word[:k]) <= width), 1)
            found.append(word[:fits])
            word = word[fits:]
        found.append(word)
    if len(found) > most:
        found[most - 1] += "\N{HORIZONTAL ELLIPSIS}"
    return found[:most]


def room(context: bpy.types.Context) -> float:
    """Pixels, at an interface scale of 1, that the sidebar has for the words of one line."""
    region = context.region
    return (UNKNOWN if region is None else region.width / _unit()) - FRAMES


def _unit() -> float:
    return bpy.context.preferences.system.ui_scale or 1.0  # 0 without a window


def wide(text: str) -> float:
    """Pixels, at an interface scale of 1, that some words take in Blender's font."""
    unit = _unit()
    return _measured(text, bpy.context.preferences.ui_styles[0].widget.points * unit) / unit


@lru_cache(4096)
def _measured(text: str, size: float) -> float:
    blf.size(0, size)
    return float(blf.dimensions(0, text)[0])

"""Measure texts in Blender's font, and break sentences into lines that fit the sidebar."""

from __future__ import annotations

from functools import lru_cache

import blf
import bpy

# pixels at an interface scale of 1: width of the sidebar that tabs, frames and box take from a text (read off
# screenshots), and the sidebar's width assumed without a window
FRAME_WIDTH, DEFAULT_WIDTH = 66, 291


def break_lines(text: str, width: float, max_lines: int) -> list[str]:
    """Break a sentence into lines; split words longer than a line, such as paths.

    Parameters
    ----------
    text : the sentence
    width : width of a line in pixels at an interface scale of 1
    max_lines : largest number of lines; the last line ends with an ellipsis if the rest is cut off
    """
    broken: list[str] = []
    for word in text.split():
        if broken and text_width(f"{broken[-1]} {word}") <= width:
            broken[-1] += f" {word}"
            continue
        while len(word) > 1 and text_width(word) > width:
            fits = next((k for k in range(len(word) - 1, 1, -1) if text_width(word[:k]) <= width), 1)
            broken.append(word[:fits])
            word = word[fits:]
        broken.append(word)
    if len(broken) > max_lines:
        broken[max_lines - 1] += "\N{HORIZONTAL ELLIPSIS}"
    return broken[:max_lines]


def line_width(context: bpy.types.Context) -> float:
    """Return the width of a line of text in the sidebar, in pixels at an interface scale of 1."""
    region = context.region
    return (DEFAULT_WIDTH if region is None else region.width / _interface_scale()) - FRAME_WIDTH


def _interface_scale() -> float:
    return bpy.context.preferences.system.ui_scale or 1.0  # 0 without a window


def text_width(text: str) -> float:
    """Return the width of a text in Blender's font, in pixels at an interface scale of 1."""
    unit = _interface_scale()
    return _pixels(text, bpy.context.preferences.ui_styles[0].widget.points * unit) / unit


@lru_cache(4096)
def _pixels(text: str, size: float) -> float:
    blf.size(0, size)
    return float(blf.dimensions(0, text)[0])

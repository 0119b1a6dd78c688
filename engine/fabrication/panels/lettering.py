"""Engraved letters: a small single-stroke font, and text along a line or a curved arm."""

from __future__ import annotations

import numpy as np

from ...arrays import Float

# height of letters along an arm or on a foot, as a share of the arm's or foot's width; larger is
# easier to read and nearer to edges
FILL_SHARE = 0.62
ADVANCE = 0.85  # distance from the start of a letter to the start of the next, as a share of their height; by eye
_SQUEEZE = 0.6  # width of a letter as a share of its height; by eye

# strokes of each letter as points on a 5 x 7 grid: column a to e from the left, row 0 to 6 from the baseline up
_STROKES = {
    "A": "a0c6e0 b2d2", "B": "a0a6d6e5e4d3a3 d3e2e1d0a0", "C": "e5d6b6a5a1b0d0e1", "D": "a0a6c6e4e2c0a0",
    "E": "e0a0a6e6 a3d3", "F": "a0a6e6 a3d3", "G": "e5d6b6a5a1b0d0e1e3c3", "H": "a0a6 e0e6 a3e3",
    "I": "b0d0 c0c6 b6d6", "J": "a1b0d0e1e6", "K": "a0a6 e6a3e0", "L": "a6a0e0", "M": "a0a6c3e6e0", "N": "a0a6e0e6",
    "O": "b0a1a5b6d6e5e1d0b0", "P": "a0a6d6e5e4d3a3", "Q": "b0a1a5b6d6e5e1d0b0 c2e0", "R": "a0a6d6e5e4d3a3 c3e0",
    "S": "a1b0d0e1e2d3b3a4a5b6d6e5", "T": "a6e6 c6c0", "U": "a6a1b0d0e1e6", "V": "a6c0e6", "W": "a6b0c4d0e6",
    "X": "a0e6 a6e0", "Y": "a6c3e6 c3c0", "Z": "a6e6a0e0",
    "0": "b0a1a5b6d6e5e1d0b0 b1d5", "1": "b5c6c0 b0d0", "2": "a5b6d6e5e4a0e0", "3": "a6e6c4d4e3e1d0b0a1",
    "4": "d0d6a2e2", "5": "e6a6a3d3e2e1d0b0a1", "6": "d6b5a3a1b0d0e1e2d3b3a2", "7": "a6e6c0",
    "8": "b3a2a1b0d0e1e2d3b3a4a5b6d6e5e4d3", "9": "b0d1e3e5d6b6a5a4b3d3e4", "-": "b3d3", ".": "c0c1", " ": "",
}  # fmt: skip


def text_strokes(text: str) -> list[Float[np.ndarray, "_ 2"]]:
    """Return the strokes of a text of height 1; it begins at x = 0 on the baseline y = 0.

    Letters missing in the font are left blank.
    """
    found = []
    for place, letter in enumerate(text.upper()):
        for stroke in _STROKES.get(letter, "").split():
            grid = [(ord(column) - ord("a"), int(row)) for column, row in zip(stroke[::2], stroke[1::2])]
            found.append(np.array(grid, dtype=float) * [_SQUEEZE / 4.0, 1.0 / 6.0] + [place * ADVANCE, 0.0])
    return found


def text_length(text: str) -> float:
    """Return the length of a text along its baseline, if its letters have height 1."""
    return ADVANCE * (len(text) - 1) + _SQUEEZE if text else 0.0


def straight_text(
    text: str, height: float, centre: np.ndarray, direction: np.ndarray
) -> list[Float[np.ndarray, "_ 2"]]:
    """Return the strokes of a text of this height (metres), centred on ``centre`` (2,) along ``direction`` (2,).

    Parameters
    ----------
    text : one line
    height : height of the letters, metres
    centre : (2,) centre of the text, metres
    direction : (2,) direction of reading, of any length

    Returns
    -------
    One open polyline per stroke, metres
    """
    along = np.asarray(direction) / np.linalg.norm(direction)
    frame = height * np.array([along, [-along[1], along[0]]])
    return [(s - [0.5 * text_length(text), 0.5]) @ frame + centre for s in text_strokes(text)]


def curved_text(text: str, height: float, line: Float[np.ndarray, "points 2"], middle: float) -> list[np.ndarray]:
    """Return the strokes of a text that follows a polyline through the middle of its letters.

    Parameters
    ----------
    text : one line
    height : height of the letters, metres
    line : points of the polyline, metres
    middle : position of the text's middle, metres along the line

    Returns
    -------
    One open polyline per stroke, metres
    """
    step = np.diff(line, axis=0)
    size = np.linalg.norm(step, axis=1)
    at = np.concatenate([[0.0], np.cumsum(size)])
    found = []
    for s in text_strokes(text):
        x = middle + height * (s[:, 0] - 0.5 * text_length(text))
        cell = np.clip(np.searchsorted(at, x) - 1, 0, len(size) - 1)
        direction = step[cell] / size[cell][:, None]
        foot = line[cell] + (x - at[cell])[:, None] * direction
        found.append(foot + height * (s[:, 1:] - 0.5) * np.stack([-direction[:, 1], direction[:, 0]], axis=1))
    return found

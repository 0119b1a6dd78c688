"""Spirals whose rooms overlap, unwound and made thinner until nothing is in another's way."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from ..arrays import Bool
from ..progress import SILENT, Progress
from .room import Room

# Rounds in which rooms ask for changes, of 19 surfaces' random designs mostly under 10, and all with those in which spirals are just
# unwound and made thinner
ASKED, ROUNDS = 25, 90
SPARE_ROOM = 0.02  # rooms that a closed one asks for, so that few rounds close it again
IDLE = 0.02  # rooms per radian; where all twists together widen a gap by less, arms become thinner
# What one round takes at most: radians of the twist, share of the width
UNWOUND, THINNER = 0.4, 0.1


def opened(
    room: Room,
    low: np.ndarray,
    width: np.ndarray,
    twist: np.ndarray,
    free: Bool[np.ndarray, " quads"],
    progress: Progress = SILENT,
) -> tuple[np.ndarray, np.ndarray]:
    """Widths and twists near those given whose rooms are all open; those given where they are.

    Every closed room asks for the smallest unwinding that opens it, or for thinner arms where nothing is left to unwind, and every
    spiral does what is asked most of it, all four arms alike. What that has not opened in some rounds is unwound and made thinner
    until it is.
    """
    least, quads = np.minimum(low[:, None], width), np.ones(len(twist), dtype=bool)
    for turn in range(ASKED):
        progress(turn / ROUNDS, "room between the arms")
        terms = room.terms(width, twist, below=0.0, quads=quads)
        if not len(terms.value):
            return width, twist
        short = SPARE_ROOM - terms.value
        wound = _falling(terms.by_design[:, width.size :], free & (twist > 0.0))
        idle = wound.power(2).sum(axis=1) < IDLE**2
        unwound = _asked(wound, np.where(idle, 0.0, short))
        thinner = _asked(
            _falling(terms.by_design[:, : width.size], (free[:, None] & (width > least)).ravel()),
            np.where(idle, short, 0.0),
        )
        share = (thinner.reshape(-1, 4) / width).min(axis=1, keepdims=True)
        width = np.maximum((1.0 + np.maximum(share, -THINNER)) * width, least)
        twist = np.maximum(twist + np.maximum(unwound, -UNWOUND), 0.0)
        quads = np.zeros(len(twist), dtype=bool)
        quads[terms.arms // 4] = True
    for turn in range(ASKED, ROUNDS):
        progress(turn / ROUNDS, "room between the arms")
        quads = room.closed(width, twist, quads) & free
        thin = quads & (twist == 0.0)
        width = np.where(thin[:, None], np.maximum((1.0 - THINNER) * width, least), width)
        twist = np.where(quads, np.where(twist < 0.1, 0.0, 0.9 * twist), twist)
        if not quads.any():
            break
    return width, twist


def _falling(slopes: csr_array, free: np.ndarray) -> csr_array:
    """Slopes of rooms by what is free to fall and widens them by that."""
    return csr_array(slopes.minimum(0.0).multiply(free))


def _asked(slopes: csr_array, short: np.ndarray) -> np.ndarray:
    """By how much every parameter has to fall at most, if each room widens by what it is ``short`` of with the smallest change."""
    size = slopes.power(2).sum(axis=1)
    return csr_array(slopes.multiply((short / np.maximum(size, 1e-12))[:, None])).min(axis=0).toarray().ravel()

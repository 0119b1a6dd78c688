"""How a loose panel flies: from the table up in an arc, turning as it goes, and down to where it is joined."""

from __future__ import annotations

import numpy as np

from ..mechanics.vectors import exponential, rotation_vector

WAYPOINTS = 9  # places of the arc between which a panel moves straight; chosen by eye


def flight(
    table: np.ndarray, place: np.ndarray, turn: np.ndarray, size: float, shape: np.ndarray, ground: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Shares of the time (M,) from 0 to 1, turns (M, 3, 3) and places (M, 3) metres of a panel's own frame.

    table : (3,) metres, where it lies at first, its frame parallel to the world's; place : (3,) and turn : (3, 3), where it
    goes; size : metres, of the whole piece; shape : (n, 3) metres, the panel in its own frame. It stays above ``ground``.
    """
    share = np.linspace(0.0, 1.0, WAYPOINTS)
    ease = share * share * (3.0 - 2.0 * share)
    turns = exponential(ease[:, None] * rotation_vector(turn[None])[0])
    arc = table + ease[:, None] * (place - table)
    arc[:, 2] += 0.35 * size * np.sin(np.pi * ease)
    arc[:, 2] = np.maximum(arc[:, 2], ground - lowest(shape, turns))
    return share, turns, arc


def lowest(shape: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """(...) metres: how far a shape (n, 3), turned by each of (..., 3, 3), reaches down from its origin; negative below it."""
    return (turns[..., 2, :] @ shape.T).min(axis=-1)

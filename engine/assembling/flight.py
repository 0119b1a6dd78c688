"""How a loose panel flies: from the table up in an arc, turning as it goes, and down to where it is joined."""

from __future__ import annotations

import numpy as np

from ..arrays import Float
from ..mechanics.vectors import exponential, rotation_vector

WAYPOINTS = 9  # places of the arc between which a panel moves straight; chosen by eye


def flight(
    table: Float[np.ndarray, " 3"], place: Float[np.ndarray, " 3"], turn: Float[np.ndarray, "3 3"],
    size: float, shape: Float[np.ndarray, "vertices 3"], ground: float,
) -> tuple[Float[np.ndarray, " times"], Float[np.ndarray, "times 3 3"], Float[np.ndarray, "times 3"]]:  # fmt: skip
    """Shares of the time from 0 to 1, turns and places, metres, of a panel's own frame.

    table : metres, where it lies at first, its frame parallel to the world's; place and turn : where it
    goes; size : metres, of the whole piece; shape : metres, the panel in its own frame. It stays above ``ground``.
    """
    share = np.linspace(0.0, 1.0, WAYPOINTS)
    ease = share * share * (3.0 - 2.0 * share)
    turns = exponential(ease[:, None] * rotation_vector(turn[None])[0])
    arc = table + ease[:, None] * (place - table)
    arc[:, 2] += 0.35 * size * np.sin(np.pi * ease)
    arc[:, 2] = np.maximum(arc[:, 2], ground - lowest(shape, turns))
    return share, turns, arc


def lowest(shape: Float[np.ndarray, "vertices 3"], turns: Float[np.ndarray, "... 3 3"]) -> np.ndarray:
    """(...) metres: how far a shape, turned by each of the turns, reaches down from its origin; negative below it."""
    return (turns[..., 2, :] @ shape.T).min(axis=-1)

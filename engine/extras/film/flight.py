"""Flight of a loose panel in an arc from the table to the place where it is joined."""

from __future__ import annotations

import numpy as np

from ...arrays import Float
from ...mechanics.vectors import rotation_matrix, rotation_vector

WAYPOINTS = 9  # number of points on the arc, between which the panel moves straight; more: smoother


def flight_path(
    table: Float[np.ndarray, " 3"], place: Float[np.ndarray, " 3"], turn: Float[np.ndarray, "3 3"],
    size: float, shape: Float[np.ndarray, "vertices 3"], ground: float,
) -> tuple[Float[np.ndarray, " times"], Float[np.ndarray, "times 3 3"], Float[np.ndarray, "times 3"]]:  # fmt: skip
    """Return a panel's flight: fractions of the time, 0 to 1, and at each the rotation and position of its frame.

    Parameters
    ----------
    table : initial position of the panel's frame, metres; its axes are parallel to the world's there
    place, turn : final position, metres, and rotation of the frame
    size : size of the whole piece, metres
    shape : vertices of the panel in its own frame, metres
    ground : height above which the panel stays, metres
    """
    share = np.linspace(0.0, 1.0, WAYPOINTS)
    ease = share * share * (3.0 - 2.0 * share)
    turns = rotation_matrix(ease[:, None] * rotation_vector(turn[None])[0])
    arc = table + ease[:, None] * (place - table)
    arc[:, 2] += 0.35 * size * np.sin(np.pi * ease)
    arc[:, 2] = np.maximum(arc[:, 2], ground - lowest_height(shape, turns))
    return share, turns, arc


def lowest_height(shape: Float[np.ndarray, "vertices 3"], turns: Float[np.ndarray, "... 3 3"]) -> np.ndarray:
    """Return the height, metres, of a shape's lowest point above its origin after each rotation; negative if below.

    Parameters
    ----------
    shape : points of the shape, metres
    turns : rotations
    """
    return (turns[..., 2, :] @ shape.T).min(axis=-1)

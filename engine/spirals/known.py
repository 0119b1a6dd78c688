"""How far spirals may be wound for the stiffness table to know them, which bounds every design beside the room of its slots."""

from __future__ import annotations

import math

import numpy as np

from ..arrays import Float

SCALE_RANGE = (5.0, 50.0)  # s/w of the table's nodes
SLOT_SHARE = 0.14  # slot over width at the largest twist of the nodes
TWIST_CAP = math.radians(600.0)  # largest twist of the nodes
CAP_POWER = 8  # how sharply the limit bends into the cap; by eye


def twist_limit(ratio: np.ndarray | float) -> np.ndarray:
    """Largest twist (radians) that the table holds at s/w = ``ratio``: the slot is 0.14 arm widths there.

    Smoothly capped near 600 degrees. The condition on the slot is (pi/4) s / sqrt(1 + twist^2) - w.
    """
    # beyond that no twist is bounded by anything but the cap
    return limit_and_slope(np.minimum(np.asarray(ratio, dtype=float), 1e6))[0]


def limit_and_slope(ratio: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The limit, and its derivative by ln(ratio)."""
    spread = (0.25 * math.pi / (1.0 + SLOT_SHARE) * ratio) ** 2
    cut = np.sqrt(spread - 1.0)
    limit = (cut**-CAP_POWER + TWIST_CAP**-CAP_POWER) ** (-1.0 / CAP_POWER)
    return limit, (limit / cut) ** (CAP_POWER + 1) * spread / cut


def spare_twist(
    radius: Float[np.ndarray, " arms"], width: Float[np.ndarray, " arms"], twist: Float[np.ndarray, " arms"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(A,) radians by which arms are wound less than the table holds, and its derivatives by radius and width.

    radius, width : metres; twist : radians
    """
    ratio = 2.0 * radius / width
    limit, slope = limit_and_slope(np.clip(ratio, *SCALE_RANGE))
    slope = np.where((ratio > SCALE_RANGE[0]) & (ratio < SCALE_RANGE[1]), slope, 0.0)
    return limit - twist, slope / radius, -slope / width

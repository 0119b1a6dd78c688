"""Range of the stiffness table: the largest twist that it covers, which is a limit for every design."""

from __future__ import annotations

import math

import numpy as np

from ...arrays import Float

SCALE_RANGE = (5.0, 50.0)  # range of s/w (spiral diameter over arm width) in the table
SLOT_SHARE = 0.14  # slot width over arm width at the largest twist in the table
TWIST_CAP = math.radians(600.0)  # largest twist in the table at any s/w, radians
CAP_POWER = 8  # sharpness of the transition from the slot's limit to ``TWIST_CAP``, by eye; larger is less smooth


def table_twist_limit(ratio: np.ndarray | float) -> np.ndarray:
    """Return the largest twist (radians) in the table at s/w = ``ratio``, smoothly capped near 600 degrees.

    At the limit the slot, (pi/4) s / sqrt(1 + twist^2) - w, is 0.14 arm widths wide.
    """
    # at larger ratios only TWIST_CAP matters; the bound avoids overflow
    return table_limit_and_slope(np.minimum(np.asarray(ratio, dtype=float), 1e6))[0]


def table_limit_and_slope(ratio: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return ``table_twist_limit`` (radians) and its derivative by ln(ratio); ``ratio`` is s/w."""
    spread = (0.25 * math.pi / (1.0 + SLOT_SHARE) * ratio) ** 2
    cut = np.sqrt(spread - 1.0)
    limit = (cut**-CAP_POWER + TWIST_CAP**-CAP_POWER) ** (-1.0 / CAP_POWER)
    return limit, (limit / cut) ** (CAP_POWER + 1) * spread / cut


def twist_margin(
    radius: Float[np.ndarray, " arms"], width: Float[np.ndarray, " arms"], twist: Float[np.ndarray, " arms"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return how far arms stay below ``table_twist_limit``, and its derivatives with respect to radius and width.

    Parameters
    ----------
    radius : (A,) distance from the quad's centre to the joint, metres
    width : (A,) width of the arm, metres
    twist : (A,) radians

    Returns
    -------
    margin : (A,) radians, negative beyond the limit
    by_radius, by_width : (A,) its derivatives, radians per metre
    """
    ratio = 2.0 * radius / width
    limit, slope = table_limit_and_slope(np.clip(ratio, *SCALE_RANGE))
    slope = np.where((ratio > SCALE_RANGE[0]) & (ratio < SCALE_RANGE[1]), slope, 0.0)
    return limit - twist, slope / radius, -slope / width

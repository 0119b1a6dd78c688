"""Stations on arms: arrays (1 + P, stations, N) of a value and its derivatives by P parameters, for N arms."""

from __future__ import annotations

import numpy as np

from ...arrays import Float
from ...spirals.curves import law


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Multiply two arrays of values with derivatives (product rule)."""
    out = a * b[:1]
    out[1:] += a[:1] * b[1:]
    return out


def sum_products(a: np.ndarray, b: np.ndarray) -> Float[np.ndarray, "numbers n"]:
    """Sum over the stations of the product of two arrays of values with derivatives."""
    out = np.einsum("psn,sn->pn", a, b[0])
    out[1:] += np.einsum("sn,psn->pn", a[0], b[1:])
    return out


def spiral_stations(
    radius: Float[np.ndarray, " n"],
    twist: Float[np.ndarray, " n"],
    t: np.ndarray,
    *,
    by_radius: int | None = None,
    by_twist: int | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return positions on pure spirals at t, seen from the tips, and their derivatives by t, both with derivatives.

    Parameters
    ----------
    radius, twist : metres and radians
    t : (1 + P, stations, 1 or N)
    by_radius, by_twist : rows of the derivatives by radius and twist, if there are any
    """
    place, pace, bend = law.spiral_points(radius, 0.0, twist, t[0])
    places, paces = pace * t, bend * t
    places[0], paces[0] = place - radius, pace
    if by_twist is not None:
        places[by_twist] += 1j * t[0] * place
        paces[by_twist] += 1j * t[0] * pace + 1j * place
    if by_radius is not None:
        places[by_radius] += place / radius - 1.0
        paces[by_radius] += pace / radius
    return places, paces

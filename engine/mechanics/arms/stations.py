"""Values at stations of N arms with derivatives by P parameters: arrays (1 + P, stations, N), the value first."""

from __future__ import annotations

import numpy as np

from ...arrays import Float


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the product of two arrays of values with derivatives, by the product rule."""
    out = a * b[:1]
    out[1:] += a[:1] * b[1:]
    return out


def sum_products(a: np.ndarray, b: np.ndarray) -> Float[np.ndarray, "numbers n"]:
    """Return the product of two arrays of values with derivatives, summed over the stations."""
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
    """Return positions on pure spirals at t, relative to the tips, and their derivatives by t.

    Parameters
    ----------
    radius, twist : metres and radians
    t : (1 + P, stations, 1 or N) with derivatives by P parameters
    by_radius, by_twist : rows of the derivatives by radius and twist, if these are among the parameters

    Returns
    -------
    Two arrays (1 + P, stations, N), complex : metres, with derivatives by the P parameters
    """
    wind = twist * t
    if by_twist is not None:
        wind[by_twist] += t[0]
    turn = radius * np.exp(1j * wind[0])
    place, pace = (1.0 - t[0]) * turn, (1j * twist * (1.0 - t[0]) - 1.0) * turn
    places = np.concatenate([place[None], 1j * place * wind[1:] - turn * t[1:]])
    paces = np.concatenate([pace[None], 1j * pace * wind[1:] - 1j * twist * turn * t[1:]])
    if by_twist is not None:
        paces[by_twist] += 1j * (1.0 - t[0]) * turn
    if by_radius is not None:
        places[by_radius] += place / radius - 1.0
        paces[by_radius] += pace / radius
    places[0] -= radius
    return places, paces

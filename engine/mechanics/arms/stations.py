"""Functions of values at S stations on each of N arms, which carry their derivatives by P parameters with them.

Such an array is (1 + P, S, N): row 0 holds the values, row 1 + p their derivatives by parameter p.
"""

from __future__ import annotations

import numpy as np

from ...arrays import Float


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the products of two arrays of values with derivatives (see the module), with the products' derivatives."""
    out = a * b[:1]
    out[1:] += a[:1] * b[1:]
    return out


def sum_products(a: np.ndarray, b: np.ndarray) -> Float[np.ndarray, "numbers n"]:
    """Return the sums (1 + P, N), over the stations, of the products of two arrays of values with derivatives."""
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
    """Return positions on spirals without blends, relative to the tips, and the derivatives of the positions by t.

    Parameters
    ----------
    radius, twist : of the spirals, metres and radians
    t : (1 + P, S, 1 or N) of the stations, 0 at the tip and 1 at the hub's centre
    by_radius, by_twist : the rows 1 + p of the parameters that are radius and twist, if these are parameters

    Returns
    -------
    (1 + P, S, N) and (1 + P, S, N) : complex, metres
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

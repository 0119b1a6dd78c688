"""Bend point of an arm: the end of the rigid lever that stands for the elastic arm.

An arm turns gradually from hub to tip. If the gap at a joint were measured between rigid levers that reach to the tips
and turn abruptly there, the bending of slender arms would look like a stretch of second order. So let the turn be
spread evenly along the arm. Its centre line is x(u) = R u e^(i twist (1 - u)), with u from 0 at the hub's centre to 1
at the tip, and sigma(u) is the share of its arc length up to u. In the frame half way between both hubs, the second
hub is shifted by

    integral of exp((f - 1/2) turn) dx,   where f is the share of the joint's turn that is reached at x.

Levers that end at ``integral of (1 - 2 share sigma)^2 dx`` give this shift up to the third order. ``share`` is the
arm's part of the joint's turn, 1/2 for equal arms.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Float

POINTS = 24  # Gauss points along an arm: within 2e-14 of the radius up to a twist of 600 degrees; more are slower
_X, _W = np.polynomial.legendre.leggauss(POINTS)


def bend_point(twist: np.ndarray, share: Float[np.ndarray, " arms"] | float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    """Return the bend points of n arms and their derivatives with respect to the twist.

    Parameters
    ----------
    twist : (n,) rad
    share : (n,) in [0, 1], the arm's part of the joint's turn

    Returns
    -------
    (n, 2) and (n, 2) : in units of the arm's radius. Axes: along the radius to the tip, and to the left of it; to the
        right for arms that wind clockwise
    """
    u, w = 0.5 * (_X + 1.0), 0.5 * _W
    phi = np.atleast_1d(np.asarray(twist, dtype=float))[:, None]
    twice = 2.0 * np.broadcast_to(np.atleast_1d(share), phi[:, 0].shape)[:, None]
    length, by_phi = _arc(phi, u)
    whole, whole_by_phi = _arc(phi, np.ones(1))
    sigma = length / whole
    slope = by_phi / whole - sigma * whole_by_phi / whole
    velocity = (1.0 - 1j * phi * u) * np.exp(1j * phi * (1.0 - u))
    turned = 1j * ((1.0 - u) * velocity - u * np.exp(1j * phi * (1.0 - u)))
    rest = 1.0 - twice * sigma
    value = (rest**2 * velocity) @ w
    change = (rest**2 * turned - 2.0 * twice * rest * slope * velocity) @ w
    return np.stack([value.real, value.imag], axis=1), np.stack([change.real, change.imag], axis=1)


def _arc(phi: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the arm's arc length up to u, in units of its radius, and its derivative with respect to the twist."""
    small = phi < 1e-3
    safe = np.where(small, 1.0, phi)
    speed = np.sqrt(1.0 + (safe * u) ** 2)
    turn = np.arcsinh(safe * u) / safe
    length = np.where(small, u + phi**2 * u**3 / 6.0, 0.5 * (u * speed + turn))
    return length, np.where(small, phi * u**3 / 3.0, 0.5 * (u * speed - turn) / safe)

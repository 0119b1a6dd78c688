"""Bend point of an arm: the end of a rigid lever from the hub that stands for the elastic arm.

The two hubs of a joint turn against each other by the joint's turn, and the arms between them bend gradually. If rigid
levers reached from the hubs to the tips, and the gap between the levers' ends were the stretch of the joint, then the
bending of slender arms would look like a stretch of second order. So the levers end at the bend points instead.

Assume that the joint's turn is spread evenly along the arc lengths of both arms. An arm's centre line is
x(u) = R u e^(i twist (1 - u)), with radius R and u from 0 at the hub's centre to 1 at the tip, and sigma(u) is the
share of its arc length up to u. In the frame half way between both hubs, bending shifts the second hub by

    integral over both arms of exp((f - 1/2) turn) dx,   where f is the share of the turn reached at x.

Two levers that end at ``integral of (1 - 2 share sigma)^2 dx`` give this shift up to the third order in the turn.
``share`` is the part of the joint's turn by which this arm bends: 1/2 for two equal arms.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Float

# number of Gauss points along an arm; more are slower. 24 are exact to 2e-14 of the radius up to a twist of 600 degrees
POINTS = 24
_X, _W = np.polynomial.legendre.leggauss(POINTS)


def bend_point(twist: np.ndarray, share: Float[np.ndarray, " arms"] | float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    """Return the bend points of n arms and their derivatives with respect to the twist.

    Parameters
    ----------
    twist : (n,) twist of the arms' spirals, radians
    share : (n,) or a number in [0, 1], the part of the joint's turn by which the arm bends

    Returns
    -------
    (n, 2) and (n, 2) : bend points relative to the hub's centre in units of the arm's radius, and their derivatives.
        Component 0 points from the hub's centre to the tip; component 1 points to the left of it, but for arms that
        wind clockwise to the right
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
    """Return the arm's arc length from the hub's centre to u, and its derivative with respect to the twist.

    phi : twist, radians; u : position on the arm, 1 at the tip. The arc length is in units of the arm's radius.
    """
    small = phi < 1e-3
    safe = np.where(small, 1.0, phi)
    speed = np.sqrt(1.0 + (safe * u) ** 2)
    turn = np.arcsinh(safe * u) / safe
    length = np.where(small, u + phi**2 * u**3 / 6.0, 0.5 * (u * speed + turn))
    return length, np.where(small, phi * u**3 / 3.0, 0.5 * (u * speed - turn) / safe)

"""Bend points of arms: the point up to which an arm's lever counts as rigid.

An arm turns gradually from hub to tip. Measuring a joint's gap as if every arm were rigid up to its tip, and turned
there at once, would mistake the bending of slender arms for a second-order stretch. With the turn spread evenly along
the arm, x(u) = R u e^(i twist (1 - u)) and its arc fraction sigma,

    shift of the second hub = integral of exp((f - 1/2) turn) dx,   f = the share of the turn that is reached there,

seen from the frame half way between both hubs. Levers that end at ``integral of (1 - 2 share sigma)^2 dx`` give the
same shift up to the third order; ``share`` is the arm's part of the joint's turn, 1/2 for equal arms.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Float

POINTS = 24  # Gauss quadrature: within 2e-14 of the radius, up to a twist of 600 degrees
_X, _W = np.polynomial.legendre.leggauss(POINTS)


def bend_point(twist: np.ndarray, share: Float[np.ndarray, " arms"] | float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    """Bend points of n arms, and their derivatives by the twist, both (n, 2), in units of the arm's radius.

    twist : (n,) rad; share : (n,) in [0, 1]. Axes: along the radius to the tip, and to the left of it; for arms that
        wind clockwise, to the right.
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
    """Length of the arm up to u, over its radius, and its derivative by the twist."""
    small = phi < 1e-3
    safe = np.where(small, 1.0, phi)
    speed = np.sqrt(1.0 + (safe * u) ** 2)
    turn = np.arcsinh(safe * u) / safe
    length = np.where(small, u + phi**2 * u**3 / 6.0, 0.5 * (u * speed + turn))
    return length, np.where(small, phi * u**3 / 3.0, 0.5 * (u * speed - turn) / safe)

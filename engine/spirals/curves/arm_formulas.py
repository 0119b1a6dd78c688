"""Formulas of an arm's centre line and width (FlexMaps section 5); t is 0 at the joint and 1 at the quad's centre.

Outside the blend, an arm is an Archimedean spiral of constant width: r = R (1 - t), angle = A + t wind. The blend, over
u = t / share from 0 to 1, adds an offset with a given slope at the joint, and changes the width.
"""

from __future__ import annotations

import numpy as np


def spiral_directions(angle: np.ndarray | float, wind: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return the directions from the centres of spirals to their points at t, as complex unit numbers.

    Parameters
    ----------
    angle, wind, t : as for ``spiral_points``
    """
    return np.exp(1j * (angle + wind * t))


def spiral_points(
    radius: np.ndarray, angle: np.ndarray | float, wind: np.ndarray, t: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the points of Archimedean spirals at t and their first and second derivatives by t, as complex numbers.

    Parameters
    ----------
    radius, angle : distance (metres) and direction (radians) of the joint from the centre
    wind : twist with the sign of the sense of rotation, radians
    t : 0 at the joint, 1 at the centre; all arguments broadcast
    """
    way, rest = spiral_directions(angle, wind, t), radius * (1.0 - t)
    across = rest * wind
    return rest * way, (1j * across - radius) * way, (-wind * across - 2j * (wind * radius)) * way


def blend_quintic(u: np.ndarray, share: np.ndarray | float = 1.0) -> np.ndarray:
    """Return the blend's offset at u: a quintic with slope 1 and no curvature at 0; value, slope, curvature are 0 at 1.

    Parameters
    ----------
    u : place in the blend, 0 at the joint, 1 at its end
    share : length of the blend in t, by which the offset is multiplied
    """
    return share * u * (1.0 + u * u * (-6.0 + u * (8.0 - 3.0 * u)))


def blend_quintic_slope(u: np.ndarray) -> np.ndarray:
    """Return the derivative of the blend's offset (with ``share`` 1) by u."""
    return 1.0 + u * u * (-18.0 + u * (32.0 - 15.0 * u))


def blend_quintic_curvature(u: np.ndarray) -> np.ndarray:
    """Return the second derivative of the blend's offset (with ``share`` 1) by u."""
    return u * (-36.0 + u * (96.0 - 60.0 * u))


def fade_out(u: np.ndarray) -> np.ndarray:
    """Return a quintic that falls from 1 at u = 0 to 0 at u = 1, without slope and curvature at both ends."""
    return 1.0 + u * u * u * (-10.0 + u * (15.0 - 6.0 * u))


def fade_out_slope(u: np.ndarray) -> np.ndarray:
    """Return the derivative of ``fade_out`` by u."""
    rest = u * (1.0 - u)
    return -30.0 * rest * rest

"""Checks of the dimensions and the material of arms, before their stiffness is computed."""

from __future__ import annotations

import math

import numpy as np

from ..errors import FlexMapsError
from ..surface.checking.finding import with_count


def check_dimensions(
    scale: np.ndarray, width: np.ndarray, twist: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Check the dimensions of n arms and return them as arrays of the same shape (n,).

    Parameters
    ----------
    scale, width, twist : numbers or arrays that broadcast with each other

    Raises
    ------
    FlexMapsError : a value is not a number, or a length is not positive; its ``faces`` are the indices of these arms
    """
    scale, width, twist = (np.atleast_1d(np.asarray(v, dtype=float)) for v in (scale, width, twist))
    scale, width, twist = np.broadcast_arrays(scale, width, twist)
    known = np.isfinite(twist) & np.isfinite(scale) & np.isfinite(width) & (scale > 0.0) & (width > 0.0)
    if not known.all():
        raise FlexMapsError(
            f"{with_count(int((~known).sum()), 'arm has', 'arms have')} a length, a width or a twist that is not a number; make the spirals again",
            faces=np.flatnonzero(~known),
        )
    return scale, width, twist


def check_material(thickness: float, youngs: float) -> None:
    """Raise FlexMapsError unless thickness and Young's modulus are positive numbers.

    Parameters
    ----------
    thickness : of the sheet, metres
    youngs : Young's modulus, Pa
    """
    if not (math.isfinite(thickness) and thickness > 0):
        raise FlexMapsError(f"The sheet's thickness is {thickness:g} m; it must be a positive number")
    if not (math.isfinite(youngs) and youngs > 0):
        raise FlexMapsError(f"Young's modulus is {youngs:g} Pa; it must be a positive number")

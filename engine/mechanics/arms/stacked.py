"""Small vectors and matrices of many joints with the joints as the last axis: contiguous, and so several times faster.

Vectors are (3, m), matrices (3, k, m).
"""

from __future__ import annotations

import numpy as np

from ...arrays import Float
from ..vectors import fill_skew

EYE = np.eye(3)[:, :, None]  # the unit matrix of every joint


def joints_last(values: np.ndarray) -> Float[np.ndarray, "... joints"]:
    """(..., m) of an array (m, ...)."""
    return np.ascontiguousarray(np.moveaxis(values, 0, -1))


def joints_first(values: np.ndarray) -> Float[np.ndarray, "joints ..."]:
    """(m, ...) of an array (..., m)."""
    return np.ascontiguousarray(np.moveaxis(values, -1, 0))


def outer(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, None] * b


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a x b; b may be a matrix, of whose columns each is multiplied."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def skew(v: np.ndarray) -> Float[np.ndarray, "3 3 joints"]:
    """(3, 3, m) with skew(v) x = v x x."""
    out = np.zeros((3, *v.shape))
    fill_skew(out, v)
    return out

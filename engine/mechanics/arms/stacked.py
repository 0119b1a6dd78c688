"""Small vectors (3, m) and matrices (3, k, m) of m joints, with the joints as the last axis.

Operations on them are several times faster than with the joints as the first axis.
"""

from __future__ import annotations

import numpy as np

from ...arrays import Float
from ..vectors import fill_skew

EYE = np.eye(3)[:, :, None]  # unit matrix, broadcast over the joints
# number of arms or joints that are computed at a time; larger exceeds the processor's cache, smaller adds overhead
BATCH = 256


def joints_last(values: np.ndarray) -> Float[np.ndarray, "... joints"]:
    """Return an array with the joints moved from the first axis to the last."""
    return np.ascontiguousarray(np.moveaxis(values, 0, -1))


def joints_first(values: np.ndarray) -> Float[np.ndarray, "joints ..."]:
    """Return an array with the joints moved from the last axis to the first."""
    return np.ascontiguousarray(np.moveaxis(values, -1, 0))


def outer(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the outer products (3, 3, m) of vectors (3, m)."""
    return a[:, None] * b


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the dot products (m,) of vectors (3, m)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the cross products a x b of vectors (3, m), or of a with each column of matrices b (3, k, m)."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def skew(v: np.ndarray) -> Float[np.ndarray, "3 3 joints"]:
    """Return the cross-product matrices (3, 3, m) of vectors v (3, m): skew(v) @ x is v cross x."""
    out = np.zeros((3, *v.shape))
    fill_skew(out, v)
    return out

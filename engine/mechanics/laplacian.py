"""Shape error in Laplacian coordinates (FlexMaps section 7, eq. 6): where a surface bends differently, not where it lies."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array

from ..arrays import Float, Int
from .assembly import nearest_rotation


def uniform_laplacian(pairs: Int[np.ndarray, "joints 2"], size: int) -> csr_array:
    """(n, n): every point less the mean of its neighbours. pairs : (m, 2) int, neighbours."""
    both = np.concatenate([pairs, pairs[:, ::-1]])
    count = np.bincount(both[:, 0], minlength=size)
    rows = np.concatenate([both[:, 0], np.arange(size)])
    cols = np.concatenate([both[:, 1], np.arange(size)])
    values = np.concatenate([-1.0 / count[both[:, 0]], np.where(count > 0, 1.0, 0.0)])
    return coo_array((values, (rows, cols)), shape=(size, size)).tocsr()


def laplacian_difference(
    pairs: np.ndarray, centres: Float[np.ndarray, "spirals 3"], target: Float[np.ndarray, "spirals 3"]
) -> Float[np.ndarray, "spirals 3"]:
    """(n, 3) metres: Laplacian coordinates of centres (n, 3), best rotated, less those of the target (n, 3)."""
    operator = uniform_laplacian(pairs, len(centres))
    own, wanted = operator @ centres, operator @ target
    return own @ nearest_rotation(own.T @ wanted).T - wanted


def laplacian_rmse(pairs: np.ndarray, centres: np.ndarray, target: np.ndarray) -> float:
    """Metres: root mean square of the difference."""
    return float(np.sqrt((laplacian_difference(pairs, centres, target) ** 2).sum(axis=1).mean()))

"""Shape error in Laplacian coordinates (FlexMaps section 7, eq. 6): where a surface bends differently, not where it lies."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array

from .assembly import nearest_rotation


def uniform_laplacian(pairs: np.ndarray, size: int) -> csr_array:
    """(n, n): every point less the mean of its neighbours. pairs : (m, 2) int, neighbours."""
    both = np.concatenate([pairs, pairs[:, ::-1]])
    count = np.bincount(both[:, 0], minlength=size)
    rows = np.concatenate([both[:, 0], np.arange(size)])
    cols = np.concatenate([both[:, 1], np.arange(size)])
    values = np.concatenate([-1.0 / count[both[:, 0]], np.where(count > 0, 1.0, 0.0)])
    return coo_array((values, (rows, cols)), shape=(size, size)).tocsr()


def laplacian_rmse(pairs: np.ndarray, centres: np.ndarray, target: np.ndarray) -> float:
    """Metres: root mean square difference of the Laplacian coordinates of (n, 3) centres and target, best rotated."""
    operator = uniform_laplacian(pairs, len(centres))
    own, wanted = operator @ centres, operator @ target
    turned = own @ nearest_rotation(own.T @ wanted).T
    return float(np.sqrt(((turned - wanted) ** 2).sum(axis=1).mean()))

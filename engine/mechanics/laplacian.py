"""Shape error in Laplacian coordinates (FlexMaps section 7, eq. 6): it compares bending, not position."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array

from ..arrays import Float, Int
from .vectors import nearest_rotation


def uniform_laplacian(pairs: Int[np.ndarray, "joints 2"], size: int) -> csr_array:
    """Build the sparse matrix (n, n) that subtracts from every point the mean of its neighbours.

    Parameters
    ----------
    pairs : (m, 2) int, pairs of neighbouring points
    size : n, number of points
    """
    both = np.concatenate([pairs, pairs[:, ::-1]])
    count = np.bincount(both[:, 0], minlength=size)
    rows = np.concatenate([both[:, 0], np.arange(size)])
    cols = np.concatenate([both[:, 1], np.arange(size)])
    values = np.concatenate([-1.0 / count[both[:, 0]], np.where(count > 0, 1.0, 0.0)])
    return coo_array((values, (rows, cols)), shape=(size, size)).tocsr()


def laplacian_difference(
    pairs: np.ndarray, centres: Float[np.ndarray, "spirals 3"], target: Float[np.ndarray, "spirals 3"]
) -> Float[np.ndarray, "spirals 3"]:
    """Return the Laplacian coordinates of the centres, rotated to fit best, minus the target's Laplacian coordinates.

    Parameters
    ----------
    pairs : (m, 2) int, pairs of neighbouring points
    centres, target : (n, 3) metres

    Returns
    -------
    (n, 3) metres
    """
    operator = uniform_laplacian(pairs, len(centres))
    own, wanted = operator @ centres, operator @ target
    return own @ nearest_rotation(own.T @ wanted).T - wanted


def laplacian_rmse(pairs: np.ndarray, centres: np.ndarray, target: np.ndarray) -> float:
    """Return the root mean square of ``laplacian_difference``, metres.

    Parameters
    ----------
    pairs, centres, target : as in ``laplacian_difference``
    """
    return float(np.sqrt((laplacian_difference(pairs, centres, target) ** 2).sum(axis=1).mean()))

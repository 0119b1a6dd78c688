"""Difference of two shapes in Laplacian coordinates (FlexMaps section 7, eq. 6): how bent they are, not where."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array

from ..arrays import Float, Int
from .vectors import nearest_rotation


def uniform_laplacian(pairs: Int[np.ndarray, "joints 2"], size: int) -> csr_array:
    """Build the sparse matrix (n, n) that subtracts from every point the mean of its neighbours.

    Parameters
    ----------
    pairs : (m, 2) indices of neighbouring points
    size : number n of points
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
    """Return the difference (n, 3) of the Laplacian coordinates of two sets of points, metres.

    The Laplacian coordinates of a point are the point minus the mean of its neighbours. Those of ``centres`` are
    rotated to fit those of ``target`` best before these are subtracted.

    Parameters
    ----------
    pairs : (m, 2) indices of neighbouring points
    centres, target : (n, 3) points, metres
    """
    operator = uniform_laplacian(pairs, len(centres))
    own, wanted = operator @ centres, operator @ target
    return own @ nearest_rotation(own.T @ wanted).T - wanted


def laplacian_rmse(pairs: np.ndarray, centres: np.ndarray, target: np.ndarray) -> float:
    """Return the root mean square length of the vectors of ``laplacian_difference``, metres.

    Parameters
    ----------
    pairs, centres, target : as in ``laplacian_difference``
    """
    return float(np.sqrt((laplacian_difference(pairs, centres, target) ** 2).sum(axis=1).mean()))

"""Products and rotations of arrays of small vectors and matrices, with the components as the last axes.

``arms/stacked.py`` holds such products for arrays with the components as the first axes.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ..arrays import Float


def matvec(matrix: Float[np.ndarray, "... i j"], vector: Float[np.ndarray, "... j"]) -> Float[np.ndarray, "... i"]:
    """Return the products (..., i) of matrices and vectors.

    Parameters
    ----------
    matrix, vector : (..., i, j) and (..., j)
    """
    return (matrix @ vector[..., None])[..., 0]


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the dot products (...) of vectors.

    Parameters
    ----------
    a, b : (..., i) vectors
    """
    return np.einsum("...i,...i->...", a, b)


def to_space(flat: np.ndarray) -> Float[np.ndarray, "... 3"]:
    """Convert complex numbers x + iy (...) to vectors (x, y, 0) (..., 3)."""
    return np.stack([flat.real, flat.imag, np.zeros(flat.shape)], axis=-1)


def outer(a: Float[np.ndarray, "... i"], b: Float[np.ndarray, "... j"]) -> Float[np.ndarray, "... i j"]:
    """Return the outer products (..., i, j) of vectors.

    Parameters
    ----------
    a, b : (..., i) and (..., j) vectors
    """
    return a[..., :, None] * b[..., None, :]


def skew(v: np.ndarray) -> Float[np.ndarray, "... 3 3"]:
    """Return the cross-product matrices (..., 3, 3) of vectors v (..., 3): skew(v) @ x is v cross x."""
    out = np.zeros((*v.shape, 3))
    fill_skew(np.moveaxis(out, (-2, -1), (0, 1)), np.moveaxis(v, -1, 0))
    return out


def fill_skew(out: np.ndarray, v: np.ndarray) -> None:
    """Write the cross-product matrices of vectors into an array of zeros.

    Parameters
    ----------
    out : (3, 3, ...) zeros, which become the matrices
    v : (3, ...) vectors
    """
    out[0, 1], out[0, 2], out[1, 2] = -v[2], v[1], -v[0]
    out[1, 0], out[2, 0], out[2, 1] = v[2], -v[1], v[0]


def rotation_vector(matrix: np.ndarray) -> Float[np.ndarray, "joints 3"]:
    """Return the rotation vectors (m, 3), radians, of rotation matrices (m, 3, 3).

    This is several times faster than scipy's function, which is used only for angles near a half turn.
    """
    double = np.stack(
        [matrix[:, 2, 1] - matrix[:, 1, 2], matrix[:, 0, 2] - matrix[:, 2, 0], matrix[:, 1, 0] - matrix[:, 0, 1]], 1
    )
    sine, cosine = 0.5 * np.linalg.norm(double, axis=1), 0.5 * (np.einsum("mii->m", matrix) - 1.0)
    angle = np.arctan2(sine, cosine)
    out = double * (0.5 * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-300), 1.0))[:, None]
    far = cosine < -0.9
    if far.any():
        out[far] = Rotation.from_matrix(matrix[far]).as_rotvec()
    return out


def rotation_matrix(turn: np.ndarray) -> Float[np.ndarray, "... 3 3"]:
    """Return the rotation matrices (..., 3, 3) of rotation vectors (..., 3), radians (Rodrigues' formula)."""
    square = (turn * turn).sum(axis=-1)
    angle = np.sqrt(square)
    sine = np.sinc(angle / np.pi)
    cosine = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    out = turn[..., :, None] * (cosine[..., None] * turn)[..., None, :]
    x, y, z = np.moveaxis(sine[..., None] * turn, -1, 0)
    out[..., 0, 1] -= z
    out[..., 1, 0] += z
    out[..., 0, 2] += y
    out[..., 2, 0] -= y
    out[..., 1, 2] -= x
    out[..., 2, 1] += x
    out[..., range(3), range(3)] += (1.0 - cosine * square)[..., None]
    return out


def right_jacobian(turn: np.ndarray) -> Float[np.ndarray, "... 3 3"]:
    """Return the right Jacobians J (..., 3, 3) of rotation vectors (..., 3), radians.

    To first order in d, exp(turn + d) = exp(turn) exp(J d) = exp(J^T d) exp(turn).
    """
    angle = np.linalg.norm(turn, axis=-1)[..., None, None]
    across = skew(turn)
    small = angle < 1e-3
    safe = np.where(small, 1.0, angle)
    once = np.where(small, 0.5 - angle**2 / 24.0, (1.0 - np.cos(safe)) / safe**2)
    twice = np.where(small, 1.0 / 6.0 - angle**2 / 120.0, (safe - np.sin(safe)) / safe**3)
    return np.eye(3) - once * across + twice * (across @ across)


def nearest_rotation(covariance: np.ndarray) -> Float[np.ndarray, "... 3 3"]:
    """Return the rotations R (..., 3, 3) that fit points p to points q best, in least squares (Kabsch).

    covariance : (..., 3, 3) sum of p q^T over the points
    """
    u, _, vt = np.linalg.svd(covariance)
    flip = np.linalg.det(u) * np.linalg.det(vt)
    u = u.copy()
    u[..., :, 2] *= flip[..., None]
    return np.swapaxes(u @ vt, -1, -2)

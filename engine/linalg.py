"""One way to solve sparse symmetric positive definite systems: CHOLMOD through cvxopt, SuperLU where it is missing.

The pattern of a system is analysed once and its values are factored again and again, which is what every Newton
iteration of this program does.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from .arrays import Int, Num


class NotPositiveDefinite(ArithmeticError):
    """The matrix has no Cholesky factor; Newton's method has to change its step."""


class Pattern:
    """Where a symmetric matrix has entries: its lower triangle in compressed columns, every diagonal entry included.

    size : number of rows
    indptr : (size + 1,) int, start of every column
    indices : (nnz,) int, row of every entry, ascending within a column
    slot : (T,) int, the entry that each of the T triplets given to the constructor adds to; triplets above the
        diagonal point to the extra slot ``nnz`` and are dropped
    """

    def __init__(self, rows: Int[np.ndarray, " _"], cols: Int[np.ndarray, " _"], size: int):
        """rows, cols : (T,) int, both triangles of the symmetric matrix or the lower one alone, repeats allowed."""
        rows, cols = np.asarray(rows, dtype=np.int64).ravel(), np.asarray(cols, dtype=np.int64).ravel()
        lower = rows >= cols
        key = cols[lower] * size + rows[lower]
        diagonal = np.arange(size, dtype=np.int64) * (size + 1)
        keys, inverse = np.unique(np.concatenate([key, diagonal]), return_inverse=True)
        self.size = int(size)
        self.indices = keys % size
        self.indptr = np.searchsorted(keys, np.arange(size + 1, dtype=np.int64) * size)
        self.slot = np.full(len(rows), len(keys), dtype=np.int64)
        self.slot[lower] = inverse[: len(key)]

    @property
    def nnz(self) -> int:
        """Number of entries of the lower triangle."""
        return len(self.indices)

    @property
    def columns(self) -> Num[np.ndarray, " nnz"]:
        """(nnz,) int: the column of every entry."""
        return np.repeat(np.arange(self.size), np.diff(self.indptr))

    def sum(self, values: np.ndarray) -> Num[np.ndarray, " nnz"]:
        """(nnz,) the entries of the lower triangle from the (T,) values of the constructor's triplets."""
        return np.bincount(self.slot, weights=np.ravel(values), minlength=self.nnz + 1)[: self.nnz]

    def matrix(self, values: np.ndarray) -> csc_array:
        """The full symmetric matrix of (nnz,) lower-triangle values."""
        lower = csc_array((values, self.indices, self.indptr), shape=(self.size, self.size))
        upper = lower.T.tocsc()
        upper.setdiag(0.0)
        return (lower + upper).tocsc()


class SparseCholesky:
    """Cholesky factors of matrices that share one pattern.

    ``backend`` is "cvxopt", "superlu" or None for the first that is there.
    """

    def __init__(self, pattern: Pattern, backend: str | None = None):
        self.pattern = pattern
        self.backend = backend or _first_backend()
        self._factor: Any = None
        if self.backend == "cvxopt":
            from cvxopt import cholmod, spmatrix

            self._matrix = spmatrix(1.0, pattern.indices, pattern.columns, (pattern.size, pattern.size))
            self._factor = cholmod.symbolic(self._matrix, uplo="L")
        elif self.backend != "superlu":
            raise ValueError(f"unknown backend '{self.backend}'")

    def factor(self, values: np.ndarray) -> None:
        """Factor the matrix with (nnz,) lower-triangle values; raises NotPositiveDefinite, also for NaN."""
        if not np.isfinite(values).all():
            raise NotPositiveDefinite("the matrix holds values that are not finite")
        if not self.pattern.size:
            return
        if self.backend == "cvxopt":
            from cvxopt import cholmod, matrix

            self._matrix.V = matrix(np.ascontiguousarray(values, dtype=float))
            try:
                cholmod.numeric(self._matrix, self._factor)
            except ArithmeticError as error:
                raise NotPositiveDefinite(str(error)) from None
            return
        self._factor = _symmetric_lu(self.pattern, values)
        if not (self._factor.U.diagonal() > 0).all() or (self._factor.perm_r != self._factor.perm_c).any():
            raise NotPositiveDefinite("an eigenvalue is not positive")

    def attempt(self, values: np.ndarray) -> bool:
        """Factor; False where the matrix is not positive definite."""
        try:
            self.factor(values)
        except NotPositiveDefinite:
            return False
        return True

    def solve(self, rhs: np.ndarray) -> np.ndarray:
        """Solve for a (size,) or (size, k) right-hand side with the last factor; a new array of the same shape."""
        rhs = np.asarray(rhs, dtype=float)
        if not self.pattern.size:
            return rhs.copy()
        if self.backend == "cvxopt":
            from cvxopt import cholmod, matrix

            columns = rhs.reshape(self.pattern.size, -1)
            dense = matrix(np.asfortranarray(columns))
            cholmod.solve(self._factor, dense)
            return np.array(dense).reshape(rhs.shape)
        return self._factor.solve(rhs)


class SparseLU:
    """Factors of a square matrix whose pattern is symmetric, whatever the signs of its eigenvalues and with values of its own on
    both sides of the diagonal; raises NotPositiveDefinite where a pivot is zero.
    """

    def __init__(self, matrix: csc_array):
        self._factor = _unpivoted(matrix)

    @property
    def negative(self) -> int:
        """Number of negative pivots: of a symmetric matrix that of its negative eigenvalues (Sylvester); else the sign of the
        determinant is that of its parity.
        """
        return int((self._factor.U.diagonal() < 0).sum())

    def solve(self, rhs: np.ndarray) -> np.ndarray:
        """Solve for a (size,) or (size, k) right-hand side."""
        return self._factor.solve(np.asarray(rhs, dtype=float))


def negative_eigenvalues(pattern: Pattern, values: np.ndarray) -> int:
    """How many eigenvalues of the matrix with these (nnz,) values are negative: the signs of its pivots (Sylvester).

    Raises NotPositiveDefinite where a pivot is zero.
    """
    return int((_symmetric_lu(pattern, values).U.diagonal() < 0).sum())


def _symmetric_lu(pattern: Pattern, values: np.ndarray) -> Any:
    """LU factors without pivoting: the signs of U's diagonal are the signs of the eigenvalues (Sylvester)."""
    return _unpivoted(pattern.matrix(values))


def _unpivoted(matrix: csc_array) -> Any:
    try:
        return splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    except RuntimeError as error:
        raise NotPositiveDefinite(str(error)) from None


def _first_backend() -> str:
    try:
        import cvxopt.cholmod  # noqa: F401
    except ImportError:
        return "superlu"
    return "cvxopt"

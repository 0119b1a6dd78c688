"""Sparse symmetric positive definite solver: CHOLMOD through cvxopt, or SuperLU if cvxopt is missing.

The sparsity pattern is analysed once. Then many matrices with this pattern are factorised, as in Newton's method. A
matrix is given by the nnz entries of its lower triangle, in the order of the pattern.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from .arrays import Int, Num


class NotPositiveDefinite(ArithmeticError):
    """The matrix has no Cholesky factor; Newton's method must modify its Hessian."""


class SparsityPattern:
    """Sparsity pattern of a symmetric matrix: its lower triangle in compressed columns, with all diagonal entries.

    size : number of rows
    indptr : (size + 1,) index of the first entry of every column
    indices : (nnz,) row of every entry, ascending within a column
    slot : (T,) index of the entry to which each of the constructor's T triplets adds; nnz for triplets above the
        diagonal, which are dropped
    """

    def __init__(self, rows: Int[np.ndarray, " _"], cols: Int[np.ndarray, " _"], size: int):
        """Build the pattern from triplets (row, column, value), without their values.

        Parameters
        ----------
        rows, cols : (T,) rows and columns of entries in both triangles or in the lower triangle only; they may repeat
        size : number of rows of the matrix
        """
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
        """Column (nnz,) of every entry."""
        return np.repeat(np.arange(self.size), np.diff(self.indptr))

    def sum(self, values: np.ndarray) -> Num[np.ndarray, " nnz"]:
        """Return the entries (nnz,) of the lower triangle: the sums of the triplets' ``values`` (T,)."""
        return np.bincount(self.slot, weights=np.ravel(values), minlength=self.nnz + 1)[: self.nnz]

    def matrix(self, values: np.ndarray) -> csc_array:
        """Return the whole symmetric matrix whose lower triangle has the entries ``values`` (nnz,)."""
        lower = csc_array((values, self.indices, self.indptr), shape=(self.size, self.size))
        upper = lower.T.tocsc()
        upper.setdiag(0.0)
        return (lower + upper).tocsc()


class SparseCholesky:
    """Cholesky factorisation of matrices that share a sparsity pattern.

    Parameters
    ----------
    pattern : sparsity pattern of the matrices
    backend : "cvxopt" or "superlu"; default cvxopt if it is installed, else SuperLU
    """

    def __init__(self, pattern: SparsityPattern, backend: str | None = None):
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
        """Factorise the matrix whose lower triangle has the entries ``values`` (nnz,).

        Raises ``NotPositiveDefinite`` if it has no Cholesky factor, also if an entry is infinite or NaN.
        """
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
        """Factorise a matrix like ``factor``, but return False instead of raising ``NotPositiveDefinite``."""
        try:
            self.factor(values)
        except NotPositiveDefinite:
            return False
        return True

    def solve(self, rhs: np.ndarray) -> np.ndarray:
        """Solve with the last factorised matrix; ``rhs`` and the result have the shape (size,) or (size, k)."""
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
    """LU factorisation, without pivoting, of a square matrix with a symmetric sparsity pattern.

    The matrix may be unsymmetric and indefinite. Raises ``NotPositiveDefinite`` if a pivot is zero.
    """

    def __init__(self, matrix: csc_array):
        self._factor = _lu_without_pivoting(matrix)

    @property
    def negative(self) -> int:
        """Number of negative pivots.

        For a symmetric matrix it equals the number of negative eigenvalues (Sylvester's law of inertia). For any matrix
        it is even if the determinant is positive, and odd if the determinant is negative.
        """
        return int((self._factor.U.diagonal() < 0).sum())

    def solve(self, rhs: np.ndarray) -> np.ndarray:
        """Solve for the right-hand side ``rhs``; it and the result have the shape (size,) or (size, k)."""
        return self._factor.solve(np.asarray(rhs, dtype=float))


def negative_eigenvalues(pattern: SparsityPattern, values: np.ndarray) -> int:
    """Count the negative eigenvalues of a symmetric matrix from the signs of its pivots (Sylvester's law of inertia).

    Parameters
    ----------
    pattern : sparsity pattern of the matrix
    values : (nnz,) entries of its lower triangle

    Raises
    ------
    NotPositiveDefinite : a pivot is zero
    """
    return int((_symmetric_lu(pattern, values).U.diagonal() < 0).sum())


def _symmetric_lu(pattern: SparsityPattern, values: np.ndarray) -> Any:
    """Return the LU factors of a symmetric matrix without pivoting.

    U has as many negative diagonal entries as the matrix has negative eigenvalues.
    """
    return _lu_without_pivoting(pattern.matrix(values))


def _lu_without_pivoting(matrix: csc_array) -> Any:
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
